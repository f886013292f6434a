//! The plant that is shown, and what is known of it beside its snapshot.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use plant::Handle;
use plant::control::Subscriptions;
use serde::Serialize;

use crate::wire::Wires;

/// What kind of plant is on the stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Encoders for the user's own master.
    Run,
    /// The demonstration, with its built-in master.
    Demo,
    /// A scenario that is played.
    Scenario,
}

/// What a server shows.
pub struct Setup {
    /// What it is.
    pub kind: Kind,
    /// What it is called.
    pub title: String,
    /// The hand on it.
    pub handle: Handle,
    /// What happens in it.
    pub subscriptions: Subscriptions,
    /// Called when a client asks for the end of the program; it must not wait for the server.
    pub on_shutdown: Box<dyn Fn() + Send + Sync>,
}

impl std::fmt::Debug for Setup {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Setup").field("kind", &self.kind).field("title", &self.title).finish_non_exhaustive()
    }
}

/// A plant with all that a server needs of it.
#[derive(Debug)]
pub(crate) struct Scene {
    pub(crate) kind: Kind,
    pub(crate) title: String,
    pub(crate) handle: Handle,
    pub(crate) subscriptions: Subscriptions,
    pub(crate) wires: Wires,
}

/// Which plant is shown.
pub(crate) struct Stage {
    shown: Mutex<Arc<Scene>>,
    pub(crate) on_shutdown: Box<dyn Fn() + Send + Sync>,
    /// Streams that want telegrams.
    pub(crate) telegram_readers: AtomicUsize,
    /// Grows whenever another plant is shown.
    pub(crate) changes: AtomicU64,
}

impl std::fmt::Debug for Stage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Stage").field("shown", &self.shown).finish_non_exhaustive()
    }
}

impl Stage {
    pub(crate) fn new(setup: Setup) -> Self {
        let Setup { kind, title, handle, subscriptions, on_shutdown } = setup;
        let wires = Wires::new(&handle);
        let scene = Scene { kind, title, handle, subscriptions, wires };
        Self {
            shown: Mutex::new(Arc::new(scene)),
            on_shutdown,
            telegram_readers: AtomicUsize::new(0),
            changes: AtomicU64::new(0),
        }
    }

    /// What is shown now.
    pub(crate) fn scene(&self) -> Arc<Scene> {
        Arc::clone(&self.shown.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Whether anybody wants to see telegrams.
    pub(crate) fn wants_telegrams(&self) -> bool {
        self.telegram_readers.load(Ordering::Relaxed) > 0
    }
}
