//! Reading `[[event]]`.

use std::ops::Range;

use profibus_dp::time::{Duration, Instant};
use serde::Deserialize;
use serde_json::{Map, Value};

use super::fault::{nearest, quoted};
use super::reader::{At, Reader, error_in_short, json_of_table};
use super::{LONGEST, Names};
use crate::control::{COMMANDS, Request};

/// More events than this are none.
const MOST: usize = 10_000;

/// What is for a connection or a program, and happens in no scenario.
pub(super) const REFUSED: [&str; 5] = ["snapshot", "subscribe", "unsubscribe", "help", "shutdown"];
/// What a built-in master can be asked for.
pub(super) const MASTER_REQUESTS: [&str; 5] =
    ["preset", "outputs", "set_address", "master_stop", "master_start"];

/// Something that happens.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// When.
    pub at: Instant,
    /// Where it stands in the file, as an octet.
    pub octet: usize,
    /// What.
    pub act: Act,
}

/// What happens.
#[derive(Debug, Clone, PartialEq)]
pub enum Act {
    /// To an encoder or a segment.
    Request(Request),
    /// At a built-in master.
    Master(MasterAct),
}

/// What a built-in master is asked for.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub enum MasterAct {
    /// It presets an encoder: output bit 31 and the value, for two cycles (manual 4.3.2).
    Preset {
        /// Which encoder of its list.
        encoder: String,
        /// In scaled steps, 0 to 2147483647.
        value: u32,
    },
    /// It sends these outputs from now on.
    Outputs {
        /// Which encoder of its list.
        encoder: String,
        /// All four octets as one number.
        value: u32,
    },
    /// It gives a station another address.
    SetAddress {
        /// On which segment.
        segment: Option<String>,
        /// Where the station is, 0 to 126.
        from: u8,
        /// Where it will be, 1 to 125.
        to: u8,
    },
    /// It asks nobody any more.
    MasterStop {
        /// On which segment.
        segment: Option<String>,
    },
    /// It goes on, with a start-up of everybody.
    MasterStart {
        /// On which segment.
        segment: Option<String>,
    },
}

/// Events of one moment come in the order of the file, `first` in front of them.
pub(super) fn read(file: &Reader<'_>, names: &Names, first: Vec<Event>) -> Vec<Event> {
    let tables = file.tables("event", MOST);
    let mut events = first;
    events.extend(tables.iter().filter_map(|table| event(table, names)));
    events.sort_by_key(|event| event.at);
    events
}

fn event(table: &Reader<'_>, names: &Names) -> Option<Event> {
    let at = table.time("at", Duration::ZERO, LONGEST);
    let at = table.required("at", at);
    let name = table.text("do");
    let At { value: name, span } = table.required("do", name)?;
    let mut fields = json_of_table(table.table);
    fields.remove("at");
    let known: Vec<_> = COMMANDS
        .iter()
        .map(|command| command.name)
        .filter(|name| !REFUSED.contains(name))
        .chain(MASTER_REQUESTS)
        .collect();
    if !known.contains(&name) {
        table.fault_of_choice("do", name, span, &known);
        return None;
    }
    check_names(table, &fields, names);
    let act = if MASTER_REQUESTS.contains(&name) {
        Act::Master(master_act(table, fields, names, span.clone())?)
    } else {
        Act::Request(request(table, fields, names, span.clone())?)
    };
    Some(Event { at: Instant::ZERO + at?, octet: span.start, act })
}

fn request(
    table: &Reader<'_>,
    fields: Map<String, Value>,
    names: &Names,
    span: Range<usize>,
) -> Option<Request> {
    let name = fields.get("do").and_then(Value::as_str).unwrap_or_default().to_owned();
    let hint = || {
        let example = COMMANDS.iter().find(|command| command.name == name).map(|command| command.example);
        format!("as JSON it is {}", example.unwrap_or_default())
    };
    let request = match Request::deserialize(Value::Object(fields)) {
        Ok(Request::Shaft { encoder, shaft }) => {
            Request::Shaft { encoder, shaft: shaft.in_folder(&table.faults.folder) }
        }
        Ok(request) => request,
        Err(error) => {
            let error = error_in_short(&error);
            table.fault(place_of(table, &error, span), format!("{name}: {error}"), hint());
            return None;
        }
    };
    if let Err(error) = request.check() {
        let error = error_in_short(&error);
        let text = error.strip_prefix(&format!("{name}: ")).unwrap_or(&error);
        let text = text.split("; write for example").next().unwrap_or(text);
        table.fault(place_of(table, text, span), format!("{name}: {text}"), hint());
        return None;
    }
    // Who is meant must be clear.
    let value = serde_json::to_value(&request).unwrap_or_default();
    for (key, there) in [("encoder", &names.encoders), ("segment", &names.segments)] {
        if value.get(key).is_some_and(Value::is_null) && there.len() > 1 {
            let hint = format!("add {key} = \"{}\", or \"all\"", there[0]);
            table.fault(span.clone(), format!("{name}: there are several, which {key} is meant?"), hint);
        }
    }
    Some(request)
}

/// Where in an event an error belongs to, as far as its words tell.
fn place_of(table: &Reader<'_>, error: &str, whole: Range<usize>) -> Range<usize> {
    let entries = || table.table.iter().filter(|(name, _)| !["at", "do"].contains(&name.get_ref().as_ref()));
    let named = entries().find(|(name, _)| error.contains(&format!("`{}`", name.get_ref())));
    if let Some((name, _)) = named {
        return name.span();
    }
    let begins = entries().find(|(name, value)| {
        let text = value.get_ref().as_str().unwrap_or("\0");
        error.starts_with(name.get_ref().as_ref())
            || error.contains(&format!("`{text}`"))
            || error.contains(&format!("{text:?}"))
    });
    begins.map_or(whole, |(_, value)| value.span())
}

/// `encoder` and `segment` are somebody's names.
fn check_names(table: &Reader<'_>, fields: &Map<String, Value>, names: &Names) {
    for (key, there) in [("encoder", &names.encoders), ("segment", &names.segments)] {
        let (message, hint) = match fields.get(key) {
            Some(Value::String(name)) if name != "all" && !there.contains(name) => {
                let hint = match nearest(name, there.iter().map(String::as_str)) {
                    Some(near) => format!("is \"{near}\" meant?"),
                    None if there.len() <= 8 => format!("there are {}", there.join(", ")),
                    None => format!("there are {} to {}", there[0], there[there.len() - 1]),
                };
                (format!("there is no {key} {}", quoted(name)), hint)
            }
            Some(Value::Number(number))
                if number.as_u64().is_none_or(|number| number == 0 || number > there.len() as u64) =>
            {
                (
                    format!("there is no {key} {number}"),
                    format!("they are numbered from 1 to {}", there.len()),
                )
            }
            _ => continue,
        };
        table.fault(table.span_of(key), message, hint);
    }
}

fn master_act(
    table: &Reader<'_>,
    mut fields: Map<String, Value>,
    names: &Names,
    span: Range<usize>,
) -> Option<MasterAct> {
    if names.mastered.is_empty() {
        let hint = "add [segment.master] to the segment";
        table.fault(span, "there is no built-in master that could do it", hint);
        return None;
    }
    let name = fields.get("do").and_then(Value::as_str).unwrap_or_default().to_owned();
    if ["preset", "outputs"].contains(&name.as_str()) {
        if let (None, [only]) = (fields.get("encoder"), &names.polled[..]) {
            fields.insert("encoder".to_owned(), only.as_str().into());
        }
        let asked = fields.get("encoder").and_then(Value::as_str).unwrap_or_default();
        if !names.polled.iter().any(|polled| polled == asked) {
            let hint = "add `encoder`, one that is in the poll list of a master";
            table.fault(table.span_of("encoder"), format!("{name}: which encoder is meant?"), hint);
            return None;
        }
    } else if fields.get("segment").is_none() {
        let [only] = &names.mastered[..] else {
            let hint = format!("add segment = \"{}\"", names.mastered[0]);
            table.fault(span, format!("{name}: there are several masters"), hint);
            return None;
        };
        fields.insert("segment".to_owned(), only.as_str().into());
    }
    let hint = match name.as_str() {
        "preset" => "write do = \"preset\", encoder = \"...\", value = 1000",
        "outputs" => "write do = \"outputs\", encoder = \"...\", value = 0x80000000",
        "set_address" => "write do = \"set_address\", from = 126, to = 5",
        _ => "write nothing beside `at`, `do` and `segment`",
    };
    match MasterAct::deserialize(Value::Object(fields)) {
        Ok(MasterAct::Preset { value, .. }) if value > i32::MAX.cast_unsigned() => {
            table.fault(table.span_of("value"), "preset: a preset has 31 bits", "write 0 to 2147483647");
            None
        }
        Ok(MasterAct::SetAddress { from, to, .. }) if from > 126 || !(1..=125).contains(&to) => {
            table.fault(span, "set_address: these are no addresses", "`from` is 0 to 126, `to` is 1 to 125");
            None
        }
        Ok(act)
            if act.segment().is_some_and(|segment| !names.mastered.iter().any(|known| known == segment)) =>
        {
            table.fault(table.span_of("segment"), format!("{name}: it has no built-in master"), hint);
            None
        }
        Ok(act) => Some(act),
        Err(error) => {
            let error = error_in_short(&error);
            table.fault(place_of(table, &error, span), format!("{name}: {error}"), hint);
            None
        }
    }
}

impl MasterAct {
    /// The segment that it is for, where it names one.
    pub(super) fn segment(&self) -> Option<&str> {
        match self {
            Self::Preset { .. } | Self::Outputs { .. } => None,
            Self::SetAddress { segment, .. }
            | Self::MasterStop { segment }
            | Self::MasterStart { segment } => segment.as_deref(),
        }
    }
}
