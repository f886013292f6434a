//! The requests of docs/control.md, each with its fields; a test compares them with what is read.

use serde_json::{Map, Value, json};

/// What a field is.
#[derive(Debug, Clone, Copy)]
enum Kind {
    /// A name, a number from 1, `all`, or nothing where there is only one.
    Which,
    Number(f64, f64),
    Whole(u64, u64),
    /// A number whose limits depend on others.
    Any,
    Bool,
    OneOf(&'static [&'static str]),
    /// Text that fits an expression.
    Text(&'static str),
    /// A shaft as text or in fields.
    Shaft,
    /// Points of seconds and volts.
    Points,
    Machine,
    /// A number or null.
    WholeOrNull,
    NumberOrNull(f64, f64),
}

/// A field: its name, what it is, whether it has to be there.
type Field = (&'static str, Kind, bool);

const ENCODER: Field = ("encoder", Kind::Which, false);
const SEGMENT: Field = ("segment", Kind::Which, false);
const SHARE: Kind = Kind::Number(0.0, 1.0);
const COUNT: Field = ("count", Kind::Whole(1, 1_000), false);
const OCTET: Field = ("octet", Kind::Whole(1, u64::MAX), true);
const MASK: Field = ("mask", Kind::Text("^(0[1-9A-Fa-f]|[1-9A-Fa-f][0-9A-Fa-f])$"), false);
const VOLTS: Kind = Kind::Number(-100.0, 100.0);
const CELSIUS: Kind = Kind::Number(-300.0, 300.0);

/// Every request.
const REQUESTS: &[(&str, &[Field])] = &[
    ("shaft", &[ENCODER, ("shaft", Kind::Shaft, true)]),
    ("supply", &[ENCODER, ("volts", VOLTS, true)]),
    ("temperature", &[ENCODER, ("celsius", CELSIUS, true)]),
    ("light", &[ENCODER, ("state", Kind::OneOf(&["ok", "low"]), true)]),
    ("battery", &[ENCODER, ("state", Kind::OneOf(&["ok", "low", "empty"]), true)]),
    ("switches", &[ENCODER, ("switches", Kind::Text("^[0-9A-Fa-f]{2}$"), true)]),
    ("power", &[ENCODER, ("state", Kind::OneOf(&["off", "on", "cycle"]), true)]),
    (
        "sensor",
        &[ENCODER, ("fault", Kind::OneOf(&["once", "held", "position_error", "turns_lost", "off"]), true)],
    ),
    (
        "memory",
        &[
            ENCODER,
            (
                "fault",
                Kind::OneOf(&[
                    "writes_fail",
                    "damage_a",
                    "damage_b",
                    "lost_at_power_on",
                    "torn_write",
                    "off",
                ]),
                true,
            ),
        ],
    ),
    ("operating_time", &[ENCODER, ("hours", Kind::Number(0.0, 1e7), true)]),
    ("leave", &[ENCODER]),
    ("join", &[ENCODER]),
    ("supply_profile", &[ENCODER, ("points", Kind::Points, true), ("repeat", Kind::Bool, false)]),
    ("brown_out", &[ENCODER, ("volts", VOLTS, true), ("for_s", Kind::Number(0.001, 1e9), true)]),
    (
        "thermal",
        &[
            ENCODER,
            ("ambient", CELSIUS, true),
            ("time_constant_s", Kind::Number(0.1, 1e9), false),
            ("kelvin_per_watt", Kind::Number(0.0, 1e3), false),
            ("watts", Kind::Number(0.0, 1e3), false),
        ],
    ),
    ("led_ageing", &[ENCODER, ("hours", Kind::Number(0.0, 1e6), true)]),
    (
        "discharge",
        &[
            ENCODER,
            ("charge", Kind::Number(0.0, 100.0), false),
            ("low", Kind::Number(0.0, 100.0), false),
            ("hours_without_power", Kind::Number(1e-6, 1e6), true),
            ("hours_with_power", Kind::NumberOrNull(1e-6, 1e6), false),
        ],
    ),
    ("endurance", &[ENCODER, ("writes", Kind::WholeOrNull, false)]),
    ("units", &[ENCODER, ("machine", Kind::Machine, false)]),
    ("termination", &[ENCODER, ("first", Kind::Bool, true), ("second", Kind::Bool, true)]),
    (
        "cut",
        &[SEGMENT, ("after", Kind::Whole(0, u64::MAX), true), ("master_after", Kind::WholeOrNull, false)],
    ),
    ("mend", &[SEGMENT]),
    ("reflections", &[SEGMENT, ("on", Kind::Bool, true)]),
    (
        "line",
        &[
            SEGMENT,
            ("seed", Kind::Whole(0, u64::MAX), false),
            ("bit_errors", SHARE, false),
            ("character_errors", SHARE, false),
            ("lost_requests", SHARE, false),
            ("lost_replies", SHARE, false),
            ("doubled_requests", SHARE, false),
            ("doubled_replies", SHARE, false),
            ("late_replies", SHARE, false),
            ("late_by_us", Kind::Whole(0, 10_000_000), false),
            ("bursts", SHARE, false),
            ("burst_length", Kind::Any, false),
            ("burst_bit_errors", Kind::Any, false),
        ],
    ),
    ("lose_requests", &[SEGMENT, COUNT]),
    ("lose_replies", &[SEGMENT, COUNT]),
    ("double_requests", &[SEGMENT, COUNT]),
    ("double_replies", &[SEGMENT, COUNT]),
    ("delay_replies", &[SEGMENT, ("by_us", Kind::Whole(0, 10_000_000), true), COUNT]),
    ("damage_request", &[SEGMENT, OCTET, MASK]),
    ("damage_reply", &[SEGMENT, OCTET, MASK]),
    ("character_error", &[SEGMENT, OCTET]),
    ("snapshot", &[ENCODER]),
    ("help", &[]),
    ("shutdown", &[]),
];

impl Kind {
    fn schema(self) -> Value {
        match self {
            Self::Which => json!({
                "description": "a name, a number from 1, or \"all\"; left out: the only one",
                "anyOf": [
                    { "type": "string" }, { "type": "integer", "minimum": 0 }, { "type": "null" },
                ],
            }),
            Self::Number(least, most) => json!({ "type": "number", "minimum": least, "maximum": most }),
            Self::Any => json!({ "type": "number" }),
            Self::Whole(least, most) => json!({ "type": "integer", "minimum": least, "maximum": most }),
            Self::Bool => json!({ "type": "boolean" }),
            Self::OneOf(all) => json!({ "enum": all }),
            Self::Text(pattern) => json!({ "type": "string", "pattern": pattern }),
            Self::Shaft => json!({
                "description": "as in docs/shafts.md: text, or fields with the kind beside them",
                "anyOf": [
                    { "type": "string", "examples": ["constant:60@here"] },
                    { "type": "object", "required": ["kind"], "examples": [{ "kind": "still" }] },
                ],
            }),
            Self::Points => json!({
                "type": "array", "minItems": 1,
                "items": {
                    "type": "array", "minItems": 2, "maxItems": 2, "items": { "type": "number" },
                },
            }),
            Self::Machine => json!({
                "type": ["object", "null"], "additionalProperties": false,
                "properties": {
                    "unit": { "type": "string" }, "zero": { "type": "integer" },
                    "per_turn": { "type": ["number", "null"] }, "drum": { "type": ["object", "null"] },
                },
            }),
            Self::WholeOrNull => json!({ "type": ["integer", "null"], "minimum": 0 }),
            Self::NumberOrNull(least, most) => {
                json!({ "type": ["number", "null"], "minimum": least, "maximum": most })
            }
        }
    }
}

/// One of the requests.
fn schema(name: &str, fields: &[Field]) -> Value {
    let mut properties = Map::new();
    properties.insert("do".to_owned(), json!({ "const": name }));
    properties.insert("id".to_owned(), json!({ "description": "anything; it comes back in the reply" }));
    properties.extend(fields.iter().map(|(name, kind, _)| ((*name).to_owned(), kind.schema())));
    let needed = fields.iter().filter(|(.., needed)| *needed).map(|(name, ..)| *name);
    let required: Vec<_> = std::iter::once("do").chain(needed).collect();
    json!({
        "title": name, "type": "object", "properties": properties, "required": required,
        "additionalProperties": false,
    })
}

/// Any of the requests.
pub(super) fn any() -> Value {
    let all: Vec<_> = REQUESTS.iter().map(|(name, fields)| schema(name, fields)).collect();
    json!({ "description": "a request of docs/control.md", "oneOf": all })
}

#[cfg(test)]
mod tests {
    use plant::control::{COMMANDS, Envelope};

    use super::*;

    /// A value of a kind that is fine.
    fn sample(name: &str, kind: Kind) -> Value {
        match kind {
            Kind::Which => json!(1),
            Kind::Number(least, most) | Kind::NumberOrNull(least, most) => json!(least.midpoint(most)),
            Kind::Any if name == "burst_length" => json!(10),
            Kind::Any => json!(0.1),
            Kind::Whole(least, _) => json!(least),
            Kind::WholeOrNull => json!(7),
            Kind::Bool => json!(true),
            Kind::OneOf(all) => json!(all[0]),
            Kind::Text(_) if name == "mask" => json!("81"),
            Kind::Text(_) => json!("2B"),
            Kind::Shaft => json!("still@0"),
            Kind::Points => json!([[0, 24]]),
            Kind::Machine => json!({ "per_turn": 0.5 }),
        }
    }

    fn full(name: &str, fields: &[Field]) -> Map<String, Value> {
        let mut request = Map::new();
        request.insert("do".to_owned(), name.into());
        request.extend(fields.iter().map(|(name, kind, _)| ((*name).to_owned(), sample(name, *kind))));
        request
    }

    fn read(request: &Map<String, Value>) -> Result<(), String> {
        let line = serde_json::to_vec(request).expect("JSON");
        let envelope = Envelope::parse(&line).map_err(|line| line.error)?;
        envelope.request.check().map_err(|error| error.to_string())
    }

    #[test]
    fn the_table_has_every_request_and_no_other() {
        let mut known: Vec<_> = COMMANDS.iter().map(|command| command.name).collect();
        // Those are for a connection of the control socket; here a stream has the events.
        known.retain(|name| !["subscribe", "unsubscribe"].contains(name));
        let mut described: Vec<_> = REQUESTS.iter().map(|(name, _)| *name).collect();
        known.sort_unstable();
        described.sort_unstable();
        assert_eq!(described, known);
    }

    #[test]
    fn every_request_is_read_as_it_is_described() {
        for (name, fields) in REQUESTS {
            let whole = full(name, fields);
            assert_eq!(read(&whole), Ok(()), "{name}");
            for (field, kind, needed) in *fields {
                let mut less = whole.clone();
                less.remove(*field);
                assert_eq!(read(&less).is_err(), *needed, "{name} without {field}");
                let mut more = whole.clone();
                more.insert(format!("{field}_too"), json!(1));
                assert!(read(&more).is_err(), "{name} with more");
                let mut wrong = whole.clone();
                wrong.insert((*field).to_owned(), json!([{}]));
                assert!(read(&wrong).is_err(), "{name}: {field} {kind:?}");
            }
        }
    }

    #[test]
    fn limits_are_those_that_are_kept() {
        for (name, fields) in REQUESTS {
            for (field, kind, _) in *fields {
                let mut request = full(name, fields);
                let mut with = |value: Value| {
                    request.insert((*field).to_owned(), value);
                    read(&request)
                };
                match kind {
                    Kind::Number(least, most) | Kind::NumberOrNull(least, most) => {
                        assert_eq!(with(json!(least)), Ok(()), "{name}: {field} {least}");
                        assert_eq!(with(json!(most)), Ok(()), "{name}: {field} {most}");
                    }
                    Kind::Whole(least, most) => {
                        assert_eq!(with(json!(least)), Ok(()), "{name}: {field} {least}");
                        assert_eq!(with(json!(most)), Ok(()), "{name}: {field} {most}");
                    }
                    Kind::OneOf(all) => {
                        all.iter().for_each(|one| assert_eq!(with(json!(one)), Ok(()), "{name}: {one}"));
                        assert!(with(json!("?")).is_err(), "{name}: {field}");
                    }
                    _ => {}
                }
            }
        }
    }

    #[test]
    fn the_examples_of_the_control_have_described_fields() {
        for command in COMMANDS {
            let Some((_, fields)) = REQUESTS.iter().find(|(name, _)| *name == command.name) else { continue };
            let example: Map<String, Value> = serde_json::from_str(command.example).expect("JSON");
            for field in example.keys().filter(|name| *name != "do") {
                assert!(fields.iter().any(|(name, ..)| name == field), "{}: {field}", command.name);
            }
        }
    }
}
