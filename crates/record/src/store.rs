//! What waits for the disk: samples and events on their way from the segments' threads to the writer's.

use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use plant::control::event_kind;
use plant::{DeviceSample, Report, Sample, SampleTap};
use profibus_dp::time::Instant;

/// What may wait for the disk.
const MOST_SAMPLES: usize = 128 * 1024;
const MOST_EVENTS: usize = 16 * 1024;

/// A sample on its way.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Kept {
    pub(crate) nanos: u64,
    /// Among the names.
    pub(crate) encoder: u32,
    /// Among the units, from 1.
    pub(crate) unit: u32,
    pub(crate) machine: f64,
    pub(crate) shaft_position: i64,
    pub(crate) rpm: f64,
    pub(crate) supply_mv: i32,
    pub(crate) temperature_tenths: i16,
    pub(crate) device: Option<DeviceSample>,
}

/// An event on its way.
#[derive(Debug)]
pub(crate) struct Happened {
    pub(crate) nanos: u64,
    pub(crate) who: Arc<str>,
    pub(crate) kind: &'static str,
    pub(crate) text: Arc<str>,
}

#[derive(Debug, Default)]
pub(crate) struct Shared {
    store: Mutex<Store>,
    /// There is room again.
    room: Condvar,
}

/// What waits.
#[derive(Debug, Default)]
pub(crate) struct Store {
    pub(crate) samples: Vec<Kept>,
    pub(crate) events: VecDeque<Happened>,
    /// The names of encoders and units; they only become more.
    pub(crate) names: Vec<Arc<str>>,
    pub(crate) units: Vec<Arc<str>>,
    /// All before this was given.
    pub(crate) settled: u64,
    /// What found no room since the last time.
    pub(crate) missing: u64,
    /// Nobody takes anything any more.
    pub(crate) closed: bool,
    /// It shall end.
    pub(crate) ending: bool,
}

impl Shared {
    pub(crate) fn lock(&self) -> MutexGuard<'_, Store> {
        // Each change is whole by itself, so a panic elsewhere does not matter.
        self.store.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn made_room(&self) {
        self.room.notify_all();
    }
}

/// Who is given the samples of one encoder, for the store.
#[derive(Debug)]
pub(crate) struct Tap {
    pub(crate) shared: Arc<Shared>,
    pub(crate) writer: std::thread::Thread,
    pub(crate) encoder: u32,
    pub(crate) unit: Option<(u32, Arc<str>)>,
    /// Nobody waits for the bus, so it waits for the disk.
    pub(crate) is_virtual: bool,
}

impl Tap {
    fn unit_number(&mut self, unit: &str) -> u32 {
        if let Some((number, known)) = &self.unit
            && **known == *unit
        {
            return *number;
        }
        let mut store = self.shared.lock();
        let at = store.units.iter().position(|known| **known == *unit).unwrap_or_else(|| {
            store.units.push(unit.into());
            store.units.len() - 1
        });
        let number = u32::try_from(at + 1).unwrap_or(0);
        self.unit = Some((number, Arc::clone(&store.units[at])));
        number
    }
}

impl SampleTap for Tap {
    fn sample(&mut self, sample: &Sample<'_>) -> ControlFlow<()> {
        let (machine, unit) =
            sample.machine.map_or((0.0, 0), |(position, unit)| (position, self.unit_number(unit)));
        let kept = Kept {
            nanos: sample.at.as_nanos(),
            encoder: self.encoder,
            unit,
            machine,
            shaft_position: sample.shaft_position,
            rpm: sample.rpm,
            supply_mv: sample.supply_mv,
            temperature_tenths: sample.temperature_tenths,
            device: sample.device,
        };
        let mut store = self.shared.lock();
        while self.is_virtual && !store.closed && store.samples.len() >= MOST_SAMPLES {
            self.writer.unpark();
            store = self.shared.room.wait(store).unwrap_or_else(PoisonError::into_inner);
        }
        if store.closed {
            return ControlFlow::Break(());
        }
        if store.samples.len() >= MOST_SAMPLES {
            store.missing += 1;
            return ControlFlow::Continue(());
        }
        store.samples.push(kept);
        // Once, on the way to a full one: the writer comes by itself soon enough.
        if store.samples.len() == MOST_SAMPLES / 4 {
            self.writer.unpark();
        }
        ControlFlow::Continue(())
    }
}

/// Where events are given to a recording. Clones are the same.
#[derive(Debug, Clone)]
pub struct EventTap {
    pub(crate) shared: Arc<Shared>,
}

impl EventTap {
    /// This happened. Never waits.
    pub fn report(&self, report: &Report) {
        let happened = Happened {
            nanos: report.at.as_nanos(),
            who: Arc::clone(&report.who),
            kind: event_kind(&report.what),
            text: report.what.to_string().into(),
        };
        let mut store = self.shared.lock();
        if store.closed {
            return;
        }
        if store.events.len() < MOST_EVENTS {
            store.events.push_back(happened);
        } else {
            store.missing += 1;
        }
    }

    /// So many reports were lost before they came here.
    pub fn lost(&self, count: u64) {
        self.shared.lock().missing += count;
    }

    /// All that was before this moment was given.
    pub fn settle(&self, until: Instant) {
        let mut store = self.shared.lock();
        store.settled = store.settled.max(until.as_nanos());
    }
}
