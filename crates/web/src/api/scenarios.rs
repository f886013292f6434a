//! `/api/scenarios`: those that come with the program, played on the stage.

use axum::extract::{Path, Request, State};
use axum::http::StatusCode;
use axum::response::Response;
use serde::Deserialize;
use serde_json::json;

use super::body::{octets, read};
use super::{App, answer};
use crate::live::FACTORS;
use crate::problem::Problem;
use crate::scenarios::{list, load};

pub(super) async fn all() -> Response {
    answer(&json!({ "scenarios": list() }))
}

/// How to play one.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Play {
    #[serde(default = "one")]
    factor: f64,
}

const fn one() -> f64 {
    1.0
}

pub(super) async fn play(
    State(app): State<App>,
    Path(name): Path<String>,
    request: Request,
) -> Result<Response, Problem> {
    let body = octets(request).await?;
    let Play { factor } =
        if body.is_empty() { Play { factor: one() } } else { read(&body, r#"{"factor":1}"#)? };
    if !FACTORS.contains(&factor) {
        let (least, most) = FACTORS.into_inner();
        return Err(Problem::bad(format!("factor is a number from {least} to {most}")));
    }
    let loaded = load(&name).ok_or_else(|| {
        let name = crate::assets::shortened(&name);
        Problem::new(
            StatusCode::NOT_FOUND,
            format!("there is no scenario {name:?}; GET /api/scenarios lists those that there are"),
        )
    })?;
    app.ask(move |stage| {
        stage.play(&name, loaded, factor).map_err(|error| {
            Problem::new(StatusCode::SERVICE_UNAVAILABLE, format!("it cannot be played: {error}"))
        })
    })
    .await?;
    Ok(answer(&json!({ "ok": true })))
}

pub(super) async fn stop(State(app): State<App>) -> Result<Response, Problem> {
    let stopped = app.ask(|stage| Ok(stage.stop())).await?;
    if stopped {
        return Ok(answer(&json!({ "ok": true })));
    }
    Err(Problem::conflict("no scenario is played; POST /api/scenarios/NAME/play begins one"))
}
