//! When the non-volatile record is written (manual 4.2.14).
//!
//! Answers never wait for a write.

use profibus_dp::time::{Duration, Instant};

/// Reading: a first change is written at once, further ones at most once in so long a time, the
/// newest value last.
pub const CHANGES_AT_MOST_EVERY: Duration = Duration::from_secs(1);

/// Reading: the operating time is written so often, with every other record, when the supply fails
/// and at an orderly end; so an unannounced cut loses at most so much.
pub const OPERATING_TIME_EVERY: Duration = Duration::from_secs(360);

/// Reading: a write is complete within so long a time.
pub const WRITE_COMPLETE_WITHIN: Duration = Duration::from_millis(40);

/// Decides when to write; what to write is the record of that moment.
///
/// The order of calls: [`change`](Self::change) as often as something changes,
/// [`take`](Self::take) to ask whether to write now, [`confirm`](Self::confirm) when it is
/// written or [`failed`](Self::failed) when it is not. Between the last two nothing is taken.
#[derive(Debug, Clone, Copy)]
pub struct WritePolicy {
    pending: Pending,
    writing: bool,
    /// Changes wait until then.
    changes_from: Instant,
    /// The operating time waits until then.
    time_from: Instant,
}

/// What waits to be written, the more urgent the later.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Pending {
    /// The operating time only.
    Nothing,
    /// A change.
    Change,
    /// Everything, without delay.
    Forced,
}

impl WritePolicy {
    /// From power-on: nothing to write yet.
    pub fn new(power_on: Instant) -> Self {
        Self {
            pending: Pending::Nothing,
            writing: false,
            changes_from: power_on,
            time_from: power_on + OPERATING_TIME_EVERY,
        }
    }

    /// Something that must be kept changed.
    pub fn change(&mut self) {
        self.pending = self.pending.max(Pending::Change);
    }

    /// The supply fails, or the end is near: write without delay.
    pub fn force(&mut self) {
        self.pending = Pending::Forced;
    }

    /// Whether a record was taken and neither confirmed nor failed yet.
    pub const fn is_writing(&self) -> bool {
        self.writing
    }

    /// Whether to write the record as it is now. If so, the write is under way.
    pub fn take(&mut self, now: Instant) -> bool {
        if self.next_deadline().is_none_or(|due| now < due) {
            return false;
        }
        if self.pending == Pending::Change {
            self.changes_from = now + CHANGES_AT_MOST_EVERY;
        }
        self.pending = Pending::Nothing;
        self.time_from = now + OPERATING_TIME_EVERY;
        self.writing = true;
        true
    }

    /// The record that was taken is written.
    pub fn confirm(&mut self) {
        self.writing = false;
    }

    /// The record that was taken could not be written: it is tried again in a second.
    pub fn failed(&mut self, now: Instant) {
        self.writing = false;
        self.change();
        self.changes_from = now + CHANGES_AT_MOST_EVERY;
    }

    /// When [`WritePolicy::take`] will say yes; `None` while a write is under way.
    pub fn next_deadline(&self) -> Option<Instant> {
        (!self.writing).then(|| match self.pending {
            Pending::Forced => Instant::ZERO,
            Pending::Change => self.changes_from.min(self.time_from),
            Pending::Nothing => self.time_from,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    /// Takes and confirms a write if one is due.
    fn written(policy: &mut WritePolicy, ms: u64) -> bool {
        let taken = policy.take(at(ms));
        if taken {
            policy.confirm();
        }
        taken
    }

    #[test]
    fn nothing_is_written_without_a_reason() {
        let mut policy = WritePolicy::new(at(0));
        assert!(!policy.take(at(359_999)));
        assert_eq!(policy.next_deadline(), Some(at(360_000)));
    }

    #[test]
    fn a_first_change_is_written_at_once_and_further_ones_once_a_second() {
        let mut policy = WritePolicy::new(at(0));
        policy.change();
        assert!(written(&mut policy, 5_000));
        assert!(!written(&mut policy, 5_100), "nothing changed since");
        policy.change();
        policy.change();
        assert_eq!(policy.next_deadline(), Some(at(6_000)));
        assert!(!written(&mut policy, 5_999));
        assert!(written(&mut policy, 6_000));
        policy.change();
        assert!(!written(&mut policy, 6_999));
        assert!(written(&mut policy, 7_000));
        policy.change();
        assert!(written(&mut policy, 9_000), "a second after the last write it is a first change");
    }

    #[test]
    fn a_change_while_writing_is_written_after() {
        let mut policy = WritePolicy::new(at(0));
        policy.change();
        assert!(policy.take(at(10)));
        assert!(policy.is_writing());
        policy.change();
        assert!(!policy.take(at(2_000)), "the write before is not confirmed");
        assert_eq!(policy.next_deadline(), None);
        policy.confirm();
        assert!(policy.take(at(2_000)));
    }

    #[test]
    fn operating_time_is_written_every_6_minutes_and_with_every_record() {
        let mut policy = WritePolicy::new(at(0));
        assert!(written(&mut policy, 360_000));
        assert_eq!(policy.next_deadline(), Some(at(720_000)));
        policy.change();
        assert!(written(&mut policy, 400_000));
        assert_eq!(policy.next_deadline(), Some(at(760_000)));
    }

    #[test]
    fn operating_time_does_not_delay_a_change() {
        let mut policy = WritePolicy::new(at(0));
        assert!(written(&mut policy, 360_000));
        policy.change();
        assert!(written(&mut policy, 360_001));
    }

    #[test]
    fn a_failing_supply_does_not_wait_for_the_second() {
        let mut policy = WritePolicy::new(at(0));
        policy.change();
        assert!(written(&mut policy, 100));
        policy.force();
        policy.change();
        assert!(written(&mut policy, 101));
        policy.force();
        assert!(policy.take(at(102)), "also when nothing changed: the operating time did");
        policy.force();
        assert!(!policy.take(at(103)), "one write at a time");
        policy.confirm();
        assert!(policy.take(at(103)));
    }

    #[test]
    fn a_failed_write_is_tried_again_in_a_second() {
        let mut policy = WritePolicy::new(at(0));
        policy.change();
        assert!(policy.take(at(100)));
        policy.failed(at(140));
        assert!(!policy.take(at(1_139)));
        assert!(policy.take(at(1_140)));
    }
}
