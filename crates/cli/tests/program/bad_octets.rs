//! Any octets, in any pieces, at any time: silence, no change, and the next good telegram is answered.

use std::time::Duration;

use crate::driver::run;
use crate::kill::Dice;
use crate::master::{CLASS_2, length, sd1, sd2, sum};

const OCTETS: usize = 2_000_000;
/// The longest telegram.
const MAX_OCTETS: usize = 255;
const SLAVE: u8 = 11;

/// Whether the octets at `at` are a telegram without a fault that the slave has to hear: to itself or to all.
fn is_for_the_slave(octets: &[u8]) -> bool {
    let Some(telegram) = length(octets).and_then(|length| octets.get(..length)) else {
        return false;
    };
    let body = match *telegram {
        [0x68, le, ler, 0x68, ..] if le == ler && (4..=249).contains(&le) => &telegram[4..],
        [0x10 | 0xA2, ..] => &telegram[1..],
        _ => return false,
    };
    let [body @ .., fcs, 0x16] = body else {
        return false;
    };
    sum(body) == *fcs && matches!(body[0] & 0x7F, SLAVE | 127)
}

/// A piece: random octets, octets that telegrams begin with, or a telegram with a wrong bit.
fn piece(dice: &mut Dice, good: &[Vec<u8>]) -> Vec<u8> {
    let at_most = if dice.below(8) == 0 { 600 } else { 40 };
    let count = 1 + dice.below(at_most);
    let random = |dice: &mut Dice| u8::try_from(dice.below(256)).unwrap();
    match dice.below(4) {
        0 => (0..count).map(|_| random(dice)).collect(),
        1 => (0..count)
            .map(|_| match dice.below(3) {
                0 => random(dice),
                _ => [0x10, 0x68, 0xA2, 0xDC, 0xE5, 0x16, 0x0B, 0x8B, 0x02, 0x82]
                    [usize::try_from(dice.below(10)).unwrap()],
            })
            .collect(),
        // A false head: so many octets more are due, or so it seems.
        2 => {
            let le = random(dice);
            [0x68, le, le, 0x68, 0x8B, 0x82, 0x5D]
                .into_iter()
                .chain((0..count % 20).map(|_| random(dice)))
                .collect()
        }
        _ => {
            let mut telegram = good[usize::try_from(dice.below(good.len() as u64)).unwrap()].clone();
            let at = usize::try_from(dice.below(telegram.len() as u64)).unwrap();
            telegram[at] ^= 1 << dice.below(8);
            telegram
        }
    }
}

#[test]
fn two_million_bad_octets_change_nothing() {
    let mut program = run(["--switches", "0B", "--shaft", "still@4711"]);
    let mut master = program.master(SLAVE);
    // Without a watchdog: nothing but octets can end the exchange of data.
    master.start_up(CLASS_2, &[0xF1]);
    assert_eq!(master.exchange(&[0x00, 0x12, 0x34, 0x56]), 4_711_u32.to_be_bytes());
    let before = master.diagnosis();
    program.wait_for(&["data exchange with master 2 begins"]);
    let lines = program.lines_so_far();

    // What would do something if it were right: parameters, an unlock, a preset, Clear, a new address.
    let good = [
        sd2(0x8B, 0x82, 0x5D, &[&[61, 62, 0x80, 1, 1, 11, 0x10, 0x8B, 0], CLASS_2].concat()),
        sd2(0x8B, 0x82, 0x7D, &[61, 62, 0x40, 0, 0, 0, 0x10, 0x8B, 0]),
        sd2(SLAVE, 0x02, 0x5D, &[0x80, 0, 0, 1]),
        sd2(SLAVE, 0x02, 0x7D, &[0x80, 0, 0, 2]),
        sd2(0xFF, 0x82, 0x46, &[58, 62, 0x02, 0]),
        sd2(0x8B, 0x82, 0x6D, &[55, 62, 12, 0x10, 0x8B, 0]),
        sd1(SLAVE, 0x02, 0x5D),
        sd1(SLAVE, 0x02, 0x49),
    ];
    let mut dice = Dice(0x5EED_0003);
    let mut sent = Vec::with_capacity(OCTETS + 1_000);
    let mut heard = Vec::new();
    while sent.len() < OCTETS {
        let begun = sent.len();
        sent.extend(piece(&mut dice, &good));
        // By chance it may have become a good one: then it is none of ours.
        let first = begun.saturating_sub(MAX_OCTETS);
        if (first..sent.len()).any(|at| is_for_the_slave(&sent[at..])) {
            sent.truncate(begun);
            continue;
        }
        master.terminal.send(&sent[begun..]);
        heard.extend(master.terminal.read());
        match dice.below(1_000) {
            // Longer than an unfinished telegram is waited for, and not so long.
            0 => std::thread::sleep(Duration::from_millis(11)),
            1..=20 => std::thread::sleep(Duration::from_micros(200)),
            _ => {}
        }
    }
    std::thread::sleep(Duration::from_millis(200));
    heard.extend(master.terminal.read());
    assert!(heard.is_empty(), "bad octets were answered: {heard:02X?}");

    assert!(program.is_running());
    assert_eq!(master.diagnosis(), before);
    // RD_Outp: the outputs are those of before. RD_Inp: the position too.
    assert_eq!(master.service(57, &[]), sd2(0x82, 0x8B, 0x08, &[62, 57, 0x00, 0x12, 0x34, 0x56]));
    assert_eq!(master.service(56, &[]), sd2(0x82, 0x8B, 0x08, &[62, 56, 0x00, 0x00, 0x12, 0x67]));
    assert_eq!(master.exchange(&[0; 4]), 4_711_u32.to_be_bytes());
    assert_eq!(program.lines_so_far(), lines, "{:?}", program.seen);
    program.end();
}

#[test]
fn the_judge_of_this_test_knows_good_telegrams() {
    assert!(is_for_the_slave(&sd1(SLAVE, 2, 0x49)));
    assert!(is_for_the_slave(&sd2(0xFF, 0x82, 0x46, &[58, 62, 2, 0])));
    assert!(is_for_the_slave(&[0xA2, 11, 2, 0x5D, 0, 0, 0, 0, 0, 0, 0, 0, 11 + 2 + 0x5D, 0x16]));
    assert!(!is_for_the_slave(&sd1(12, 2, 0x49)));
    assert!(!is_for_the_slave(&[0x10, 11, 2, 0x49, 0x57, 0x16]));
    assert!(!is_for_the_slave(&[0x10, 11, 2]));
}

#[test]
fn a_good_telegram_right_after_garbage_is_answered_after_a_pause_at_the_latest() {
    let mut program = run(["--switches", "0B"]);
    let terminal = program.terminal();
    let status = sd1(SLAVE, 2, 0x49);
    let answer = sd1(2, SLAVE, 0x00);
    // Octets that begin nothing: the telegram may follow at once.
    for garbage in [
        &[0x00, 0x16, 0xFF][..],
        &[0xE5, 0xE5],
        &[0xDC, 0x03, 0x02],
        &[0x68, 0x05, 0x06],
        &[0x68, 0x03, 0x03],
    ] {
        assert_eq!(terminal.ask(&[garbage, &status].concat()), answer, "{garbage:02X?}");
    }
    // A false head swallows what follows; after a pause of more than 10 ms it is forgotten.
    for garbage in
        [&[0x68, 0xF9, 0xF9, 0x68][..], &[0x10, 0x0B], &[0xA2], &[0x68], &[0x68, 0x20, 0x20, 0x68, 0x8B]]
    {
        terminal.send(garbage);
        std::thread::sleep(Duration::from_millis(15));
        assert_eq!(terminal.ask(&status), answer, "{garbage:02X?}");
    }
    // Half a telegram, and its other half too late.
    terminal.send(&status[..3]);
    std::thread::sleep(Duration::from_millis(30));
    assert!(terminal.is_silent(&status[3..]));
    assert_eq!(terminal.ask(&status), answer);
    // A request that another follows at once is not answered; the other is.
    assert_eq!(terminal.ask(&[&status[..], &status].concat()), answer);
    assert!(terminal.answer(Duration::from_millis(50)).is_empty());
    assert!(terminal.is_silent(&[&status[..], &[0x10]].concat()));
}
