//! The shaft: latches and what the bus demands, at one priority.

use profibus_dp::time::Instant;
use sch108bex::halves::ShaftHalf;
use sch108bex::sensor::ShaftReading;
use sch108bex::specification::LATCH_PERIOD;

use crate::bus::BUS;
use crate::cell::Latched;

/// All that belongs to the latch.
#[derive(Debug)]
pub struct Shaft {
    /// The core's half.
    pub half: ShaftHalf,
    /// The next latch.
    pub next: Instant,
    /// Latches since power-on.
    pub latches: u32,
    /// What a simulated shaft delivers.
    pub reading: ShaftReading,
}

/// The one shaft.
pub static SHAFT: Latched<Shaft> = Latched::new();

impl Shaft {
    /// At power-on, with the first latch then.
    pub fn new(half: ShaftHalf, power_on: Instant) -> Self {
        Self { half, next: power_on, latches: 0, reading: ShaftReading::Full(0) }
    }

    /// Takes a latch; `ticks` is what the clock shows at it.
    #[inline]
    pub fn latch(&mut self, ticks: u32, reading: ShaftReading) {
        let at = self.next;
        self.next = at + LATCH_PERIOD;
        self.latches = self.latches.wrapping_add(1);
        let changed = self.half.sample(at, reading, &mut ());
        let image = *self.half.inputs();
        BUS.lock(|bus| {
            bus.clock.latch(ticks, at);
            bus.half.show(&image);
        });
        if changed {
            self.publish();
        }
    }

    /// Carries the health over.
    #[cold]
    #[inline(never)]
    pub fn publish(&self) {
        let health = self.half.health();
        BUS.lock(|bus| bus.half.publish(health));
    }

    /// Does what the bus demands.
    pub fn obey(&mut self) {
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
