//! Time: a free-running counter of 32 bits, and the latch that keeps count of its turns.

use profibus_dp::time::Instant;

/// Nanoseconds a tick, times 2^24.
#[derive(Debug, Clone, Copy)]
pub struct Scale(pub u32);

impl Scale {
    /// Of a counter with so many ticks a second, 4 MHz at least.
    #[expect(clippy::cast_possible_truncation, reason = "250 ns a tick are 2^32")]
    pub const fn of(hertz: u32) -> Self {
        Self(((1_000_000_000_u64 << 24) / hertz as u64) as u32)
    }
}

/// The time now, from the latest latch on.
#[derive(Debug)]
pub struct Clock {
    /// The counter; in lock-step a word that the world link moves.
    counter: *const u32,
    scale: Scale,
    ticks: u32,
    at: Instant,
}

impl Clock {
    /// From a counter on, at time 0.
    ///
    /// # Safety
    ///
    /// `counter` can be read for ever.
    pub unsafe fn new(counter: *const u32, scale: Scale) -> Self {
        let mut clock = Self { counter, scale, ticks: 0, at: Instant::ZERO };
        clock.ticks = clock.ticks();
        clock
    }

    /// The counter now.
    #[inline(always)]
    pub fn ticks(&self) -> u32 {
        // SAFETY: it can be read, see `new`.
        unsafe { self.counter.read_volatile() }
    }

    /// The time now: right for four seconds after the latest latch.
    #[inline(always)]
    pub fn now(&self) -> Instant {
        let since = self.ticks().wrapping_sub(self.ticks);
        let nanos = (u64::from(since) * u64::from(self.scale.0)) >> 24;
        Instant::from_nanos(self.at.as_nanos().wrapping_add(nanos))
    }

    /// The latch, so many ticks after the one before, is at `at`.
    pub fn latch(&mut self, ticks: u32, at: Instant) {
        self.ticks = ticks;
        self.at = at;
    }
}
