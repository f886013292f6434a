//! `POST /api/commands`: the requests of docs/control.md.

use axum::extract::State;
use axum::http::StatusCode;
use axum::response::Response;
use plant::control::{ControlError, Envelope, Reply, Request};

use super::body::Json;
use super::{App, json};
use crate::problem::Problem;

pub(super) async fn command(State(app): State<App>, Json(body): Json) -> Result<Response, Problem> {
    let Envelope { id, request } = Envelope::parse(&body).map_err(|line| Problem::bad(line.error))?;
    let result = match &request {
        Request::Shutdown {} => {
            (app.stage.on_shutdown)();
            None
        }
        Request::Subscribe {} | Request::Unsubscribe {} => {
            return Err(Problem::bad(format!(
                "{} is for the control socket; here GET /api/stream has the events",
                request.name()
            )));
        }
        _ => {
            app.ask(move |stage| stage.scene().handle.apply(&request).map_err(|error| refused(&error)))
                .await?
        }
    };
    let reply = Reply::done(id, result);
    Ok(json(serde_json::to_string(&reply).unwrap_or_default()))
}

/// Why the plant does not do it.
pub(super) fn refused(error: &ControlError) -> Problem {
    let status = match error {
        ControlError::Nobody { .. } => StatusCode::NOT_FOUND,
        ControlError::Store(_) | ControlError::Preset(_) => StatusCode::CONFLICT,
        ControlError::Plant(_) => StatusCode::SERVICE_UNAVAILABLE,
        _ => StatusCode::BAD_REQUEST,
    };
    Problem::new(status, error.to_string())
}
