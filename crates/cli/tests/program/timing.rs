//! Rates, and replies that take as long as on a real bus.

use std::time::{Duration, Instant};

use crate::driver::run;
use crate::master::{CLASS_2, Master, Terminal, status, status_answer};

const RATES: [u32; 10] =
    [9_600, 19_200, 45_450, 93_750, 187_500, 500_000, 1_500_000, 3_000_000, 6_000_000, 12_000_000];

/// No master that has closed the bus is back at another rate sooner.
fn open_next(bus: &std::path::Path, rate: u32) -> Terminal {
    std::thread::sleep(Duration::from_millis(1));
    Terminal::open(bus, rate)
}

#[test]
fn a_fixed_rate_is_deaf_to_others() {
    let mut program = run(["--switches", "0B", "--baud", "19200"]);
    let bus = program.bus();
    // Twice around: what it hears at another rate leaves nothing behind.
    for rate in [9_600, 19_200, 500_000, 19_200, 12_000_000, 19_200] {
        let terminal = open_next(&bus, rate);
        if rate == 19_200 {
            assert_eq!(terminal.ask(&status(11)), status_answer(11), "{rate}");
        } else {
            assert!(terminal.is_silent(&status(11)), "{rate}");
        }
    }
}

#[test]
fn auto_answers_at_every_rate_that_a_master_sets() {
    let mut program = run(["--switches", "0B", "--baud", "auto"]);
    let bus = program.bus();
    for rate in RATES {
        let terminal = open_next(&bus, rate);
        assert_eq!(terminal.ask(&status(11)), status_answer(11), "{rate}");
    }
    // One that PROFIBUS has not counts as found too.
    let terminal = open_next(&bus, 38_400);
    assert_eq!(terminal.ask(&status(11)), status_answer(11));
    program.wait_for(&["a rate that is none of PROFIBUS's"]);
}

#[test]
fn data_exchange_begins_at_every_rate() {
    for rate in RATES {
        let mut program = run(["--switches", "0B", "--shaft", "still@77"]);
        let mut master = Master::new(Terminal::open(&program.bus(), rate), 11);
        master.start_up(CLASS_2, &[0xF1]);
        assert_eq!(master.position(), 77, "{rate}");
    }
}

/// How long the fastest and the slowest of some answers took.
fn times(terminal: &Terminal, request: &[u8], octets: usize) -> (Duration, Duration) {
    let mut times = Vec::new();
    while times.len() < 8 {
        let begun = Instant::now();
        terminal.send(request);
        let answer = terminal.answer(Duration::from_secs(1));
        if !answer.is_empty() {
            times.push(begun.elapsed());
            assert_eq!(answer.len(), octets);
        }
    }
    (times.iter().min().copied().unwrap(), times.iter().max().copied().unwrap())
}

#[test]
fn paced_answers_take_as_long_as_on_a_bus() {
    // At 9600, a character of 11 bits. FDL status: 6 octets, min T_SDR of 11 bits, 6 octets: 143 bits.
    // Slave_Diag: 11 octets, 11 bits, 27 octets: 429 bits.
    let diagnosis = crate::master::sd2(0x8B, 0x82, 0x4D, &[60, 62]);
    for (request, octets, bits) in [(status(11), 6, 143), (diagnosis, 27, 429)] {
        let due = Duration::from_nanos(bits * 1_000_000_000 / 9_600);
        let mut program = run(["--switches", "0B", "--pace"]);
        let (fastest, _) = times(&Terminal::open(&program.bus(), 9_600), &request, octets);
        assert!(fastest >= due, "{fastest:?}, but {due:?} on a bus");
        assert!(fastest < due * 2, "{fastest:?}, but {due:?} on a bus");

        let mut program = run(["--switches", "0B"]);
        let (fastest, _) = times(&Terminal::open(&program.bus(), 9_600), &request, octets);
        assert!(fastest < due / 2, "{fastest:?} without --pace");
    }
}

#[test]
fn pace_follows_the_rate_and_min_tsdr() {
    // 500 kbit/s: 143 bits are 286 us; with a min T_SDR of 255 bits 387 bits are 774 us.
    let mut program = run(["--switches", "0B", "--pace"]);
    let mut master = program.master(11);
    let (fastest, _) = times(&master.terminal, &status(11), 6);
    assert!(fastest >= Duration::from_micros(286) && fastest < Duration::from_millis(5), "{fastest:?}");
    // Neither lock nor unlock: only min T_SDR is taken.
    assert_eq!(master.service(61, &[0x00, 0, 0, 255, 0x10, 0x8B, 0]), [0xE5]);
    let (fastest, _) = times(&master.terminal, &status(11), 6);
    assert!(fastest >= Duration::from_micros(774) && fastest < Duration::from_millis(5), "{fastest:?}");
}
