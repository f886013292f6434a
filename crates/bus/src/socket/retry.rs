//! When to try again what did not work, and what to tell about it.

use std::io::ErrorKind;
use std::time::{Duration, Instant};

use rustix::io::Errno;

use crate::end::{Event, Note};

const FIRST: Duration = Duration::from_millis(10);
const LONGEST: Duration = Duration::from_secs(1);

/// Pauses that grow, and reasons that are told once.
#[derive(Debug)]
pub(super) struct Retry {
    /// When it is time again.
    due: Option<Instant>,
    pause: Duration,
    told: Option<ErrorKind>,
}

impl Default for Retry {
    /// Nothing has gone wrong yet.
    fn default() -> Self {
        Self { due: None, pause: FIRST, told: None }
    }
}

impl Retry {
    /// How long to wait; `None`: no longer, or nothing has gone wrong.
    pub(super) fn remaining(&self) -> Option<Duration> {
        let remaining = self.due?.saturating_duration_since(Instant::now());
        (!remaining.is_zero()).then_some(remaining)
    }

    #[inline]
    pub(super) fn is_waiting(&self) -> bool {
        self.due.is_some() && self.remaining().is_some()
    }

    /// It did not work: later again, after a longer pause each time. A reason that is new is noted.
    pub(super) fn failed(&mut self, error: Errno, note: impl FnOnce(ErrorKind) -> Note) -> Event {
        self.later();
        let why = std::io::Error::from(error).kind();
        if self.told.replace(why) == Some(why) { Event::TimedOut } else { Event::Noted(note(why)) }
    }

    /// Later again.
    pub(super) fn later(&mut self) {
        self.due = Some(Instant::now() + self.pause);
        self.pause = LONGEST.min(2 * self.pause);
    }

    /// It has worked, for now.
    pub(super) fn succeeded(&mut self) {
        (self.due, self.told) = (None, None);
    }

    /// What has worked is of use: the next trouble is another one.
    #[inline]
    pub(super) fn is_proven(&mut self) {
        self.pause = FIRST;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_grow_up_to_a_second_and_reasons_are_told_once() {
        let mut retry = Retry::default();
        assert!(!retry.is_waiting());
        let pauses: Vec<_> = (0..9)
            .map(|_| {
                retry.later();
                retry.remaining().expect("a pause").as_millis() + 1
            })
            .collect();
        for (pause, due) in pauses.into_iter().zip([10, 20, 40, 80, 160, 320, 640, 1000, 1000]) {
            assert!((due - 5..=due).contains(&pause), "{pause} for {due}");
        }
        let refused = Event::Noted(Note::Unreachable(ErrorKind::ConnectionRefused));
        assert_eq!(retry.failed(Errno::CONNREFUSED, Note::Unreachable), refused);
        assert_eq!(retry.failed(Errno::CONNREFUSED, Note::Unreachable), Event::TimedOut);
        let late = Event::Noted(Note::Unreachable(ErrorKind::TimedOut));
        assert_eq!(retry.failed(Errno::TIMEDOUT, Note::Unreachable), late);
        retry.succeeded();
        assert!(!retry.is_waiting());
        assert_eq!(retry.failed(Errno::TIMEDOUT, Note::Unreachable), late);
        retry.is_proven();
        retry.later();
        assert!(retry.remaining().expect("a pause") <= FIRST);
    }
}
