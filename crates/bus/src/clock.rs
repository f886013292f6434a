//! Clocks: where a segment's `now` comes from.

use profibus_dp::time::{Duration, Instant};

/// The computer's monotonic clock, in nanoseconds since the clock was made.
///
/// Copies show the same time.
#[derive(Debug, Clone, Copy)]
pub struct WallClock {
    start: std::time::Instant,
}

impl WallClock {
    /// A clock that shows zero now.
    pub fn new() -> Self {
        Self { start: std::time::Instant::now() }
    }

    /// The time since the clock was made.
    pub fn now(&self) -> Instant {
        Instant::ZERO + Duration::from(self.start.elapsed())
    }
}

impl Default for WallClock {
    fn default() -> Self {
        Self::new()
    }
}

/// A clock that stands still until it is moved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct VirtualClock {
    now: Instant,
}

impl VirtualClock {
    /// A clock that shows `now`.
    pub const fn new(now: Instant) -> Self {
        Self { now }
    }

    /// The time it shows.
    pub const fn now(&self) -> Instant {
        self.now
    }

    /// Moves on to `instant`; never back.
    pub fn advance_to(&mut self, instant: Instant) {
        self.now = self.now.max(instant);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_wall_clock_starts_at_zero_and_runs() {
        let clock = WallClock::new();
        let copy = clock;
        let first = clock.now();
        assert!(first < Instant::from_millis(1_000));
        std::thread::sleep(std::time::Duration::from_millis(2));
        assert!(copy.now().since(first) >= Duration::from_millis(2));
    }

    #[test]
    fn the_virtual_clock_never_goes_back() {
        let mut clock = VirtualClock::new(Instant::from_millis(5));
        clock.advance_to(Instant::from_millis(7));
        clock.advance_to(Instant::from_millis(6));
        assert_eq!(clock.now(), Instant::from_millis(7));
    }
}
