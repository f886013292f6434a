//! What an encoder begins with beyond plain values: requests that are done for it at its start.

use serde::Deserialize;
use serde_json::{Map, Value};

use super::reader::{At, Reader, error_in_short};
use crate::control::{Request, Which};
use crate::machine::Machine;

/// A key, the request that it is, the field that a plain value goes to, and an example.
struct Start {
    key: &'static str,
    name: &'static str,
    field: Option<&'static str>,
    example: &'static str,
}

const STARTS: [Start; 6] = [
    Start {
        key: "machine",
        name: "units",
        field: Some("machine"),
        example: "{ unit = \"m\", per_turn = 0.5 }, or a drum in place of per_turn",
    },
    Start {
        key: "supply_profile",
        name: "supply_profile",
        field: None,
        example: "{ points = [[0, 24], [2, 24], [2, 5], [2.5, 24]], repeat = true }",
    },
    Start { key: "thermal", name: "thermal", field: None, example: "{ ambient = 40, kelvin_per_watt = 10 }" },
    Start { key: "led_ageing", name: "led_ageing", field: Some("hours"), example: "1000" },
    Start {
        key: "discharge",
        name: "discharge",
        field: None,
        example: "{ charge = 50, hours_without_power = 8760 }",
    },
    Start { key: "endurance", name: "endurance", field: Some("writes"), example: "100000" },
];

/// The requests of an encoder's table, without the encoder.
pub(super) fn read(table: &Reader<'_>) -> Vec<Request> {
    STARTS.iter().filter_map(|start| one(table, start)).collect()
}

fn one(table: &Reader<'_>, start: &Start) -> Option<Request> {
    let At { value, span } = table.json(start.key)?;
    let wrong = |text: &str| {
        let text = text.split("; write for example").next().unwrap_or(text);
        let text = text.strip_prefix(&format!("{}: ", start.name)).unwrap_or(text);
        let message = format!("`{}`: {text}", start.key);
        table.fault(span.clone(), message, format!("write {} = {}", start.key, start.example));
    };
    let mut fields = match (start.field, value) {
        (Some(field), value) => Map::from_iter([(field.to_owned(), value)]),
        (None, Value::Object(fields)) => fields,
        (None, _) => {
            wrong("it is a table with fields");
            return None;
        }
    };
    if let Some(stray) = ["do", "encoder"].into_iter().find(|name| fields.contains_key(*name)) {
        wrong(&format!("it has no field `{stray}`"));
        return None;
    }
    fields.insert("do".to_owned(), start.name.into());
    match Request::deserialize(Value::Object(fields)) {
        Ok(request) => match request.check() {
            Ok(()) => Some(request),
            Err(error) => {
                wrong(&error_in_short(&error));
                None
            }
        },
        Err(error) => {
            wrong(&error_in_short(&error));
            None
        }
    }
}

/// The machine among them.
pub(super) fn machine(starts: &[Request]) -> Option<&Machine> {
    starts.iter().find_map(|request| match request {
        Request::Units { machine, .. } => machine.as_ref(),
        _ => None,
    })
}

/// The same request for the encoder of this name.
pub(super) fn for_encoder(request: &Request, name: &str) -> Request {
    let mut request = request.clone();
    match &mut request {
        Request::Units { encoder, .. }
        | Request::SupplyProfile { encoder, .. }
        | Request::Thermal { encoder, .. }
        | Request::LedAgeing { encoder, .. }
        | Request::Discharge { encoder, .. }
        | Request::Endurance { encoder, .. } => *encoder = Some(Which::Name(name.to_owned())),
        _ => {}
    }
    request
}
