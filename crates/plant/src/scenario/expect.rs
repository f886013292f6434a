//! Reading `[[expect]]`.

use profibus_dp::time::{Duration, Instant};
use sch108bex::diagnostics::{Alarms, Warnings};
use serde_json::{Map, Value};

use super::fault::{nearest, quoted};
use super::keys::{ALARMS, STATES, WARNINGS};
use super::poll::octets;
use super::quantity::{Scale, Travel, Unit};
use super::reader::{At, Reader};
use super::{LONGEST, Names, SegmentPlan, shown};
use crate::control::EVENT_KINDS;

/// More expectations than this are none.
const MOST: usize = 10_000;

/// Something that must hold.
#[derive(Debug, Clone, PartialEq)]
pub struct Expectation {
    /// What the report calls it, where the file says so.
    pub name: Option<String>,
    /// Where it stands in the file, as an octet.
    pub octet: usize,
    /// What.
    pub what: What,
}

/// What must hold.
#[derive(Debug, Clone, PartialEq)]
pub enum What {
    /// At one moment an encoder is as it is checked for.
    State {
        /// When; before the events of this moment.
        at: Instant,
        /// Its full name.
        encoder: String,
        /// All of them.
        checks: Vec<Check>,
    },
    /// An event comes, or does not.
    Event {
        /// Which kind.
        kind: String,
        /// To whom; `None`: anybody.
        encoder: Option<String>,
        /// What it has, at least.
        fields: Map<String, Value>,
        /// From then on.
        after: Instant,
        /// Until then.
        before: Option<Instant>,
        /// Whether it has to come.
        seen: bool,
    },
    /// The built-in master fetches a diagnosis with this in it.
    Sees {
        /// The encoder's full name.
        encoder: String,
        /// What.
        flag: Flag,
        /// From then on.
        after: Instant,
        /// Until then.
        before: Option<Instant>,
        /// Within so many of its cycles.
        cycles: Option<u64>,
    },
}

/// What an encoder is checked for.
#[derive(Debug, Clone, PartialEq)]
pub enum Check {
    /// In scaled steps.
    Position(f64, f64),
    /// In the unit of the machine: the value, how far it may be off, and what makes it of steps.
    Travel(Travel, f64, Box<Scale>),
    /// In steps per time base.
    Velocity(f64, f64),
    /// In steps per time base.
    Acceleration(f64, f64),
    /// In scaled steps.
    Offset(f64, f64),
    /// As snapshots call it; `off`: no power.
    State(&'static str),
    /// The address that it answers to.
    Address(Option<u8>),
    /// Exactly these.
    Alarms(Alarms),
    /// Exactly these.
    Warnings(Warnings),
    /// Whether the built-in master exchanges data with it.
    Exchanging(bool),
    /// What the built-in master had last begins so.
    Inputs(Vec<u8>),
    /// A bit of the diagnosis that the built-in master fetched last.
    Diagnosis {
        /// From 1.
        octet: usize,
        /// 0 to 7.
        bit: u8,
        /// Whether it is set.
        is: bool,
    },
}

/// An alarm or a warning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flag {
    /// An alarm.
    Alarm(Alarms),
    /// A warning.
    Warning(Warnings),
}

/// Keys that say what is looked at: at a moment, for an event, for what the master sees.
const AT_A_MOMENT: [&str; 12] = [
    "position",
    "velocity",
    "acceleration",
    "offset",
    "within",
    "state",
    "address",
    "alarms",
    "warnings",
    "exchanging",
    "inputs",
    "diagnosis",
];

impl Expectation {
    /// The last moment that it needs.
    pub(super) fn last(&self) -> Instant {
        match &self.what {
            What::State { at, .. } => *at,
            What::Event { after, before, .. } | What::Sees { after, before, .. } => before.unwrap_or(*after),
        }
    }
}

pub(super) fn read(file: &Reader<'_>, names: &Names, segments: &[SegmentPlan]) -> Vec<Expectation> {
    let tables = file.tables("expect", MOST);
    tables.iter().filter_map(|table| expectation(table, names, segments)).collect()
}

fn expectation(table: &Reader<'_>, names: &Names, segments: &[SegmentPlan]) -> Option<Expectation> {
    let name = table.text("name").map(|name| shown(name.value));
    let has = |key: &str| table.raw(key).is_some();
    let (event, sees) = (has("event"), has("sees"));
    let stray = match (event, sees) {
        (true, false) => AT_A_MOMENT.iter().chain(&["at", "cycles"]).find(|key| has(key)),
        (false, true) => AT_A_MOMENT.iter().chain(&["at", "fields", "seen"]).find(|key| has(key)),
        (true, true) => Some(&"sees"),
        (false, false) => ["fields", "seen", "cycles", "after", "before"].iter().find(|key| has(key)),
    };
    if let Some(stray) = stray {
        let hint = "an expectation is about a moment (`at` and values), an `event`, or what the master `sees`; write one for each";
        table.fault(
            table.span_of(stray),
            format!("`{stray}` does not go together with the other keys"),
            hint,
        );
        return None;
    }
    let what = if event {
        of_event(table, names)
    } else if sees {
        of_sight(table, names)
    } else {
        of_moment(table, names, segments)
    };
    Some(Expectation { name, octet: table.span.start, what: what? })
}

/// The encoder that is meant.
fn encoder(table: &Reader<'_>, names: &Names) -> Option<String> {
    if table.raw("encoder").is_none() && names.encoders.len() == 1 {
        return names.encoders.first().cloned();
    }
    let name = table.text("encoder");
    let At { value, span } = table.required("encoder", name)?;
    if !names.encoders.iter().any(|known| known == value) {
        let near = nearest(value, names.encoders.iter().map(String::as_str));
        let near = near.unwrap_or(&names.encoders[0]);
        table.fault(span, format!("there is no encoder {}", quoted(value)), format!("is \"{near}\" meant?"));
        return None;
    }
    Some(value.to_owned())
}

fn polled(table: &Reader<'_>, key: &str, encoder: &str, names: &Names) -> bool {
    let polled = names.polled.iter().any(|polled| polled == encoder);
    if !polled {
        let hint = "add [[segment.master.poll]] for it";
        table.fault(
            table.span_of(key),
            format!("no built-in master asks {encoder}, so `{key}` cannot be told"),
            hint,
        );
    }
    polled
}

fn times(table: &Reader<'_>) -> Option<(Instant, Option<Instant>)> {
    let after = Instant::ZERO + table.time("after", Duration::ZERO, LONGEST).unwrap_or(Duration::ZERO);
    let before = table.time("before", Duration::ZERO, LONGEST).map(|before| Instant::ZERO + before);
    if before.is_some_and(|before| before < after) {
        table.fault(table.span_of("before"), "`before` is earlier than `after`", "write a later time");
        return None;
    }
    Some((after, before))
}

fn of_event(table: &Reader<'_>, names: &Names) -> Option<What> {
    let At { value: kind, span } = table.text("event")?;
    if !EVENT_KINDS.contains(&kind) {
        table.fault_of_choice("event", kind, span, EVENT_KINDS);
        return None;
    }
    let fields = match table.json("fields") {
        None => Map::new(),
        Some(At { value: Value::Object(fields), .. }) => fields,
        Some(At { span, .. }) => {
            table.fault(span, "`fields` is no table", "write { warnings = [\"battery_charge\"] }");
            return None;
        }
    };
    let encoder = match table.raw("encoder") {
        Some(_) => Some(encoder(table, names)?),
        None => None,
    };
    let (after, before) = times(table)?;
    let seen = table.boolean("seen").unwrap_or(true);
    Some(What::Event { kind: kind.to_owned(), encoder, fields, after, before, seen })
}

fn of_sight(table: &Reader<'_>, names: &Names) -> Option<What> {
    let encoder = encoder(table, names)?;
    let at = table.one_of("sees")?;
    let flag = match at.checked_sub(ALARMS.len()) {
        None => Flag::Alarm(Alarms::from_name(&ALARMS[at].to_uppercase())?),
        Some(at) => Flag::Warning(Warnings::from_name(&WARNINGS[at].to_uppercase())?),
    };
    if !polled(table, "sees", &encoder, names) {
        return None;
    }
    let cycles = table.integer("cycles", 1, 1_000_000).and_then(|cycles| u64::try_from(cycles).ok());
    let (after, before) = times(table)?;
    Some(What::Sees { encoder, flag, after, before, cycles })
}

fn of_moment(table: &Reader<'_>, names: &Names, segments: &[SegmentPlan]) -> Option<What> {
    let at = table.time("at", Duration::ZERO, LONGEST);
    let at = table.required("at", at);
    let encoder = encoder(table, names)?;
    let plan = segments.iter().flat_map(|segment| &segment.encoders).find(|plan| plan.name == encoder)?;
    let mut checks: Vec<Check> = Vec::new();
    checks.extend(position(table, plan.scale.as_ref()));
    for (key, check) in [
        ("velocity", Check::Velocity as fn(f64, f64) -> Check),
        ("acceleration", Check::Acceleration),
        ("offset", Check::Offset),
    ] {
        if let Some(value) = table.number(key, -4_294_967_296.0, 4_294_967_296.0) {
            checks.push(check(value, within_steps(table)?));
        }
    }
    checks.extend(table.one_of("state").map(|at| Check::State(STATES[at])));
    let address = table.integer("address", 0, 126).and_then(|address| u8::try_from(address).ok());
    checks.extend(address.map(|address| Check::Address((address > 0).then_some(address))));
    let alarms = flags(table, "alarms", ALARMS, Alarms::from_name);
    checks.extend(alarms.map(|alarms| Check::Alarms(alarms.into_iter().collect())));
    let warnings = flags(table, "warnings", WARNINGS, Warnings::from_name);
    checks.extend(warnings.map(|warnings| Check::Warnings(warnings.into_iter().collect())));
    for key in ["exchanging", "inputs", "diagnosis"] {
        if table.raw(key).is_some() && !polled(table, key, &encoder, names) {
            return None;
        }
    }
    checks.extend(table.boolean("exchanging").map(Check::Exchanging));
    checks.extend(octets(table, "inputs").map(Check::Inputs));
    checks.extend(diagnosis(table));
    if checks.is_empty() && !table.faults.any() {
        let hint = "add position, velocity, state, alarms, warnings or another; or `event`, or `sees`";
        table.fault(table.span.clone(), "this expectation expects nothing", hint);
    }
    Some(What::State { at: Instant::ZERO + at?, encoder, checks })
}

/// How far a value in steps may be off. Where the position is in the unit of the machine, `within` is the
/// position's.
fn within_steps(table: &Reader<'_>) -> Option<f64> {
    let of_travel = table.raw("position").is_some_and(|position| position.get_ref().as_str().is_some());
    if of_travel || table.raw("within").is_none() {
        return Some(0.0);
    }
    table.number("within", 0.0, 4_294_967_296.0)
}

/// A position in steps, or in the unit of the machine.
fn position(table: &Reader<'_>, scale: Option<&Scale>) -> Option<Check> {
    let found = table.raw("position")?;
    if found.get_ref().as_str().is_none() {
        let steps = table.number("position", 0.0, 4_294_967_296.0)?;
        return Some(Check::Position(steps, within_steps(table)?));
    }
    let At { value: position, span } = table.parsed::<Travel>("position")?;
    let Some(scale) = scale else {
        let hint = "add per_revolution = \"...\" or machine = { ... } to the encoder, or write steps";
        table.fault(span, "how far the machine moves in one revolution is not known", hint);
        return None;
    };
    let within = match table.raw("within") {
        None => None,
        Some(_) => Some(table.parsed::<Travel>("within")?.value),
    };
    if scale.unit() != position.unit
        || within.is_some_and(|within| within.unit != scale.unit() || within.value < 0.0)
    {
        let kind = match scale.unit() {
            Unit::Metre => "lengths, like \"3.20 m\"",
            Unit::Degree => "angles, like \"90 deg\"",
        };
        let hint = format!("write `position` and `within` as the encoder has them: {kind}");
        table.fault(span, "lengths and angles do not go together", hint);
        return None;
    }
    Some(Check::Travel(position, within.map_or(0.0, |within| within.value), Box::new(scale.clone())))
}

fn flags<T>(
    table: &Reader<'_>,
    key: &str,
    known: &[&str],
    by_name: impl Fn(&str) -> Option<T>,
) -> Option<Vec<T>> {
    let texts = table.texts(key)?;
    let mut found = Vec::new();
    for At { value, span } in texts {
        let Some(flag) = by_name(&value.to_uppercase()).filter(|_| known.contains(&value)) else {
            table.fault_of_choice(key, value, span, known);
            return None;
        };
        found.push(flag);
    }
    Some(found)
}

fn diagnosis(table: &Reader<'_>) -> Option<Check> {
    let At { value, span } = table.json("diagnosis")?;
    let number = |key: &str, least: u64, most: u64| {
        let number = value.get(key).and_then(Value::as_u64);
        number.filter(|number| (least..=most).contains(number))
    };
    let is = match value.get("is") {
        None => Some(true),
        Some(is) => is.as_bool(),
    };
    let known = |key: &String| ["octet", "bit", "is"].contains(&key.as_str());
    let whole = value.as_object().is_some_and(|fields| fields.keys().all(known));
    match (number("octet", 1, 57), number("bit", 0, 7), is) {
        (Some(octet), Some(bit), Some(is)) if whole => {
            Some(Check::Diagnosis { octet: usize::try_from(octet).ok()?, bit: u8::try_from(bit).ok()?, is })
        }
        _ => {
            let hint = "write { octet = 8, bit = 0 }, octets from 1 to 57, bits from 0 to 7; is = false for a bit that is not set";
            table.fault(span, "`diagnosis` is no bit of a diagnosis", hint);
            None
        }
    }
}
