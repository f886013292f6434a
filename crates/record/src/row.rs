//! A row of a recording, and its columns.

use std::borrow::Cow;
use std::sync::Arc;

use plant::DeviceSample;
use profibus_dp::dp::State;
use sch108bex::diagnostics::{Alarms, Warnings};
use sch108bex::functionality::Functionality;

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Whole numbers.
    Whole,
    /// Numbers.
    Real,
    /// Words.
    Text,
}

/// A column of a recording.
#[derive(Debug)]
pub struct Column {
    /// What it is called.
    pub name: &'static str,
    /// What it holds.
    pub kind: Kind,
    /// The unit, for axes; `""`: none.
    pub unit: &'static str,
    of: fn(&Row) -> Value<'_>,
}

/// What stands in a column of a row.
#[derive(Debug, Clone, PartialEq)]
pub enum Value<'a> {
    /// Nothing.
    Null,
    /// A whole number.
    Whole(i64),
    /// A number.
    Real(f64),
    /// Words.
    Text(Cow<'a, str>),
}

/// One row: an encoder at a moment, or something that happened to it.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// On the clock of the segment.
    pub time_ns: u64,
    /// The encoder's name; of events also the segment's.
    pub encoder: Arc<str>,
    /// Which of both.
    pub what: What,
}

/// What a row tells.
#[derive(Debug, Clone, PartialEq)]
pub enum What {
    /// What the encoder showed.
    Sample(Values),
    /// What happened.
    Event {
        /// In one word, as in docs/control.md.
        kind: Cow<'static, str>,
        /// In a sentence.
        text: Arc<str>,
    },
}

/// What an encoder showed.
#[derive(Debug, Clone, PartialEq)]
pub struct Values {
    /// What its device showed; `None` without power.
    pub device: Option<DeviceSample>,
    /// The shaft, in physical counts, turns included.
    pub shaft_position: i64,
    /// Revolutions per minute.
    pub rpm: f64,
    /// Where the machine is, and its unit.
    pub machine: Option<(f64, Arc<str>)>,
    /// Millivolts.
    pub supply_mv: i32,
    /// Tenths of a degree Celsius.
    pub temperature_tenths: i16,
}

/// All columns, in their order.
#[rustfmt::skip]
pub const COLUMNS: &[Column] = &[
    Column { name: "time_ns", kind: Kind::Whole, unit: "ns", of: |row| whole(row.time_ns) },
    Column { name: "encoder", kind: Kind::Text, unit: "", of: |row| Value::Text((&*row.encoder).into()) },
    Column { name: "event", kind: Kind::Text, unit: "", of: |row| row.event().map_or(Value::Null, |(kind, _)| text(kind)) },
    Column { name: "text", kind: Kind::Text, unit: "", of: |row| row.event().map_or(Value::Null, |(_, words)| text(words)) },
    Column { name: "position", kind: Kind::Whole, unit: "steps", of: |row| device(row, |device| whole(device.position)) },
    Column { name: "velocity", kind: Kind::Whole, unit: "units of the time base", of: |row| device(row, |device| whole(device.velocity)) },
    Column { name: "acceleration", kind: Kind::Whole, unit: "units of the time base", of: |row| device(row, |device| whole(device.acceleration)) },
    Column { name: "physical_position", kind: Kind::Whole, unit: "counts", of: |row| device(row, |device| whole(device.physical_position)) },
    Column { name: "shaft_position", kind: Kind::Whole, unit: "counts", of: |row| values(row, |values| whole(values.shaft_position)) },
    Column { name: "rpm", kind: Kind::Real, unit: "RPM", of: |row| values(row, |values| Value::Real(values.rpm)) },
    Column { name: "machine_position", kind: Kind::Real, unit: "", of: |row| values(row, |values| values.machine.as_ref().map_or(Value::Null, |(position, _)| Value::Real(*position))) },
    Column { name: "machine_unit", kind: Kind::Text, unit: "", of: |row| values(row, |values| values.machine.as_ref().map_or(Value::Null, |(_, unit)| text(unit))) },
    Column { name: "state", kind: Kind::Text, unit: "", of: |row| values(row, |values| text(state(values))) },
    Column { name: "functionality", kind: Kind::Text, unit: "", of: |row| device(row, |device| device.functionality.map_or(Value::Null, |agreed| text(functionality(agreed)))) },
    Column { name: "alarms", kind: Kind::Text, unit: "", of: |row| device(row, |device| names(alarms(device.alarms))) },
    Column { name: "warnings", kind: Kind::Text, unit: "", of: |row| device(row, |device| names(warnings(device.warnings))) },
    Column { name: "supply_v", kind: Kind::Real, unit: "V", of: |row| values(row, |values| Value::Real(f64::from(values.supply_mv) / 1e3)) },
    Column { name: "temperature_c", kind: Kind::Real, unit: "degrees C", of: |row| values(row, |values| Value::Real(f64::from(values.temperature_tenths) / 10.0)) },
];

impl Column {
    /// What a row has in it.
    pub fn of<'a>(&self, row: &'a Row) -> Value<'a> {
        (self.of)(row)
    }

    /// The column of this name.
    pub fn named(name: &str) -> Option<&'static Self> {
        COLUMNS.iter().find(|column| column.name == name)
    }
}

impl Row {
    fn event(&self) -> Option<(&str, &str)> {
        match &self.what {
            What::Event { kind, text } => Some((kind, text)),
            What::Sample(_) => None,
        }
    }
}

fn whole<'a>(value: impl TryInto<i64>) -> Value<'a> {
    Value::Whole(value.try_into().unwrap_or(i64::MAX))
}

fn text(text: &str) -> Value<'_> {
    Value::Text(text.into())
}

fn values<'a>(row: &'a Row, of: impl FnOnce(&'a Values) -> Value<'a>) -> Value<'a> {
    match &row.what {
        What::Sample(values) => of(values),
        What::Event { .. } => Value::Null,
    }
}

fn device<'a>(row: &'a Row, of: impl FnOnce(&'a DeviceSample) -> Value<'a>) -> Value<'a> {
    values(row, |values| values.device.as_ref().map_or(Value::Null, of))
}

fn state(values: &Values) -> &'static str {
    match values.device.map(|device| device.state) {
        None => "off",
        Some(State::WaitPrm) => "wait_prm",
        Some(State::WaitCfg(_)) => "wait_cfg",
        Some(State::DataExchange(..)) => "data_exchange",
    }
}

fn functionality(functionality: Functionality) -> &'static str {
    match functionality {
        Functionality::Class1 => "class_1",
        Functionality::Class2 => "class_2",
        Functionality::Scancon2 => "scancon_2",
    }
}

fn alarms(alarms: Alarms) -> Option<String> {
    (!alarms.is_empty()).then(|| joined(alarms.iter_names().map(|(name, _)| name)))
}

fn warnings(warnings: Warnings) -> Option<String> {
    (!warnings.is_empty()).then(|| joined(warnings.iter_names().map(|(name, _)| name)))
}

fn joined<'a>(names: impl Iterator<Item = &'a str>) -> String {
    names.map(str::to_lowercase).collect::<Vec<_>>().join(" ")
}

fn names<'a>(names: Option<String>) -> Value<'a> {
    names.map_or(Value::Null, |names| Value::Text(names.into()))
}
