//! The endpoints.

mod body;
mod commands;
mod master;
mod scenarios;

use std::sync::Arc;

use axum::Router;
use axum::body::Body;
use axum::extract::{RawQuery, State};
use axum::http::{HeaderMap, StatusCode, Uri, header};
use axum::middleware::from_fn_with_state;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use plant::control::Turns;
use tokio::sync::{Semaphore, broadcast, watch};

use crate::guard::{Guard, guard};
use crate::problem::Problem;
use crate::publisher::Batch;
use crate::server::MOST_STREAMS;
use crate::stage::Stage;
use crate::{assets, stream, view};

/// What the endpoints share.
#[derive(Debug, Clone)]
pub(crate) struct App {
    pub(crate) stage: Arc<Stage>,
    batches: broadcast::Sender<Arc<Batch>>,
    ending: watch::Receiver<bool>,
    streams: Arc<Semaphore>,
    /// What all clients together may ask of the segments.
    turns: Arc<Turns>,
}

impl App {
    pub(crate) fn new(
        stage: Arc<Stage>,
        batches: broadcast::Sender<Arc<Batch>>,
        ending: watch::Receiver<bool>,
    ) -> Self {
        let streams = Arc::new(Semaphore::new(MOST_STREAMS));
        Self { stage, batches, ending, streams, turns: Arc::default() }
    }

    /// Does what has to wait for a segment, when it is its turn.
    pub(crate) async fn ask<R: Send + 'static>(
        &self,
        work: impl FnOnce(&Stage) -> Result<R, Problem> + Send + 'static,
    ) -> Result<R, Problem> {
        let (stage, turns) = (Arc::clone(&self.stage), Arc::clone(&self.turns));
        let done = tokio::task::spawn_blocking(move || {
            turns.take();
            work(&stage)
        });
        done.await.unwrap_or_else(|_| {
            Err(Problem::new(
                StatusCode::INTERNAL_SERVER_ERROR,
                "this is a fault of the program; please report it",
            ))
        })
    }

    /// Everything as it is now, in JSON.
    async fn snapshot(&self) -> Result<String, Problem> {
        self.ask(|stage| {
            let scene = stage.scene();
            let snapshot = scene
                .handle
                .snapshot()
                .map_err(|error| Problem::new(StatusCode::SERVICE_UNAVAILABLE, error.to_string()))?;
            Ok(view::of(&scene, &snapshot).to_string())
        })
        .await
    }
}

/// All that there is, behind the guard.
pub(crate) fn router(app: App, watch: Arc<Guard>) -> Router {
    Router::new()
        .route("/api/snapshot", get(snapshot))
        .route("/api/commands", post(commands::command))
        .route("/api/stream", get(events))
        .route("/api/master", post(master::master))
        .route("/api/scenarios", get(scenarios::all))
        .route("/api/scenarios/stop", post(scenarios::stop))
        .route("/api/scenarios/{name}/play", post(scenarios::play))
        .fallback(otherwise)
        .method_not_allowed_fallback(wrong_method)
        .with_state(app)
        .layer(from_fn_with_state(watch, guard))
}

/// An answer in JSON.
pub(crate) fn json(text: String) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], Body::from(text)).into_response()
}

/// A value as an answer.
pub(crate) fn answer(value: &serde_json::Value) -> Response {
    json(value.to_string())
}

async fn snapshot(State(app): State<App>) -> Result<Response, Problem> {
    Ok(json(app.snapshot().await?))
}

async fn events(State(app): State<App>, RawQuery(query): RawQuery) -> Result<Response, Problem> {
    let telegrams = match query.as_deref() {
        None | Some("" | "telegrams=on") => true,
        Some("telegrams=off") => false,
        Some(_) => {
            return Err(Problem::bad("write ?telegrams=off, ?telegrams=on or nothing behind /api/stream"));
        }
    };
    let place = Arc::clone(&app.streams).try_acquire_owned().map_err(|_| {
        let detail = format!("{MOST_STREAMS} streams are open already; close one of them and try again");
        Problem::new(StatusCode::TOO_MANY_REQUESTS, detail)
    })?;
    let batches = app.batches.subscribe();
    let first = app.snapshot().await?;
    Ok(stream::answer(&app.stage, batches, app.ending.clone(), place, telegrams, &first))
}

async fn otherwise(method: axum::http::Method, uri: Uri, headers: HeaderMap) -> Response {
    if method == axum::http::Method::GET || method == axum::http::Method::HEAD {
        return assets::serve(&uri, &headers);
    }
    let detail =
        format!("there is nothing to {method} at this address; GET /api/openapi.json lists what there is");
    Problem::new(StatusCode::NOT_FOUND, detail).into_response()
}

async fn wrong_method(method: axum::http::Method) -> Problem {
    let detail = format!("{method} is not for this address; the header Allow has what is");
    Problem::new(StatusCode::METHOD_NOT_ALLOWED, detail)
}
