//! Standard output and standard error that are closed or full, and documents for programs.

use std::fs::OpenOptions;
use std::process::{Command, Stdio};

use rustix::process::Signal;
use serde_json::Value;

use crate::driver::{Ended, Program, end_of, program, run};

/// A pipe that nobody reads.
fn closed() -> Stdio {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    writer.into()
}

fn full() -> Stdio {
    OpenOptions::new().write(true).open("/dev/full").expect("Linux has one").into()
}

fn with(arguments: &[&str], set: impl FnOnce(&mut Command) -> &mut Command) -> Ended {
    let mut command = program();
    set(command.args(arguments));
    end_of(&mut command)
}

#[test]
fn a_closed_standard_error_changes_no_status() {
    for (arguments, status) in [
        (&["scaling", "--units", "70000"][..], 1),
        (&["decode", "10"], 1),
        (&["scaling", "--units", "4096", "--revolutions", "4294967295"], 2),
        (&["run", "--state", "/"], 1),
    ] {
        let ended = with(arguments, |command| command.stderr(closed()));
        assert_eq!(ended.status, Some(status), "{arguments:?}");
    }
    // Its note about the ident number is read by nobody.
    let mut command = program();
    let mut encoder = Program::start(command.args(["run", "--switches", "05"]).stderr(closed()));
    encoder.wait_for(&["ready"]);
    assert_eq!(encoder.end_with(Signal::INT).code(), Some(0));
}

#[test]
fn results_that_do_not_fit_on_the_disk_are_an_error_and_those_that_nobody_reads_are_none() {
    for arguments in [
        &["gsd"][..],
        &["gsd", "--json"],
        &["datasheet"],
        &["scaling", "--units", "4096"],
        &["decode", "E5", "--json"],
        &["conformance", "--list"],
    ] {
        let ended = with(arguments, |command| command.stdout(full()));
        assert_eq!(ended.status, Some(1), "{arguments:?}: {}", ended.errors);
        assert!(ended.errors.starts_with("error: standard output is not whole"), "{}", ended.errors);
        let ended = with(arguments, |command| command.stdout(closed()));
        assert_eq!((ended.status, ended.errors.as_str()), (Some(0), ""), "{arguments:?}");
    }
}

#[test]
fn numbers_that_are_none_are_told_what_to_write() {
    for (arguments, words) in [
        (&["scaling", "--units", "0x1000"][..], "write a whole number from 0 to 4294967295"),
        (&["scaling", "--units", "-5"], "write a whole number from 0 to 4294967295"),
        (&["scaling", "--units", "1", "--range", "99999999999"], "write a whole number from 0 to 4294967295"),
        (&["run", "--reply-limit", "-1"], "write a whole number from 1 to 60000"),
        (&["run", "--max-tsdr", "x"], "write a whole number from 1 to 1000000"),
        (&["master", "--port", "pty", "--address", "-1", "diag"], "write a whole number from 0 to 126"),
        (&["master", "--port", "pty", "--retries", "99", "diag"], "write a whole number from 1 to 15"),
        (&["conformance", "--port", "pty", "--address", "126"], "write a whole number from 0 to 125"),
        (&["ctl", "nobody", "supply", "abc"], "write a number like 8.5"),
        (&["ctl", "nobody", "lose-replies", "1001"], "write a whole number from 1 to 1000"),
        (&["ctl", "nobody", "damage-reply", "0"], "write a whole number from 1 to 255"),
    ] {
        let ended = with(arguments, |command| command);
        assert_eq!(ended.status, Some(2), "{arguments:?}: {}", ended.errors);
        assert!(ended.errors.contains(words), "{arguments:?}: {}", ended.errors);
    }
}

#[test]
fn the_table_of_the_cases_is_a_document_too() {
    let table = with(&["conformance", "--list", "--profile", "encoder"], |command| command).output;
    // Without the head; areas have no number.
    let rows: Vec<_> = table.lines().skip(2).filter(|line| !line.starts_with("| |")).collect();
    let document =
        with(&["conformance", "--list", "--profile", "encoder", "--json"], |command| command).output;
    let document: Value = serde_json::from_str(&document).expect("JSON");
    let cases = document["cases"].as_array().expect("a list");
    assert!(cases.len() > 50 && cases.len() == rows.len(), "{} and {}", cases.len(), rows.len());
    for (case, row) in cases.iter().zip(rows) {
        let id = case["id"].as_str().expect("an id");
        assert!(row.starts_with(&format!("| {id} | ")), "{id}: {row}");
        assert_eq!(case["profile"], "encoder", "{id}");
    }
}

#[test]
fn conformance_takes_one_of_several_encoders_by_its_number() {
    let folder = tempfile::tempdir().expect("a folder");
    let control = folder.path().join("control").display().to_string();
    let mut encoders = run(["--switches", "05", "--encoder", "switches=06", "--control", &control]);
    let bus = encoders.bus().display().to_string();
    for encoder in ["2", "encoder 2"] {
        let arguments = ["conformance", "--port", &bus, "--address", "6", "--case", "1"];
        let rest = ["--brief", "--control", &control, "--encoder", encoder];
        let ended = with(&[&arguments[..], &rest].concat(), |command| command);
        assert_eq!((ended.status, ended.errors.as_str()), (Some(0), ""), "{encoder}");
        assert!(ended.output.contains("pass 1"), "{}", ended.output);
    }
    encoders.end();
}
