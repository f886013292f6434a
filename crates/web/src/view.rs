//! A snapshot as the page has it: that of the control socket, and more.

use plant::PlantSnapshot;
use serde_json::{Map, Value, json};

use crate::stage::Scene;

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
}

fn stage(scene: &Scene, snapshot: &PlantSnapshot) -> Value {
    let clock = snapshot.segments.iter().map(|segment| segment.at.as_nanos()).max();
    json!({
        "kind": scene.kind,
        "title": scene.title,
        "time_factor": 1,
        "clock_ns": clock.unwrap_or_default(),
        "master": "foreign",
        "playing": null,
    })
}
