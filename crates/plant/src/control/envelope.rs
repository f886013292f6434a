//! Requests and replies as lines.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::control::apply::Applied;
use crate::control::commands::{FIRST, advice};
use crate::control::request::Request;

/// A request as it came, with what its sender calls it.
#[derive(Debug, Clone, PartialEq)]
pub struct Envelope {
    /// Any JSON value, echoed in the reply.
    pub id: Option<Value>,
    /// What is asked for.
    pub request: Request,
}

/// A line that is no request, and the sentence about it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{error}")]
pub struct RefusedLine {
    /// What its sender calls it, where that could be read.
    pub id: Option<Value>,
    /// What is wrong, and what to write instead.
    pub error: String,
}

/// What came of a request.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reply {
    /// As in the request.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub id: Option<Value>,
    /// Whether it was done.
    pub ok: bool,
    /// If not: why, and what to write instead.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// What was asked for.
    #[serde(flatten)]
    pub result: Option<Applied>,
}

impl Envelope {
    /// Reads a line.
    ///
    /// # Errors
    ///
    /// It is no JSON object, or none of the requests; the sentence says what to write instead.
    pub fn parse(line: &[u8]) -> Result<Self, RefusedLine> {
        let mut object: Map<String, Value> = serde_json::from_slice(line).map_err(|error| RefusedLine {
            id: None,
            error: format!("this is no JSON object ({error}); write one on each line, like {FIRST}"),
        })?;
        let id = object.remove("id");
        let Some(Value::String(name)) = object.get("do").cloned() else {
            let error = format!("\"do\" is missing, which names the request; write for example {FIRST}");
            return Err(RefusedLine { id, error });
        };
        match Request::deserialize(Value::Object(object)) {
            Ok(request) => Ok(Self { id, request }),
            Err(error) => Err(RefusedLine { id, error: advice(&name, &error.to_string()) }),
        }
    }
}

impl Reply {
    /// It was done.
    pub const fn done(id: Option<Value>, result: Option<Applied>) -> Self {
        Self { id, ok: true, error: None, result }
    }

    /// It was not.
    pub const fn refused(id: Option<Value>, error: String) -> Self {
        Self { id, ok: false, error: Some(error), result: None }
    }
}
