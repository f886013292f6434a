//! Automatic baud rate detection.
//!
//! | state | leaves it |
//! |-------|-----------|
//! | searching | with one error-free SD1, SD2 or SD3, whoever it is for; to the next rate when the listening time is over or after 20 characters with errors |
//! | found | 5 s after the last error-free SD1, SD2 or SD3, unless the DP watchdog runs |
//! | fixed | never: the host knows the rate |

use crate::time::{Baudrate, Duration, Instant};

/// How a station comes to its baud rate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BaudSetting {
    /// The host knows it.
    Fixed(Baudrate),
    /// Searched, beginning with the rate used last.
    Search(Baudrate),
}

/// What the search has come to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// This rate is listened to now.
    Listening(Baudrate),
    /// This rate it is.
    Found(Baudrate),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Fixed,
    Found,
    Searching { since: Instant, errors: u8, round_begun: bool },
}

/// The watchdog/baud machine's states BAUD_SEARCH and BAUD_CONTROL.
#[derive(Debug, Clone)]
pub struct BaudSearch {
    rate: Baudrate,
    state: State,
    /// End of the last error-free telegram, whoever it was for.
    last_life: Instant,
}

impl BaudSearch {
    /// Reading "Baud rate": how long silence lasts before a found rate is searched anew.
    pub const CONTROL_TIME: Duration = Duration::from_secs(5);
    /// So many characters with errors, and the next rate is tried at once.
    pub const MAX_ERRORS: u8 = 20;

    /// At power-on.
    pub const fn new(now: Instant, setting: BaudSetting) -> Self {
        let (rate, state) = match setting {
            BaudSetting::Fixed(rate) => (rate, State::Fixed),
            BaudSetting::Search(rate) => (rate, Self::searching(now)),
        };
        Self { rate, state, last_life: now }
    }

    const fn searching(now: Instant) -> State {
        State::Searching { since: now, errors: 0, round_begun: false }
    }

    /// The rate in use or listened to.
    pub const fn rate(&self) -> Baudrate {
        self.rate
    }

    /// Whether the rate is known, so that answers may be sent.
    pub const fn is_found(&self) -> bool {
        !matches!(self.state, State::Searching { .. })
    }

    /// The host tells the rate: nothing is searched any more.
    pub const fn fix(&mut self, rate: Baudrate) {
        self.rate = rate;
        self.state = State::Fixed;
    }

    /// How long one rate is listened to: longer than the longest pause between two telegrams.
    pub const fn listening_time(rate: Baudrate) -> Duration {
        match rate {
            Baudrate::B9600 | Baudrate::B19200 | Baudrate::B45450 | Baudrate::B93750 | Baudrate::B187500 => {
                Duration::from_secs(1)
            }
            _ => Duration::from_millis(500),
        }
    }

    /// An error-free SD1, SD2 or SD3 ended at `now`. `true`: it ended the search, and is not
    /// answered itself.
    #[inline]
    pub fn life(&mut self, now: Instant) -> bool {
        self.last_life = now;
        if self.is_found() {
            return false;
        }
        self.state = State::Found;
        true
    }

    /// The DP watchdog has stopped at `now`: the control time begins.
    pub fn begin_control(&mut self, now: Instant) {
        self.last_life = self.last_life.max(now);
    }

    /// A character with an error.
    pub fn line_error(&mut self, now: Instant) -> Option<Change> {
        if let State::Searching { errors, .. } = &mut self.state {
            *errors = errors.saturating_add(1);
            if *errors >= Self::MAX_ERRORS {
                return Some(self.next_rate(now));
            }
        }
        None
    }

    /// Lets time pass. `dp_control`: the DP watchdog runs, and the rate is left alone.
    pub fn poll(&mut self, now: Instant, dp_control: bool) -> Option<Change> {
        let due = self.deadline(dp_control)?;
        if now < due {
            return None;
        }
        if self.is_found() {
            self.state = Self::searching(due);
            return Some(Change::Listening(self.rate));
        }
        Some(self.next_rate(due))
    }

    /// When [`poll`](Self::poll) has something to do.
    pub fn deadline(&self, dp_control: bool) -> Option<Instant> {
        match self.state {
            State::Fixed => None,
            State::Found => (!dp_control).then(|| self.last_life + Self::CONTROL_TIME),
            State::Searching { since, .. } => Some(since + Self::listening_time(self.rate)),
        }
    }

    /// Reading "Baud rate": from the last rate, then 12 Mbit/s downwards.
    fn next_rate(&mut self, now: Instant) -> Change {
        let begun = matches!(self.state, State::Searching { round_begun: true, .. });
        self.rate = if begun { self.rate.next_lower() } else { Baudrate::B12000000 };
        self.state = State::Searching { since: now, errors: 0, round_begun: true };
        Change::Listening(self.rate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    const START: Instant = Instant::from_millis(1_000);

    #[test]
    fn a_round_begins_with_the_last_rate_and_then_goes_down_from_the_top() {
        let mut search = BaudSearch::new(START, BaudSetting::Search(Baudrate::B19200));
        let mut heard = Vec::from([search.rate()]);
        let mut now = START;
        for _ in 0..11 {
            now = search.deadline(false).expect("searching");
            assert_eq!(search.poll(now - Duration::from_nanos(1), false), None);
            let Some(Change::Listening(rate)) = search.poll(now, false) else { panic!("no change") };
            heard.push(rate);
        }
        let mut expected = Vec::from([Baudrate::B19200]);
        expected.extend(Baudrate::ALL.into_iter().rev());
        expected.push(Baudrate::B12000000);
        assert_eq!(heard, expected);
        // DP slave reference, section 5.3: a round takes 8 s at most (here after 1 s at 19.2k).
        assert!(now.since(START) <= Duration::from_millis(8_500), "{now:?}");
    }

    #[test]
    fn twenty_errors_end_the_patience_with_a_rate() {
        let mut search = BaudSearch::new(START, BaudSetting::Search(Baudrate::B500000));
        for _ in 0..19 {
            assert_eq!(search.line_error(START), None);
        }
        assert_eq!(search.line_error(START), Some(Change::Listening(Baudrate::B12000000)));
    }

    #[test]
    fn a_found_rate_is_kept_alive_and_lost_after_the_control_time() {
        let mut search = BaudSearch::new(START, BaudSetting::Search(Baudrate::B500000));
        assert!(search.life(START));
        assert!(!search.life(START + Duration::from_secs(3)));
        let lost = START + Duration::from_secs(8);
        assert_eq!(search.poll(lost - Duration::from_nanos(1), false), None);
        assert_eq!(search.poll(lost, true), None, "the DP watchdog runs");
        assert_eq!(search.poll(lost, false), Some(Change::Listening(Baudrate::B500000)));
        assert!(!search.is_found());
    }

    #[test]
    fn a_fixed_rate_never_changes() {
        let mut search = BaudSearch::new(START, BaudSetting::Fixed(Baudrate::B93750));
        assert_eq!(search.deadline(false), None);
        assert_eq!(search.poll(Instant::MAX, false), None);
        assert_eq!((0..100).find_map(|_| search.line_error(START)), None);
        assert_eq!(search.rate(), Baudrate::B93750);
    }
}
