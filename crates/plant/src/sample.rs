//! Encoders at regular moments, for recordings and curves.

use std::fmt::Debug;
use std::ops::ControlFlow;

use profibus_dp::dp::State;
use profibus_dp::time::{Duration, Instant};
use sch108bex::Device;
use sch108bex::diagnostics::{Alarms, Warnings};
use sch108bex::functionality::Functionality;

use crate::encoder::EncoderStation;
use crate::handle::Handle;
use crate::plant::PlantError;
use crate::report::Reporter;

/// The least distance of samples: from latch to latch (manual 6). No value changes faster.
pub const LEAST_EVERY: Duration = Duration::from_micros(500);

/// An encoder at one moment: the latest latch until then, and all that happened before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample<'a> {
    /// The moment, on the clock of the segment.
    pub at: Instant,
    /// Where the shaft is, in physical counts, turns included.
    pub shaft_position: i64,
    /// Its speed in revolutions per minute, positive clockwise.
    pub rpm: f64,
    /// Where the machine is, and its unit, where it is known.
    pub machine: Option<(f64, &'a str)>,
    /// The supply, in millivolts.
    pub supply_mv: i32,
    /// Inside, in tenths of a degree Celsius.
    pub temperature_tenths: i16,
    /// What the device shows; `None` without power.
    pub device: Option<DeviceSample>,
}

/// What a device with power shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceSample {
    /// Where the DP state machine stands.
    pub state: State,
    /// What was agreed on; `None` outside data exchange.
    pub functionality: Option<Functionality>,
    /// In scaled steps, as the input image has it.
    pub position: u32,
    /// In the unit of the time base.
    pub velocity: i32,
    /// In the unit of the time base.
    pub acceleration: i32,
    /// In physical counts, turns included.
    pub physical_position: i64,
    /// The alarms that are set.
    pub alarms: Alarms,
    /// The warnings that are set.
    pub warnings: Warnings,
}

impl DeviceSample {
    pub(crate) fn of(device: &Device<Reporter>) -> Self {
        let sensor = device.sensor();
        Self {
            state: *device.bus().slave().state(),
            functionality: device.encoder().functionality(),
            position: sensor.position(),
            velocity: sensor.velocity(),
            acceleration: sensor.acceleration(),
            physical_position: sensor.physical_position(),
            alarms: sensor.alarms(),
            warnings: sensor.warnings(),
        }
    }
}

/// Who is given the samples of one encoder, on the thread of its segment: it must not wait in real time.
pub trait SampleTap: Debug + Send {
    /// One more; samples come in order of time. `Break`: no more are wanted.
    fn sample(&mut self, sample: &Sample<'_>) -> ControlFlow<()>;
}

/// Somebody who wants samples, and when the next is due.
#[derive(Debug)]
pub(crate) struct Sampling {
    every: Duration,
    next: Instant,
    tap: Box<dyn SampleTap>,
}

/// All who want samples of one encoder.
#[derive(Debug)]
pub(crate) struct Samplings {
    all: Vec<Sampling>,
    /// No sample is due before this.
    next: Instant,
}

impl Default for Samplings {
    fn default() -> Self {
        Self { all: Vec::new(), next: Instant::MAX }
    }
}

impl Samplings {
    #[inline]
    pub(crate) fn are_due(&self, now: Instant) -> bool {
        self.next <= now
    }

    fn find_next(&mut self) {
        self.next = self.all.iter().map(|sampling| sampling.next).min().unwrap_or(Instant::MAX);
    }
}

impl EncoderStation {
    /// Gives samples at all whole multiples of `every` (at least [`LEAST_EVERY`]) from `now` on.
    ///
    /// They are taken when something else is to be done later than that or [`take_samples`](Self::take_samples) is called;
    /// what they show does not depend on it.
    pub fn sample_to(&mut self, now: Instant, every: Duration, tap: Box<dyn SampleTap>) {
        self.take_samples(now);
        let every = every.max(LEAST_EVERY);
        let since = now.as_nanos().next_multiple_of(every.as_nanos());
        let samplings = self.samplings_mut();
        samplings.all.push(Sampling { every, next: Instant::from_nanos(since), tap });
        samplings.find_next();
    }

    /// Takes the samples that are due up to `now`.
    #[inline]
    pub fn take_samples(&mut self, now: Instant) {
        if self.samplings_mut().are_due(now) {
            self.take_due_samples(now);
        }
    }

    #[cold]
    fn take_due_samples(&mut self, now: Instant) {
        // Out of the way, so that the latches for them ask for none.
        let mut samplings = std::mem::take(self.samplings_mut());
        while samplings.are_due(now) {
            let at = samplings.next;
            let sample = self.sample(at);
            samplings.all.retain_mut(|sampling| {
                if sampling.next > at {
                    return true;
                }
                sampling.next = at + sampling.every;
                sampling.tap.sample(&sample).is_continue()
            });
            samplings.find_next();
        }
        *self.samplings_mut() = samplings;
    }
}

impl Handle {
    /// Gives samples of every encoder at the whole multiples of `every` on its segment's clock, from now on.
    /// `tap` makes who is given those of the encoder with this number (from 0) and name.
    ///
    /// # Errors
    ///
    /// A segment has ended.
    pub fn sample_to(
        &self,
        every: Duration,
        mut tap: impl FnMut(usize, &str) -> Box<dyn SampleTap>,
    ) -> Result<(), PlantError> {
        let mut number = 0;
        for place in self.places() {
            let taps = place.encoders.iter().map(|encoder| {
                number += 1;
                tap(number - 1, &encoder.name)
            });
            let taps: Vec<_> = taps.collect();
            place.ask(move |segment| {
                let now = segment.now();
                for (station, tap) in segment.stations_mut().iter_mut().zip(taps) {
                    station.sample_to(now, every, tap);
                }
            })?;
        }
        Ok(())
    }

    /// Takes the samples that are due by now; up to when all of them were taken.
    ///
    /// Where no telegram comes nobody else does it.
    ///
    /// # Errors
    ///
    /// A segment has ended.
    pub fn take_samples(&self) -> Result<Instant, PlantError> {
        let mut until = Instant::MAX;
        for place in self.places() {
            let now = place.ask(|segment| {
                let now = segment.now();
                segment.stations_mut().iter_mut().for_each(|station| station.take_samples(now));
                now
            })?;
            until = until.min(now);
        }
        Ok(until)
    }
}
