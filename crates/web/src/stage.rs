//! The plant that is shown, and what is known of it beside its snapshot.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use plant::Handle;
use plant::control::Subscriptions;
use plant::scenario::RunError;
use serde::Serialize;

use crate::live::Live;
use crate::recordings::Recordings;
use crate::scenarios::{self, Loaded};
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

/// The plant that a server shows.
#[derive(Debug)]
pub enum Shown {
    /// One that others run.
    Plant {
        /// What it is.
        kind: Kind,
        /// What it is called.
        title: String,
        /// The hand on it.
        handle: Handle,
        /// What happens in it.
        subscriptions: Subscriptions,
    },
    /// The demonstration: the server runs it itself.
    Demonstration,
}

/// What a server is given.
pub struct Setup {
    /// What it shows.
    pub shown: Shown,
    /// Called when a client asks for the end of the program; it must not wait for the server.
    pub on_shutdown: Box<dyn Fn() + Send + Sync>,
}

impl std::fmt::Debug for Setup {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Setup").field("shown", &self.shown).finish_non_exhaustive()
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
    /// What the server runs itself.
    pub(crate) live: Option<Live>,
}

/// Which plant is shown.
pub(crate) struct Stage {
    /// The one of the program.
    own: Arc<Scene>,
    shown: Mutex<Arc<Scene>>,
    pub(crate) recordings: Recordings,
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

impl Scene {
    fn of_live(kind: Kind, title: String, live: Live) -> Self {
        let (handle, subscriptions) = (live.handle.clone(), live.subscriptions.clone());
        let wires = Wires::new(&handle);
        Self { kind, title, handle, subscriptions, wires, live: Some(live) }
    }
}

impl Stage {
    pub(crate) fn new(setup: Setup) -> Result<Self, RunError> {
        let Setup { shown, on_shutdown } = setup;
        let scene = match shown {
            Shown::Plant { kind, title, handle, subscriptions } => {
                let wires = Wires::new(&handle);
                Scene { kind, title, handle, subscriptions, wires, live: None }
            }
            Shown::Demonstration => {
                let Loaded { plan, source } = scenarios::demonstration();
                let title = plan.title.clone();
                Scene::of_live(Kind::Demo, title, Live::start("demonstration", plan, source, 1.0)?)
            }
        };
        let own = Arc::new(scene);
        Ok(Self {
            shown: Mutex::new(Arc::clone(&own)),
            own,
            recordings: Recordings::default(),
            on_shutdown,
            telegram_readers: AtomicUsize::new(0),
            changes: AtomicU64::new(0),
        })
    }

    /// What is shown now.
    pub(crate) fn scene(&self) -> Arc<Scene> {
        Arc::clone(&self.shown())
    }

    /// Shows a scenario in place of what was shown.
    pub(crate) fn play(&self, name: &str, loaded: Loaded, factor: f64) -> Result<(), RunError> {
        let Loaded { plan, source } = loaded;
        let title = plan.title.clone();
        let scene = Scene::of_live(Kind::Scenario, title, Live::start(name, plan, source, factor)?);
        self.show(Arc::new(scene));
        Ok(())
    }

    /// The program's own plant again; whether another was shown.
    pub(crate) fn stop(&self) -> bool {
        !Arc::ptr_eq(&self.show(Arc::clone(&self.own)), &self.own)
    }

    /// What was shown before.
    fn show(&self, scene: Arc<Scene>) -> Arc<Scene> {
        let before = std::mem::replace(&mut *self.shown(), scene);
        self.changes.fetch_add(1, Ordering::Release);
        before
    }

    fn shown(&self) -> MutexGuard<'_, Arc<Scene>> {
        // Each change is whole by itself, so a panic elsewhere does not matter.
        self.shown.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether anybody wants to see telegrams.
    pub(crate) fn wants_telegrams(&self) -> bool {
        self.telegram_readers.load(Ordering::Relaxed) > 0
    }
}
