//! The shaft: latches and what the bus demands, at one priority.

use logic::turns;
use profibus_dp::time::Instant;
use sch108bex::device::NonvolatileWrite;
use sch108bex::halves::ShaftHalf;
use sch108bex::health::Measurement;
use sch108bex::sensor::ShaftReading;
use sch108bex::specification::LATCH_PERIOD;

use crate::bus::{BUS, Line};
use crate::cell::Latched;

/// All that belongs to the latch.
#[derive(Debug)]
pub struct Shaft {
    /// The core's half.
    pub half: ShaftHalf,
    /// Latches since power-on.
    pub latches: u32,
    /// What a simulated shaft delivers.
    pub reading: ShaftReading,
    /// The next latch.
    next: Instant,
    /// The counter then.
    ticks: u32,
    /// From latch to latch.
    period: u32,
}

/// The one shaft.
pub static SHAFT: Latched<Option<Shaft>> = Latched::new();

impl Shaft {
    /// At power-on, with the first latch then; `timing` is the counter now and from latch to latch.
    pub fn new(half: ShaftHalf, power_on: Instant, (ticks, period): (u32, u32)) -> Self {
        Self { half, latches: 0, reading: ShaftReading::Full(0), next: power_on, ticks, period }
    }

    /// Takes the latch that is due.
    #[inline]
    pub fn latch(&mut self, reading: ShaftReading, line: &impl Line) {
        let (at, ticks) = (self.next, self.ticks);
        self.next = at + LATCH_PERIOD;
        self.ticks = ticks.wrapping_add(self.period);
        self.latches = self.latches.wrapping_add(1);
        let changed = self.half.sample(at, reading, &mut ());
        let image = *self.half.inputs();
        let now = BUS.lock(|bus| {
            bus.clock.latch(ticks, at);
            bus.half.show(&image);
            bus.clock.ticks()
        });
        if changed {
            self.publish();
        }
        if now.wrapping_sub(ticks) >= self.period {
            self.catch_up(now);
        }
        BUS.lock(|bus| bus.poll(line));
    }

    /// Latches were missed, under a debugger or an emulator: they are skipped.
    #[cold]
    #[inline(never)]
    fn catch_up(&mut self, now: u32) {
        while now.wrapping_sub(self.ticks).cast_signed() >= 0 {
            self.ticks = self.ticks.wrapping_add(self.period);
            self.next += LATCH_PERIOD;
            self.latches = self.latches.wrapping_add(1);
        }
    }

    /// Carries the health over.
    #[cold]
    #[inline(never)]
    pub fn publish(&self) {
        let health = self.half.health();
        BUS.lock(|bus| bus.half.publish(health));
    }

    /// Takes what was measured.
    pub fn measure(&mut self, measurement: &Measurement) {
        let now = BUS.lock(|bus| bus.clock.now());
        self.half.measure(now, measurement, &mut ());
        self.publish();
    }

    /// What is to be written now; nothing before the first latch.
    pub fn take(&mut self, address: Option<u8>, changed: bool) -> Option<NonvolatileWrite> {
        if self.latches == 0 {
            return None;
        }
        let now = BUS.lock(|bus| bus.clock.now());
        if self.half.poll(now, &mut ()) {
            self.publish();
        }
        self.half.take_nonvolatile(now, address, changed)
    }

    /// The record taken is written, or could not be.
    pub fn written(&mut self, written: bool) {
        if written {
            self.half.confirm_nonvolatile();
        } else {
            let now = BUS.lock(|bus| bus.clock.now());
            self.half.nonvolatile_failed(now);
        }
    }

    /// The position that the battery is to keep.
    pub fn kept(&self) -> [u32; turns::WORDS] {
        let variant = self.half.sensor().variant();
        let [low, ..] = split(self.half.sensor().physical_position());
        turns::keep(low & variant.total().wrapping_sub(1))
    }

    /// Does what the bus demands.
    pub fn obey(&mut self) {
        // A handful at most: each telegram makes one.
        loop {
            let (now, demand) = BUS.lock(|bus| (bus.clock.now(), bus.half.take_demand()));
            let Some(demand) = demand else { break };
            self.half.obey(now, demand, &mut ());
        }
        let image = *self.half.inputs();
        BUS.lock(|bus| bus.half.show(&image));
        self.publish();
    }
}

/// The lower and the upper half.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "halves")]
const fn split(number: i64) -> [u32; 2] {
    [number as u32, (number >> 32) as u32]
}
