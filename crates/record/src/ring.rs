//! The last minutes of all encoders in memory, for curves that go on.

use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use plant::{Handle, PlantError, Sample, SampleTap};
use profibus_dp::time::{Duration, Instant};

use crate::row::{Row, Values, What};

/// So many samples of an encoder are kept at most, whatever the span.
const MOST_SAMPLES: usize = 1 << 20;

/// The last samples of all encoders of a plant. Clones are the same; it ends when the last is dropped.
#[derive(Debug, Clone)]
pub struct Ring {
    handle: Handle,
    encoders: Arc<Vec<Kept>>,
}

#[derive(Debug)]
struct Kept {
    name: Arc<str>,
    samples: Mutex<VecDeque<(u64, Values)>>,
}

/// Who is given the samples of one encoder.
#[derive(Debug)]
struct Tap {
    ring: Weak<Vec<Kept>>,
    encoder: usize,
    most: usize,
    unit: Option<Arc<str>>,
}

impl Ring {
    /// Keeps a sample of every encoder of a plant every so often, for at least this span, from now on. A million of
    /// each are the most.
    ///
    /// # Errors
    ///
    /// A segment has ended.
    pub fn new(handle: &Handle, every: Duration, span: Duration) -> Result<Self, PlantError> {
        let kept = |name: &str| Kept { name: name.into(), samples: Mutex::default() };
        let encoders = Arc::new(handle.encoder_names().map(kept).collect::<Vec<_>>());
        let every = every.max(plant::sample::LEAST_EVERY);
        let most = span.as_nanos().div_ceil(every.as_nanos()) + 1;
        let most = usize::try_from(most).map_or(MOST_SAMPLES, |most| most.min(MOST_SAMPLES));
        handle.sample_to(every, |encoder, _| {
            Box::new(Tap { ring: Arc::downgrade(&encoders), encoder, most, unit: None })
        })?;
        Ok(Self { handle: handle.clone(), encoders })
    }

    /// The samples after this moment, encoder by encoder, each in order of time; and the moment to ask from next.
    ///
    /// # Errors
    ///
    /// A segment has ended.
    pub fn since(&self, after: Instant) -> Result<(Vec<Row>, Instant), PlantError> {
        let until = self.handle.take_samples()?;
        let mut rows = Vec::new();
        for Kept { name, samples } in &*self.encoders {
            let samples = lock(samples);
            let from = samples.partition_point(|(nanos, _)| *nanos <= after.as_nanos());
            let new = samples.range(from..).take_while(|(nanos, _)| *nanos <= until.as_nanos());
            rows.extend(new.map(|(nanos, values)| Row {
                time_ns: *nanos,
                encoder: Arc::clone(name),
                what: What::Sample(values.clone()),
            }));
        }
        Ok((rows, until))
    }
}

impl SampleTap for Tap {
    fn sample(&mut self, sample: &Sample<'_>) -> ControlFlow<()> {
        let Some(ring) = self.ring.upgrade() else {
            return ControlFlow::Break(());
        };
        let machine = sample.machine.map(|(position, unit)| {
            if self.unit.as_deref() != Some(unit) {
                self.unit = Some(unit.into());
            }
            (position, self.unit.clone().unwrap_or_default())
        });
        let values = Values {
            device: sample.device,
            shaft_position: sample.shaft_position,
            rpm: sample.rpm,
            machine,
            supply_mv: sample.supply_mv,
            temperature_tenths: sample.temperature_tenths,
        };
        let mut samples = lock(&ring[self.encoder].samples);
        if samples.len() >= self.most {
            samples.pop_front();
        }
        samples.push_back((sample.at.as_nanos(), values));
        ControlFlow::Continue(())
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Each change is whole by itself, so a panic elsewhere does not matter.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
