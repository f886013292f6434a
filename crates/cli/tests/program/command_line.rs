//! Wrong command lines: a sentence that names the option and says what to write.

use std::ffi::{OsStr, OsString};
use std::fs;
use std::os::unix::ffi::OsStringExt;

use tempfile::tempdir;

use crate::driver::{end_of, program};

/// Runs it with arguments in an empty directory: exit status and standard error. Nothing may be printed on
/// standard output, and no file may be made.
#[track_caller]
fn refused<A: AsRef<OsStr>>(arguments: impl IntoIterator<Item = A>) -> (Option<i32>, String) {
    let directory = tempdir().unwrap();
    let ended = end_of(program().current_dir(directory.path()).args(arguments));
    let files: Vec<_> =
        fs::read_dir(directory.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!((ended.output.as_str(), files), ("", vec![]), "{}", ended.errors);
    assert!(!ended.errors.contains("panicked"), "{}", ended.errors);
    (ended.status, ended.errors)
}

/// The arguments after `run`, and what standard error must hold.
const WRONG: &[(&[&str], &[&str])] = &[
    // Switches: two hexadecimal digits.
    (&["--switches", "0"], &["--switches", "two hexadecimal digits"]),
    (&["--switches", "2AA"], &["--switches", "two hexadecimal digits"]),
    (&["--switches", "G1"], &["--switches", "two hexadecimal digits"]),
    (&["--switches", "+1"], &["--switches", "two hexadecimal digits"]),
    (&["--switches", ""], &["--switches", "two hexadecimal digits"]),
    (&["--switches", "0x"], &["--switches", "like 2A"]),
    (&["--switches", "ß"], &["--switches", "like 2A"]),
    (&["--switches"], &["--switches", "value is required"]),
    // Bits: 2x0 to 16x15.
    (&["--bits", "1x0"], &["--bits", "2 to 16"]),
    (&["--bits", "17x1"], &["--bits", "2 to 16"]),
    (&["--bits", "16x16"], &["--bits", "0 to 15"]),
    (&["--bits", "16"], &["--bits", "like 16x15"]),
    (&["--bits", "x"], &["--bits", "like 16x15"]),
    (&["--bits", "-1x1"], &["--bits", "like 16x15"]),
    (&["--bits", "16x"], &["--bits", "like 16x15"]),
    (&["--bits", "99999999999x1"], &["--bits", "like 16x15"]),
    (&["--bits", ""], &["--bits", "like 16x15"]),
    // Serial numbers: 6 or 7 digits.
    (&["--serial", "12345"], &["--serial", "6 or 7 decimal digits"]),
    (&["--serial", "12345678"], &["--serial", "6 or 7 decimal digits"]),
    (&["--serial", "12345a"], &["--serial", "6 or 7 decimal digits"]),
    (&["--serial", ""], &["--serial", "6 or 7 decimal digits"]),
    // Ident numbers: 0x and up to four digits.
    (&["--ident", "108B"], &["--ident", "like 0x108B"]),
    (&["--ident", "0x"], &["--ident", "like 0x108B"]),
    (&["--ident", "0x10000"], &["--ident", "like 0x108B"]),
    (&["--ident", "0x-1"], &["--ident", "like 0x108B"]),
    (&["--ident", ""], &["--ident", "like 0x108B"]),
    // Shafts.
    (&["--shaft", "moving"], &["--shaft", "still@RAW or constant:RPM"]),
    (&["--shaft", ""], &["--shaft", "still@RAW or constant:RPM"]),
    (&["--shaft", "still@"], &["--shaft", "whole number of counts"]),
    (&["--shaft", "still@1.5"], &["--shaft", "whole number of counts"]),
    (&["--shaft", "still@99999999999999999999"], &["--shaft", "whole number of counts"]),
    (&["--shaft", "still@-1"], &["--shaft", "0 to 2147483647"]),
    (&["--shaft", "still@2147483648"], &["--shaft", "0 to 2147483647"]),
    (&["--bits", "13x12", "--shaft", "still@33554432"], &["--shaft", "0 to 33554431", "13x12"]),
    (&["--bits", "2x0", "--shaft", "constant:1@4"], &["--shaft", "0 to 3"]),
    (&["--shaft", "constant:"], &["--shaft", "it needs rpm"]),
    (&["--shaft", "constant:fast@0"], &["--shaft", "revolutions per minute"]),
    (&["--shaft", "constant:NaN"], &["--shaft", "revolutions per minute"]),
    (&["--shaft", "constant:inf"], &["--shaft", "revolutions per minute"]),
    (&["--shaft", "constant:1e300@0"], &["--shaft", "between -1000000 and 1000000"]),
    // Numbers of the world.
    (&["--supply", "NaN"], &["--supply", "volts between -100 and 100"]),
    (&["--supply", "1e9"], &["--supply", "volts between -100 and 100"]),
    (&["--supply", "24V"], &["--supply", "volts between -100 and 100"]),
    (&["--supply", ""], &["--supply", "like 24 or 8.9"]),
    (&["--temperature", "inf"], &["--temperature", "degrees Celsius"]),
    (&["--temperature", "-301"], &["--temperature", "between -300 and 300"]),
    (&["--temperature", "warm"], &["--temperature", "like 20 or 65.1"]),
    (&["--light", "dim"], &["--light", "ok, low"]),
    (&["--light", ""], &["--light", "ok, low"]),
    (&["--battery", "full"], &["--battery", "ok, low, empty"]),
    // Rates and limits.
    (&["--baud", "115200"], &["--baud", "9600, 19200, 45450", "or write auto"]),
    (&["--baud", "0"], &["--baud", "9600, 19200, 45450"]),
    (&["--baud", "-9600"], &["--baud", "or write auto"]),
    (&["--baud", "AUTO"], &["--baud", "or write auto"]),
    (&["--baud", ""], &["--baud", "or write auto"]),
    (&["--reply-limit", "0"], &["--reply-limit", "from 1 to 60000"]),
    (&["--reply-limit", "60001"], &["--reply-limit", "from 1 to 60000"]),
    (&["--reply-limit", "-1"], &["--reply-limit"]),
    (&["--reply-limit", "1e3"], &["--reply-limit"]),
    (&["--reply-limit", "99999999999999999999"], &["--reply-limit"]),
    (&["--port", "nonsense"], &["--port", "nonsense", "pty"]),
    (&["--port", ""], &["--port", "write pty"]),
    // Further encoders.
    (&["--encoder", ""], &["--encoder", "KEY=VALUE"]),
    (&["--encoder", "switches"], &["--encoder", "KEY=VALUE"]),
    (&["--encoder", "colour=red"], &["--encoder", "keys are switches, bits"]),
    (&["--encoder", "switches=0C,,"], &["--encoder", "KEY=VALUE"]),
    (&["--encoder", "switches=0C;bits=13x12"], &["--encoder", "switches=0C;bits=13x12", "two hexadecimal"]),
    (&["--encoder", "switches=GG"], &["--encoder", "switches=GG", "two hexadecimal digits"]),
    (&["--encoder", "bits=99x1"], &["--encoder", "bits=99x1", "2 to 16"]),
    (&["--encoder", "serial=1"], &["--encoder", "serial=1", "6 or 7 decimal digits"]),
    (&["--encoder", "shaft=round"], &["--encoder", "shaft=round", "still@RAW"]),
    (&["--encoder", "bits=2x0,shaft=still@4"], &["--encoder", "shaft", "0 to 3"]),
    (&["--encoder", "state="], &["--encoder", "state="]),
    // Memory.
    (&["--reset-state"], &["--reset-state", "--state"]),
    (&["--state", ""], &["--state"]),
    (&["--state"], &["--state", "value is required"]),
    (&["--link", ""], &["--link"]),
    // A wrong one after a good one that would make a file.
    (&["--state", "memory", "--encoder", "bits=99x1"], &["--encoder", "bits=99x1"]),
    (&["--state", "memory", "--encoder", "bits=2x0,shaft=still@4"], &["--encoder", "0 to 3"]),
    (&["--encoder", "state=memory", "--encoder", "shaft=still@-1"], &["--encoder", "0 to 2147483647"]),
    (&["--state", "memory", "--shaft", "still@-1"], &["--shaft", "0 to 2147483647"]),
    (&["--state", "memory", "--port", "nonsense"], &["--port", "nonsense"]),
    (&["--state", "memory", "--switches", "-1x"], &["--switches", "two hexadecimal digits"]),
    (&["--state", "one", "--state", "two"], &["--state", "multiple times"]),
    // What there is not.
    (&["--frobnicate"], &["--frobnicate"]),
    (&["--switch", "0B"], &["--switch", "--switches"]),
    (&["-x"], &["-x"]),
    (&["something"], &["something cannot be read", "name a scenario file"]),
    (&[""], &["a value is required", "FILE"]),
];

#[test]
fn wrong_arguments_of_run_are_named_with_a_remedy() {
    assert!(WRONG.len() >= 40);
    let mut bad = Vec::new();
    for (arguments, parts) in WRONG {
        let (status, errors) = refused(["run"].iter().chain(*arguments));
        let first = errors.lines().next().unwrap_or_default();
        let missing: Vec<_> = parts.iter().filter(|part| !errors.contains(**part)).collect();
        if status != Some(2) || !missing.is_empty() || !first.starts_with("error: ") {
            bad.push(format!("{arguments:?}: {status:?}, without {missing:?}: {errors}"));
        }
    }
    assert!(bad.is_empty(), "{}", bad.join("\n"));
}

#[test]
fn other_commands_and_arguments_are_refused() {
    for (arguments, part) in [
        (&["frobnicate"][..], "frobnicate"),
        (&["demo", "--switches", "0B"], "--switches"),
        (&["demo", "more"], "more"),
        (&["--switches", "0B"], "--switches"),
        (&[""], "unrecognized"),
        (&["--", "run"], "run"),
    ] {
        let (status, errors) = refused(arguments);
        assert_eq!(status, Some(2), "{arguments:?}: {errors}");
        assert!(errors.contains(part), "{arguments:?}: {errors}");
    }
}

#[test]
fn arguments_that_are_no_text_are_refused() {
    let strange = OsString::from_vec(vec![b'0', 0xFF, 0x80]);
    for option in ["--switches", "--bits", "--shaft", "--encoder", "--ident", "--supply", "--port", "--light"]
    {
        let (status, errors) = refused(["run".as_ref(), option.as_ref(), strange.as_os_str()]);
        assert_eq!(status, Some(2), "{option}: {errors}");
        assert!(errors.contains("UTF-8") || errors.contains(option), "{option}: {errors}");
    }
    let (status, errors) = refused([strange.as_os_str()]);
    assert_eq!(status, Some(2), "{errors}");
}

#[test]
fn what_is_not_the_command_lines_fault_has_status_1() {
    for (arguments, parts) in [
        (&["--state", "no/such/place"][..], &["no/such/place", "directory that exists"][..]),
        (&["--state", "/"], &["state file /", "directory"]),
        (&["--link", "no/such/place"], &["no/such/place", "directory that exists"]),
        (&["--encoder", "switches=0C,state=no/such/place"], &["no/such/place", "directory that exists"]),
    ] {
        let (status, errors) = refused(["run"].iter().chain(arguments));
        assert_eq!(status, Some(1), "{arguments:?}: {errors}");
        for part in parts {
            assert!(errors.contains(part), "{arguments:?}, {part}: {errors}");
        }
    }
}

#[test]
fn a_wrong_command_line_resets_no_memory() {
    let directory = tempdir().unwrap();
    let state = directory.path().join("memory");
    fs::write(&state, "precious").unwrap();
    for wrong in ["bits=99x1", "shaft=still@-1", "state="] {
        let ended = end_of(
            program().args(["run", "--reset-state", "--state"]).arg(&state).args(["--encoder", wrong]),
        );
        assert_eq!(ended.status, Some(2), "{}", ended.errors);
        assert_eq!(fs::read(&state).unwrap(), b"precious", "{wrong}");
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
    }
}

#[test]
fn help_and_version_are_no_errors() {
    for (argument, part) in [("--help", "sch108bex"), ("--version", "sch108bex 0.")] {
        let ended = end_of(program().arg(argument));
        assert_eq!((ended.status, ended.errors.as_str()), (Some(0), ""));
        assert!(ended.output.contains(part), "{}", ended.output);
    }
    let ended = end_of(program().args(["run", "--help"]));
    assert_eq!(ended.status, Some(0));
    for option in
        ["--port", "--link", "--baud", "--pace", "--switches", "--bits", "--ident", "--serial", "--state"]
    {
        assert!(ended.output.contains(option), "{option}");
    }
}
