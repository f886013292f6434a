//! A recording that goes on: takes samples and events, and writes them on a thread of its own.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::thread::{JoinHandle, Thread};
use std::time::Duration as Time;

use plant::control::{Item, Subscription};
use plant::{Handle, PlantError, SampleTap};
use profibus_dp::time::{Duration, Instant};

use crate::format::{Format, Rows, create};
use crate::row::{Row, Values, What};
use crate::store::{EventTap, Happened, Kept, Shared, Store, Tap};

/// How often what waits goes to the file, and samples are asked for where no telegram comes.
const PERIOD: Time = Time::from_millis(20);
/// A disk that takes nothing for so long at the end is given up.
const PATIENCE: Time = Time::from_secs(5);

/// How to record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Settings {
    /// From sample to sample; at least [`plant::sample::LEAST_EVERY`].
    pub every: Duration,
    /// The segments' time is virtual: they wait for the disk, and the file depends on what they do only.
    pub is_virtual: bool,
}

/// What became of a recording.
#[derive(Debug, Default)]
pub struct Report {
    /// Samples in the file.
    pub samples: u64,
    /// Events in the file.
    pub events: u64,
    /// Samples and events that are not in it.
    pub missing: u64,
    /// What the disk said.
    pub error: Option<io::Error>,
}

/// A recording that goes on. Dropping it ends it.
pub struct Recorder {
    shared: Arc<Shared>,
    settings: Settings,
    writer: Thread,
    done: Option<Receiver<Report>>,
    /// Asks for samples, in real time.
    asker: Option<(Sender<()>, JoinHandle<()>)>,
    listener: Option<(Subscription, JoinHandle<()>)>,
}

impl fmt::Debug for Recorder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Recorder").field("settings", &self.settings).finish_non_exhaustive()
    }
}

impl Recorder {
    /// Begins to record to a new file; one that is there is replaced. `trouble` is called once, with a sentence,
    /// if the disk takes no more: nothing is recorded then, and the bus goes on.
    ///
    /// # Errors
    ///
    /// The file cannot be written, or its name does not say how.
    pub fn start(
        path: &Path,
        settings: Settings,
        trouble: impl FnOnce(&str) + Send + 'static,
    ) -> io::Result<Self> {
        let format = Format::of(path).map_err(|error| io::Error::new(io::ErrorKind::InvalidInput, error))?;
        let rows = create(path, format, settings.is_virtual)?;
        let shared = Arc::new(Shared::default());
        let (to, done) = mpsc::channel();
        let work = Work {
            rows,
            path: path.to_owned(),
            pending: Vec::new(),
            events: Vec::new(),
            names: Vec::new(),
            units: Vec::new(),
            report: Report::default(),
            trouble: Some(Box::new(trouble)),
        };
        let of_work = Arc::clone(&shared);
        let thread = std::thread::Builder::new().name("recording".to_owned()).spawn(move || {
            // Whoever has started it may be gone.
            let _ = to.send(work.run(&of_work));
        })?;
        Ok(Self {
            shared,
            settings,
            writer: thread.thread().clone(),
            done: Some(done),
            asker: None,
            listener: None,
        })
    }

    /// Records all encoders of a plant from now on.
    ///
    /// In virtual time whoever moves it calls [`step`](Self::step); in real time nothing more is to be done.
    ///
    /// # Errors
    ///
    /// A segment has ended, or the system gives no thread.
    pub fn attach(&mut self, handle: &Handle) -> Result<(), PlantError> {
        handle.sample_to(self.settings.every, |_, name| Box::new(self.tap(name)))?;
        if !self.settings.is_virtual {
            let (to, stop) = mpsc::channel();
            let (handle, events) = (handle.clone(), self.events());
            let thread = std::thread::Builder::new()
                .name("samples".to_owned())
                .spawn(move || ask(&handle, &events, &stop))
                .map_err(|error| PlantError::Thread("recording".to_owned(), error))?;
            self.asker = Some((to, thread));
        }
        Ok(())
    }

    /// Who is given the samples of an encoder of this name.
    pub fn tap(&self, encoder: &str) -> impl SampleTap + use<> {
        let mut store = self.shared.lock();
        store.names.push(encoder.into());
        Tap {
            shared: Arc::clone(&self.shared),
            writer: self.writer.clone(),
            encoder: u32::try_from(store.names.len() - 1).unwrap_or_default(),
            unit: None,
            is_virtual: self.settings.is_virtual,
        }
    }

    /// Where events are given to it.
    pub fn events(&self) -> EventTap {
        EventTap { shared: Arc::clone(&self.shared) }
    }

    /// Takes the events of a subscription, on a thread of its own.
    ///
    /// # Errors
    ///
    /// The system gives no thread.
    pub fn listen(&mut self, subscription: Subscription) -> io::Result<()> {
        let (events, source) = (self.events(), subscription.clone());
        let thread = std::thread::Builder::new().name("events".to_owned()).spawn(move || {
            while let Some(item) = source.next() {
                match item {
                    Item::Report(report) => events.report(&report),
                    Item::Dropped(count) => events.lost(count),
                }
            }
        })?;
        self.listener = Some((subscription, thread));
        Ok(())
    }

    /// Virtual time has come to this moment; all events before were given.
    ///
    /// # Errors
    ///
    /// A segment has ended.
    pub fn step(&self, handle: &Handle, to: Instant) -> Result<(), PlantError> {
        handle.take_samples()?;
        self.events().settle(to);
        Ok(())
    }

    /// Takes the last samples, while the plant still runs.
    pub fn stop_sampling(&mut self) {
        if let Some((stop, thread)) = self.asker.take() {
            drop(stop);
            let _ = thread.join();
        }
    }

    /// Ends the recording: all that was given is in the file then.
    pub fn finish(mut self) -> Report {
        self.end()
    }

    fn end(&mut self) -> Report {
        self.stop_sampling();
        if let Some((subscription, thread)) = self.listener.take() {
            subscription.close();
            let _ = thread.join();
        }
        let Some(done) = self.done.take() else {
            return Report::default();
        };
        self.shared.lock().ending = true;
        self.writer.unpark();
        done.recv_timeout(PATIENCE).unwrap_or_else(|_| {
            let mut store = self.shared.lock();
            store.closed = true;
            let missing = store.missing + (store.samples.len() + store.events.len()) as u64;
            let error = io::Error::other(format!("it took nothing for {} s", PATIENCE.as_secs()));
            Report { missing, error: Some(error), ..Report::default() }
        })
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.end();
    }
}

/// Asks for samples until it is told to stop, and once more then.
fn ask(handle: &Handle, events: &EventTap, stop: &Receiver<()>) {
    let mut before = None;
    loop {
        let stopped = matches!(stop.recv_timeout(PERIOD), Err(RecvTimeoutError::Disconnected));
        let Ok(until) = handle.take_samples() else {
            return;
        };
        // Events have had a period to come by their own way.
        if let Some(before) = before.replace(until) {
            events.settle(before);
        }
        if stopped {
            return;
        }
    }
}

/// Whom to tell that the disk takes no more.
type Trouble = Box<dyn FnOnce(&str) + Send>;

/// What the thread works with.
struct Work {
    rows: Box<dyn Rows>,
    path: PathBuf,
    /// Taken, but not settled yet.
    pending: Vec<Kept>,
    events: Vec<Happened>,
    names: Vec<Arc<str>>,
    units: Vec<Arc<str>>,
    report: Report,
    trouble: Option<Trouble>,
}

impl Work {
    fn run(mut self, shared: &Shared) -> Report {
        let mut taken = Store::default();
        loop {
            {
                let mut store = shared.lock();
                std::mem::swap(&mut taken.samples, &mut store.samples);
                self.events.extend(store.events.drain(..));
                self.names.extend_from_slice(&store.names[self.names.len()..]);
                self.units.extend_from_slice(&store.units[self.units.len()..]);
                taken.missing = std::mem::take(&mut store.missing);
                taken.settled = if store.ending { u64::MAX } else { store.settled };
                taken.ending = store.ending;
                store.closed |= self.report.error.is_some();
            }
            shared.made_room();
            self.pending.append(&mut taken.samples);
            self.report.missing += taken.missing;
            let result = if self.report.error.is_none() { self.write(&taken) } else { Ok(()) };
            if let Err(error) = result {
                self.give_up(error);
            }
            if self.report.error.is_some() {
                self.report.missing += (self.pending.len() + self.events.len()) as u64;
                self.pending.clear();
                self.events.clear();
            }
            if taken.ending {
                return self.report;
            }
            std::thread::park_timeout(PERIOD);
        }
    }

    fn give_up(&mut self, error: io::Error) {
        let Report { samples, events, .. } = self.report;
        if let Some(trouble) = self.trouble.take() {
            trouble(&format!(
                "the recording {} ends here: {error}; it has {samples} samples and {events} events, and \
                 everything else goes on",
                self.path.display()
            ));
        }
        self.report.error = Some(error);
    }

    /// What is settled goes to the file, in order of time: at one moment samples first, by encoder.
    fn write(&mut self, taken: &Store) -> io::Result<()> {
        let until = taken.settled;
        self.pending.sort_by_key(|kept| (kept.nanos, kept.encoder));
        self.events.sort_by_key(|happened| happened.nanos);
        let settled = self.pending.partition_point(|kept| kept.nanos < until || taken.ending);
        let past = self.events.partition_point(|happened| happened.nanos < until || taken.ending);
        let pending: Vec<_> = self.pending.drain(..settled).collect();
        let mut events = self.events.drain(..past).collect::<Vec<_>>().into_iter().peekable();
        let last = pending.last().map_or(0, |kept| kept.nanos);
        for (at, kept) in pending.iter().enumerate() {
            while let Some(event) = events.next_if(|event| event.nanos < kept.nanos) {
                self.put_event(event)?;
            }
            let row = self.row(kept);
            self.rows.write(&row).inspect_err(|_| self.report.missing += (pending.len() - at) as u64)?;
            self.report.samples += 1;
        }
        events.try_for_each(|event| self.put_event(event))?;
        if taken.missing > 0 {
            let text =
                format!("{} samples and events are missing here: the disk was too slow", taken.missing);
            let (who, kind) = ("recording".into(), "recording_gap");
            self.put_event(Happened { nanos: last, who, kind, text: text.into() })?;
        }
        if taken.ending { self.rows.finish() } else { self.rows.settle() }
    }

    fn put_event(&mut self, event: Happened) -> io::Result<()> {
        let Happened { nanos, who, kind, text } = event;
        let row = Row { time_ns: nanos, encoder: who, what: What::Event { kind: kind.into(), text } };
        self.rows.write(&row)?;
        self.report.events += 1;
        Ok(())
    }

    fn row(&self, kept: &Kept) -> Row {
        Row {
            time_ns: kept.nanos,
            encoder: Arc::clone(&self.names[kept.encoder as usize]),
            what: What::Sample(kept.values(&self.units)),
        }
    }
}

impl Kept {
    /// As a row has it.
    pub(crate) fn values(&self, units: &[Arc<str>]) -> Values {
        let unit = self.unit.checked_sub(1).and_then(|at| units.get(at as usize));
        Values {
            device: self.device,
            shaft_position: self.shaft_position,
            rpm: self.rpm,
            machine: unit.map(|unit| (self.machine, Arc::clone(unit))),
            supply_mv: self.supply_mv,
            temperature_tenths: self.temperature_tenths,
        }
    }
}
