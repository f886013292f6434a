//! Reading `[[segment.encoder]]`.

use std::ops::Range;

use profibus_dp::time::{Duration, Instant};
use sch108bex::Identity;
use sch108bex::configuration::Configurations;
use sch108bex::end_cap::{RotarySwitches, TerminationSwitches};
use sch108bex::health::{Battery, Measurement};
use sch108bex::specification::{PLACEHOLDER_IDENT, SerialNumber, Variant};
use serde::Deserialize;

use super::fault::quoted;
use super::keys::TERMINATIONS;
use super::quantity::{Scale, Travel};
use super::reader::{At, Reader, error_in_short};
use super::{EncoderPlan, LONGEST, segments, starts};
use crate::control::{Request, ShaftSpec};
use crate::machine::Machine;
use crate::shaft::{Shaft, ShaftError};
use crate::world::World;

/// Stations that have room on a bus beside a master.
const MOST: usize = 126;

/// An encoder whose place in the cable is still to be found.
#[derive(Debug)]
pub(super) struct Found {
    pub(super) plan: EncoderPlan,
    pub(super) termination: Termination,
}

/// The termination switches as the file has them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Termination {
    Auto,
    On,
    Off,
    One,
}

impl Termination {
    pub(super) fn switches(self, at_end: bool) -> TerminationSwitches {
        let (first, second) = match self {
            Self::Auto => (at_end, at_end),
            Self::On => (true, true),
            Self::Off => (false, false),
            Self::One => (true, false),
        };
        TerminationSwitches { first, second }
    }
}

pub(super) fn read(
    segment: &Reader<'_>,
    segment_name: &str,
    states: &mut Vec<(String, Range<usize>)>,
) -> Vec<Found> {
    let mut all: Vec<Found> = Vec::new();
    for table in segment.tables("encoder", MOST) {
        let Ok(named) = segments::name(&table, "name") else {
            continue;
        };
        let Some(name) = table.required("name", named) else {
            continue;
        };
        check_state(&table, states);
        let count = table.integer("count", 1, 126);
        let first = encoder(&table, format!("{segment_name}.{name}"));
        for found in several(&table, &first, count) {
            if all.iter().any(|other| other.plan.name == found.plan.name) {
                let message = format!("there are two encoders {}", quoted(&found.plan.name));
                table.fault(
                    table.span_of("name"),
                    message,
                    "give each encoder of a segment a name of its own",
                );
                break;
            }
            all.push(found);
        }
        if all.len() > MOST {
            let message = format!("more than {MOST} encoders on one segment");
            table.fault(table.span.clone(), message, "a bus has 127 addresses, and the master takes one");
            all.truncate(MOST);
            break;
        }
    }
    all
}

/// Two encoders cannot keep their memory in one file.
fn check_state(table: &Reader<'_>, states: &mut Vec<(String, Range<usize>)>) {
    let Some(state) = table.text("state") else {
        return;
    };
    if state.value.is_empty() {
        table.fault(state.span, "`state` is empty", "write the path of a file, or leave it out");
    } else if table.integer("count", 1, 126).is_some_and(|count| count > 1) {
        table.fault(
            state.span,
            "several encoders cannot share a state file",
            "write them one by one, or leave `state` out",
        );
    } else if states.iter().any(|(other, _)| normal(other) == normal(state.value)) {
        let message = format!("another encoder keeps its memory in {} already", quoted(state.value));
        table.fault(state.span, message, "give each encoder a state file of its own");
    } else {
        states.push((state.value.to_owned(), state.span));
    }
}

/// A path without `./`.
fn normal(path: &str) -> std::path::PathBuf {
    std::path::Path::new(path).components().filter(|part| *part != std::path::Component::CurDir).collect()
}

/// The encoders that a `count` makes of the first.
fn several(table: &Reader<'_>, first: &Found, count: Option<i64>) -> Vec<Found> {
    let one = |plan| Found { plan, termination: first.termination };
    let Some(count) = count.and_then(|count| u8::try_from(count).ok()) else {
        return vec![one(first.plan.clone())];
    };
    let RotarySwitches(begin) = first.plan.identity.switches;
    let delivered = first.plan.identity.switches == RotarySwitches::DELIVERED;
    if !delivered && begin.checked_add(count - 1).is_none_or(|last| last > 125) {
        let message = format!("{count} encoders from address {begin} on go past address 125");
        table.fault(table.span_of("count"), message, "write a lower `count` or lower `switches`");
        return Vec::new();
    }
    let numbered = (0..count).map(|at| {
        let mut plan = first.plan.clone();
        plan.name = format!("{}-{}", plan.name, at + 1);
        if !delivered {
            plan.identity.switches = RotarySwitches(begin + at);
        }
        let serial = first.plan.identity.serial_number.to_string().trim().parse::<u32>().unwrap_or_default();
        if let Ok(serial) = (serial + u32::from(at)).to_string().parse() {
            plan.identity.serial_number = serial;
        }
        one(plan)
    });
    numbered.collect()
}

fn encoder(table: &Reader<'_>, name: String) -> Found {
    let variant = table.parsed("bits").map_or(Variant::FULL, |bits| bits.value);
    let identity = Identity {
        variant,
        ident_number: ident(table).unwrap_or(PLACEHOLDER_IDENT),
        serial_number: table.parsed("serial").map_or(SerialNumber::DEFAULT, |serial| serial.value),
        switches: table.parsed("switches").map_or(RotarySwitches::DELIVERED, |switches| switches.value),
    };
    let termination = match table.one_of("termination").map(|at| TERMINATIONS[at]) {
        Some("on") => Termination::On,
        Some("off") => Termination::Off,
        Some("one") => Termination::One,
        _ => Termination::Auto,
    };
    let mut starts = starts::read(table);
    let gsd = table.text("gsd");
    if let Some(At { span, .. }) = gsd.as_ref().filter(|_| table.raw("ident").is_some()) {
        table.fault(
            span.clone(),
            "`gsd` and `ident` both say what the ident number is",
            "leave one of them out",
        );
    }
    let per_revolution = table.parsed::<Travel>("per_revolution");
    if let Some(travel) = per_revolution.as_ref().filter(|travel| travel.value.value <= 0.0) {
        table.fault(
            travel.span.clone(),
            "`per_revolution` is not above 0",
            "write a length or an angle above 0",
        );
    }
    let shaft = shaft(table, variant);
    let units = per_revolution.as_ref().filter(|_| shaft.machine().is_none()).map(|travel| travel.value);
    let scale = scale(table, per_revolution, starts::machine(&starts), &shaft, variant);
    // Snapshots and recordings have the unit, too.
    starts.extend(units.map(|Travel { value, unit }| Request::Units {
        encoder: None,
        machine: Some(Machine::linear(unit.symbol(), value)),
    }));
    let joins_at = table.time("joins_at", Duration::ZERO, LONGEST);
    if joins_at.is_some() && table.raw("joined").is_some() {
        let message = "`joins_at` and `joined` both say whether it is there at the start";
        table.fault(table.span_of("joined"), message, "leave one of them out");
    }
    let plan = EncoderPlan {
        name,
        identity,
        configurations: Configurations::default(),
        gsd: gsd.map(|gsd| gsd.value.into()),
        state: table.text("state").map(|state| state.value.into()),
        termination: TerminationSwitches::OFF,
        scale,
        shaft,
        world: world(table),
        starts,
        joined: table.boolean("joined").unwrap_or(true),
        joins_at: joins_at.map(|at| (Instant::ZERO + at, table.span_of("joins_at").start)),
    };
    Found { plan, termination }
}

/// What makes units of steps: the key for it, else the machine, else the machine of the shaft.
fn scale(
    table: &Reader<'_>,
    per_revolution: Option<At<Travel>>,
    machine: Option<&Machine>,
    shaft: &Shaft,
    variant: Variant,
) -> Option<Scale> {
    if let Some(At { value, span }) = per_revolution {
        if machine.is_some() {
            let message = "`per_revolution` and `machine` both say what a revolution moves";
            table.fault(span, message, "leave one of them out");
        }
        return Some(Scale::of_travel(value));
    }
    let scale = Scale::of_machine(machine.or_else(|| shaft.machine())?, variant);
    if let (None, Some(machine)) = (&scale, machine) {
        let message =
            format!("`machine`: {} is no unit that positions can be written in", quoted(&machine.unit));
        table.fault(table.span_of("machine"), message, "write unit = \"m\", mm, cm, km, in, ft, deg or rev");
    }
    scale
}

/// An ident number as a whole number, or as text with 0x.
pub(super) fn ident(table: &Reader<'_>) -> Option<u16> {
    let found = table.raw("ident")?;
    let Some(text) = found.get_ref().as_str() else {
        return table.integer("ident", 0, 0xFFFF).and_then(|ident| u16::try_from(ident).ok());
    };
    let digits = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"));
    let digits = digits.filter(|digits| !digits.starts_with('+'));
    let ident = digits.and_then(|digits| u16::from_str_radix(digits, 16).ok());
    if ident.is_none() {
        table.fault(found.span(), format!("{} is no ident number", quoted(text)), "write one like 0x108B");
    }
    ident
}

fn shaft(table: &Reader<'_>, variant: Variant) -> Shaft {
    let Some(found) = table.json("shaft") else {
        return Shaft::still(0);
    };
    let wrong = |text: String| {
        let hint =
            "write for example \"still@1000\", \"constant:60\" or { kind = \"constant\", rpm = 60, raw = 0 }";
        table.fault(found.span.clone(), format!("`shaft`: {text}"), hint);
        Shaft::still(0)
    };
    let spec = match ShaftSpec::deserialize(&found.value) {
        Ok(spec) => spec.in_folder(&table.faults.folder),
        Err(error) => return wrong(error_in_short(&error)),
    };
    match spec.resolve().and_then(|(shaft, _)| shaft.check(variant).map(|()| shaft)) {
        Ok(shaft) => shaft,
        Err(ShaftError::Coupled) => {
            let hint = "write still@RAW here, and add an event at 0 s with do = \"shaft\" that couples it";
            table.fault(found.span.clone(), "`shaft`: a coupled shaft needs an encoder that runs", hint);
            Shaft::still(0)
        }
        Err(error) => wrong(error_in_short(&error)),
    }
}

#[expect(clippy::cast_possible_truncation, reason = "bounded before")]
fn world(table: &Reader<'_>) -> World {
    let World(mut world) = World::default();
    if let Some(volts) = table.number("supply", -100.0, 100.0) {
        world.supply_mv = (volts * 1e3).round() as i32;
    }
    if let Some(celsius) = table.number("temperature", -300.0, 300.0) {
        world.temperature_tenths = (celsius * 10.0).round() as i16;
    }
    world.light_ok = table.one_of("light") != Some(1);
    world.battery = match table.one_of("battery") {
        Some(1) => Battery::Low,
        Some(2) => Battery::Empty,
        _ => Battery::Ok,
    };
    World(Measurement { ..world })
}
