//! Reading tables of a TOML file value by value, with the place of everything that is wrong.

use std::cell::RefCell;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use profibus_dp::time::Duration;
use serde_json::{Map, Number, Value};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::fault::{Fault, nearest, quoted};
use super::keys::{Kind, Table};
use super::quantity;

/// More faults than this help nobody.
const MOST_FAULTS: usize = 20;

/// Where faults are gathered.
#[derive(Debug)]
pub(super) struct Gathered {
    faults: RefCell<Vec<Fault>>,
    /// Files that are read with the scenario are there.
    pub(super) folder: PathBuf,
}

impl Gathered {
    /// None yet.
    pub(super) fn of(folder: &Path) -> Self {
        Self { faults: RefCell::default(), folder: folder.to_owned() }
    }

    pub(super) fn add(&self, fault: Fault) {
        let mut faults = self.faults.borrow_mut();
        if faults.len() < MOST_FAULTS {
            faults.push(fault);
        }
    }

    pub(super) fn take(&self) -> Vec<Fault> {
        std::mem::take(&mut self.faults.borrow_mut())
    }

    pub(super) fn any(&self) -> bool {
        !self.faults.borrow().is_empty()
    }
}

/// A value and where it stands.
#[derive(Debug, Clone)]
pub(super) struct At<T> {
    pub(super) value: T,
    pub(super) span: Range<usize>,
}

/// A table that is being read.
#[derive(Debug, Clone)]
pub(super) struct Reader<'a> {
    pub(super) faults: &'a Gathered,
    pub(super) table: &'a DeTable<'a>,
    pub(super) span: Range<usize>,
    keys: &'static Table,
}

impl<'a> Reader<'a> {
    /// Reads a table; keys that it cannot have are faults already.
    pub(super) fn new(
        faults: &'a Gathered,
        table: &'a DeTable<'a>,
        span: Range<usize>,
        keys: &'static Table,
    ) -> Self {
        for (name, _) in table.iter().filter(|(name, _)| !keys.open && keys.key(name.get_ref()).is_none()) {
            let known = || keys.keys.iter().map(|key| key.name);
            let hint = match nearest(name.get_ref(), known()) {
                Some(known) => format!("is `{known}` meant?"),
                None => format!("it has {}", known().collect::<Vec<_>>().join(", ")),
            };
            let message = format!("{} has no key {}", keys.what, quoted(name.get_ref()));
            faults.add(Fault::new(name.span(), message, hint));
        }
        Self { faults, table, span, keys }
    }

    pub(super) fn fault(&self, span: Range<usize>, message: impl Into<String>, hint: impl Into<String>) {
        self.faults.add(Fault::new(span, message, hint));
    }

    pub(super) fn raw(&self, name: &str) -> Option<&'a Spanned<DeValue<'a>>> {
        debug_assert!(self.keys.open || self.keys.key(name).is_some(), "{name} is in no table of keys");
        self.table.get(name)
    }

    /// Where the value of a key stands, else the table.
    pub(super) fn span_of(&self, name: &str) -> Range<usize> {
        self.table.get(name).map_or_else(|| self.span.clone(), Spanned::span)
    }

    /// The value of a key that has to be there.
    pub(super) fn required<T>(&self, name: &str, value: Option<T>) -> Option<T> {
        if value.is_none() && self.table.get(name).is_none() {
            let message = format!("{} needs `{name}`", self.keys.what);
            self.fault(self.span.clone(), message, format!("add {name} = {}", self.example(name)));
        }
        value
    }

    fn example(&self, name: &str) -> String {
        match self.keys.key(name).map(|key| key.kind) {
            Some(Kind::Quantity) => "\"1 s\"".to_owned(),
            Some(Kind::Tables(table) | Kind::Table(table)) => format!("a table {}", table.heading),
            _ => format!("... ({})", self.keys.key(name).map_or("a value", |key| key.values)),
        }
    }

    fn wrong_kind(&self, name: &str, found: &Spanned<DeValue<'_>>, due: &str) {
        let values = self.keys.key(name).map_or("", |key| key.values);
        let message = format!("`{name}` is {due}, and this is {}", kind_of(found.get_ref()));
        self.fault(found.span(), message, format!("write {values}"));
    }

    pub(super) fn text(&self, name: &str) -> Option<At<&'a str>> {
        let found = self.raw(name)?;
        let Some(value) = found.get_ref().as_str() else {
            self.wrong_kind(name, found, "a text");
            return None;
        };
        Some(At { value, span: found.span() })
    }

    /// A text that stands for something.
    pub(super) fn parsed<T: FromStr<Err: std::fmt::Display>>(&self, name: &str) -> Option<At<T>> {
        let text = self.text(name)?;
        match text.value.parse() {
            Ok(value) => Some(At { value, span: text.span }),
            Err(error) => {
                let values = self.keys.key(name).map_or("", |key| key.values);
                let message = format!("`{name}`: {}", error_in_short(&error));
                self.fault(text.span, message, format!("write {values}"));
                None
            }
        }
    }

    /// One of the texts that the key can have, by its place in the list.
    pub(super) fn one_of(&self, name: &str) -> Option<usize> {
        let Some(Kind::OneOf(texts)) = self.keys.key(name).map(|key| key.kind) else {
            return None;
        };
        let At { value, span } = self.text(name)?;
        let found = texts.iter().position(|known| *known == value);
        if found.is_none() {
            self.fault_of_choice(name, value, span, texts);
        }
        found
    }

    pub(super) fn fault_of_choice(&self, name: &str, value: &str, span: Range<usize>, texts: &[&str]) {
        let hint = match nearest(value, texts.iter().copied()) {
            Some(known) => format!("is \"{known}\" meant? There are {}", texts.join(", ")),
            None => format!("write one of {}", texts.join(", ")),
        };
        self.fault(span, format!("`{name}` cannot be {}", quoted(value)), hint);
    }

    pub(super) fn boolean(&self, name: &str) -> Option<bool> {
        let found = self.raw(name)?;
        let value = found.get_ref().as_bool();
        if value.is_none() {
            self.wrong_kind(name, found, "true or false");
        }
        value
    }

    pub(super) fn number(&self, name: &str, least: f64, most: f64) -> Option<f64> {
        let found = self.raw(name)?;
        let value = match number_of(found.get_ref()) {
            Some(value) if (least..=most).contains(&value) => return Some(value),
            Some(value) => value,
            None => {
                self.wrong_kind(name, found, "a number");
                return None;
            }
        };
        self.fault(
            found.span(),
            format!("`{name}` is {value}, which is outside its range"),
            format!("write a number from {least} to {most}"),
        );
        None
    }

    pub(super) fn integer(&self, name: &str, least: i64, most: i64) -> Option<i64> {
        let found = self.raw(name)?;
        let Some(integer) = found.get_ref().as_integer() else {
            self.wrong_kind(name, found, "a whole number");
            return None;
        };
        let value = i64::from_str_radix(integer.as_str(), integer.radix()).ok();
        let value = value.filter(|value| (least..=most).contains(value));
        if value.is_none() {
            self.fault(
                found.span(),
                format!("`{name}` is {}, which is outside its range", shortened(&integer.to_string())),
                format!("write a whole number from {least} to {most}"),
            );
        }
        value
    }

    /// A span of time.
    pub(super) fn time(&self, name: &str, least: Duration, most: Duration) -> Option<Duration> {
        let found = self.raw(name)?;
        let time = match (found.get_ref().as_str(), number_of(found.get_ref())) {
            (Some(text), _) => quantity::time(text),
            (None, Some(seconds)) => quantity::seconds(seconds),
            _ => {
                self.wrong_kind(name, found, "a time");
                return None;
            }
        };
        let show = quantity::show_time;
        match time {
            Some(time) if (least..=most).contains(&time) => Some(time),
            Some(_) => {
                let hint = format!("write a time from {} to {}", show(least), show(most));
                self.fault(found.span(), format!("`{name}` is outside its range"), hint);
                None
            }
            None => {
                let hint = "write seconds, like 2.5, or a text with us, ms, s, min, h or d, like \"250 ms\"";
                self.fault(found.span(), format!("`{name}` is no time"), hint);
                None
            }
        }
    }

    /// A table within this one.
    pub(super) fn inner(&self, name: &str) -> Option<Reader<'a>> {
        let found = self.raw(name)?;
        let Some(Kind::Table(keys)) = self.keys.key(name).map(|key| key.kind) else {
            return None;
        };
        let Some(table) = found.get_ref().as_table() else {
            let message = format!("`{name}` is a table, and this is {}", kind_of(found.get_ref()));
            self.fault(found.span(), message, format!("write {}", keys.heading));
            return None;
        };
        Some(Reader::new(self.faults, table, found.span(), keys))
    }

    /// The tables of a list within this one, at most so many.
    pub(super) fn tables(&self, name: &str, most: usize) -> Vec<Reader<'a>> {
        let (Some(found), Some(Kind::Tables(keys))) =
            (self.raw(name), self.keys.key(name).map(|key| key.kind))
        else {
            return Vec::new();
        };
        let no_tables = |found: &Spanned<DeValue<'_>>| {
            let message = format!("`{name}` is a list of tables, and this is {}", kind_of(found.get_ref()));
            self.fault(
                found.span(),
                message,
                format!("write {} with two brackets on each side", keys.heading),
            );
        };
        let Some(list) = found.get_ref().as_array() else {
            no_tables(found);
            return Vec::new();
        };
        if let Some(first) = list.get(most) {
            let message = format!("{} tables {} are too many", list.len(), keys.heading);
            self.fault(first.span(), message, format!("{most} is the most"));
        }
        let tables = list.iter().take(most).filter_map(|entry| {
            let Some(table) = entry.get_ref().as_table() else {
                no_tables(entry);
                return None;
            };
            Some(Reader::new(self.faults, table, entry.span(), keys))
        });
        tables.collect()
    }

    /// A list of texts.
    pub(super) fn texts(&self, name: &str) -> Option<Vec<At<&'a str>>> {
        let found = self.raw(name)?;
        let Some(list) = found.get_ref().as_array() else {
            self.wrong_kind(name, found, "a list of texts");
            return None;
        };
        let texts = list.iter().map(|entry| {
            let Some(value) = entry.get_ref().as_str() else {
                self.wrong_kind(name, entry, "a list of texts");
                return None;
            };
            Some(At { value, span: entry.span() })
        });
        texts.collect()
    }

    /// A value with fields of its own.
    pub(super) fn json(&self, name: &str) -> Option<At<Value>> {
        let found = self.raw(name)?;
        Some(At { value: json_of(found.get_ref()), span: found.span() })
    }
}

/// A value as JSON has it; dates are texts.
pub(super) fn json_of(value: &DeValue<'_>) -> Value {
    match value {
        DeValue::String(text) => Value::from(text.as_ref()),
        DeValue::Integer(integer) => {
            let number = i64::from_str_radix(integer.as_str(), integer.radix());
            number.map_or_else(|_| Value::from(integer.to_string()), Value::from)
        }
        DeValue::Float(float) => {
            let number = float.as_str().parse().ok().and_then(Number::from_f64);
            number.map_or_else(|| Value::from(float.as_str()), Value::Number)
        }
        DeValue::Boolean(value) => Value::from(*value),
        DeValue::Datetime(date) => Value::from(date.to_string()),
        DeValue::Array(list) => list.iter().map(|entry| json_of(entry.get_ref())).collect(),
        DeValue::Table(table) => Value::Object(json_of_table(table)),
    }
}

/// A table as JSON has it.
pub(super) fn json_of_table(table: &DeTable<'_>) -> Map<String, Value> {
    table.iter().map(|(name, value)| (name.get_ref().to_string(), json_of(value.get_ref()))).collect()
}

#[expect(clippy::cast_precision_loss, reason = "whole numbers in scenarios are far below 2^53")]
fn number_of(value: &DeValue<'_>) -> Option<f64> {
    let number = match value {
        DeValue::Integer(integer) => i64::from_str_radix(integer.as_str(), integer.radix()).ok()? as f64,
        DeValue::Float(float) => float.as_str().parse().ok()?,
        _ => return None,
    };
    number.is_finite().then_some(number)
}

fn kind_of(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "a text",
        DeValue::Integer(_) => "a whole number",
        DeValue::Float(_) => "a number with a point",
        DeValue::Boolean(_) => "true or false",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "a list",
        DeValue::Table(_) => "a table",
    }
}

/// Errors may quote what they are about, which may be long.
pub(super) fn error_in_short(error: &impl std::fmt::Display) -> String {
    shortened(&error.to_string())
}

fn shortened(text: &str) -> String {
    const MOST: usize = 200;
    let short: String = text.chars().filter(|character| !character.is_control()).take(MOST).collect();
    if short.len() < text.len() && text.chars().count() > MOST { format!("{short}...") } else { short }
}
