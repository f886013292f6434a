//! Twenty times a second: what there is to show, to all streams at once.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use plant::PlantSnapshot;
use plant::control::{EventLine, Item, Subscription};
use tokio::sync::broadcast;

use crate::stage::{Scene, Stage};
use crate::view;
use crate::wire::Taken;

/// How often.
const PERIOD: Duration = Duration::from_millis(50);
/// A snapshot comes so often, even where nothing changes.
const QUIET: Duration = Duration::from_millis(900);
/// Reports of a telegram come this much later than the telegram.
const REPORTS_FOLLOW: Duration = Duration::from_millis(2);
/// Recordings are looked at so often.
const LOOK: Duration = Duration::from_millis(500);
/// So many batches wait for a stream; older ones are lost to it.
const MOST_WAITING: usize = 32;

/// What all streams get at a moment.
#[derive(Debug, Default)]
pub(crate) struct Batch {
    /// In JSON.
    pub(crate) snapshot: Option<String>,
    /// Each in JSON.
    pub(crate) events: Vec<String>,
    /// A list in JSON.
    pub(crate) telegrams: String,
    /// How many are in it.
    pub(crate) shown: u64,
    /// All telegrams that were seen before, and with this batch.
    pub(crate) seen: [u64; 2],
    /// The same of events.
    pub(crate) told: [u64; 2],
}

/// Makes batches until it is dropped.
#[derive(Debug)]
pub(crate) struct Publisher {
    batches: broadcast::Sender<Arc<Batch>>,
    ended: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Publisher {
    pub(crate) fn start(stage: Arc<Stage>) -> std::io::Result<Self> {
        let (batches, _) = broadcast::channel(MOST_WAITING);
        let ended = Arc::new(AtomicBool::new(false));
        let thread = {
            let (batches, ended) = (batches.clone(), Arc::clone(&ended));
            std::thread::Builder::new()
                .name("web batches".to_owned())
                .spawn(move || run(&stage, &batches, &ended))?
        };
        Ok(Self { batches, ended, thread: Some(thread) })
    }

    /// Where they are to be had.
    pub(crate) fn batches(&self) -> broadcast::Sender<Arc<Batch>> {
        self.batches.clone()
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            let _ = thread.join();
        }
    }
}

/// What is known of the plant that is shown.
struct Watched {
    scene: Arc<Scene>,
    change: u64,
    reports: Subscription,
    last: Option<PlantSnapshot>,
    sent: Instant,
}

impl Watched {
    fn of(stage: &Stage) -> Self {
        let change = stage.changes.load(Ordering::Acquire);
        let scene = stage.scene();
        let reports = scene.subscriptions.subscribe();
        Self { scene, change, reports, last: None, sent: Instant::now() }
    }
}

fn run(stage: &Stage, batches: &broadcast::Sender<Arc<Batch>>, ended: &AtomicBool) {
    let mut watched = Watched::of(stage);
    let (mut seen, mut told) = (0, 0);
    let (mut due, mut looked) = (Instant::now(), Instant::now());
    while !ended.load(Ordering::Relaxed) {
        due = (due + PERIOD).max(Instant::now());
        if watched.change != stage.changes.load(Ordering::Acquire) {
            watched.scene.wires.listen(false);
            watched = Watched::of(stage);
        }
        let wanted = batches.receiver_count() > 0;
        watched.scene.wires.listen(wanted && stage.wants_telegrams());
        if wanted {
            let batch = watched.batch(seen, told);
            (seen, told) = (batch.seen[1], batch.told[1]);
            // Nobody there any more: all the same.
            let _ = batches.send(Arc::new(batch));
        } else {
            watched.last = None;
            watched.reports.take_waiting();
        }
        if looked.elapsed() > LOOK {
            stage.recordings.bound();
            looked = Instant::now();
        }
        std::thread::park_timeout(due.saturating_duration_since(Instant::now()));
    }
}

impl Watched {
    fn batch(&mut self, seen: u64, told: u64) -> Batch {
        let mut batch = Batch { seen: [seen; 2], told: [told; 2], ..Batch::default() };
        // A segment that has ended: its last event tells it.
        let snapshot = self.scene.handle.snapshot().ok();
        let mut taken = Taken::default();
        if let Some(snapshot) = &snapshot {
            taken = self.scene.wires.take(snapshot, seen + 1);
            std::thread::sleep(REPORTS_FOLLOW);
        }
        for item in self.reports.take_waiting() {
            let line = match &item {
                Item::Report(report) => {
                    taken.refuse(&self.scene, report);
                    EventLine::from(&**report)
                }
                Item::Dropped(count) => EventLine::dropped(*count),
            };
            batch.events.push(json(&line));
            batch.told[1] += 1;
        }
        batch.telegrams = json(&taken.telegrams);
        batch.shown = taken.telegrams.len() as u64;
        batch.seen[1] += taken.seen;
        if let Some(snapshot) = snapshot {
            batch.snapshot = self.worth_showing(snapshot);
        }
        batch
    }

    /// The snapshot, where something has changed or it was long ago.
    fn worth_showing(&mut self, snapshot: PlantSnapshot) -> Option<String> {
        let same = self.last.as_ref().is_some_and(|last| is_same(last, &snapshot));
        if same && self.sent.elapsed() < QUIET {
            return None;
        }
        let text = json(&view::of(&self.scene, &snapshot));
        (self.last, self.sent) = (Some(snapshot), Instant::now());
        Some(text)
    }
}

/// Whether nothing but time is different.
fn is_same(one: &PlantSnapshot, other: &PlantSnapshot) -> bool {
    one.segments.len() == other.segments.len()
        && one.encoders.len() == other.encoders.len()
        && one.segments.iter().zip(&other.segments).all(|(one, other)| {
            let mut other = other.clone();
            other.at = one.at;
            *one == other
        })
        && one.encoders.iter().zip(&other.encoders).all(|(one, other)| {
            let mut other = other.clone();
            other.at = one.at;
            *one == other
        })
}

fn json(value: &impl serde::Serialize) -> String {
    serde_json::to_string(value).unwrap_or_default()
}
