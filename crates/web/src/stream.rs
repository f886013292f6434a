//! `GET /api/stream`: server-sent events.
//!
//! Who does not read loses batches, and is told how many telegrams and events were in them.

use std::convert::Infallible;
use std::fmt::Write;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use axum::body::{Body, Bytes};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use futures_util::future::{Either, select};
use futures_util::stream::unfold;
use plant::control::EventLine;
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::{OwnedSemaphorePermit, broadcast, watch};
use tokio::time::timeout;

use crate::publisher::Batch;
use crate::stage::Stage;

/// Something comes at least this often.
const HEARTBEAT: Duration = Duration::from_secs(1);

/// One reader.
struct Stream {
    batches: broadcast::Receiver<Arc<Batch>>,
    ending: watch::Receiver<bool>,
    /// Counts it among those who want telegrams.
    telegrams: Option<Wanted>,
    /// What is sent before anything else.
    first: Option<String>,
    /// How far it has read telegrams and events.
    read: Option<[u64; 2]>,
    _place: OwnedSemaphorePermit,
}

/// Somebody wants telegrams as long as this is there.
struct Wanted(Arc<Stage>);

impl Wanted {
    fn new(stage: Arc<Stage>) -> Self {
        stage.telegram_readers.fetch_add(1, Ordering::Relaxed);
        Self(stage)
    }
}

impl Drop for Wanted {
    fn drop(&mut self) {
        self.0.telegram_readers.fetch_sub(1, Ordering::Relaxed);
    }
}

/// The answer that goes on until its reader or the server goes. `snapshot`: what it begins with.
pub(crate) fn answer(
    stage: &Arc<Stage>,
    batches: broadcast::Receiver<Arc<Batch>>,
    ending: watch::Receiver<bool>,
    place: OwnedSemaphorePermit,
    telegrams: bool,
    snapshot: &str,
) -> Response {
    let stream = Stream {
        batches,
        ending,
        telegrams: telegrams.then(|| Wanted::new(Arc::clone(stage))),
        first: Some(format!("retry: 1000\n\nevent: snapshot\ndata: {snapshot}\n\n")),
        read: None,
        _place: place,
    };
    let body = Body::from_stream(unfold(stream, |mut stream| async {
        let text = stream.next().await?;
        Some((Ok::<_, Infallible>(Bytes::from(text)), stream))
    }));
    let headers = [(header::CONTENT_TYPE, "text/event-stream"), (header::CACHE_CONTROL, "no-store")];
    (headers, body).into_response()
}

impl Stream {
    /// The next text; `None` at the end.
    async fn next(&mut self) -> Option<String> {
        if let Some(first) = self.first.take() {
            return Some(first);
        }
        loop {
            let batch = timeout(HEARTBEAT, self.batches.recv());
            let ends = self.ending.wait_for(|ends| *ends);
            let next = match select(pin!(batch), pin!(ends)).await {
                Either::Left((next, _)) => next,
                Either::Right(_) => return None,
            };
            match next {
                Err(_) => return Some(": nothing new\n\n".to_owned()),
                Ok(Err(RecvError::Closed)) => return None,
                // The counters of the next batch tell how much that was.
                Ok(Err(RecvError::Lagged(_))) => {}
                Ok(Ok(batch)) => {
                    let text = self.text(&batch);
                    if !text.is_empty() {
                        return Some(text);
                    }
                }
            }
        }
    }

    fn text(&mut self, batch: &Batch) -> String {
        let [seen, told] = self.read.unwrap_or([batch.seen[0], batch.told[0]]);
        self.read = Some([batch.seen[1], batch.told[1]]);
        let mut text = String::new();
        let missed = batch.told[0].saturating_sub(told);
        if missed > 0 {
            let line = serde_json::to_string(&EventLine::dropped(missed)).unwrap_or_default();
            let _ = write!(text, "event: event\ndata: {line}\n\n");
        }
        for event in &batch.events {
            let _ = write!(text, "event: event\ndata: {event}\n\n");
        }
        if self.telegrams.is_some() {
            let dropped = (batch.seen[1] - seen.min(batch.seen[1])).saturating_sub(batch.shown);
            if dropped > 0 || batch.shown > 0 {
                let _ = write!(
                    text,
                    "event: telegrams\ndata: {{\"dropped\":{dropped},\"telegrams\":{}}}\n\n",
                    batch.telegrams
                );
            }
        }
        if let Some(snapshot) = &batch.snapshot {
            let _ = write!(text, "event: snapshot\ndata: {snapshot}\n\n");
        }
        text
    }
}
