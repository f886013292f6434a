//! What a technician does with a laptop at the end cap: `scan`, `diag`, `monitor`, `preset`, `set-address`.
//!
//! On any port, against any encoder of this kind. They ask as a light master does, one thing at a time;
//! [`session`] has the start-up that some of them need.

pub(crate) mod address;
pub(crate) mod diag;
pub(crate) mod find;
mod listen;
pub(crate) mod monitor;
pub(crate) mod names;
pub(crate) mod parameters;
pub(crate) mod place;
pub(crate) mod preset;
mod readings;
pub(crate) mod scan;
pub(crate) mod session;
mod watch;
pub(crate) mod words;

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use ::master::{Error, LightMaster, Wire};
use signal_hook::consts::{SIGINT, SIGTERM};

use crate::Failure;

/// The master that these commands ask with.
pub(crate) type Light = LightMaster<Wire>;

#[expect(clippy::needless_pass_by_value, reason = "for map_err")]
pub(crate) fn failed(error: Error) -> Failure {
    Failure::Failed(error.to_string())
}

/// Set by Ctrl-C and SIGTERM.
pub(crate) fn until_stopped() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .map_err(|error| Failure::Failed(format!("cannot take note of Ctrl-C: {error}")))?;
    }
    Ok(stop)
}

/// A span that is written in seconds on the command line.
pub(crate) fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds| (0.1..=86_400.0).contains(seconds));
    seconds.ok_or_else(|| "write seconds between 0.1 and 86400, like 10".to_owned())
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0.1 to 86400 s")]
pub(crate) fn span(seconds: f64) -> profibus_dp::time::Duration {
    profibus_dp::time::Duration::from_millis((seconds * 1e3) as u64)
}
