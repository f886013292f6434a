//! Telegrams out of octets that come in pieces.

use dissector::splitter::{Piece, Splitter};
use profibus_dp::wire::telegram::{Parsed, Telegram, parse};

use crate::packet::{Direction, Faults, Packet};

/// Octets of one telegram never have such a pause between them, not even over a network.
pub const PAUSE_NANOS: u64 = 20_000_000;

/// Puts telegrams together. Octets of a master and of slaves never belong to one telegram; nor do those
/// before and after a pause.
#[derive(Debug, Default)]
pub struct Assembler {
    splitter: Splitter,
    /// What came last.
    last: Option<(u64, Option<Direction>)>,
    /// Octets so far.
    count: u64,
    /// Since which octet, counted from 1, octets have come at which time.
    times: Vec<(u64, u64)>,
    /// Said about the octets that wait.
    comments: Vec<String>,
    /// A character error among the octets that wait.
    character_error: bool,
}

impl Assembler {
    /// Takes octets that were on the line at `nanos`. `comments`: what there is to say about them.
    pub fn push(
        &mut self,
        nanos: u64,
        direction: Option<Direction>,
        octets: &[u8],
        comments: Vec<String>,
        take: &mut dyn FnMut(Packet),
    ) {
        let apart = |(then, who): (u64, Option<Direction>)| {
            who != direction || nanos.saturating_sub(then) > PAUSE_NANOS
        };
        if self.last.is_some_and(apart) || !comments.is_empty() {
            self.finish(take);
        }
        self.last = Some((nanos, direction));
        if comments.is_empty() && self.splitter.is_one_telegram(octets) {
            self.count += octets.len() as u64;
            let direction = direction.or_else(|| of_telegram(octets));
            return take(Packet { nanos, direction, octets: octets.to_vec(), ..Packet::default() });
        }
        self.times.push((self.count + 1, nanos));
        self.count += octets.len() as u64;
        self.comments = comments;
        let mut splitter = std::mem::take(&mut self.splitter);
        splitter.push(octets, &mut |piece| take(self.packet(piece)));
        self.splitter = splitter;
        if !self.comments.is_empty() {
            self.finish(take);
        }
    }

    /// A character with an error: what waits is no telegram.
    pub fn character_error(&mut self, take: &mut dyn FnMut(Packet)) {
        self.character_error = true;
        self.finish(take);
        self.character_error = false;
    }

    /// Time has gone on to `nanos`: whatever waits longer than a pause goes out.
    pub fn pass(&mut self, nanos: u64, take: &mut dyn FnMut(Packet)) {
        if self.last.is_some_and(|(then, _)| nanos.saturating_sub(then) > PAUSE_NANOS) {
            self.finish(take);
        }
    }

    /// The end, or a pause.
    pub fn finish(&mut self, take: &mut dyn FnMut(Packet)) {
        if self.splitter.is_waiting() {
            self.finish_splitter(take);
        }
        self.comments.clear();
        self.times.clear();
    }

    fn finish_splitter(&mut self, take: &mut dyn FnMut(Packet)) {
        let mut splitter = std::mem::take(&mut self.splitter);
        splitter.finish(&mut |piece| take(self.packet(piece)));
        self.splitter = splitter;
    }

    fn packet(&mut self, piece: Piece) -> Packet {
        let (at, octets, wrong) = match piece {
            Piece::Telegram { at, octets } => (at, octets, None),
            Piece::Bad { at, octets, wrong } => (at, octets, Some((wrong, None))),
            Piece::Garbage { at, count, first, wrong } => (at, first, Some((wrong, Some(count)))),
        };
        // Times of octets that went out before are of no more use.
        while self.times.get(1).is_some_and(|(since, _)| *since <= at) {
            self.times.remove(0);
        }
        let nanos = self.times.first().map_or(0, |(_, nanos)| *nanos);
        let mut comments = std::mem::take(&mut self.comments);
        let mut faults = Faults::default();
        if let Some((wrong, count)) = wrong {
            faults = Faults::of(wrong);
            comments.push(match count {
                Some(count) if count > octets.len() as u64 => {
                    format!("no telegram, {count} octets of which the first are here: {wrong}")
                }
                Some(_) => format!("no telegram: {wrong}"),
                None => format!("bad telegram: {wrong}"),
            });
        }
        faults.character = self.character_error;
        let direction = self.last.and_then(|(_, direction)| direction).or_else(|| of_telegram(&octets));
        Packet { nanos, direction, octets, faults, missing: 0, comments }
    }
}

/// Bit 6 of FC tells; a token is a master's, an E5 a slave's.
fn of_telegram(octets: &[u8]) -> Option<Direction> {
    match parse(octets) {
        Parsed::Complete(Telegram::Data(telegram), _) if !telegram.fc.is_request() => Some(Direction::Reply),
        Parsed::Complete(Telegram::ShortAcknowledgement, _) => Some(Direction::Reply),
        Parsed::Complete(..) => Some(Direction::Request),
        _ => None,
    }
}
