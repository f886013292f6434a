//! State files that are damaged or something else.

use std::fs;
use std::path::Path;

use tempfile::{TempDir, tempdir};

use crate::driver::{end_of, program};
use crate::master::{status, status_answer};
use crate::state::{SLOT, newer_and_older, position, preset, run_with};

/// A state file whose newer slot holds an offset of 2000 and whose older one holds 1000.
fn two_values() -> (TempDir, std::path::PathBuf, Vec<u8>) {
    let directory = tempdir().unwrap();
    let state = directory.path().join("memory");
    let mut first = run_with(&state, &["--switches", "0B"]);
    preset(&mut first, 11, 1_000);
    first.end();
    let mut second = run_with(&state, &["--switches", "0B"]);
    preset(&mut second, 11, 2_000);
    // Without an orderly end, which would write the other slot too.
    second.kill();
    let file = fs::read(&state).unwrap();
    (directory, state, file)
}

fn with_damage(file: &[u8], at: &[usize]) -> Vec<u8> {
    let mut file = file.to_vec();
    for at in at {
        file[*at] ^= 0x10;
    }
    file
}

#[test]
fn with_one_slot_damaged_the_other_is_used_with_a_warning() {
    let (_directory, state, good) = two_values();
    let (newer, older) = newer_and_older(&good);
    // In the sequence number, in the offset and in the check sum.
    for within in [5, 17, 39] {
        for (slot, value) in [(newer, 1_000), (older, 2_000)] {
            fs::write(&state, with_damage(&good, &[slot + within])).unwrap();
            let mut program = run_with(&state, &["--switches", "0B"]);
            let name = if slot == 0 { "A" } else { "B" };
            let warning = program.seen[1].clone();
            assert!(
                warning.contains(&format!("warning: encoder: slot {name} of the state file")),
                "{warning}"
            );
            assert!(warning.contains("its checksum is wrong"), "{warning}");
            assert!(warning.contains("the other slot is used"), "{warning}");
            assert_eq!(position(&mut program, 11), value, "slot {name} damaged");
            // The next records make it whole.
            program.end();
            let mut program = run_with(&state, &["--switches", "0B"]);
            assert_eq!(program.seen.len(), 2, "{:?}", program.seen);
            assert_eq!(position(&mut program, 11), value);
        }
    }
}

#[test]
fn a_warning_about_a_slot_does_not_hide_one_about_the_address() {
    let (_directory, state, good) = two_values();
    fs::write(&state, with_damage(&good, &[17])).unwrap();
    let mut program = run_with(&state, &["--switches", "00"]);
    program.wait_for(&["slot A of the state file is damaged"]);
    assert!(program.seen.iter().any(|line| line.contains("off the bus")), "{:?}", program.seen);
}

/// The file stays, and the error names it and the way out.
#[track_caller]
fn refused(state: &Path, parts: &[&str]) {
    let before = fs::read(state).unwrap();
    let ended = end_of(program().args(["run", "--switches", "0B", "--state"]).arg(state));
    assert_eq!((ended.status, ended.output.as_str()), (Some(1), ""), "{}", ended.errors);
    assert!(ended.errors.contains(&state.display().to_string()), "{}", ended.errors);
    assert!(ended.errors.contains("--reset-state"), "{}", ended.errors);
    for part in parts {
        assert!(ended.errors.contains(part), "{part}: {}", ended.errors);
    }
    assert_eq!(fs::read(state).unwrap(), before);
    assert_eq!(fs::read_dir(state.parent().unwrap()).unwrap().count(), 1);
}

#[test]
fn with_both_slots_damaged_it_does_not_start() {
    let (_directory, state, good) = two_values();
    fs::write(&state, with_damage(&good, &[17, SLOT + 17])).unwrap();
    refused(&state, &["damaged", "slot A: its checksum is wrong", "slot B: its checksum is wrong"]);
    fs::write(&state, [b'x'; 80]).unwrap();
    refused(&state, &["slot A: it does not begin like a record of this device"]);
    fs::write(&state, [0; 80]).unwrap();
    refused(&state, &["damaged"]);
    // Half of it never written is no excuse: the other half held the only record.
    let mut half = with_damage(&good, &[17]);
    half[SLOT..].fill(0xFF);
    fs::write(&state, half).unwrap();
    refused(&state, &["damaged"]);
}

#[test]
fn a_file_of_another_size_is_something_else() {
    let (_directory, state, good) = two_values();
    for size in [1, 40, 79, 81, 160, 100_000] {
        let mut file = good.repeat(size / 80 + 1);
        file.truncate(size);
        fs::write(&state, file).unwrap();
        refused(&state, &[&format!("has {size} octets, but a state file has 80")]);
    }
}

#[test]
fn reset_state_keeps_the_old_file_and_starts_as_delivered() {
    let (_directory, state, good) = two_values();
    for old in [with_damage(&good, &[17, SLOT + 17]), vec![1, 2, 3], good] {
        let directory = tempdir().unwrap();
        let state = directory.path().join(state.file_name().unwrap());
        fs::write(&state, &old).unwrap();
        let mut program = run_with(&state, &["--reset-state"]);
        assert_eq!(program.terminal().ask(&status(126)), status_answer(126));
        assert_eq!(program.master(126).diagnosis().octet(8), 0, "no alarm as delivered");
        program.end();
        assert_eq!(fs::read(directory.path().join("memory.bad")).unwrap(), old);
        // From now on it is a good one, and what was preset is gone.
        let mut program = run_with(&state, &["--switches", "0B"]);
        assert_eq!(program.seen.len(), 2, "{:?}", program.seen);
        assert_eq!(position(&mut program, 11), 0);
    }
}

#[test]
fn reset_state_overwrites_no_older_file_that_was_kept() {
    let directory = tempdir().unwrap();
    let state = directory.path().join("memory");
    for old in ["first", "second", "third"] {
        fs::write(&state, old).unwrap();
        run_with(&state, &["--reset-state"]).end();
    }
    let mut kept: Vec<_> = fs::read_dir(directory.path())
        .unwrap()
        .map(|entry| fs::read(entry.unwrap().path()).unwrap())
        .filter(|octets| octets.len() != 80)
        .collect();
    kept.sort();
    assert_eq!(kept, [b"first".to_vec(), b"second".to_vec(), b"third".to_vec()]);
    assert_eq!(fs::read(directory.path().join("memory.bad")).unwrap(), b"first");
}

#[test]
fn reset_state_needs_no_file() {
    let directory = tempdir().unwrap();
    let state = directory.path().join("memory");
    run_with(&state, &["--reset-state"]).end();
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
}

#[test]
fn what_can_be_no_state_file_is_named_with_a_remedy() {
    let directory = tempdir().unwrap();
    let file = directory.path().join("file");
    fs::write(&file, "precious").unwrap();
    for (path, why) in [
        (directory.path().join("no/such/place"), "directory that exists"),
        (directory.path().to_owned(), "directory"),
        // Below a file; and devices.
        (file.join("memory"), "directory"),
        ("/dev/null".into(), "no regular file"),
        ("/dev/zero".into(), "no regular file"),
    ] {
        for reset in [&[][..], &["--reset-state"]] {
            let ended = end_of(program().args(["run", "--state"]).arg(&path).args(reset));
            assert_eq!((ended.status, ended.output.as_str()), (Some(1), ""), "{}", path.display());
            assert!(ended.errors.contains(&path.display().to_string()), "{}", ended.errors);
            assert!(ended.errors.contains(why), "{}", ended.errors);
            assert!(ended.errors.contains("name a file"), "{}", ended.errors);
        }
    }
    assert_eq!(fs::read(&file).unwrap(), b"precious");
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
}
