//! What a segment counts, and what it tells its owner.

use std::fmt;

use profibus_dp::time::{Baudrate, BitTimes};

use crate::end::{Note, Written};

/// What a segment has counted since it was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Telegrams without fault, of any kind.
    pub telegrams: u64,
    /// Replies handed to the end.
    pub replies: u64,
    /// Replies dropped because the master had gone on before they could start.
    pub overtaken: u64,
    /// Replies dropped because they were older than the reply limit.
    pub late: u64,
    /// Replies on a serial device that started after [`Settings::max_tsdr`](super::Settings::max_tsdr); they were sent all the same.
    pub after_max_tsdr: u64,
    /// Replies that two stations gave at once.
    pub collisions: u64,
    /// Replies of which the end took none or not all.
    pub dropped: u64,
    /// Characters with a parity or framing error.
    pub line_errors: u64,
    /// Second masters that the end refused.
    pub refused: u64,
}

/// What happened at the far side of a segment's end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum News {
    /// A master is there, with this rate (see [`RateListener::rate_found`](super::RateListener::rate_found) for `None`).
    MasterCame(Option<Baudrate>),
    /// The master has set another rate.
    RateChanged(Option<Baudrate>),
    /// Nobody is there any more.
    MasterLeft,
    /// Replies started too late; told with the first, the second, the fourth, and so on.
    LateReplies(LateReplies),
    /// Something that changes nothing for the segment.
    Noted(Note),
}

/// Replies that started so late that masters may have given up. Prints as a sentence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LateReplies {
    /// How many so far.
    pub count: u64,
    /// How long after its request the newest started, as far as the computer sees: what the adapter
    /// adds comes on top.
    pub took: BitTimes,
    /// How long it may have taken.
    pub limit: BitTimes,
}

impl fmt::Display for LateReplies {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { count, took: BitTimes(took), limit: BitTimes(limit) } = self;
        let replies = if *count == 1 { "reply has" } else { "replies have" };
        write!(
            f,
            "{count} {replies} started late, the newest {took} bit times after its request, and {limit} are \
             allowed: give the master a longer slot time"
        )
    }
}

impl Counters {
    #[inline]
    pub(super) fn count_reply(&mut self, written: Written) {
        self.replies += 1;
        self.dropped += u64::from(written != Written::All);
    }
}
