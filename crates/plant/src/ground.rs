//! Segments in real time and in virtual time, as far as requests and snapshots need them.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bus::{Counters, Faults, Segment, VirtualSegment, WireTap};
use profibus_dp::time::{Baudrate, Instant};

use crate::encoder::EncoderStation;

/// A segment in virtual time, shared between its master and whoever sends it requests.
pub(crate) type Virtual = Arc<Mutex<VirtualSegment<EncoderStation>>>;

/// The encoders of one segment, whatever their time.
pub(crate) trait Ground {
    fn now(&self) -> Instant;
    /// The encoders, in the order they were added.
    fn stations(&self) -> &[EncoderStation];
    /// The encoders, to be changed, in the order they were added.
    fn stations_mut(&mut self) -> &mut [EncoderStation];
    fn faults(&self) -> &Faults;
    fn faults_mut(&mut self) -> &mut Faults;
    fn counters(&self) -> Counters;
    fn rate(&self) -> Option<Baudrate>;
    fn set_tap(&mut self, tap: Option<Box<dyn WireTap>>);
    fn add_tap(&mut self, tap: Box<dyn WireTap>);
}

impl Ground for Segment<EncoderStation> {
    fn now(&self) -> Instant {
        Segment::now(self)
    }

    fn stations(&self) -> &[EncoderStation] {
        Segment::stations(self)
    }

    fn stations_mut(&mut self) -> &mut [EncoderStation] {
        Segment::stations_mut(self)
    }

    fn faults(&self) -> &Faults {
        Segment::faults(self)
    }

    fn faults_mut(&mut self) -> &mut Faults {
        Segment::faults_mut(self)
    }

    fn counters(&self) -> Counters {
        Segment::counters(self)
    }

    fn rate(&self) -> Option<Baudrate> {
        Segment::rate(self)
    }

    fn set_tap(&mut self, tap: Option<Box<dyn WireTap>>) {
        Segment::set_tap(self, tap);
    }

    fn add_tap(&mut self, tap: Box<dyn WireTap>) {
        Segment::add_tap(self, tap);
    }
}

impl Ground for VirtualSegment<EncoderStation> {
    fn now(&self) -> Instant {
        VirtualSegment::now(self)
    }

    fn stations(&self) -> &[EncoderStation] {
        VirtualSegment::stations(self)
    }

    fn stations_mut(&mut self) -> &mut [EncoderStation] {
        VirtualSegment::stations_mut(self)
    }

    fn faults(&self) -> &Faults {
        VirtualSegment::faults(self)
    }

    fn faults_mut(&mut self) -> &mut Faults {
        VirtualSegment::faults_mut(self)
    }

    fn counters(&self) -> Counters {
        Counters { collisions: self.collisions(), ..Counters::default() }
    }

    fn rate(&self) -> Option<Baudrate> {
        Some(VirtualSegment::rate(self))
    }

    fn set_tap(&mut self, tap: Option<Box<dyn WireTap>>) {
        VirtualSegment::set_tap(self, tap);
    }

    fn add_tap(&mut self, tap: Box<dyn WireTap>) {
        VirtualSegment::add_tap(self, tap);
    }
}

/// The segment; each change of it is whole by itself, so a panic elsewhere does not matter.
pub(crate) fn lock(segment: &Virtual) -> MutexGuard<'_, VirtualSegment<EncoderStation>> {
    segment.lock().unwrap_or_else(PoisonError::into_inner)
}
