//! The endpoints.

mod body;
mod commands;
mod master;
mod recordings;
mod scenarios;

use std::sync::Arc;

use axum::Router;
use axum::body::Body;
use axum::extract::{RawQuery, State};
use axum::http::{HeaderMap, StatusCode, Uri, header};
use axum::middleware::from_fn_with_state;
use axum::response::{IntoResponse, Response};
use axum::routing::{MethodRouter, delete, get, post};
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

/// An endpoint: how it is reached, what it takes and gives, and what serves it.
pub(crate) struct Endpoint {
    pub(crate) method: &'static str,
    pub(crate) path: &'static str,
    /// The name of the operation.
    pub(crate) id: &'static str,
    pub(crate) does: &'static str,
    /// What the answer is.
    pub(crate) done: &'static str,
    /// Where it stands, its name, its schema, and what it does.
    pub(crate) parameters: &'static [(&'static str, &'static str, &'static str, &'static str)],
    /// The schema of its body, and whether there has to be one.
    pub(crate) takes: Option<(&'static str, bool)>,
    pub(crate) gives: Gives,
    /// Statuses of problems, beside those of every endpoint.
    pub(crate) refuses: &'static [(u16, &'static str)],
    serve: fn() -> MethodRouter<App>,
}

/// What an endpoint gives.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Gives {
    /// JSON of a schema.
    Json(&'static str),
    /// Server-sent events.
    Events,
    /// A file.
    File,
}

const BODY: [(u16, &str); 4] = [
    (400, "the body is not what is meant"),
    (408, "the body did not come"),
    (413, "the body is too long"),
    (415, "the body is no JSON"),
];
const NO_SUCH: (u16, &str) = (404, "there is none of this name");
const NAME: (&str, &str, &str, &str) = ("path", "name", "Name", "which one");

/// All that there is beside the page.
pub(crate) const ENDPOINTS: &[Endpoint] = &[
    Endpoint {
        method: "GET",
        path: "/api/openapi.json",
        id: "openapi",
        does: "This document",
        done: "OpenAPI 3.1",
        parameters: &[],
        takes: None,
        gives: Gives::Json("Document"),
        refuses: &[],
        serve: || get(async || answer(&crate::openapi::document())),
    },
    Endpoint {
        method: "GET",
        path: "/api/snapshot",
        id: "snapshot",
        does: "Everything as it is now",
        done: "segments, encoders and the stage",
        parameters: &[],
        takes: None,
        gives: Gives::Json("Snapshot"),
        refuses: &[],
        serve: || get(snapshot),
    },
    Endpoint {
        method: "POST",
        path: "/api/commands",
        id: "command",
        does: "Change encoders, their world, the line or the cable",
        done: "it is done",
        parameters: &[],
        takes: Some(("Command", true)),
        gives: Gives::Json("Reply"),
        refuses: &[
            BODY[0],
            BODY[1],
            BODY[2],
            BODY[3],
            (404, "there is no such encoder or segment"),
            (409, "it does not fit what is there"),
        ],
        serve: || post(commands::command),
    },
    Endpoint {
        method: "POST",
        path: "/api/master",
        id: "master",
        does: "Have the built-in master do something",
        done: "it is done, and the encoder has not refused it",
        parameters: &[],
        takes: Some(("MasterRequest", true)),
        gives: Gives::Json("Answer"),
        refuses: &[
            BODY[0],
            BODY[1],
            BODY[2],
            BODY[3],
            (404, "the master asks no such encoder, or nobody answers"),
            (409, "the encoder refuses it, in its own words; or the master is not built in"),
        ],
        serve: || post(master::master),
    },
    Endpoint {
        method: "GET",
        path: "/api/stream",
        id: "stream",
        does: "Snapshots, events and telegrams as they come",
        done: "server-sent events: snapshot, event, telegrams",
        parameters: &[("query", "telegrams", "OnOff", "off leaves telegrams out")],
        takes: None,
        gives: Gives::Events,
        refuses: &[(400, "the query is none"), (429, "too many streams are open")],
        serve: || get(events),
    },
    Endpoint {
        method: "GET",
        path: "/api/scenarios",
        id: "scenarios",
        does: "The scenarios that can be played",
        done: "their names, titles and stories",
        parameters: &[],
        takes: None,
        gives: Gives::Json("Scenarios"),
        refuses: &[],
        serve: || get(scenarios::all),
    },
    Endpoint {
        method: "POST",
        path: "/api/scenarios/{name}/play",
        id: "play",
        does: "Play a scenario in place of what is shown",
        done: "it is shown",
        parameters: &[NAME],
        takes: Some(("Play", false)),
        gives: Gives::Json("Done"),
        refuses: &[BODY[0], BODY[1], BODY[2], NO_SUCH],
        serve: || post(scenarios::play),
    },
    Endpoint {
        method: "POST",
        path: "/api/scenarios/stop",
        id: "stop",
        does: "Show again what was there before",
        done: "it is shown",
        parameters: &[],
        takes: None,
        gives: Gives::Json("Done"),
        refuses: &[(409, "no scenario is played")],
        serve: || post(scenarios::stop),
    },
    Endpoint {
        method: "GET",
        path: "/api/recordings",
        id: "recordings",
        does: "The recordings that there are",
        done: "their names and sizes",
        parameters: &[],
        takes: None,
        gives: Gives::Json("Recordings"),
        refuses: &[],
        serve: || get(recordings::all),
    },
    Endpoint {
        method: "POST",
        path: "/api/recordings",
        id: "record",
        does: "Begin a recording: values over time (csv), or what is on a bus (pcapng)",
        done: "it runs",
        parameters: &[],
        takes: Some(("Record", true)),
        gives: Gives::Json("Recording"),
        refuses: &[
            BODY[0],
            BODY[1],
            BODY[2],
            BODY[3],
            (404, "there is no such segment"),
            (429, "there are too many"),
        ],
        serve: || post(recordings::start),
    },
    Endpoint {
        method: "POST",
        path: "/api/recordings/{name}/stop",
        id: "stop_recording",
        does: "End a recording",
        done: "its file is whole",
        parameters: &[NAME],
        takes: None,
        gives: Gives::Json("Recording"),
        refuses: &[NO_SUCH],
        serve: || post(recordings::stop),
    },
    Endpoint {
        method: "GET",
        path: "/api/recordings/{name}",
        id: "download",
        does: "The file of a recording, as far as it is",
        done: "the file",
        parameters: &[NAME],
        takes: None,
        gives: Gives::File,
        refuses: &[NO_SUCH],
        serve: || get(recordings::download),
    },
    Endpoint {
        method: "DELETE",
        path: "/api/recordings/{name}",
        id: "delete_recording",
        does: "End a recording and remove its file",
        done: "it is gone",
        parameters: &[NAME],
        takes: None,
        gives: Gives::Json("Done"),
        refuses: &[NO_SUCH],
        serve: || delete(recordings::remove),
    },
];

/// All that there is, behind the guard.
pub(crate) fn router(app: App, watch: Arc<Guard>) -> Router {
    let router = ENDPOINTS
        .iter()
        .fold(Router::new(), |router, endpoint| router.route(endpoint.path, (endpoint.serve)()));
    router
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
