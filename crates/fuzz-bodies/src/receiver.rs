//! The receiver: octets in any pieces, in both modes, by both paths.

use profibus_dp::fdl::{Receiver, ReceiverMode};
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};
use profibus_dp::wire::Telegram;
use profibus_dp::wire::telegram::{MAX_OCTETS, Parsed, parse};

use crate::tape::Tape;

/// A piece of what is on the line.
#[derive(Debug, Clone, Copy)]
enum Piece<'a> {
    /// Idle bit times, then octets.
    Octets(u32, &'a [u8]),
    /// A character with an error.
    LineError,
}

/// What was heard, and when its last octet ended.
type Heard = Vec<(Instant, String)>;

/// The first octet chooses the rate. Then pieces: idle time, length, octets.
///
/// # Panics
///
/// When the paths hear different telegrams, when it matters how a stream is cut, when a telegram is heard
/// that is none, or when one after a pause is not.
pub fn receiver(octets: &[u8]) {
    let mut tape = Tape::new(octets);
    let rate = tape.pick(&Baudrate::ALL);
    let pieces = pieces(&mut tape);
    let by_octets = octet_by_octet(rate, &pieces);
    let by_slices_too = by_slices(rate, &pieces);
    assert!(are_alike(&by_octets, &by_slices_too), "the two paths: {by_octets:?} and {by_slices_too:?}");
    let whole: Vec<u8> = pieces.iter().flat_map(|piece| piece.octets().to_vec()).collect();
    let cut: Vec<_> = pieces.iter().map(|piece| piece.octets()).collect();
    assert_eq!(stream(rate, &cut), stream(rate, &[&whole]), "however a stream is cut");
    for mode in [ReceiverMode::Idle, ReceiverMode::Stream] {
        hears_after_a_pause(mode, rate, &pieces);
    }
    parses_what_it_emits(&whole);
}

fn pieces<'a>(tape: &mut Tape<'a>) -> Vec<Piece<'a>> {
    let mut pieces = Vec::new();
    while !tape.is_over() && pieces.len() < 64 {
        let idle = match tape.octet() {
            0xFF => {
                pieces.push(Piece::LineError);
                continue;
            }
            // No pause for half of them.
            idle @ 0..=127 => u32::from(idle) / 2 % 32 * u32::from(idle & 1),
            idle => u32::from(idle - 128).pow(2),
        };
        let length = usize::from(tape.octet());
        pieces.push(Piece::Octets(idle, tape.slice(length)));
    }
    pieces
}

impl<'a> Piece<'a> {
    const fn octets(self) -> &'a [u8] {
        match self {
            Self::Octets(_, octets) => octets,
            Self::LineError => &[],
        }
    }
}

/// A clock in bit times, so that nothing is rounded twice.
struct Clock(Baudrate, u32);

impl Clock {
    fn pass(&mut self, bits: u32) -> Instant {
        self.1 += bits;
        Instant::from_millis(1) + self.0.duration(BitTimes(self.1))
    }

    fn characters(&mut self, count: usize) -> Instant {
        self.pass(u32::try_from(count).expect("few") * BitTimes::CHARACTER.0)
    }
}

/// The same telegrams, at the same times but for what is rounded.
fn are_alike(one: &Heard, other: &Heard) -> bool {
    one.len() == other.len()
        && one.iter().zip(other).all(|((at, text), (at_too, text_too))| {
            text == text_too && at.since(*at_too).max(at_too.since(*at)) <= Duration::from_nanos(2)
        })
}

fn note(heard: &mut Heard, end: Instant, telegram: &Telegram<'_>) {
    if let Telegram::Data(data) = telegram {
        let mut octets = [0; MAX_OCTETS];
        let length = data.emit(&mut octets).expect("255 octets hold any telegram");
        assert_eq!(parse(&octets[..length]), Parsed::Complete(*telegram, length));
    }
    heard.push((end, format!("{telegram:02X?}")));
}

fn octet_by_octet(rate: Baudrate, pieces: &[Piece<'_>]) -> Heard {
    let mut receiver = Receiver::new(ReceiverMode::Idle, rate);
    let (mut clock, mut heard) = (Clock(rate, 0), Heard::new());
    for piece in pieces {
        match piece {
            Piece::LineError => receiver.line_error(clock.characters(1)),
            Piece::Octets(idle, octets) => {
                clock.pass(*idle);
                for &octet in *octets {
                    let now = clock.characters(1);
                    if let Some(telegram) = receiver.octet(now, octet) {
                        note(&mut heard, now, &telegram);
                    }
                }
            }
        }
    }
    heard
}

fn by_slices(rate: Baudrate, pieces: &[Piece<'_>]) -> Heard {
    let mut heard = Heard::new();
    feed(&mut Receiver::new(ReceiverMode::Idle, rate), &mut Clock(rate, 0), pieces, &mut heard);
    heard
}

fn feed(receiver: &mut Receiver, clock: &mut Clock, pieces: &[Piece<'_>], heard: &mut Heard) {
    for piece in pieces {
        match piece {
            Piece::LineError => receiver.line_error(clock.characters(1)),
            Piece::Octets(idle, octets) => {
                clock.pass(*idle);
                let now = clock.characters(octets.len());
                if !octets.is_empty() {
                    receiver.receive(now, octets, |end, telegram| note(heard, end, telegram));
                }
            }
        }
    }
}

/// Reads of a stream whose octets take no time.
fn stream(rate: Baudrate, reads: &[&[u8]]) -> Vec<String> {
    let mut receiver = Receiver::new(ReceiverMode::Stream, rate);
    let (now, mut heard) = (Instant::from_millis(1), Heard::new());
    for read in reads.iter().filter(|read| !read.is_empty()) {
        receiver.receive(now, read, |end, telegram| note(&mut heard, end, telegram));
    }
    heard.into_iter().map(|(_, text)| text).collect()
}

/// FDL status to station 11.
const STATUS: [u8; 6] = [0x10, 0x0B, 0x02, 0x49, 0x56, 0x16];

fn hears_after_a_pause(mode: ReceiverMode, rate: Baudrate, pieces: &[Piece<'_>]) {
    let mut receiver = Receiver::new(mode, rate);
    let (mut clock, mut heard) = (Clock(rate, 0), Heard::new());
    feed(&mut receiver, &mut clock, pieces, &mut heard);
    let before = heard.len();
    // Longer than the 10 ms of a stream and the 33 bit times of any line.
    clock.pass(rate.bits_per_second() / 50 + 100);
    let now = clock.characters(STATUS.len());
    let ended = receiver.receive(now, &STATUS, |end, telegram| note(&mut heard, end, telegram));
    assert!(ended && heard.len() == before + 1, "after a pause: {:?}", &heard[before..]);
}

/// Where a telegram lies at the beginning, it is the octets that it would be sent with.
fn parses_what_it_emits(octets: &[u8]) {
    match parse(octets) {
        Parsed::Complete(Telegram::Data(data), count) => {
            let mut emitted = [0; MAX_OCTETS];
            let length = data.emit(&mut emitted).expect("255 octets hold any telegram");
            // Eight octets of PDU may come as SD3, and are sent as SD2; FFh as a SAP stands for none.
            let usual = octets[0] != 0xA2 && !octets[5..count.min(9)].contains(&0xFF);
            assert!(!usual || emitted[..length] == octets[..count], "{data:?}");
        }
        Parsed::Complete(Telegram::Token { .. }, count) => assert_eq!(count, 3),
        Parsed::Complete(Telegram::ShortAcknowledgement, count) => assert_eq!(count, 1),
        Parsed::Incomplete { missing } => assert!(missing > 0 && octets.len() < MAX_OCTETS),
        Parsed::Invalid(_) => assert!(!octets.is_empty()),
    }
}
