//! `/api/recordings`: begun, ended, downloaded, removed.

use std::fs::File;
use std::io::Read;

use axum::body::{Body, Bytes};
use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use futures_util::stream::unfold;
use serde::Deserialize;
use serde_json::json;

use super::body::Json;
use super::{App, answer};
use crate::problem::Problem;
use crate::recordings::{Kind, Listed, Refusal};

/// What goes to a client at once.
const CHUNK: usize = 64 * 1024;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Start {
    kind: Kind,
    segment: Option<String>,
}

pub(super) async fn all(State(app): State<App>) -> Result<Response, Problem> {
    let all = app.ask(|stage| Ok(stage.recordings.list())).await?;
    Ok(answer(&json!({ "recordings": all })))
}

pub(super) async fn start(State(app): State<App>, body: Json) -> Result<Response, Problem> {
    let Start { kind, segment } = body.read(r#"{"kind":"csv"}"#)?;
    let started = app.ask(move |stage| {
        let scene = stage.scene();
        stage.recordings.start(&scene, kind, segment.as_deref()).map_err(|refusal| {
            let status = match refusal {
                Refusal::TooMany | Refusal::TooManyRun => StatusCode::TOO_MANY_REQUESTS,
                Refusal::NoSegment(..) => StatusCode::NOT_FOUND,
                Refusal::Several(_) => StatusCode::BAD_REQUEST,
                Refusal::Failed(_) => StatusCode::SERVICE_UNAVAILABLE,
            };
            Problem::new(status, refusal.to_string())
        })
    });
    Ok(listed(&started.await?))
}

pub(super) async fn stop(State(app): State<App>, Path(name): Path<String>) -> Result<Response, Problem> {
    let stopped = app.ask(move |stage| stage.recordings.stop(&name).ok_or_else(|| none(&name))).await?;
    Ok(listed(&stopped))
}

pub(super) async fn remove(State(app): State<App>, Path(name): Path<String>) -> Result<Response, Problem> {
    app.ask(move |stage| if stage.recordings.remove(&name) { Ok(()) } else { Err(none(&name)) }).await?;
    Ok(answer(&json!({ "ok": true })))
}

pub(super) async fn download(State(app): State<App>, Path(name): Path<String>) -> Result<Response, Problem> {
    let asked = name.clone();
    let file = app.ask(move |stage| {
        let path = stage.recordings.path(&asked).ok_or_else(|| none(&asked))?;
        File::open(path).map_err(|_| none(&asked))
    });
    let file = file.await?;
    let body = Body::from_stream(unfold(Some(file), |file| async move {
        let mut file = file?;
        let read = tokio::task::spawn_blocking(move || {
            let mut octets = vec![0; CHUNK];
            let count = file.read(&mut octets)?;
            octets.truncate(count);
            std::io::Result::Ok((octets, file))
        });
        match read.await {
            Ok(Ok((octets, _))) if octets.is_empty() => None,
            Ok(Ok((octets, file))) => Some((Ok(Bytes::from(octets)), Some(file))),
            Ok(Err(error)) => Some((Err(error), None)),
            Err(_) => None,
        }
    }));
    let headers = [
        (header::CONTENT_TYPE, "application/octet-stream".to_owned()),
        (header::CONTENT_DISPOSITION, format!("attachment; filename=\"{name}\"")),
    ];
    Ok((headers, body).into_response())
}

fn listed(listed: &Listed) -> Response {
    answer(&serde_json::to_value(listed).unwrap_or_default())
}

fn none(name: &str) -> Problem {
    let name = crate::assets::shortened(name);
    let detail = format!("there is no recording {name:?}; GET /api/recordings lists those that there are");
    Problem::new(StatusCode::NOT_FOUND, detail)
}
