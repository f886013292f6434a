//! `POST /api/master`: what the built-in master is asked for.

use axum::extract::State;
use axum::http::StatusCode;
use axum::response::Response;
use plant::scenario::{MasterRefusal, MasterRequest};
use serde_json::json;

use super::body::Json;
use super::{App, answer};
use crate::problem::Problem;

/// What to write in place of what is none.
pub(crate) const EXAMPLE: &str = r#"{"do":"preset","value":1000000}"#;

pub(super) async fn master(State(app): State<App>, body: Json) -> Result<Response, Problem> {
    let request: MasterRequest = body.read(EXAMPLE)?;
    let done = app.ask(move |stage| {
        let scene = stage.scene();
        let Some(live) = &scene.live else {
            return Err(Problem::conflict(
                "the master of this bus is your own, and does what it is programmed to; a built-in one is in `demo \
                 --http` and in scenarios",
            ));
        };
        let answered = live.ask(request).ok_or_else(|| {
            Problem::conflict("the scenario is over, and its master with it; play it again, or stop it")
        })?;
        answered.map_err(|refusal| match refusal {
            MasterRefusal::Nobody(text) => Problem::new(StatusCode::NOT_FOUND, text),
            MasterRefusal::Value(text) => Problem::bad(text),
            MasterRefusal::Refused(text) => Problem::conflict(text),
        })
    });
    Ok(answer(&json!({ "ok": true, "answer": done.await? })))
}
