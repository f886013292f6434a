//! What somebody sees who listens to a segment and takes no part.
//!
//! Without a tap a telegram pays one look at a pointer.

use std::fmt;

use profibus_dp::time::{Baudrate, Instant};

use crate::end::Written;
use crate::faults::FaultCounters;

/// Somebody who listens to a segment, on the segment's thread: it must never wait for long.
pub trait WireTap: Send + fmt::Debug {
    /// Takes note of what was on the line. In real time `at` is when the computer had the octets, or gave
    /// them away; in virtual time it is the first edge of the first octet.
    fn saw(&mut self, at: Instant, sight: Sight<'_>);
}

/// What was on the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sight<'a> {
    /// Octets of the master, cut anywhere.
    Request {
        /// As they arrived, after what the fault layer did to them. Where it let nobody hear them, as
        /// they were sent.
        octets: &'a [u8],
        /// What the fault layer did to them.
        faults: FaultCounters,
    },
    /// Octets of a station.
    Reply {
        /// As the master gets them; those that he does not get, as the station gave them.
        octets: &'a [u8],
        /// What the fault layer did to them.
        faults: FaultCounters,
        /// Two stations answered at once.
        collision: bool,
        /// Whether the end took them.
        written: Written,
    },
    /// A reply that was due and was not sent: octets came before it.
    Overtaken,
    /// A reply that was due and was not sent: it was older than the reply limit.
    TooLate,
    /// A character with a parity or framing error.
    CharacterError,
    /// A master is there, with this rate if it has one of the ten.
    MasterCame(Option<Baudrate>),
    /// The rate is another one.
    Rate(Option<Baudrate>),
    /// Nobody is there any more.
    MasterLeft,
}

/// Two who listen.
#[derive(Debug)]
struct Both([Box<dyn WireTap>; 2]);

impl WireTap for Both {
    fn saw(&mut self, at: Instant, sight: Sight<'_>) {
        for tap in &mut self.0 {
            tap.saw(at, sight);
        }
    }
}

/// One more who listens.
pub(crate) fn add(there: &mut Option<Box<dyn WireTap>>, tap: Box<dyn WireTap>) {
    *there = Some(match there.take() {
        None => tap,
        Some(first) => Box::new(Both([first, tap])),
    });
}

impl FaultCounters {
    /// What was done since the counters stood as `before`.
    #[must_use]
    pub fn since(&self, before: &Self) -> Self {
        let less = |now: u64, then: u64| now.saturating_sub(then);
        Self {
            lost_requests: less(self.lost_requests, before.lost_requests),
            doubled_requests: less(self.doubled_requests, before.doubled_requests),
            damaged_request_characters: less(
                self.damaged_request_characters,
                before.damaged_request_characters,
            ),
            lost_replies: less(self.lost_replies, before.lost_replies),
            doubled_replies: less(self.doubled_replies, before.doubled_replies),
            late_replies: less(self.late_replies, before.late_replies),
            damaged_reply_characters: less(self.damaged_reply_characters, before.damaged_reply_characters),
        }
    }
}
