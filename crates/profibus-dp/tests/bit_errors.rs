//! Every error of one, two and three bits in the characters of a telegram: in idle mode none is
//! taken for another telegram.
//!
//! A character is 11 bits: start (0), eight data bits, the lowest first, even parity, stop (1). The
//! errors hit the bits on the line, start and stop bits included, so a receiver may lose its
//! framing. It is an ideal UART: it waits for a 0, takes that for a start bit and samples the ten
//! bits that follow in their middle; the next start bit may follow the stop bit at once. With wrong
//! parity, or a 0 for a stop bit, the character is an error. How the UART finds its way after an error
//! does not matter: the receiver is deaf from then on until the line has been idle for 33 bit
//! times, and no three errors make that out of a telegram (`no_three_errors_make_an_idle_line`).
//!
//! So a walk may end with the first error it sees. Most of them end within the first damaged
//! character, which is why eight million of them take a second.

#![allow(clippy::pedantic)] // Test code: casts and names are plain enough here.

use profibus_dp::fdl::{Receiver, ReceiverMode};
use profibus_dp::time::{Baudrate, BitTimes, Instant};
use profibus_dp::wire::Telegram;

const RATE: Baudrate = Baudrate::B500000;
/// Bits of a character.
const CHARACTER: usize = 11;

fn sd2(body: &[u8]) -> Vec<u8> {
    let le = body.len() as u8;
    let sum = body.iter().fold(0u8, |sum, octet| sum.wrapping_add(*octet));
    [&[0x68, le, le, 0x68], body, &[sum, 0x16]].concat()
}

const STATUS: [u8; 6] = [0x10, 0x0B, 0x02, 0x49, 0x56, 0x16];

/// Telegrams of each format up to 33 octets; the token by itself.
fn telegrams() -> Vec<(&'static str, Vec<u8>)> {
    let chk_cfg = [0x68, 0x06, 0x06, 0x68, 0x8B, 0x82, 0x7D, 0x3E, 0x3E, 0xF1, 0xF7, 0x16];
    let sd3 = [0xA2, 0x8B, 0x82, 0x7D, 0x3E, 0x3E, 0xF1, 0, 0, 0, 0, 0, 0xF7, 0x16];
    // For station 5, with telegrams for us among its data.
    let nested =
        [&[0x05, 0x02, 0x7D, 0x16], &STATUS[..], &[0x16, 0xE5], &chk_cfg, &[0x16, 0xE5, 0xDC]].concat();
    vec![
        ("SC", vec![0xE5]),
        ("SD1, FDL status", STATUS.to_vec()),
        ("SD1, Data_Exchange", vec![0x10, 0x0B, 0x02, 0x7D, 0x8A, 0x16]),
        ("SD2, Slave_Diag", vec![0x68, 0x05, 0x05, 0x68, 0x8B, 0x82, 0x6D, 0x3C, 0x3E, 0xF4, 0x16]),
        ("SD2, preset", vec![0x68, 0x07, 0x07, 0x68, 0x0B, 0x02, 0x7D, 0x80, 0x00, 0x10, 0x00, 0x1A, 0x16]),
        ("SD2, all zeros", sd2(&[&[0x0B, 0x02, 0x5D][..], &[0; 12]].concat())),
        ("SD2, all ones", sd2(&[&[0x0B, 0x02, 0x5D][..], &[0xFF; 12]].concat())),
        ("SD3, Chk_Cfg", sd3.to_vec()),
        ("SD2 of 33 octets with telegrams for us in it", sd2(&nested)),
    ]
}

/// The bits of a telegram on the line.
fn bits(octets: &[u8]) -> Vec<u8> {
    let character = |octet: &u8| {
        let data = (0..8).map(|bit| octet >> bit & 1);
        let parity = (octet.count_ones() % 2) as u8;
        [0].into_iter().chain(data).chain([parity, 1]).collect::<Vec<u8>>()
    };
    octets.iter().flat_map(character).collect()
}

/// When bit `at` begins.
fn instant(at: usize) -> Instant {
    Instant::from_millis(1) + RATE.duration(BitTimes(at as u32))
}

/// The next character from bit `at` on: where it ends, and what it is; `None`: an error.
#[inline]
fn character(line: &[u8], mut at: usize) -> Option<(usize, Option<u8>)> {
    while *line.get(at)? == 1 {
        at += 1;
    }
    let bit = |index: usize| line.get(at + index).copied().unwrap_or(1);
    let octet = (0..8).fold(0, |octet, index| octet | bit(1 + index) << index);
    let good = (octet.count_ones() as u8 + bit(9)).is_multiple_of(2) && bit(10) == 1;
    Some((at + CHARACTER, good.then_some(octet)))
}

/// A telegram on its way, and receivers that have heard it up to each of its characters.
struct Walker {
    line: Vec<u8>,
    receivers: Vec<Receiver>,
    original: String,
}

impl Walker {
    fn new(octets: &[u8]) -> Self {
        let mut receiver = Receiver::new(ReceiverMode::Idle, RATE);
        let mut receivers = vec![receiver.clone()];
        let mut original = String::new();
        for (index, octet) in octets.iter().enumerate() {
            if let Some(telegram) = receiver.octet(instant((index + 1) * CHARACTER), *octet) {
                original = format!("{telegram:?}");
            }
            receivers.push(receiver.clone());
        }
        assert!(!original.is_empty(), "{octets:02X?} is a telegram");
        Self { line: bits(octets), receivers, original }
    }

    /// Whether another telegram is heard, with these bits wrong; the first of them comes first.
    fn accepts_another(&mut self, wrong: &[usize], is_other: fn(&Telegram<'_>) -> bool) -> bool {
        for &at in wrong {
            self.line[at] ^= 1;
        }
        let first = wrong[0] / CHARACTER;
        let mut receiver = self.receivers[first].clone();
        let mut at = first * CHARACTER;
        let mut another = false;
        while let Some((end, Some(octet))) = character(&self.line, at) {
            if let Some(telegram) = receiver.octet(instant(end), octet) {
                another |= is_other(&telegram) && format!("{telegram:?}") != self.original;
            }
            at = end;
        }
        for &at in wrong {
            self.line[at] ^= 1;
        }
        another
    }
}

/// All errors of up to three bits whose first is at `first`; how many there are.
fn all_from(walker: &mut Walker, first: usize, is_other: fn(&Telegram<'_>) -> bool, what: &str) -> u64 {
    let length = walker.line.len();
    let mut count = 0;
    let mut try_one = |wrong: &[usize]| {
        assert!(!walker.accepts_another(wrong, is_other), "{what}: bits {wrong:?}");
        count += 1;
    };
    try_one(&[first]);
    for second in first + 1..length {
        try_one(&[first, second]);
        for third in second + 1..length {
            try_one(&[first, second, third]);
        }
    }
    count
}

fn all_errors(octets: &[u8], is_other: fn(&Telegram<'_>) -> bool, what: &str) -> u64 {
    let length = octets.len() * CHARACTER;
    std::thread::scope(|scope| {
        // Every other first bit: both threads have the same to do.
        let halves = [0, 1].map(|half| {
            scope.spawn(move || {
                let mut walker = Walker::new(octets);
                (half..length)
                    .step_by(2)
                    .map(|first| all_from(&mut walker, first, is_other, what))
                    .sum::<u64>()
            })
        });
        halves.into_iter().map(|half| half.join().expect("no error was accepted")).sum()
    })
}

#[test]
fn no_error_of_up_to_three_bits_makes_another_telegram() {
    for (what, octets) in telegrams() {
        assert!(octets.len() <= 33, "{what}");
        let bits = (octets.len() * CHARACTER) as u64;
        let due = bits + bits * (bits - 1) / 2 + bits * (bits - 1) * (bits - 2) / 6;
        assert_eq!(all_errors(&octets, |_| true, what), due, "{what}: all of them");
    }
}

// A token has no check sum: two bits of one octet make another token of it. Slaves answer none.
#[test]
fn no_error_of_up_to_three_bits_makes_more_of_a_token_than_another_token() {
    let is_more = |telegram: &Telegram<'_>| !matches!(telegram, Telegram::Token { .. });
    all_errors(&[0xDC, 0x03, 0x02], is_more, "token");
}

// What the walks rely on: each stretch of 33 bits in a telegram has more zeros than errors could hide.
#[test]
fn no_three_errors_make_an_idle_line() {
    for (what, octets) in telegrams().into_iter().chain([("longest", longest())]) {
        for window in bits(&octets).windows(33) {
            assert!(window.iter().filter(|bit| **bit == 0).count() > 3, "{what}");
        }
    }
}

// The walks end with the first error seen; here they do not: the whole line reaches the receiver.
#[test]
fn what_follows_an_error_is_not_taken_for_a_telegram_either() {
    for (what, octets) in telegrams() {
        let mut line = bits(&octets);
        let length = line.len();
        for (first, second) in
            (0..length).flat_map(|first| (first..length).map(move |second| (first, second)))
        {
            line[first] ^= 1;
            line[second] ^= u8::from(second != first);
            let mut receiver = Receiver::new(ReceiverMode::Idle, RATE);
            let (mut at, mut heard) = (0, 0);
            while let Some((end, octet)) = character(&line, at) {
                match octet {
                    Some(octet) => heard += usize::from(receiver.octet(instant(end), octet).is_some()),
                    None => receiver.line_error(instant(end)),
                }
                at = end;
            }
            assert_eq!(heard, 0, "{what}: bits {first}, {second}");
            line[first] ^= 1;
            line[second] ^= u8::from(second != first);
        }
    }
}

fn longest() -> Vec<u8> {
    let data = (0..246u32).map(|index| (index * index * 7 + index) as u8);
    sd2(&[0x0B, 0x02, 0x7D].into_iter().chain(data).collect::<Vec<u8>>())
}

/// A small generator of numbers below `below`; the same ones each time.
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, below: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % below
    }
}

// 255 octets, by sampling: errors anywhere, and errors that begin with two bits of one character, since
// those pass the parity.
#[test]
fn samples_of_errors_make_no_other_telegram_of_the_longest_one() {
    let mut walker = Walker::new(&longest());
    let (length, mut numbers) = (walker.line.len(), Numbers(1));
    for index in 0..400_000 {
        let first = numbers.below(length);
        let second = if index % 2 == 0 {
            numbers.below(length)
        } else {
            first / CHARACTER * CHARACTER + numbers.below(CHARACTER)
        };
        let mut wrong = vec![first, second, numbers.below(length)];
        wrong.sort_unstable();
        wrong.dedup();
        assert!(!walker.accepts_another(&wrong, |_| true), "bits {wrong:?}");
    }
    // All pairs within one character.
    for at in 0..length / CHARACTER {
        for (a, b) in (0..CHARACTER).flat_map(|a| (a + 1..CHARACTER).map(move |b| (a, b))) {
            let wrong = [at * CHARACTER + a, at * CHARACTER + b];
            assert!(!walker.accepts_another(&wrong, |_| true), "bits {wrong:?}");
        }
    }
}

// The walks can see something: with four wrong bits the check sum is beaten, and they say so.
#[test]
fn four_bits_can_make_another_telegram() {
    let mut walker = Walker::new(&STATUS);
    // DA 0B -> 08 is two bits, FC 49 -> 4A two more: the sum is 2 less.
    let wrong = [(1, 1), (1, 2), (3, 1), (3, 2)].map(|(octet, bit)| octet * CHARACTER + bit);
    let made = [0x10, 0x08, 0x02, 0x4A, 0x54, 0x16];
    assert_eq!(made[1] ^ STATUS[1], 0x03);
    assert!(!walker.accepts_another(&wrong, |_| true), "the sum is wrong by 2");
    // DA 0B -> 08 (3 less), FC 49 -> 4C (3 more): two bits each.
    let wrong = [(1, 1), (1, 2), (3, 1), (3, 3)].map(|(octet, bit)| octet * CHARACTER + bit);
    assert!(walker.accepts_another(&wrong, |_| true), "10 08 02 4C 56 16 is a telegram");
}
