//! The octet path and the slice path of the receiver are one and the same to the outside.

#![allow(clippy::pedantic)] // Test code: casts and names are plain enough here.

use profibus_dp::fdl::{Receiver, ReceiverMode};
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};
use profibus_dp::wire::{Telegram, telegram};
use proptest::prelude::*;

const RATE: Baudrate = Baudrate::B500000;

/// What came, and when its last octet ended.
type Heard = Vec<(Instant, String)>;

fn note(heard: &mut Heard, end: Instant, telegram: &Telegram<'_>) {
    heard.push((end, format!("{telegram:02X?}")));
}

fn character() -> Duration {
    RATE.duration(BitTimes::CHARACTER)
}

/// Pieces of octets, each with the idle bit times before it.
fn octet_by_octet(pieces: &[(u32, Vec<u8>)]) -> Heard {
    let mut receiver = Receiver::new(ReceiverMode::Idle, RATE);
    let (mut now, mut heard) = (Instant::from_millis(1), Heard::new());
    for (idle, octets) in pieces {
        now += RATE.duration(BitTimes(*idle));
        for &octet in octets {
            now += character();
            if let Some(telegram) = receiver.octet(now, octet) {
                note(&mut heard, now, &telegram);
            }
        }
    }
    heard
}

fn piece_by_piece(mode: ReceiverMode, pieces: &[(u32, Vec<u8>)]) -> (Heard, bool) {
    let mut receiver = Receiver::new(mode, RATE);
    let (mut now, mut heard) = (Instant::from_millis(1), Heard::new());
    let mut ended = false;
    for (idle, octets) in pieces {
        now += RATE.duration(BitTimes(*idle));
        now += RATE.duration(BitTimes(11 * octets.len() as u32));
        if !octets.is_empty() {
            ended = receiver.receive(now, octets, |end, telegram| note(&mut heard, end, telegram));
        }
    }
    (heard, ended)
}

fn good_telegram() -> impl Strategy<Value = Vec<u8>> {
    let any_data = (any::<u8>(), 0u8..127, any::<u8>(), proptest::collection::vec(any::<u8>(), 0..40));
    prop_oneof![
        4 => any_data.prop_map(|(da, sa, fc, pdu)| {
            let (da, sa) = (da & 0x7F, sa & 0x7F);
            let fcs = telegram::sum(&[da, sa, fc]).wrapping_add(telegram::sum(&pdu));
            if pdu.is_empty() {
                vec![0x10, da, sa, fc, fcs, 0x16]
            } else if pdu.len() == 8 {
                [&[0xA2, da, sa, fc], &pdu[..], &[fcs, 0x16]].concat()
            } else {
                let le = pdu.len() as u8 + 3;
                [&[0x68, le, le, 0x68, da, sa, fc], &pdu[..], &[fcs, 0x16]].concat()
            }
        }),
        1 => Just(vec![0xE5]),
        1 => Just(vec![0xDC, 3, 2]),
        1 => Just(vec![0x10, 0x8B, 0x82, 0x6D, 0x7A, 0x16]),
    ]
}

fn octets() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        4 => good_telegram(),
        1 => (good_telegram(), any::<prop::sample::Index>(), 1u8..=255).prop_map(|(mut octets, at, flip)| {
            let at = at.index(octets.len());
            octets[at] ^= flip;
            octets
        }),
        1 => (good_telegram(), any::<prop::sample::Index>()).prop_map(|(octets, cut)| octets[..cut.index(octets.len())].to_vec()),
        1 => proptest::collection::vec(prop_oneof![Just(0x68), Just(0x10), Just(0xA2), Just(0xDC), Just(0xE5), any::<u8>()], 0..12),
    ]
}

/// How long a telegram is that these octets would begin, if anything tells that they do not.
fn claimed(octets: &[u8]) -> usize {
    match *octets {
        [0xE5, ..] => 1,
        [0xDC, ..] => 3,
        [0x10, ..] => 6,
        [0xA2, ..] => 14,
        // The head is looked at when it is whole.
        [0x68] | [0x68, _] | [0x68, _, _] => 4,
        [0x68, le, ler, 0x68, ..] if le == ler && (4..=249).contains(&le) => usize::from(le) + 6,
        _ => 0,
    }
}

/// Idle times that matter: none, just not idle, idle, long.
fn idle() -> impl Strategy<Value = u32> {
    prop_oneof![Just(0u32), 1u32..33, 34u32..60, Just(10_000)]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4_000))]

    #[test]
    fn octet_path_and_slice_path_hear_the_same(pieces in proptest::collection::vec((idle(), octets()), 0..8)) {
        prop_assert_eq!(octet_by_octet(&pieces), piece_by_piece(ReceiverMode::Idle, &pieces).0);
    }

    // However the same octets are cut into reads, a stream receiver hears the same telegrams.
    #[test]
    fn a_stream_is_heard_alike_however_it_is_cut(
        parts in proptest::collection::vec(octets(), 0..6),
        cuts in proptest::collection::vec(any::<prop::sample::Index>(), 0..6),
    ) {
        let all = parts.concat();
        let mut ends: Vec<usize> = cuts.iter().map(|cut| cut.index(all.len() + 1)).collect();
        ends.sort_unstable();
        ends.push(all.len());
        let mut begin = 0;
        let pieces: Vec<_> = ends.into_iter().map(|end| {
            let piece = (0, all[begin..end].to_vec());
            begin = end;
            piece
        }).collect();
        let texts = |heard: Heard| heard.into_iter().map(|(_, text)| text).collect::<Vec<_>>();
        let whole = [(0, all.clone())];
        prop_assert_eq!(
            texts(piece_by_piece(ReceiverMode::Stream, &pieces).0),
            texts(piece_by_piece(ReceiverMode::Stream, &whole).0)
        );
    }

    // Without a pause only what a false header overlaps is lost: telegrams that begin where no false
    // header before them reaches are heard, all of them.
    #[test]
    fn a_stream_loses_at_most_what_a_false_header_overlaps(
        garbage in proptest::collection::vec(prop_oneof![Just(0x68u8), Just(0x04), Just(0x10), Just(0xA2), Just(0xDC), Just(0xE5), any::<u8>()], 0..30),
        telegrams in proptest::collection::vec(good_telegram(), 1..12),
        cuts in proptest::collection::vec(any::<prop::sample::Index>(), 0..4),
    ) {
        let mut all = garbage.clone();
        let mut starts = Vec::new();
        for telegram in &telegrams {
            starts.push(all.len());
            all.extend(telegram);
        }
        // Octets before this one may be lost with a false header.
        let mut lost = garbage.len();
        let mut at = 0;
        while at < all.len() && !(starts.contains(&at) && at >= lost) {
            lost = lost.max(at + claimed(&all[at..]));
            at += 1;
        }
        let safe = starts.iter().position(|start| *start >= at).unwrap_or(telegrams.len());
        let mut ends: Vec<usize> = cuts.iter().map(|cut| cut.index(all.len() + 1)).chain([all.len()]).collect();
        ends.sort_unstable();
        let begins = [0].into_iter().chain(ends.iter().copied());
        let pieces: Vec<_> = begins.zip(&ends).map(|(begin, end)| (0, all[begin..*end].to_vec())).collect();
        let (heard, _) = piece_by_piece(ReceiverMode::Stream, &pieces);
        let (alone, _) = piece_by_piece(ReceiverMode::Stream, &[(0, telegrams[safe..].concat())]);
        let texts = |heard: &Heard| heard.iter().map(|(_, text)| text.clone()).collect::<Vec<_>>();
        let (heard, alone) = (texts(&heard), texts(&alone));
        prop_assert!(heard.ends_with(&alone), "{heard:?} has to end with {alone:?}; telegram {safe} at {at}");
    }

    // Garbage before a telegram and between two, each followed by a pause: nothing is lost.
    #[test]
    fn garbage_followed_by_a_pause_loses_nothing(
        parts in proptest::collection::vec((proptest::collection::vec(any::<u8>(), 0..60), good_telegram()), 1..6),
    ) {
        for mode in [ReceiverMode::Idle, ReceiverMode::Stream] {
            let pieces: Vec<_> = parts.iter().flat_map(|(garbage, telegram)| {
                [(10_000, garbage.clone()), (10_000, telegram.clone())]
            }).collect();
            let (heard, _) = piece_by_piece(mode, &pieces);
            let clean: Vec<_> = parts.iter().map(|(_, telegram)| (10_000, telegram.clone())).collect();
            let (due, _) = piece_by_piece(mode, &clean);
            let mut left = heard.iter().map(|(_, text)| text);
            for (_, text) in &due {
                prop_assert!(left.any(|heard| heard == text), "{mode:?}: {text} was lost");
            }
        }
    }

    // The octet path, the slice path and characters with errors between them.
    #[test]
    fn characters_with_errors_make_no_difference_between_the_paths(
        pieces in proptest::collection::vec((idle(), octets(), any::<bool>()), 0..8),
    ) {
        let mut receivers = [Receiver::new(ReceiverMode::Idle, RATE), Receiver::new(ReceiverMode::Idle, RATE)];
        let mut heard = [Heard::new(), Heard::new()];
        let mut now = Instant::from_millis(1);
        for (idle, octets, error) in &pieces {
            now += RATE.duration(BitTimes(*idle));
            let begin = now;
            for &octet in octets {
                now += character();
                if let Some(telegram) = receivers[0].octet(now, octet) {
                    note(&mut heard[0], now, &telegram);
                }
            }
            if !octets.is_empty() {
                prop_assert_eq!(now, begin + RATE.duration(BitTimes(11 * octets.len() as u32)));
                receivers[1].receive(now, octets, |end, telegram| note(&mut heard[1], end, telegram));
            }
            if *error {
                now += character();
                for receiver in &mut receivers {
                    receiver.line_error(now);
                }
            }
        }
        prop_assert_eq!(&heard[0], &heard[1]);
    }

    // Bad input: after any octets and a pause the next good telegram is heard.
    #[test]
    fn after_anything_and_a_pause_the_next_telegram_is_heard(
        garbage in proptest::collection::vec((idle(), proptest::collection::vec(any::<u8>(), 0..300)), 0..4),
    ) {
        let status = vec![0x10, 0x0B, 0x02, 0x49, 0x56, 0x16];
        for mode in [ReceiverMode::Idle, ReceiverMode::Stream] {
            let mut pieces = garbage.clone();
            pieces.push((10_000, status.clone()));
            let (heard, ended) = piece_by_piece(mode, &pieces);
            prop_assert!(ended);
            let expected = format!("{:02X?}", match telegram::parse(&status) {
                telegram::Parsed::Complete(telegram, _) => telegram,
                other => panic!("{other:?}"),
            });
            prop_assert_eq!(heard.last().map(|(_, text)| text.as_str()), Some(expected.as_str()));
        }
    }
}

fn heard(mode: ReceiverMode, pieces: &[(u32, &[u8])]) -> (usize, bool) {
    let pieces: Vec<_> = pieces.iter().map(|(idle, octets)| (*idle, octets.to_vec())).collect();
    let (heard, ended) = piece_by_piece(mode, &pieces);
    (heard.len(), ended)
}

const STATUS: &[u8] = &[0x10, 0x0B, 0x02, 0x49, 0x56, 0x16];

// Cases 13, 14 and 16 of the DP slave reference.
#[test]
fn a_stream_finds_the_next_telegram_at_once() {
    for garbage in [&[0xFF, 0x00, 0x55][..], &[0x68], &[0x68, 0x05, 0x05, 0x68, 0x8B]] {
        let joined = [garbage, STATUS].concat();
        assert_eq!(heard(ReceiverMode::Stream, &[(100, &joined)]), (1, true), "{garbage:02X?}");
        assert_eq!(heard(ReceiverMode::Idle, &[(100, &joined)]), (0, false), "{garbage:02X?}");
        assert_eq!(heard(ReceiverMode::Idle, &[(100, &joined), (34, STATUS)]), (1, true), "{garbage:02X?}");
    }
}

#[test]
fn a_fault_makes_an_idle_receiver_deaf_until_33_bit_times_of_idle() {
    let mut bad = STATUS.to_vec();
    bad[4] ^= 1;
    assert_eq!(heard(ReceiverMode::Idle, &[(100, &bad), (32, STATUS)]), (0, false));
    assert_eq!(heard(ReceiverMode::Idle, &[(100, &bad), (34, STATUS)]), (1, true));
}

// Longer than what an octet counts: no noise brings it back to a beginning.
#[test]
fn an_idle_receiver_stays_deaf_however_long_the_noise() {
    for length in 1..600 {
        for noise in [0x00, 0x10, 0x16, 0x68] {
            let joined = [&[0xFF], &vec![noise; length][..], STATUS].concat();
            assert_eq!(heard(ReceiverMode::Idle, &[(100, &joined)]), (0, false), "{length} of {noise:02X}");
        }
    }
}

#[test]
fn a_telegram_may_pause_for_less_than_33_bit_times() {
    let (head, tail) = STATUS.split_at(3);
    assert_eq!(heard(ReceiverMode::Idle, &[(100, head), (32, tail)]), (1, true));
    assert_eq!(heard(ReceiverMode::Idle, &[(100, head), (34, tail)]), (0, false));
    // 10 ms in a stream: 5000 bit times at 500 kbit/s.
    assert_eq!(heard(ReceiverMode::Stream, &[(100, head), (4_000, tail)]), (1, true));
    assert_eq!(heard(ReceiverMode::Stream, &[(100, head), (6_000, tail), (6_000, STATUS)]), (1, true));
}

#[test]
fn a_line_error_spoils_the_telegram_it_falls_into() {
    for at in 0..STATUS.len() {
        let mut receiver = Receiver::new(ReceiverMode::Idle, RATE);
        let mut now = Instant::from_millis(1);
        for (index, &octet) in STATUS.iter().enumerate() {
            now += character();
            if index == at {
                receiver.line_error(now);
            } else {
                assert!(receiver.octet(now, octet).is_none(), "error at {at}");
            }
        }
    }
}

// The line was busy with the damaged character, however long it was idle before.
#[test]
fn idle_is_counted_from_a_damaged_character_on() {
    for (idle, expected) in [(32, false), (34, true)] {
        let mut receiver = Receiver::new(ReceiverMode::Idle, RATE);
        let mut now = Instant::from_millis(1);
        receiver.line_error(now);
        now += RATE.duration(BitTimes(idle));
        let mut heard = false;
        for &octet in STATUS {
            now += character();
            heard = receiver.octet(now, octet).is_some();
        }
        assert_eq!(heard, expected, "{idle} bit times after it");
    }
}
