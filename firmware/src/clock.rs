//! Time: a free-running counter of 32 bits, and the latch that keeps count of its turns.

use profibus_dp::time::{Duration, Instant};
use sch108bex::specification::LATCH_PERIOD;

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

/// What a clock without a counter reads.
static NOTHING: u32 = 0;

// SAFETY: it reads registers or a word that is written whole.
unsafe impl Send for Clock {}

impl Clock {
    /// One that stands.
    pub const STOPPED: Self =
        Self { counter: &raw const NOTHING, scale: Scale(1 << 24), ticks: 0, at: Instant::ZERO };

    /// From a counter on, at time 0.
    ///
    /// # Safety
    ///
    /// `counter` can be read for ever.
    pub unsafe fn new(counter: *const u32, scale: Scale) -> Self {
        let mut clock = Self { counter, scale, ..Self::STOPPED };
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
        self.at(self.ticks())
    }

    /// The time when the counter was at `ticks`, after the latest latch.
    #[inline(always)]
    pub fn at(&self, ticks: u32) -> Instant {
        Instant::from_nanos(self.at.as_nanos().wrapping_add(self.nanos(self.ticks, ticks)))
    }

    /// From one count to a later one, in nanoseconds.
    #[inline(always)]
    pub fn nanos(&self, from: u32, to: u32) -> u64 {
        (u64::from(to.wrapping_sub(from)) * u64::from(self.scale.0)) >> 24
    }

    /// So many ticks are as long as this, a second at most.
    pub fn ticks_of(&self, span: Duration) -> u32 {
        let ticks = (span.as_nanos() << 24).checked_div(u64::from(self.scale.0));
        ticks.and_then(|ticks| u32::try_from(ticks).ok()).unwrap_or(u32::MAX)
    }

    /// The counter now, and its ticks from latch to latch: no rest at any rate that there is.
    pub fn timing(&self) -> (u32, u32) {
        (self.ticks(), self.ticks_of(LATCH_PERIOD))
    }

    /// The latch at `at` was when the counter was at `ticks`.
    #[inline]
    pub fn latch(&mut self, ticks: u32, at: Instant) {
        self.ticks = ticks;
        self.at = at;
    }
}
