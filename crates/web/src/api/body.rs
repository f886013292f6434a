//! Bodies of requests: bounded in size and time, and JSON.

use std::time::Duration;

use axum::body::{Bytes, to_bytes};
use axum::extract::{FromRequest, Request};
use axum::http::{StatusCode, header};
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use tokio::time::timeout;

use crate::problem::Problem;
use crate::server::MOST_OCTETS;

/// A body comes within this time.
const PATIENCE: Duration = Duration::from_secs(10);

/// The octets of a body that says that it is JSON.
#[derive(Debug)]
pub(crate) struct Json(pub(crate) Bytes);

impl<S: Send + Sync> FromRequest<S> for Json {
    type Rejection = Problem;

    async fn from_request(request: Request, _: &S) -> Result<Self, Problem> {
        let media = request.headers().get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok());
        let media = media.map(|media| media.split(';').next().unwrap_or_default().trim());
        if !media.is_some_and(|media| media.eq_ignore_ascii_case("application/json")) {
            return Err(Problem::new(
                StatusCode::UNSUPPORTED_MEDIA_TYPE,
                "send JSON, with the header Content-Type: application/json",
            ));
        }
        octets(request).await.map(Self)
    }
}

impl Json {
    /// What the body is; `example`: what to write in place of what is none. Lists are none.
    pub(crate) fn read<T: DeserializeOwned>(&self, example: &str) -> Result<T, Problem> {
        read(&self.0, example)
    }
}

pub(crate) fn read<T: DeserializeOwned>(octets: &[u8], example: &str) -> Result<T, Problem> {
    let wrong = |error| Problem::bad(format!("{error}; write for example {example}"));
    let object: Map<String, Value> = serde_json::from_slice(octets).map_err(wrong)?;
    T::deserialize(Value::Object(object)).map_err(wrong)
}

/// All octets of a body.
pub(crate) async fn octets(request: Request) -> Result<Bytes, Problem> {
    let announced = request.headers().get(header::CONTENT_LENGTH).and_then(|value| value.to_str().ok());
    let announced: usize = announced.and_then(|value| value.parse().ok()).unwrap_or(0);
    let too_long = || {
        let detail = format!("the body has more than {MOST_OCTETS} octets; send a shorter one");
        Problem::new(StatusCode::PAYLOAD_TOO_LARGE, detail)
    };
    if announced > MOST_OCTETS {
        return Err(too_long());
    }
    match timeout(PATIENCE, to_bytes(request.into_body(), MOST_OCTETS)).await {
        Ok(Ok(octets)) => Ok(octets),
        Ok(Err(_)) => Err(too_long()),
        Err(_) => Err(Problem::new(StatusCode::REQUEST_TIMEOUT, "the body did not come; send it at once")),
    }
}
