//! Movements as users write them: in fields, for JSON and TOML, and as text with the same names.
//!
//! ```text
//! KIND[:NAME=VALUE[:NAME=VALUE...]][@RAW]
//! ```

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::ShaftError;
use crate::control::Which;

/// The movement of a shaft in fields. Which of them a kind takes, and which it needs, is looked at when
/// the shaft is made; units are turns, or those of the machine where its fields are there.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShaftFields {
    /// Which movement.
    pub kind: ShaftKind,
    /// Revolutions per minute, positive clockwise (`constant`); the highest either way (`walk`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rpm: Option<f64>,
    /// The physical position in counts at which it begins; left out: where the shaft is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub raw: Option<i64>,
    /// `ramp`: the speed at its start; 0 if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from_rpm: Option<f64>,
    /// `ramp`: the speed at its end, and from then on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to_rpm: Option<f64>,
    /// `ramp`: how many seconds it takes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub over_s: Option<f64>,
    /// `sine`: units to each side.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub amplitude: Option<f64>,
    /// `sine`: seconds for once to and fro.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub period_s: Option<f64>,
    /// `move`, `hoist`, `trip`: units to go, the sign is the direction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by: Option<f64>,
    /// `move`, `hoist`, `trip`: units a second at most.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed: Option<f64>,
    /// `hoist`, `trip`: the same for the way back; `speed` if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub back_speed: Option<f64>,
    /// `move`, `hoist`, `trip`: units per second squared at most.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub acceleration: Option<f64>,
    /// `move`, `hoist`, `trip`: units per second cubed at most; left out: no limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jerk: Option<f64>,
    /// Seconds to stand: before a `move`, at both ends of a `hoist` or a `trip`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pause_s: Option<f64>,
    /// `walk`: after so many seconds another speed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub every_s: Option<f64>,
    /// `walk`: where chance begins.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// `walk`: turns from the start at most.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within: Option<f64>,
    /// `playback`: a CSV or Parquet file with columns of seconds and of units.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// `playback`: from its end on again from its start.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub repeat: Option<bool>,
    /// `coupled`: the encoder whose shaft drives this one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to: Option<Which>,
    /// `coupled`: turns of this shaft for one of the other; negative turns the other way round.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ratio: Option<Ratio>,
    /// The unit of the machine, such as `m`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Units of the machine for one turn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub per_turn: Option<f64>,
    /// A drum with rope in layers instead of `per_turn`: see [`Drum`](crate::machine::Drum).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drum_diameter: Option<f64>,
    /// Of the rope on the drum.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rope_diameter: Option<f64>,
    /// Turns of rope side by side on the drum.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turns_per_layer: Option<f64>,
    /// Turns on the drum at the start; 0 if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wound_turns: Option<f64>,
    /// Lines between the blocks; 1 if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lines: Option<f64>,
    /// Play between machine and encoder, in degrees of its shaft.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub backlash_deg: Option<f64>,
    /// A shaking on top, in degrees of the encoder's shaft to each side.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vibration_deg: Option<f64>,
    /// How often it shakes in a second.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vibration_hz: Option<f64>,
}

/// The kinds of movement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ShaftKind {
    /// It stands still.
    #[default]
    Still,
    /// It turns at constant speed.
    Constant,
    /// From one speed to another, and on at that.
    Ramp,
    /// To and fro.
    Sine,
    /// By a distance, with limits of speed, acceleration and jerk.
    Move,
    /// Up, stand, down, stand, and so on.
    Hoist,
    /// The same with a drum of rope in layers, as the draw-works of a rig move its block.
    Trip,
    /// At speeds by chance.
    Walk,
    /// As a file says.
    Playback,
    /// As another encoder's shaft, through a gear.
    Coupled,
}

/// A gear ratio.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "a ratio is a number like 2.5, or a text like \"3/2\"")]
pub enum Ratio {
    /// Kept to a millionth.
    Number(f64),
    /// A fraction of two whole numbers, exactly.
    Fraction(String),
}

/// What a kind takes beside what all take, an example, and whether units of the machine make sense.
pub(super) struct Form {
    pub(super) takes: &'static [&'static str],
    pub(super) example: &'static str,
    pub(super) units: bool,
}

/// What all kinds but `still` take.
const ALL: [&str; 5] = ["kind", "raw", "backlash_deg", "vibration_deg", "vibration_hz"];
const MACHINE: [&str; 7] =
    ["unit", "per_turn", "drum_diameter", "rope_diameter", "turns_per_layer", "wound_turns", "lines"];
const CYCLE: &[&str] = &["by", "speed", "back_speed", "acceleration", "jerk", "pause_s"];

impl ShaftKind {
    pub(super) const fn form(self) -> Form {
        let (takes, example, units): (&[&str], _, _) = match self {
            Self::Still => (&[], "still@1000", false),
            Self::Constant => (&["rpm"], "constant:60", false),
            Self::Ramp => (&["from_rpm", "to_rpm", "over_s"], "ramp:to_rpm=60:over_s=10", false),
            Self::Sine => (&["amplitude", "period_s"], "sine:amplitude=2:period_s=30", true),
            Self::Move => (
                &["by", "speed", "acceleration", "jerk", "pause_s"],
                "move:by=10:speed=2:acceleration=1:jerk=1",
                true,
            ),
            Self::Hoist => {
                (CYCLE, "hoist:by=3.2:speed=0.8:acceleration=0.4:jerk=1:pause_s=2:unit=m:per_turn=0.5", true)
            }
            Self::Trip => (
                CYCLE,
                "trip:by=28:speed=1.5:acceleration=0.5:jerk=0.5:pause_s=20:drum_diameter=0.76:\
                 rope_diameter=0.035:turns_per_layer=37:wound_turns=40:lines=10",
                true,
            ),
            Self::Walk => {
                (&["rpm", "every_s", "seed", "within"], "walk:rpm=30:every_s=0.5:seed=7:within=10", false)
            }
            Self::Playback => (&["file", "repeat"], "playback:unit=m:per_turn=0.5:file=trip.csv", true),
            Self::Coupled => (&["to", "ratio"], "coupled:to=1:ratio=3/2", false),
        };
        Form { takes, example, units }
    }
}

impl ShaftFields {
    /// Reads the text form.
    ///
    /// # Errors
    ///
    /// What is wrong, and what to write instead.
    pub fn parse(text: &str) -> Result<Self, ShaftError> {
        let (kind, rest) = text.split_at(text.find([':', '@']).unwrap_or(text.len()));
        let kind: ShaftKind = serde_json::from_value(Value::from(kind))
            .map_err(|_| ShaftError::Form(text.chars().take(80).collect()))?;
        let (rest, raw) = match rest.rsplit_once('@') {
            // A file's name may have one.
            Some(_) if kind == ShaftKind::Playback => (rest, None),
            Some((rest, raw)) => (rest, Some(raw)),
            None => (rest, None),
        };
        let mut fields = Map::new();
        fields.insert("kind".to_owned(), serde_json::to_value(kind).unwrap_or_default());
        if let Some(raw) = raw {
            let raw = raw.parse::<i64>().map_err(|_| ShaftError::Raw(raw.to_owned()))?;
            fields.insert("raw".to_owned(), raw.into());
        }
        let rest = rest.strip_prefix(':').unwrap_or(rest);
        read_pairs(kind, rest, &mut fields)?;
        serde_json::from_value(Value::Object(fields)).map_err(|error| kind.wrong(&error.to_string()))
    }

    /// Refuses fields that the kind does not take.
    pub(super) fn check_names(&self) -> Result<(), ShaftError> {
        let Form { takes, units, .. } = self.kind.form();
        let Ok(Value::Object(fields)) = serde_json::to_value(self) else {
            return Ok(());
        };
        let known =
            |name: &&str| takes.contains(name) || ALL.contains(name) || units && MACHINE.contains(name);
        match fields.keys().map(String::as_str).find(|name| !known(name)) {
            Some(name) => Err(self.kind.wrong(&format!("it takes no {name}"))),
            None => Ok(()),
        }
    }
}

impl ShaftKind {
    /// How it is called.
    pub fn name(self) -> String {
        serde_json::to_value(self).ok().and_then(|name| Some(name.as_str()?.to_owned())).unwrap_or_default()
    }

    pub(super) fn wrong(self, what: &str) -> ShaftError {
        ShaftError::Field { kind: self.name(), what: what.to_owned(), example: self.form().example }
    }
}

fn read_pairs(kind: ShaftKind, text: &str, fields: &mut Map<String, Value>) -> Result<(), ShaftError> {
    let mut rest = text;
    while !rest.is_empty() {
        // A file's name is the rest of the text, whatever is in it.
        let end = if rest.starts_with("file=") { None } else { rest.find([':', ',']) };
        let (pair, after) = end.map_or((rest, ""), |end| (&rest[..end], &rest[end + 1..]));
        rest = after;
        let (name, value) = match pair.split_once('=') {
            Some(pair) => pair,
            None if kind == ShaftKind::Constant => ("rpm", pair),
            None => return Err(kind.wrong(&format!("{pair:?} is no NAME=VALUE"))),
        };
        if name == "rpm" && value.parse::<f64>().ok().is_none_or(|rpm| !rpm.is_finite()) {
            return Err(ShaftError::Speed(value.to_owned()));
        }
        let value = if ["file", "unit"].contains(&name) { Value::from(value) } else { scalar(value) };
        if fields.insert(name.to_owned(), value).is_some() {
            return Err(kind.wrong(&format!("{name} is there twice")));
        }
    }
    Ok(())
}

/// A number or a boolean where it reads as one.
fn scalar(text: &str) -> Value {
    if let Ok(whole) = text.parse::<i64>() {
        return whole.into();
    }
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() => number.into(),
        _ => text.parse::<bool>().map_or_else(|_| text.into(), Value::from),
    }
}
