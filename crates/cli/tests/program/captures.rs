//! `run --capture`, `capture`, `decode` of a capture and `replay`, as their users see them.

use std::fs;
use std::path::Path;
use std::time::Duration;

use rustix::process::Signal;
use serde_json::Value;
use tempfile::tempdir;

use crate::driver::{Ended, Program, end_of, program, run};
use crate::master::{CLASS_2, Terminal, status, status_answer};

/// `decode` with these options and the capture.
fn decode(path: &Path, options: &[&str]) -> Ended {
    end_of(program().arg("decode").args(options).arg(path))
}

/// The documents of `decode --json`.
fn documents(path: &Path, options: &[&str]) -> Vec<Value> {
    let ended = end_of(program().args(["decode", "--json"]).args(options).arg(path));
    ended.output.lines().map(|line| serde_json::from_str(line).expect("a document")).collect()
}

/// A run with a start-up and ten exchanges in a class 2 encoder whose shaft stands still.
fn recorded(path: &Path, more: &[&str]) {
    let mut program = run(["--switches", "05", "--capture", path.to_str().unwrap()].iter().chain(more));
    let mut master = program.master(5);
    master.start_up(CLASS_2, &[0xF1]);
    for _ in 0..10 {
        master.exchange(&[0; 4]);
    }
    drop(master);
    program.wait_for(&["the master has closed the bus"]);
    program.end();
}

#[test]
fn a_capture_of_a_run_has_every_telegram_with_its_time_and_its_answer() {
    let directory = tempdir().unwrap();
    let path = directory.path().join("run.pcapng");
    recorded(&path, &[]);
    let documents = documents(&path, &[]);
    let of = |service: &str, direction: &str| {
        // On a busy computer a request may have to be repeated.
        let fits = |entry: &&Value| {
            entry["service"] == service && entry["direction"] == direction && entry["retry"] == false
        };
        documents.iter().filter(fits).count()
    };
    assert!(of("Data_Exchange", "request") == 10 && of("Data_Exchange", "response") >= 10);
    assert!(of("Set_Prm", "request") == 1 && of("Set_Prm", "response") >= 1);
    let times: Vec<u64> = documents.iter().map(|entry| entry["nanos"].as_u64().expect("a time")).collect();
    assert!(times.is_sorted() && times[0] > 1_600_000_000_000_000_000, "{times:?}");
    assert_eq!(documents[0]["seconds"], 0.0);
    let notes = documents.iter().filter(|entry| entry["kind"] == "note");
    let notes: Vec<String> = notes.map(|note| note["comments"][0].as_str().unwrap().to_owned()).collect();
    assert!(notes.contains(&"a master came, 500000 bit/s".to_owned()), "{notes:?}");
    assert!(notes.contains(&"the master left".to_owned()), "{notes:?}");
}

#[test]
fn filters_leave_only_what_is_asked_for() {
    let directory = tempdir().unwrap();
    let path = directory.path().join("run.pcapng");
    recorded(&path, &[]);
    let count = |options: &[&str]| documents(&path, options).len();
    let all = count(&[]);
    assert_eq!(count(&["--service", "Data_Exchange"]), 20);
    assert_eq!(count(&["--service", "setprm"]), 2, "with its E5");
    assert_eq!(count(&["--address", "6"]), 0);
    assert_eq!(count(&["--address", "5", "--service", "set-prm"]), 2, "E5 has no address of its own");
    assert_eq!(count(&["--to", "1000"]), all);
    assert_eq!(count(&["--from", "1000"]), 0);
    assert!(count(&["--errors"]) < all && count(&["--errors", "--service", "Data_Exchange"]) == 0);
    let wrong = decode(&path, &["--service", "Set_Everything"]);
    assert_eq!(wrong.status, Some(2));
    assert!(wrong.errors.contains("Data_Exchange, Set_Slave_Add"), "{}", wrong.errors);
    let timeless = end_of(program().args(["decode", "--from", "1", "10", "0B", "02", "49", "56", "16"]));
    assert_eq!(timeless.status, Some(2));
    assert!(timeless.errors.contains("octets alone have no times"), "{}", timeless.errors);
}

#[test]
fn what_was_on_the_bus_before_kill_9_is_in_the_file() {
    let directory = tempdir().unwrap();
    let path = directory.path().join("run.pcapng");
    let mut program = run(["--switches", "05", "--capture", path.to_str().unwrap()]);
    let terminal = program.terminal();
    for _ in 0..20 {
        assert_eq!(terminal.ask(&status(5)), status_answer(5));
    }
    // Longer than what was seen may wait for the disk.
    std::thread::sleep(Duration::from_millis(500));
    program.kill();
    let documents = documents(&path, &["--service", "FDL_Status"]);
    assert_eq!(documents.len(), 40);
}

#[test]
fn a_file_that_is_cut_or_no_capture_gets_a_sentence() {
    let directory = tempdir().unwrap();
    let path = directory.path().join("run.pcapng");
    recorded(&path, &[]);
    let whole = fs::read(&path).unwrap();
    fs::write(&path, &whole[..whole.len() - 10]).unwrap();
    let cut = decode(&path, &[]);
    assert_eq!(cut.status, Some(1));
    assert!(cut.errors.contains("whatever wrote it was cut off"), "{}", cut.errors);
    assert!(cut.output.contains("Data_Exchange: position 0"), "{}", cut.output);
    // A block after the first two that claims 4 GB.
    let mut huge = whole.clone();
    huge.extend([6, 0, 0, 0, 0xFC, 0xFF, 0xFF, 0xFF]);
    fs::write(&path, &huge).unwrap();
    let huge = decode(&path, &[]);
    assert!(huge.status == Some(1) && huge.errors.contains("claims 4294967292 octets"), "{}", huge.errors);
    // Ethernet.
    let mut foreign = whole;
    let interface =
        foreign[28..].windows(4).position(|four| four == [1, 0, 0, 0]).expect("an interface") + 28;
    foreign[interface + 8] = 1;
    fs::write(&path, &foreign).unwrap();
    let foreign = decode(&path, &[]);
    assert!(foreign.status == Some(1) && foreign.errors.contains("link type 1"), "{}", foreign.errors);
}

#[test]
fn the_link_type_is_the_one_that_was_asked_for() {
    let directory = tempdir().unwrap();
    let path = directory.path().join("run.pcapng");
    for (options, number) in [(&[][..], 147_u16), (&["--link-type", "257"], 257)] {
        recorded(&path, options);
        let file = fs::read(&path).unwrap();
        // The interface follows the section header of 28 octets: type, length, link type.
        assert_eq!(file[36..38], number.to_le_bytes(), "{:?}", &file[..48]);
        assert_eq!(decode(&path, &[]).status, Some(0));
    }
    let wrong = end_of(program().args(["run", "--capture", "x", "--link-type", "1"]));
    assert!(wrong.status == Some(2) && wrong.errors.contains("147 (USER0)"), "{}", wrong.errors);
    let nowhere = end_of(program().args(["run", "--capture", "/nowhere/x"]));
    assert!(nowhere.status == Some(1) && nowhere.errors.contains("/nowhere/x"), "{}", nowhere.errors);
}

#[test]
fn a_replay_is_right_against_the_same_encoder_and_names_the_octets_against_another() {
    let directory = tempdir().unwrap();
    let path = directory.path().join("run.pcapng");
    recorded(&path, &["--shaft", "still@4096"]);
    let replay = |shaft: &str, options: &[&str]| {
        let mut program = run(["--switches", "05", "--shaft", shaft]);
        let bus = program.bus();
        let mut command = crate::driver::program();
        command.arg("replay").arg(&path).arg("--port").arg(bus).args(["--speed", "1000"]).args(options);
        let ended = end_of(&mut command);
        program.end();
        ended
    };
    let same = replay("still@4096", &["--as", "test"]);
    assert_eq!(same.status, Some(0), "{} {}", same.output, same.errors);
    assert!(same.output.contains(", 0 differ"), "{}", same.output);
    // 1000h and 1001h: the last octet of four, and the check sum.
    let other = replay("still@4097", &["--as", "test"]);
    assert_eq!(other.status, Some(1), "{}", other.output);
    assert!(other.output.contains("Data_Exchange: no preset: octets 11, 12 differ"), "{}", other.output);
    assert!(other.output.contains(", 10 differ"), "{}", other.output);
    let ignored = replay("still@4097", &["--as", "test", "--ignore-inputs"]);
    assert_eq!(ignored.status, Some(0), "{} {}", ignored.output, ignored.errors);
    let master = replay("still@4097", &[]);
    assert!(master.status == Some(0) && master.output.contains("answers"), "{}", master.output);
}

#[test]
fn a_replay_without_anything_to_send_gets_a_sentence() {
    let directory = tempdir().unwrap();
    let path = directory.path().join("octets");
    fs::write(&path, "10 0B 02 49 56 16").unwrap();
    let no_capture = end_of(program().arg("replay").arg(&path).args(["--port", "/dev/null"]));
    assert!(
        no_capture.status == Some(1) && no_capture.errors.contains("is no pcapng file"),
        "{}",
        no_capture.errors
    );
}

#[test]
fn capture_listens_and_sends_nothing() {
    let directory = tempdir().unwrap();
    let path = directory.path().join("heard.pcapng");
    let mut command = program();
    command.args(["capture", "--port", "pty"]).arg(&path);
    let mut program = Program::start(&mut command);
    let terminal = Terminal::open(&program.bus(), 500_000);
    program.wait_for(&["ready"]);
    // What others say, cut anywhere.
    terminal.send(&status(5)[..4]);
    terminal.send(&[&status(5)[4..], &status_answer(5)].concat());
    assert!(terminal.is_silent(&status(6)));
    terminal.send(&[0x55, 0x55]);
    std::thread::sleep(Duration::from_millis(100));
    assert_eq!(program.end_with(Signal::INT).code(), Some(0));
    let lines = decode(&path, &[]).output;
    for due in [
        "2 -> 5  FDL_Status request",
        "5 -> 2  FDL_Status: OK",
        "2 -> 6  FDL_Status request",
        "2 octets skipped",
    ] {
        assert_eq!(lines.matches(due).count(), 1, "{due}: {lines}");
    }
}
