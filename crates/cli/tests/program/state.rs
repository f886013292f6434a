//! The state file over orderly ends and new starts.

use std::ffi::OsStr;
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use rustix::process::Signal;
use tempfile::tempdir;

use crate::driver::{Program, end_of, program, run};
use crate::master::{CLASS_2, IDENT, status, status_answer};

/// Octets of one of the two slots.
pub(crate) const SLOT: usize = 40;

/// `run` with a state file.
pub(crate) fn run_with(state: &Path, more: &[&str]) -> Program {
    let state = [OsStr::new("--state"), state.as_os_str()];
    run(state.into_iter().chain(more.iter().map(OsStr::new)))
}

/// Octets 5-8 of a slot: its sequence number.
pub(crate) fn sequence(slot: &[u8]) -> u32 {
    u32::from_be_bytes(slot[4..8].try_into().unwrap())
}

/// Where the newer slot of a state file begins, and where the other.
pub(crate) fn newer_and_older(file: &[u8]) -> (usize, usize) {
    if sequence(&file[..SLOT]) > sequence(&file[SLOT..]) { (0, SLOT) } else { (SLOT, 0) }
}

/// Octets 11-16 of the newer slot: the operating time in milliseconds.
fn operating_time(state: &Path) -> u64 {
    let file = fs::read(state).unwrap();
    let (newer, _) = newer_and_older(&file);
    file[newer + 10..newer + 16].iter().fold(0, |time, octet| time << 8 | u64::from(*octet))
}

/// Gives the encoder at 126 an address.
pub(crate) fn give_address(program: &mut Program, address: u8) {
    let mut master = program.master(126);
    assert_eq!(master.service(55, &[address, IDENT[0], IDENT[1], 0]), [0xE5]);
}

/// Presets the encoder at `slave` and waits until it shows.
pub(crate) fn preset(program: &mut Program, slave: u8, value: u32) {
    let mut master = program.master(slave);
    master.start_up(CLASS_2, &[0xF1]);
    master.exchange(&[0; 4]);
    master.exchange(&(0x8000_0000 | value).to_be_bytes());
    std::thread::sleep(Duration::from_millis(1));
    assert_eq!(master.position(), value);
}

/// The position that the encoder at `slave` shows.
pub(crate) fn position(program: &mut Program, slave: u8) -> u32 {
    let mut master = program.master(slave);
    let diagnosis = master.start_up(CLASS_2, &[0xF1]);
    let position = master.position();
    // A still shaft at 0: the offset value, modulo the range, is the position (manual 4.2.14).
    assert_eq!(diagnosis.offset().cast_unsigned() & 0x7FFF_FFFF, position);
    position
}

#[test]
fn address_and_offset_are_kept_over_a_restart() {
    let directory = tempdir().unwrap();
    let state = directory.path().join("memory");
    let mut first = run_with(&state, &[]);
    give_address(&mut first, 11);
    // At once, and only there.
    assert_eq!(first.terminal().ask(&status(11)), status_answer(11));
    preset(&mut first, 11, 123_456);
    first.end();

    let mut second = run_with(&state, &[]);
    assert!(second.seen.iter().all(|line| !line.contains("warning")), "{:?}", second.seen);
    assert!(second.terminal().is_silent(&status(126)));
    assert_eq!(position(&mut second, 11), 123_456);
    second.end();
    assert_eq!(fs::read(&state).unwrap().len(), 80);
}

#[test]
fn both_signals_save_the_memory() {
    for signal in [Signal::INT, Signal::TERM] {
        let directory = tempdir().unwrap();
        let state = directory.path().join("memory");
        let begun = Instant::now();
        let mut program = run_with(&state, &[]);
        let ready = Instant::now();
        let made = fs::read(&state).unwrap();
        std::thread::sleep(Duration::from_millis(100));
        let least = ready.elapsed().as_millis();
        assert_eq!(program.end_with(signal).code(), Some(0));
        let most = begun.elapsed().as_millis();
        let time = u128::from(operating_time(&state));
        assert!((least..=most).contains(&time), "{signal:?}: {time} ms, but {least} to {most}");
        assert_ne!(fs::read(&state).unwrap(), made);
    }
}

#[test]
fn the_operating_time_goes_on() {
    let directory = tempdir().unwrap();
    let state = directory.path().join("memory");
    let mut last = 0;
    for _ in 0..4 {
        let program = run_with(&state, &[]);
        std::thread::sleep(Duration::from_millis(20));
        program.end();
        let time = operating_time(&state);
        assert!(time >= last + 20, "{time} ms after {last} ms");
        last = time;
    }
}

#[test]
fn without_a_state_file_it_is_as_delivered_each_time() {
    let mut first = run::<&str>([]);
    give_address(&mut first, 11);
    first.end();
    assert_eq!(run::<&str>([]).terminal().ask(&status(126)), status_answer(126));
}

#[test]
fn the_switches_win_over_the_stored_address() {
    let directory = tempdir().unwrap();
    let state = directory.path().join("memory");
    let mut first = run_with(&state, &[]);
    give_address(&mut first, 11);
    first.end();
    let mut second = run_with(&state, &["--switches", "2A"]);
    assert_eq!(second.terminal().ask(&status(42)), status_answer(42));
    assert!(second.terminal().is_silent(&status(11)));
    second.end();
    // Back at 126 the stored one counts again.
    assert_eq!(run_with(&state, &[]).terminal().ask(&status(11)), status_answer(11));
}

#[test]
fn a_second_run_on_the_same_state_file_is_refused() {
    let directory = tempdir().unwrap();
    let state = directory.path().join("memory");
    let mut first = run_with(&state, &["--switches", "0B"]);
    preset(&mut first, 11, 77);
    let before = fs::read(&state).unwrap();
    for reset in [&[][..], &["--reset-state"]] {
        let ended = end_of(program().args(["run", "--state"]).arg(&state).args(reset));
        assert_eq!((ended.status, ended.output.as_str()), (Some(1), ""));
        assert!(ended.errors.contains(&state.display().to_string()), "{}", ended.errors);
        assert!(ended.errors.contains("in use by another encoder"), "{}", ended.errors);
        assert!(ended.errors.contains("end that one, or name another file"), "{}", ended.errors);
        assert_eq!(fs::read(&state).unwrap(), before);
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
    }
    assert_eq!(position(&mut first, 11), 77);
    // It is free as soon as the first has ended, however it did.
    first.kill();
    assert_eq!(position(&mut run_with(&state, &["--switches", "0B"]), 11), 77);
}

#[test]
fn two_encoders_of_one_run_cannot_share_a_state_file() {
    let directory = tempdir().unwrap();
    let state = directory.path().join("memory");
    let further = format!("switches=0C,state={}", state.display());
    let ended = end_of(program().args(["run", "--state"]).arg(&state).args(["--encoder", &further]));
    assert_eq!((ended.status, ended.output.as_str()), (Some(1), ""));
    assert!(ended.errors.contains("in use by another encoder"), "{}", ended.errors);
}

#[test]
fn each_encoder_keeps_its_own_memory() {
    let directory = tempdir().unwrap();
    let one = directory.path().join("one");
    let further = format!("switches=0C,state={}", directory.path().join("two").display());
    let arguments = ["--switches", "0B", "--encoder", &further];
    let mut first = run_with(&one, &arguments);
    preset(&mut first, 11, 1_111);
    preset(&mut first, 12, 2_222);
    first.end();
    let mut second = run_with(&one, &arguments);
    assert_eq!(position(&mut second, 11), 1_111);
    assert_eq!(position(&mut second, 12), 2_222);
}

#[test]
fn an_offset_under_another_scaling_is_kept_and_told() {
    let directory = tempdir().unwrap();
    let state = directory.path().join("memory");
    let mut first = run_with(&state, &["--switches", "0B"]);
    preset(&mut first, 11, 70_000);
    first.end();
    let mut second = run_with(&state, &["--switches", "0B"]);
    let mut master = second.master(11);
    // 100 units per revolution, 1000 in all: 70000 modulo 1000 is 0, 70000 itself stays the offset value.
    let mut scaled = CLASS_2.to_vec();
    scaled[1..10].copy_from_slice(&[0x0A, 0, 0, 0, 100, 0, 0, 0x03, 0xE8]);
    assert_eq!(master.start_up(&scaled, &[0xF1]).offset(), 70_000);
    assert_eq!(master.position(), 0);
    second.wait_for(&["the offset value 70000 was made under another scaling"]);
}

#[test]
fn an_empty_battery_forgets_the_turns_and_the_next_start_clears_the_alarm() {
    let directory = tempdir().unwrap();
    let state = directory.path().join("memory");
    let mut first = run_with(&state, &["--switches", "0B"]);
    preset(&mut first, 11, 5_000);
    first.end();
    // Alarm bit 0 (manual 4.2.2), battery warning bit 5 (manual 4.2.9).
    for (battery, alarms, warnings) in [("empty", 1, 0x20), ("ok", 0, 0), ("ok", 0, 0)] {
        let program = run_with(&state, &["--switches", "0B", "--battery", battery]);
        let mut program = program;
        let diagnosis = program.master(11).start_up(CLASS_2, &[0xF1]);
        assert_eq!((diagnosis.octet(8), diagnosis.octet(21)), (alarms, warnings), "{battery}");
        if alarms == 0 {
            assert_eq!(diagnosis.offset(), 0, "the preset is lost with the turns");
        }
        program.end();
    }
}
