//! Replies and events as people read them.

use serde_json::Value;

use super::order;
use crate::output;

/// Prints what a reply has beyond that it was done.
pub(super) fn reply(reply: &Value) {
    if let Some(commands) = reply["commands"].as_array() {
        for command in commands {
            output::line(&format!("{}\n    {}", text(&command["example"]), text(&command["does"])));
        }
    }
    if reply["encoder"].is_object() {
        tree(&reply["encoder"], 0);
    }
    for part in ["segments", "encoders"] {
        for (number, one) in (1..).zip(reply["snapshot"][part].as_array().into_iter().flatten()) {
            output::line(&format!("{} {number}: {}", &part[..part.len() - 1], text(&one["name"])));
            tree(one, 1);
        }
    }
}

/// An event as `run` prints it.
pub(super) fn event(line: &str) -> String {
    let Ok(event) = serde_json::from_str::<Value>(line) else {
        return line.to_owned();
    };
    let sentence = text(&event["text"]);
    match (event["at_ns"].as_u64(), event["who"].as_str()) {
        (Some(nanos), Some(who)) => {
            #[expect(clippy::cast_precision_loss, reason = "for reading only")]
            let seconds = nanos as f64 / 1e9;
            format!("{seconds:11.6}  {who}: {sentence}")
        }
        _ => format!("             {sentence}"),
    }
}

/// One value a line, what belongs together indented.
fn tree(value: &Value, depth: usize) {
    let indent = "  ".repeat(depth);
    let mut values: Vec<_> = value.as_object().into_iter().flatten().collect();
    values.sort_by_key(|(name, _)| order::place(name));
    for (name, value) in values {
        let name = name.replace('_', " ");
        if value.is_object() {
            output::line(&format!("{indent}{name}:"));
            tree(value, depth + 1);
        } else {
            output::line(&format!("{indent}{name}: {}", text(value)));
        }
    }
}

fn text(value: &Value) -> String {
    match value {
        Value::Null => "none".to_owned(),
        Value::Bool(true) => "yes".to_owned(),
        Value::Bool(false) => "no".to_owned(),
        Value::String(text) => text.clone(),
        Value::Array(values) if values.is_empty() => "none".to_owned(),
        Value::Array(values) => values.iter().map(text).collect::<Vec<_>>().join(", ").replace('_', " "),
        other => other.to_string(),
    }
}
