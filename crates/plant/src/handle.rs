//! The hand by which any thread reaches a running plant.

use std::sync::{Arc, mpsc};

use bus::{Control, Segment, WireTap};
use profibus_dp::time::Instant;
use sch108bex::specification::Variant;

use crate::control::{Couplings, judge};
use crate::encoder::EncoderStation;
use crate::ground::{Ground, Virtual, lock};
use crate::plant::{Command, PlantError};
use crate::snapshot::{PlantSnapshot, SegmentSnapshot};

/// A hand on the segments that a plant had when it was given out. Cheap to clone; commands given
/// after the plant has ended are refused.
#[derive(Debug, Clone)]
pub struct Handle {
    places: Arc<[Place]>,
    couplings: Couplings,
}

/// A segment as a handle knows it.
#[derive(Debug, Clone)]
pub(crate) struct Place {
    pub(crate) name: String,
    pub(crate) port: String,
    pub(crate) encoders: Vec<Known>,
    pub(crate) way: Way,
}

/// How a handle reaches a segment.
#[derive(Debug, Clone)]
pub(crate) enum Way {
    /// On the thread that runs it in real time.
    Thread(Control<Command>),
    /// Where it is, between two steps of its virtual time.
    Virtual(Virtual),
}

/// What does not change of an encoder.
#[derive(Debug, Clone)]
pub(crate) struct Known {
    pub(crate) name: String,
    pub(crate) variant: Variant,
}

/// An encoder that was found: its segment, and where it is there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Found<'a> {
    pub(crate) place: &'a Place,
    pub(crate) at: usize,
    pub(crate) variant: Variant,
}

impl Handle {
    pub(crate) fn new(places: impl Iterator<Item = Place>, couplings: Couplings) -> Self {
        Self { places: places.collect(), couplings }
    }

    pub(crate) fn couplings(&self) -> &Couplings {
        &self.couplings
    }

    pub(crate) fn places(&self) -> &[Place] {
        &self.places
    }

    /// The names of all encoders, in the order they were added.
    pub fn encoder_names(&self) -> impl Iterator<Item = &str> {
        self.places.iter().flat_map(|place| &place.encoders).map(|encoder| encoder.name.as_str())
    }

    /// The segments in the order they were added, each with the names of its encoders.
    pub fn segments(&self) -> impl Iterator<Item = (&str, impl Iterator<Item = &str>)> {
        self.places
            .iter()
            .map(|place| (place.name.as_str(), place.encoders.iter().map(|encoder| encoder.name.as_str())))
    }

    /// The encoder with this number, counted from 0 over all segments.
    pub(crate) fn encoder(&self, number: usize) -> Option<Found<'_>> {
        let mut all = self.places.iter().flat_map(|place| {
            let numbered = place.encoders.iter().enumerate();
            numbered.map(move |(at, encoder)| Found { place, at, variant: encoder.variant })
        });
        all.nth(number)
    }

    /// Lets somebody listen to the segment with this name, instead of whoever did before; `None`: nobody.
    ///
    /// # Errors
    ///
    /// The segment has ended, or there is none of this name.
    pub fn set_tap(&self, segment: &str, tap: Option<Box<dyn WireTap>>) -> Result<(), PlantError> {
        let place = self.places().iter().find(|place| place.name == segment);
        let place = place.ok_or_else(|| PlantError::NoSegment(segment.to_owned()))?;
        place.ask(move |segment| segment.set_tap(tap))
    }

    /// Lets somebody listen to the segment with this name, beside those who do already.
    ///
    /// # Errors
    ///
    /// As for [`set_tap`](Self::set_tap).
    pub fn add_tap(&self, segment: &str, tap: Box<dyn WireTap>) -> Result<(), PlantError> {
        let place = self.places().iter().find(|place| place.name == segment);
        let place = place.ok_or_else(|| PlantError::NoSegment(segment.to_owned()))?;
        place.ask(move |segment| segment.add_tap(tap))
    }

    /// Everything as it is now.
    ///
    /// # Errors
    ///
    /// A segment has ended.
    pub fn snapshot(&self) -> Result<PlantSnapshot, PlantError> {
        let mut all = PlantSnapshot { segments: Vec::new(), encoders: Vec::new() };
        for place in self.places() {
            let Place { name, port, .. } = place.clone();
            let (segment, encoders) = place.ask(move |segment| {
                let now = segment.now();
                let seen = segment_snapshot(name, port, segment);
                let stations = segment.stations_mut().iter_mut();
                (seen, stations.map(|station| station.snapshot(now)).collect::<Vec<_>>())
            })?;
            all.segments.push(segment);
            all.encoders.extend(encoders);
        }
        Ok(all)
    }
}

fn segment_snapshot(name: String, port: String, segment: &dyn Ground) -> SegmentSnapshot {
    let faults = segment.faults();
    SegmentSnapshot {
        name,
        port,
        at: segment.now(),
        rate: segment.rate(),
        counters: segment.counters(),
        cable: faults.cable(),
        reflected: faults.reflected(),
        termination: judge(segment.stations(), &faults.cable()),
        noise: faults.noise(),
        waiting: faults.waiting(),
        faults: faults.counters(),
    }
}

impl Place {
    /// Does something with the segment, on its thread where it has one, and waits until it is done.
    pub(crate) fn ask<R: Send + 'static>(
        &self,
        work: impl FnOnce(&mut dyn Ground) -> R + Send + 'static,
    ) -> Result<R, PlantError> {
        let control = match &self.way {
            Way::Virtual(segment) => return Ok(work(&mut *lock(segment))),
            Way::Thread(control) => control,
        };
        let ended = || PlantError::Ended(self.name.clone());
        let (to, done) = mpsc::channel();
        let work = move |segment: &mut Segment<EncoderStation>| {
            // Whoever has asked is gone: all the same.
            let _ = to.send(work(segment));
        };
        control.send(Command::With(Box::new(work))).map_err(|_| ended())?;
        done.recv().map_err(|_| ended())
    }
}

impl Found<'_> {
    /// Does something with the encoder, and waits until it is done.
    pub(crate) fn ask<R: Send + 'static>(
        &self,
        work: impl FnOnce(&mut EncoderStation, Instant) -> R + Send + 'static,
    ) -> Result<R, PlantError> {
        let at = self.at;
        self.place.ask(move |segment| {
            let now = segment.now();
            work(&mut segment.stations_mut()[at], now)
        })
    }
}
