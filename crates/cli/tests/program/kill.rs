//! `kill -9` in the middle of what must be kept: the old value or the new one, and the new one as soon
//! as the master knows of it.

use std::time::{Duration, Instant};

use tempfile::tempdir;

use crate::driver::Program;
use crate::master::{CLASS_2, IDENT, Terminal, length, status, status_answer};
use crate::state::run_with;

const ROUNDS: usize = 40;

/// Numbers without a pattern, the same in every run.
pub(crate) struct Dice(pub(crate) u64);

impl Dice {
    /// `xorshift64*`.
    pub(crate) fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 16
    }

    pub(crate) fn below(&mut self, limit: u64) -> u64 {
        self.next() % limit
    }
}

/// How many rounds ended with the one or the other.
#[derive(Debug, Default)]
struct Count {
    answered: usize,
    kept_old: usize,
    kept_new: usize,
}

impl Count {
    #[track_caller]
    fn round(&mut self, answered: bool, kept: u32, old: u32, new: u32) {
        assert!(kept == new || kept == old, "{kept} is neither {old} nor {new}");
        assert!(kept == new || !answered, "the master knows of {new}, but {old} is there");
        self.answered += usize::from(answered);
        self.kept_old += usize::from(kept == old);
        self.kept_new += usize::from(kept == new);
    }

    /// Otherwise the moments were not random enough to tell anything.
    fn judge(&self) {
        println!("{self:?}");
        assert!(self.answered >= ROUNDS / 5 && self.kept_old > 0, "{self:?}");
    }
}

/// Sends a request and kills the program at a random moment; whether the whole answer came before.
fn send_and_kill(
    program: &mut Program,
    terminal: &Terminal,
    request: &[u8],
    round: usize,
    dice: &mut Dice,
) -> bool {
    // Some at once, some when the answer is there, most in between.
    let (wait_for_answer, moment) = match round % 4 {
        0 => (true, Duration::from_secs(2)),
        1 => (false, Duration::ZERO),
        _ => (false, Duration::from_micros(dice.below(250))),
    };
    let sent = Instant::now();
    terminal.send(request);
    let mut answer = Vec::new();
    let is_whole = |answer: &[u8]| length(answer).is_some_and(|length| answer.len() >= length);
    while sent.elapsed() < moment && !(wait_for_answer && is_whole(&answer)) {
        answer.extend(terminal.read());
    }
    program.kill();
    is_whole(&answer)
}

#[test]
fn a_preset_is_kept_whole_or_not_at_all() {
    let directory = tempdir().unwrap();
    let state = directory.path().join("memory");
    let mut dice = Dice(0x5EED_0001);
    let mut count = Count::default();
    let mut last = None;
    for round in 0..=ROUNDS {
        // A still shaft at 0: the position is the offset.
        let mut program = run_with(&state, &["--switches", "0B", "--ident", "0x108B"]);
        let mut master = program.master(11);
        master.start_up(CLASS_2, &[0xF1]);
        let position = master.position();
        if let Some((answered, old, new)) = last {
            count.round(answered, position, old, new);
        }
        let new = u32::try_from(dice.below(0x8000_0000)).unwrap();
        let request = master.outputs(&(0x8000_0000 | new).to_be_bytes());
        let answered = send_and_kill(&mut program, &master.terminal, &request, round, &mut dice);
        last = Some((answered, position, new));
    }
    count.judge();
}

#[test]
fn an_address_is_changed_whole_or_not_at_all() {
    let directory = tempdir().unwrap();
    let state = directory.path().join("memory");
    let mut dice = Dice(0x5EED_0002);
    let mut count = Count::default();
    let (mut address, mut last) = (126, None);
    for round in 0..=ROUNDS {
        let mut program = run_with(&state, &["--ident", "0x108B"]);
        if let Some((answered, old, new)) = last {
            // What it says, and what the bus says.
            let line = program.wait_for(&["power on, station address "]);
            address = line.rsplit(' ').next().unwrap().parse().unwrap();
            count.round(answered, u32::from(address), u32::from(old), u32::from(new));
            let terminal = program.terminal();
            assert_eq!(terminal.ask(&status(address)), status_answer(address));
            assert!(terminal.is_silent(&status(if address == old { new } else { old })));
        }
        let mut master = program.master(address);
        // Whoever it is asked by, the master is known to be heard.
        master.diagnosis();
        // 3 to 125, and another than before: 2 is the master's own.
        let new = 3 + (address - 2 + u8::try_from(dice.below(100)).unwrap()) % 123;
        let request = master.request(55, &[new, IDENT[0], IDENT[1], 0]);
        let answered = send_and_kill(&mut program, &master.terminal, &request, round, &mut dice);
        last = Some((answered, address, new));
    }
    count.judge();
}
