//! Telegrams out of a stream of octets without times.
//!
//! What is no telegram is handed out too: a bad telegram with what is wrong in it, or garbage. After
//! either, the next telegram that has no fault is found; within garbage a token or an `E5` counts only if a
//! telegram follows it.

use std::fmt;

use profibus_dp::wire::telegram::{Fault, Parsed, SD1, SD1_OCTETS, SD2, SD3_OCTETS, Telegram, parse};

/// The octets of garbage that are kept; the rest is counted.
pub const GARBAGE_KEPT: usize = 32;

/// A part of the stream. `at` is its first octet, counted from 1.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Piece {
    /// A telegram without a fault.
    Telegram {
        /// Where it begins.
        at: u64,
        /// All of it.
        octets: Vec<u8>,
    },
    /// It began as a telegram.
    Bad {
        /// Where it begins.
        at: u64,
        /// Up to its end, or to the good telegram within it.
        octets: Vec<u8>,
        /// What is wrong.
        wrong: Wrong,
    },
    /// Octets that begin no telegram.
    Garbage {
        /// Where it begins.
        at: u64,
        /// How many octets.
        count: u64,
        /// The first of them, at most [`GARBAGE_KEPT`].
        first: Vec<u8>,
        /// What is wrong with the first.
        wrong: Wrong,
    },
}

/// What is wrong with octets, and with which: from 1 at the beginning of the piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wrong {
    /// The octet at fault.
    pub octet: usize,
    /// Why.
    pub why: Why,
}

/// Why octets are no telegram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Why {
    /// A fault of the format.
    Fault(Fault),
    /// It ends before its end.
    TooShort {
        /// Octets that are missing, at least.
        missing: usize,
    },
}

impl fmt::Display for Wrong {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "octet {}: ", self.octet)?;
        match self.why {
            Why::Fault(Fault::StartDelimiter(octet)) => {
                write!(f, "{octet:02X}h begins no telegram; 10h, 68h, A2h, DCh and E5h do")
            }
            Why::Fault(Fault::LengthRepetition(le, again)) => {
                write!(f, "the length is repeated as {again}, but octet 2 says {le}")
            }
            Why::Fault(Fault::Length(le)) => write!(f, "a length of {le}, but 4 to 249 are possible"),
            Why::Fault(Fault::SecondStartDelimiter(octet)) => write!(f, "{octet:02X}h, but 68h is due here"),
            Why::Fault(Fault::CheckSum(got, due)) => {
                write!(f, "the check sum is {got:02X}h, but the octets make {due:02X}h")
            }
            Why::Fault(Fault::EndDelimiter(octet)) => write!(f, "{octet:02X}h, but a telegram ends with 16h"),
            Why::Fault(Fault::MissingExtension) => {
                f.write_str("bit 7 of an address announces a SAP, but no octet is left for it")
            }
            Why::TooShort { missing } => write!(f, "it ends here, but {missing} more octets are due"),
        }
    }
}

/// Finds the telegrams. Holds at most some 500 octets.
#[derive(Debug, Default)]
pub struct Splitter {
    buffer: Vec<u8>,
    /// Octets of the stream before the buffer.
    gone: u64,
    garbage: Option<Garbage>,
}

#[derive(Debug)]
struct Garbage {
    at: u64,
    count: u64,
    first: Vec<u8>,
    wrong: Wrong,
}

/// What to do with the beginning of the buffer.
enum Step {
    Wait,
    Telegram(usize),
    Bad(usize, Wrong),
    Skip(Wrong),
}

impl Splitter {
    /// Takes the next octets of the stream.
    pub fn push(&mut self, octets: &[u8], take: &mut dyn FnMut(Piece)) {
        for part in octets.chunks(256) {
            self.buffer.extend_from_slice(part);
            self.work(false, take);
        }
    }

    /// Whether octets wait for those that follow them.
    pub fn is_waiting(&self) -> bool {
        !self.buffer.is_empty() || self.garbage.is_some()
    }

    /// Takes the next octets of the stream if none wait and these are one whole telegram, which is the usual: the
    /// same as [`push`](Self::push) would find, without a copy.
    pub fn is_one_telegram(&mut self, octets: &[u8]) -> bool {
        let is_one = !self.is_waiting()
            && matches!(parse(octets), Parsed::Complete(_, length) if length == octets.len());
        if is_one {
            self.gone += octets.len() as u64;
        }
        is_one
    }

    /// The stream ends here, or pauses so long that no telegram goes on after it.
    pub fn finish(&mut self, take: &mut dyn FnMut(Piece)) {
        self.work(true, take);
        self.end_of_garbage(take);
    }

    fn work(&mut self, ending: bool, take: &mut dyn FnMut(Piece)) {
        let mut done = 0;
        while done < self.buffer.len() {
            let rest = &self.buffer[done..];
            let at = self.gone + done as u64 + 1;
            match step(rest, ending, self.garbage.is_some()) {
                Step::Wait => break,
                Step::Telegram(length) => {
                    let octets = rest[..length].to_vec();
                    self.end_of_garbage(take);
                    take(Piece::Telegram { at, octets });
                    done += length;
                }
                Step::Bad(length, wrong) => {
                    take(Piece::Bad { at, octets: rest[..length].to_vec(), wrong });
                    done += length;
                }
                Step::Skip(wrong) => {
                    let octet = rest[0];
                    let garbage =
                        self.garbage.get_or_insert(Garbage { at, count: 0, first: Vec::new(), wrong });
                    garbage.count += 1;
                    if garbage.first.len() < GARBAGE_KEPT {
                        garbage.first.push(octet);
                    }
                    done += 1;
                }
            }
        }
        self.buffer.drain(..done);
        self.gone += done as u64;
    }

    fn end_of_garbage(&mut self, take: &mut dyn FnMut(Piece)) {
        if let Some(Garbage { at, count, first, wrong }) = self.garbage.take() {
            take(Piece::Garbage { at, count, first, wrong });
        }
    }
}

fn step(octets: &[u8], ending: bool, in_garbage: bool) -> Step {
    let too_short = |missing| Wrong { octet: octets.len(), why: Why::TooShort { missing } };
    match parse(octets) {
        Parsed::Complete(Telegram::Data(_), length) => Step::Telegram(length),
        Parsed::Complete(weak, length) if in_garbage => {
            let plausible =
                !matches!(weak, Telegram::Token { da: 127.., .. } | Telegram::Token { sa: 127.., .. });
            match parse(&octets[length..]) {
                _ if !plausible => Step::Skip(too_short(0)),
                Parsed::Complete(Telegram::Data(_), _) => Step::Telegram(length),
                Parsed::Incomplete { .. } if ending => Step::Telegram(length),
                Parsed::Incomplete { .. } => Step::Wait,
                _ => Step::Skip(too_short(0)),
            }
        }
        Parsed::Complete(_, length) => Step::Telegram(length),
        Parsed::Incomplete { .. } if !ending => Step::Wait,
        Parsed::Incomplete { missing } => bad(octets, octets.len(), too_short(missing), true, in_garbage),
        Parsed::Invalid(fault) => {
            let length = extent(octets, fault);
            let wrong = Wrong { octet: octet_of(fault, octets, length.unwrap_or(1)), why: Why::Fault(fault) };
            match length {
                Some(length) => bad(octets, length, wrong, ending, in_garbage),
                None => Step::Skip(wrong),
            }
        }
    }
}

/// A telegram with a fault has this length, unless a good one begins within it.
fn bad(octets: &[u8], length: usize, wrong: Wrong, ending: bool, in_garbage: bool) -> Step {
    for inner in 1..length {
        match parse(&octets[inner..]) {
            Parsed::Complete(Telegram::Data(_), _) if in_garbage => return Step::Skip(wrong),
            Parsed::Complete(Telegram::Data(_), _) => return Step::Bad(inner, wrong),
            Parsed::Incomplete { .. } if !ending => return Step::Wait,
            _ => {}
        }
    }
    if in_garbage { Step::Skip(wrong) } else { Step::Bad(length, wrong) }
}

/// The length that a telegram with this fault has by its beginning, if that can be relied on.
fn extent(octets: &[u8], fault: Fault) -> Option<usize> {
    if !matches!(fault, Fault::CheckSum(..) | Fault::EndDelimiter(_) | Fault::MissingExtension) {
        return None;
    }
    let length = match octets {
        [SD1, ..] => SD1_OCTETS,
        [SD2, le, ..] => usize::from(*le) + 6,
        _ => SD3_OCTETS,
    };
    Some(length.min(octets.len()))
}

fn octet_of(fault: Fault, octets: &[u8], length: usize) -> usize {
    match fault {
        Fault::StartDelimiter(_) => 1,
        Fault::LengthRepetition(..) => 3,
        Fault::SecondStartDelimiter(_) => 4,
        Fault::CheckSum(..) => length - 1,
        Fault::EndDelimiter(_) => length,
        Fault::MissingExtension if octets.first() == Some(&SD2) => 5,
        Fault::Length(_) | Fault::MissingExtension => 2,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::hex;

    fn split(text: &str) -> Vec<String> {
        let octets = hex::octets(text).expect("hex");
        told(&octets, octets.len().max(1))
    }

    fn told(octets: &[u8], size: usize) -> Vec<String> {
        let mut told = Vec::new();
        let mut take = |piece| {
            told.push(match piece {
                Piece::Telegram { at, octets } => format!("{at}: {}", hex::text(&octets)),
                Piece::Bad { at, octets, wrong } => format!("{at}: BAD {} {wrong}", hex::text(&octets)),
                Piece::Garbage { at, count, first, wrong } => {
                    format!("{at}: {count} of garbage {} {wrong}", hex::text(&first))
                }
            });
        };
        let mut splitter = Splitter::default();
        for part in octets.chunks(size) {
            splitter.push(part, &mut take);
        }
        splitter.finish(&mut take);
        told
    }

    // Reference 1.5, all formats in a row.
    #[test]
    fn all_formats_are_found() {
        let formats = [
            "10 0B 02 49 56 16",
            "68 05 05 68 8B 82 6D 3C 3E F4 16",
            "A2 82 8B 08 3E 3C 02 05 00 FF 47 11 ED 16",
            "DC 03 02",
            "E5",
        ];
        let mut at = 1;
        let due: Vec<String> = formats
            .iter()
            .map(|text| {
                let line = format!("{at}: {text}");
                at += text.split(' ').count();
                line
            })
            .collect();
        assert_eq!(split(&formats.join(" ")), due);
    }

    // Reference 7.1, cases 2, 3, 6, 8, 9, 13, 14, 16, and a length that is repeated wrongly.
    #[test]
    fn what_is_wrong_is_told_with_the_octet() {
        for (text, words) in [
            (
                "10 0B 02 49 57 16",
                "1: BAD 10 0B 02 49 57 16 octet 5: the check sum is 57h, but the octets make 56h",
            ),
            ("10 0B 02 49 56 17", "1: BAD 10 0B 02 49 56 17 octet 6: 17h, but a telegram ends with 16h"),
            ("68 05 05 69 8B 82 6D 3C 3E F4 16", "octet 4: 69h, but 68h is due here"),
            ("68 05 06 68 8B 82 6D 3C 3E F4 16", "octet 3: the length is repeated as 6, but octet 2 says 5"),
            ("68 03 03 68 0B 02 49 56 16", "octet 2: a length of 3, but 4 to 249 are possible"),
            ("10 8B 82 6D 7A 16", "octet 2: bit 7 of an address announces a SAP"),
            ("68 04 04 68 8B 82 6D 3C B6 16", "octet 5: bit 7 of an address announces a SAP"),
            ("68 05 05 68 8B 82", "octet 6: it ends here, but 5 more octets are due"),
        ] {
            let told = split(text);
            assert!(told.len() == 1 && told[0].contains(words), "{text}: {told:#?}");
        }
    }

    #[test]
    fn one_whole_telegram_is_taken_at_once_only_where_nothing_waits() {
        let status = hex::octets("10 0B 02 49 56 16").expect("hex");
        let mut pieces = Vec::new();
        let mut splitter = Splitter::default();
        assert!(splitter.is_one_telegram(&status));
        let no_telegram: [&[u8]; 3] = [&status[..5], &[status.as_slice(), &[0xE5]].concat(), &[0xFF]];
        for octets in no_telegram {
            assert!(!splitter.is_one_telegram(octets), "{octets:02X?}");
        }
        // The beginning of an SD2 whose data may well look like a telegram.
        splitter.push(&[0x68, 9, 9], &mut |piece| pieces.push(piece));
        assert!(splitter.is_waiting() && !splitter.is_one_telegram(&status));
        splitter.finish(&mut |piece| pieces.push(piece));
        assert!(splitter.is_one_telegram(&status));
        splitter.push(&[0xFF], &mut |piece| pieces.push(piece));
        assert!(!splitter.is_one_telegram(&status));
        splitter.finish(&mut |piece| pieces.push(piece));
        // Octets taken at once count: 6, 3 and 6 before this one.
        assert!(
            matches!(pieces[..], [Piece::Bad { at: 7, .. }, Piece::Garbage { at: 16, .. }]),
            "{pieces:?}"
        );
    }

    #[test]
    fn a_good_telegram_after_a_bad_one_is_found() {
        let status = "10 0B 02 49 56 16";
        let last = |text: &str| split(&format!("{text} {status}")).pop().expect("something");
        for text in [
            "FF 00 55",
            "68",
            "68 05 05 68 8B",
            "10 0B 02 49 57 16",
            "68 F9 F9 68 01",
            "E5 55",
            "55 E5 DC 03 02",
            "A2 00 10 10 68",
        ] {
            assert!(
                last(text).ends_with(&format!(": {status}")),
                "{text}: {:#?}",
                split(&format!("{text} {status}"))
            );
        }
        assert_eq!(split("55 E5 10 0B 02 49 56 16").len(), 3, "an E5 before a telegram is one");
        assert_eq!(split("55 E5 66 10 0B 02 49 56 16").len(), 2, "an E5 within garbage is garbage");
    }

    // The false header's own end comes first; the telegram within goes on behind it.
    #[test]
    fn a_telegram_that_outlasts_a_false_header_is_waited_for() {
        let octets = hex::octets("68 05 05 68 8B 82 6D 3C 10 0B 02 49 56 16").expect("hex");
        for size in [1, 11, 14] {
            let told = told(&octets, size);
            assert!(told.len() == 2 && told[1] == "9: 10 0B 02 49 56 16", "{size}: {told:#?}");
        }
    }

    #[test]
    fn garbage_without_end_is_counted_and_not_kept() {
        let told = told(&vec![0x55; 1_000_000], 4096);
        assert_eq!(told.len(), 1);
        assert!(told[0].starts_with("1: 1000000 of garbage 55 55") && told[0].len() < 300, "{told:#?}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]

        #[test]
        fn every_octet_is_in_just_one_piece(
            octets in prop::collection::vec(prop_oneof![any::<u8>(), prop::sample::select(&[0x68, 0x10, 0xE5, 0xA2, 0xDC, 4, 0xF9][..])], 0..700),
            size in 1_usize..300,
        ) {
            let mut next = 1;
            let mut most = 0;
            let mut take = |piece| {
                let (at, count) = match piece {
                    Piece::Telegram { at, octets } | Piece::Bad { at, octets, .. } => (at, octets.len() as u64),
                    Piece::Garbage { at, count, .. } => (at, count),
                };
                assert_eq!(at, next);
                next += count;
            };
            let mut splitter = Splitter::default();
            for part in octets.chunks(size) {
                splitter.push(part, &mut take);
                most = most.max(splitter.buffer.len());
            }
            splitter.finish(&mut take);
            prop_assert_eq!(next, octets.len() as u64 + 1);
            prop_assert!(most < 600);
            // However the stream is cut, the same is found.
            prop_assert_eq!(told(&octets, size), told(&octets, 1));
        }
    }
}
