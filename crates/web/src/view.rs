//! A snapshot as the page has it: that of the control socket, and more.

use dissector::Profile;
use dissector::advice::Diagnosis;
use plant::PlantSnapshot;
use sch108bex::parameterization::TimeBase;
use serde_json::{Map, Value, json};

use crate::live::Live;
use crate::stage::{Kind, Scene};

/// The whole of it.
pub(crate) fn of(scene: &Scene, snapshot: &PlantSnapshot) -> Value {
    let mut view = serde_json::to_value(snapshot).unwrap_or_default();
    let owners: Vec<(String, usize)> =
        scene.handle.segments().map(|(name, encoders)| (name.to_owned(), encoders.count())).collect();
    let segments = owners.iter().flat_map(|(name, count)| std::iter::repeat_n(name, *count));
    if let Some(encoders) = view.get_mut("encoders").and_then(Value::as_array_mut) {
        for ((encoder, plain), segment) in encoders.iter_mut().zip(&snapshot.encoders).zip(segments) {
            if let Value::Object(fields) = encoder {
                more(fields, plain, segment);
            }
        }
    }
    if let Value::Object(fields) = &mut view {
        fields.insert("stage".to_owned(), stage(scene, snapshot));
    }
    view
}

fn more(fields: &mut Map<String, Value>, encoder: &plant::Snapshot, segment: &str) {
    let switches = encoder.switches.0;
    let termination = encoder.termination;
    fields.insert("segment".to_owned(), segment.into());
    fields.insert(
        "cap".to_owned(),
        json!({
            "x16": switches >> 4, "x1": switches & 0x0F,
            "terminated_first": termination.first, "terminated_second": termination.second,
        }),
    );
    machine(fields, encoder);
    if let (Some(Value::Object(view)), Some(device)) = (fields.get_mut("device"), &encoder.device) {
        let time_base = match device.time_base {
            TimeBase::Per10Ms => "10_ms",
            TimeBase::Per100Ms => "100_ms",
            TimeBase::Per1000Ms => "1000_ms",
            TimeBase::Rpm => "rpm",
        };
        view.insert("time_base".to_owned(), time_base.into());
        view.insert("scaling".to_owned(), device.scaling.is_on().into());
        view.insert("diagnosis".to_owned(), diagnosis(device.diagnosis.octets()));
    }
}

/// What the device would answer to Slave_Diag, in words.
fn diagnosis(octets: &[u8]) -> Value {
    let Some(Diagnosis { octets, summary, findings, .. }) = Diagnosis::read_as(octets, Profile::Encoder)
    else {
        return Value::Null;
    };
    let words = findings.into_iter().map(|finding| {
        let advice = Some(&finding.advice).filter(|advice| !advice.is_empty());
        json!({
            "octets": finding.octets, "bit": finding.bit, "level": finding.level, "name": finding.name,
            "text": finding.text, "advice": advice,
        })
    });
    let mut words: Vec<_> = words.collect();
    if words.is_empty() {
        let text = "nothing is wrong: data are exchanged";
        words.push(json!({
            "octets": [1, 1], "bit": null, "level": "fine", "name": "fine", "text": text, "advice": null,
        }));
    }
    json!({ "octets": octets, "summary": summary, "words": words })
}

/// The machine's speed in its unit, and units for a turn where that is always the same.
fn machine(fields: &mut Map<String, Value>, encoder: &plant::Snapshot) {
    let Some(machine) = &encoder.machine else { return };
    if let Some(Value::Object(view)) = fields.get_mut("machine") {
        view.insert("per_turn".to_owned(), machine.per_turn.into());
        view.insert("speed".to_owned(), machine.speed.into());
    }
}

fn stage(scene: &Scene, snapshot: &PlantSnapshot) -> Value {
    let clock = snapshot.segments.iter().map(|segment| segment.at.as_nanos()).max();
    let playing = scene.live.as_ref().filter(|_| scene.kind == Kind::Scenario).map(Live::state);
    json!({
        "kind": scene.kind,
        "title": scene.title,
        "time_factor": scene.live.as_ref().map_or(1.0, |live| live.factor),
        "clock_ns": clock.unwrap_or_default(),
        "master": if scene.live.is_some() { "built_in" } else { "foreign" },
        "playing": playing,
    })
}
