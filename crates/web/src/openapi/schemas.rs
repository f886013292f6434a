//! The schemas by their names.

use serde_json::{Value, json};

use super::{commands, reference};

/// All of them.
pub(super) fn all() -> Value {
    let mut all = asked();
    for part in [shown(), kept()] {
        if let (Value::Object(all), Value::Object(part)) = (&mut all, part) {
            all.extend(part);
        }
    }
    all
}

fn refer(name: &str) -> Value {
    json!({ "$ref": reference(name) })
}

fn nullable(name: &str) -> Value {
    json!({ "anyOf": [refer(name), { "type": "null" }] })
}

/// What is asked for, and the short answers.
fn asked() -> Value {
    let which = json!({ "anyOf": [
        { "type": "string" }, { "type": "integer", "minimum": 0 }, { "type": "null" },
    ] });
    json!({
        "Problem": object(&json!({
            "type": { "const": "about:blank" }, "title": text(), "status": whole(400, 599), "detail": text(),
        })),
        "Document": { "type": "object" },
        "Command": commands::any(),
        "Reply": {
            "description": "what was asked for stands beside ok",
            "type": "object", "required": ["ok"],
            "properties": {
                "ok": { "const": true }, "id": {}, "snapshot": { "type": "object" }, "encoder": { "type": "object" },
                "commands": { "type": "array" },
            },
            "additionalProperties": false,
        },
        "Done": object(&json!({ "ok": { "const": true } })),
        "Answer": object(&json!({ "ok": { "const": true }, "answer": { "type": "object" } })),
        "MasterRequest": { "oneOf": [
            master("preset", &json!({ "encoder": which, "value": whole(0, 0x7FFF_FFFF) }), &["value"]),
            master(
                "parameterize",
                &json!({
                    "encoder": which, "functionality": { "enum": ["class_1", "class_2", "scancon_2"] },
                    "code_sequence": { "enum": ["clockwise", "counter_clockwise"] },
                    "scaling": { "type": "boolean" },
                    "measuring_units_per_revolution": steps(), "total_measuring_range": steps(),
                    "time_base": { "enum": ["10_ms", "100_ms", "1000_ms", "rpm"] },
                }),
                &["functionality"],
            ),
            master("set_address", &json!({ "from": whole(0, 126), "to": whole(0, 125) }), &["from", "to"]),
            master("sync", &json!({}), &[]),
            master("unsync", &json!({}), &[]),
            master("freeze", &json!({}), &[]),
            master("unfreeze", &json!({}), &[]),
            master("unlock", &json!({ "encoder": which }), &[]),
        ] },
    })
}

/// The plant and the stage.
fn shown() -> Value {
    json!({
        "Snapshot": {
            "type": "object", "required": ["segments", "encoders", "stage"],
            "properties": {
                "segments": { "type": "array", "items": { "type": "object", "required": ["name", "at_ns"] } },
                "encoders": { "type": "array", "items": refer("Encoder") },
                "stage": refer("Stage"),
            },
        },
        "Encoder": {
            "description": "as in docs/control.md, and more",
            "type": "object", "required": ["name", "segment", "cap", "volts", "device"],
            "properties": {
                "name": text(), "segment": text(), "volts": { "type": "number" },
                "cap": object(&json!({
                    "x16": whole(0, 15), "x1": whole(0, 15), "terminated_first": { "type": "boolean" },
                    "terminated_second": { "type": "boolean" },
                })),
                "device": nullable("Device"),
            },
        },
        "Device": {
            "type": "object", "required": ["state", "position", "velocity", "acceleration", "diagnosis", "time_base"],
            "properties": {
                "state": { "enum": ["wait_prm", "wait_cfg", "data_exchange"] },
                "position": whole(0, u32::MAX.into()),
                "time_base": { "enum": ["10_ms", "100_ms", "1000_ms", "rpm"] },
                "scaling": { "type": "boolean" },
                "diagnosis": refer("Diagnosis"),
            },
        },
        "Diagnosis": object(&json!({
            "octets": text(), "summary": text(),
            "words": { "type": "array", "items": object(&json!({
                "octets": { "type": "array", "items": { "type": "integer" }, "minItems": 2, "maxItems": 2 },
                "bit": { "type": ["integer", "null"] },
                "level": { "enum": ["alarm", "warning", "note", "fine"] },
                "name": text(), "text": text(), "advice": { "type": ["string", "null"] },
            })) },
        })),
        "Stage": object(&json!({
            "kind": { "enum": ["run", "demo", "scenario"] }, "title": text(),
            "time_factor": { "type": "number" }, "clock_ns": { "type": "integer" },
            "master": { "enum": ["built_in", "foreign"] }, "playing": nullable("Playing"),
        })),
        "Playing": object(&json!({
            "scenario": text(), "state": { "enum": ["playing", "passed", "failed", "stopped"] },
            "at_s": { "type": "number" }, "seconds": { "type": "number" },
            "expectations": { "type": "array", "items": object(&json!({
                "line": { "type": "integer" }, "text": text(), "state": { "enum": ["waiting", "held", "failed"] },
                "why": { "type": ["string", "null"] },
            })) },
            "troubles": { "type": "array", "items": text() },
        })),
    })
}

/// Scenarios and recordings.
fn kept() -> Value {
    json!({
        "Scenarios": object(&json!({ "scenarios": { "type": "array", "items": object(&json!({
            "name": text(), "title": text(), "story": text(), "seconds": { "type": "number" },
        })) } })),
        "Play": {
            "type": "object", "additionalProperties": false,
            "properties": { "factor": { "type": "number", "minimum": 0.01, "maximum": 1_000 } },
        },
        "Record": {
            "type": "object", "additionalProperties": false, "required": ["kind"],
            "properties": {
                "kind": { "enum": ["csv", "pcapng"] },
                "segment": { "description": "for pcapng; left out: the only one", "type": ["string", "null"] },
            },
        },
        "Recording": object(&json!({
            "name": text(), "kind": { "enum": ["csv", "pcapng"] }, "octets": { "type": "integer" },
            "running": { "type": "boolean" }, "trouble": { "type": ["string", "null"] },
        })),
        "Recordings": object(&json!({ "recordings": { "type": "array", "items": refer("Recording") } })),
        "Name": { "type": "string", "minLength": 1, "maxLength": 100, "pattern": "^[a-z0-9.-]+$" },
        "OnOff": { "enum": ["on", "off"] },
    })
}

/// All of these fields, and no other.
fn object(properties: &Value) -> Value {
    let required: Vec<_> = properties.as_object().into_iter().flat_map(|fields| fields.keys()).collect();
    json!({
        "type": "object", "required": required, "properties": properties, "additionalProperties": false,
    })
}

fn master(name: &str, fields: &Value, required: &[&str]) -> Value {
    let mut properties = fields.clone();
    properties["do"] = json!({ "const": name });
    let required: Vec<_> = std::iter::once("do").chain(required.iter().copied()).collect();
    json!({
        "title": name, "type": "object", "required": required, "properties": properties,
        "additionalProperties": false,
    })
}

fn text() -> Value {
    json!({ "type": "string" })
}

fn whole(least: u64, most: u64) -> Value {
    json!({ "type": "integer", "minimum": least, "maximum": most })
}

fn steps() -> Value {
    json!({ "type": ["integer", "null"], "minimum": 0, "maximum": u32::MAX })
}
