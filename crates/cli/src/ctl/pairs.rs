//! Arguments that hold several values: NAME=VALUE, SECONDS:VOLTS.

use serde_json::{Map, Number, Value};

use super::usage;
use crate::Failure;
use crate::arguments::decimal;

/// Names that stand outside of what is named here.
const TAKEN: [&str; 4] = ["do", "id", "encoder", "segment"];

/// What goes wrong by chance: `off`, or values with names.
pub(super) fn noise(values: &[String]) -> Result<Value, Failure> {
    let example = "write for example seed=7 lost_replies=0.01, or off";
    if values == ["off"] {
        return Ok(Value::Null);
    }
    let mut fields = Map::new();
    for (name, value) in named(values, example)? {
        fields.insert(name.to_owned(), number(name, value, example)?.into());
    }
    Ok(fields.into())
}

/// The machine of a shaft: `off`, or values with names; those of a drum go into it.
pub(super) fn machine(values: &[String]) -> Result<Value, Failure> {
    const OF_A_DRUM: [&str; 5] =
        ["drum_diameter", "rope_diameter", "turns_per_layer", "wound_turns", "lines"];
    let example = "write for example unit=m per_turn=0.5, or off";
    if values == ["off"] {
        return Ok(Value::Null);
    }
    let (mut machine, mut drum) = (Map::new(), Map::new());
    for (name, value) in named(values, example)? {
        let is_text = name == "unit";
        let value = if is_text { Value::from(value) } else { number(name, value, example)?.into() };
        let place = if OF_A_DRUM.contains(&name) { &mut drum } else { &mut machine };
        place.insert(name.to_owned(), value);
    }
    if !drum.is_empty() {
        machine.insert("drum".to_owned(), drum.into());
    }
    Ok(machine.into())
}

/// How many writes the memory takes; `null` for any number.
pub(super) fn writes(text: &str) -> Result<Value, Failure> {
    if text == "any" {
        return Ok(Value::Null);
    }
    let writes = text.parse::<u64>().map(Value::from);
    writes.map_err(|_| {
        usage(format!("endurance: {text:?} is no number of writes; write one like 100000, or any"))
    })
}

/// A supply voltage over time.
pub(super) fn points(points: &[String]) -> Result<Value, Failure> {
    let read = points.iter().map(|point| {
        let (seconds, volts) = point.split_once(':')?;
        Some(Value::from(vec![decimal(seconds).ok()?, decimal(volts).ok()?]))
    });
    points
        .iter()
        .zip(read)
        .map(|(point, read)| {
            read.ok_or_else(|| {
                usage(format!(
                    "supply-profile: {point:?} is no SECONDS:VOLTS; write for example 0:24 2:24 2:5 2.5:24"
                ))
            })
        })
        .collect()
}

/// Names and values, each name once.
fn named<'a>(values: &'a [String], example: &str) -> Result<Vec<(&'a str, &'a str)>, Failure> {
    let mut found: Vec<(&str, &str)> = Vec::new();
    for text in values {
        let (name, value) =
            text.split_once('=').ok_or_else(|| usage(format!("{text:?} is no NAME=VALUE; {example}")))?;
        if TAKEN.contains(&name) || found.iter().any(|(other, _)| *other == name) {
            return Err(usage(format!("{text:?}: {name} cannot be given here, or not twice; {example}")));
        }
        found.push((name, value));
    }
    Ok(found)
}

fn number(name: &str, value: &str, example: &str) -> Result<Number, Failure> {
    let text = format!("{name}={value}");
    value.parse().map_err(|_| usage(format!("{text:?}: the value is no number; {example}")))
}
