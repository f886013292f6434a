//! What a bus segment sees of a station.

use crate::time::{Baudrate, Instant};
use crate::wire::Telegram;

/// When a reply may start: not before the one, not after the other.
///
/// Reading "Replies": from the end of the request, min T_SDR to max(max T_SDR of the rate,
/// min T_SDR) + 11 bit times. Octets handed out count as sent.
///
/// Borrows nothing, so a driver can keep it, set a timer and ask for the octets with
/// [`Station::transmit`] when the time has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// End of the request + min T_SDR.
    pub not_before: Instant,
    /// End of the request + max(max T_SDR of the rate, min T_SDR) + 11 bit times.
    pub not_after: Instant,
}

/// A station on a segment: octets or telegrams in, replies out, all with the time they happen.
///
/// `now` of [`receive`](Self::receive) and [`indicate`](Self::indicate) is the end of the last
/// octet's stop bit. A driver calls, in the order in which things happen:
///
/// - inputs: `receive` (octets) or `indicate` (a telegram that the segment has parsed),
///   `line_error`, `poll`;
/// - outputs: `transmit`, inside the window that an input returned;
/// - questions: `next_deadline` (call `poll` then), `listening_rate`, `address`.
pub trait Station {
    /// Takes octets from the line, one or many, `now` being the end of the last one.
    ///
    /// Returns the window of the reply, where there is one. A reply that was not fetched before
    /// is dropped: whatever follows a request takes its place.
    fn receive(&mut self, now: Instant, octets: &[u8]) -> Option<Window>;

    /// Takes a telegram that somebody else has parsed and found free of errors.
    fn indicate(&mut self, now: Instant, telegram: &Telegram<'_>) -> Option<Window>;

    /// Takes note of a character with a parity, framing or overrun error.
    fn line_error(&mut self, now: Instant);

    /// The reply, if one is due and `now` lies in its window. Octets handed out count as sent.
    fn transmit(&mut self, now: Instant) -> Option<&[u8]>;

    /// Lets time pass: watchdog, baud search.
    fn poll(&mut self, now: Instant);

    /// When [`poll`](Self::poll) wants to be called next; `None`: nothing is under way.
    /// May be earlier than anything happens, never later.
    fn next_deadline(&self) -> Option<Instant>;

    /// The rate at which the station listens.
    fn listening_rate(&self) -> Baudrate;

    /// The address the station answers to; `None` while it stays off the bus.
    fn address(&self) -> Option<u8>;
}
