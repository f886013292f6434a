//! How many requests get done: enough for any program, too few to disturb a bus.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// So many are done at once after a pause.
const MOST: u32 = 64;

/// After that one is done in each of these.
const EACH: Duration = Duration::from_micros(500);

/// What clients wait for before each request, all of them together.
#[derive(Debug)]
pub struct Turns(Mutex<Left>);

#[derive(Debug)]
struct Left {
    count: u32,
    since: Instant,
}

impl Default for Turns {
    fn default() -> Self {
        Self::new()
    }
}

impl Turns {
    /// With all of them left.
    pub fn new() -> Self {
        Self(Mutex::new(Left { count: MOST, since: Instant::now() }))
    }

    /// Waits for one, and takes it.
    pub fn take(&self) {
        let mut left = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        left.refill(Instant::now());
        while left.count == 0 {
            // Whoever comes meanwhile waits for the lock, and sleeps as well.
            std::thread::sleep(EACH);
            left.refill(Instant::now());
        }
        left.count -= 1;
    }
}

impl Left {
    fn refill(&mut self, now: Instant) {
        let more = now.duration_since(self.since).as_micros() / EACH.as_micros();
        if more > 0 {
            self.count = u32::try_from(more).unwrap_or(MOST).saturating_add(self.count).min(MOST);
            self.since = now;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn after_a_burst_requests_come_two_in_a_millisecond() {
        let begun = Instant::now();
        let mut left = Left { count: MOST, since: begun };
        left.count = 0;
        left.refill(begun + Duration::from_micros(499));
        assert_eq!(left.count, 0);
        left.refill(begun + Duration::from_millis(1));
        assert_eq!(left.count, 2);
        left.refill(begun + Duration::from_hours(1));
        assert_eq!(left.count, MOST);
    }

    #[test]
    fn a_flood_is_held_up() {
        let turns = Turns::new();
        let begun = Instant::now();
        (0..MOST + 40).for_each(|_| turns.take());
        assert!(begun.elapsed() >= Duration::from_millis(19), "{:?}", begun.elapsed());
    }
}
