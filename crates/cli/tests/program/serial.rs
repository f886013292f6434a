//! Encoders on a serial device, as far as a pseudo terminal can stand for one.

use std::path::Path;
use std::time::{Duration, Instant};

use tempfile::tempdir;

use crate::driver::{Program, end_of, program, run};
use crate::master::{CLASS_2, Master, SCANCON, Terminal, status, status_answer};

/// `run` on a cable; what it must print once that can be used.
fn encoders(options: &[&str]) -> (Program, Terminal) {
    let (far, path) = Terminal::cable();
    let path = path.display().to_string();
    // A busy computer may be late.
    let mut program = run([&["--port", &path, "--reply-limit", "4000"], options].concat());
    program.wait_for(&[&format!("bus: {path}")]);
    (program, far)
}

#[test]
fn several_encoders_exchange_data_on_a_serial_device() {
    let options = [
        "--baud",
        "93750",
        "--switches",
        "05",
        "--encoder",
        "switches=06",
        "--encoder",
        "switches=7D,bits=13x12",
    ];
    let (program, far) = encoders(&options);
    assert_eq!(far.rate(), 93_750);
    for slave in [5, 6, 125, 5] {
        assert_eq!(far.ask(&status(slave)), status_answer(slave));
    }
    assert!(far.is_silent(&status(7)));
    let mut master = Master::new(far, 5);
    master.start_up(SCANCON, &[0xF1, 0xD1, 0xD1]);
    assert_eq!(master.exchange(&[0; 4]).len(), 12);
    let mut master = Master::new(master.terminal, 6);
    master.start_up(CLASS_2, &[0xF1]);
    assert_eq!(master.exchange(&[0; 4]).len(), 4);
    program.end();
}

#[test]
fn encoders_search_the_rate_of_a_serial_device_together() {
    let (mut program, far) = encoders(&["--switches", "05", "--encoder", "switches=06"]);
    // Nobody sends: they go on, the first from 500 kbit/s to the highest and down from there.
    let begun = Instant::now();
    for rate in [12_000_000, 6_000_000] {
        while far.rate() != rate {
            assert!(begun.elapsed() < Duration::from_secs(10), "{}", far.rate());
            std::thread::sleep(Duration::from_millis(5));
        }
    }
    program.wait_for(&["encoder: searching the baud rate: listening at 12 Mbit/s"]);
    program.wait_for(&["encoder 2: searching the baud rate: listening at 12 Mbit/s"]);
    // The first telegram ends the search, and is not answered; a master asks again.
    assert_eq!(far.ask(&status(6)), status_answer(6));
    program.wait_for(&["encoder 2: baud rate 6 Mbit/s found"]);
    assert_eq!(far.ask(&status(5)), status_answer(5));
    program.wait_for(&["encoder: baud rate 6 Mbit/s found"]);
    assert_eq!(far.rate(), 6_000_000);
    let searched = program.seen.iter().filter(|line| line.contains("searching")).count();
    assert_eq!(searched, 2, "once for each encoder: {:#?}", program.seen);
    program.end();
}

#[test]
fn late_replies_are_reported() {
    let (mut program, far) = encoders(&["--baud", "12000000", "--switches", "05", "--max-tsdr", "1"]);
    assert_eq!(far.ask(&status(5)), status_answer(5));
    // A bit time at this rate are 83 ns.
    program.wait_for(&["bus: 1 reply has started late, the newest ", " and 1 are allowed", "slot time"]);
    program.end();
}

#[test]
fn a_serial_device_that_goes_ends_the_program_with_its_memory_written() {
    let directory = tempdir().unwrap();
    let state = directory.path().join("state");
    let (far, path) = Terminal::cable();
    let mut command = program();
    command.arg("run").arg("--port").arg(&path).arg("--state").arg(&state);
    let mut running = Program::start(&mut command);
    running.wait_for(&["ready"]);
    drop(far);
    running.wait_for(&["the segment has ended: cannot read from ", "was it unplugged"]);
    let ended = running.ended();
    assert_eq!(ended.status, Some(1), "{}", ended.errors);
    assert!(ended.errors.contains("error: cannot read from ") && ended.errors.contains("unplugged"));
    assert!(state.exists());
}

#[test]
fn serial_devices_that_cannot_be_had_are_a_sentence_and_status_1() {
    let directory = tempdir().unwrap();
    let file = directory.path().join("file");
    std::fs::write(&file, "precious").unwrap();
    let (_far, busy) = Terminal::cable();
    let _other = run([Path::new("--port"), &busy]);
    for (port, parts) in [
        (Path::new("/dev/ttyUSB99"), ["cannot open /dev/ttyUSB99: ", "/dev/serial/by-id"]),
        (Path::new("/dev/null"), ["cannot use /dev/null: it is no serial device", "like /dev/ttyUSB0"]),
        (&file, ["it is no serial device", "write the path of one"]),
        (directory.path(), ["it is no serial device", "write the path of one"]),
        (&busy, ["another program has it; end that one", "fuser -v /dev/pts/"]),
    ] {
        let ended = end_of(program().arg("run").arg("--port").arg(port));
        let port = port.display();
        assert_eq!((ended.status, ended.output.as_str()), (Some(1), ""), "{port}: {}", ended.errors);
        assert!(parts.iter().all(|part| ended.errors.contains(part)), "{port}: {}", ended.errors);
    }
    assert_eq!(std::fs::read(&file).unwrap(), b"precious");
}

#[test]
fn options_that_do_not_go_with_a_port_are_a_sentence_and_status_2() {
    for (options, words) in [
        (&["--port", "/dev/ttyUSB99", "--pace"][..], "leave --pace out"),
        (&["--port", "/dev/ttyUSB99", "--link", "here"], "leave --link out"),
        (&["--max-tsdr", "100"], "--max-tsdr is for a serial device"),
        (&["--port", "tcp-listen:127.0.0.1:0", "--max-tsdr", "100"], "leave --max-tsdr out"),
        (&["--port", "/dev/ttyUSB99", "--max-tsdr", "0"], "--max-tsdr"),
        (&["--port", "/dev/ttyUSB99", "--max-tsdr", "-1"], "--max-tsdr"),
        (&["--port", "/dev/ttyUSB99", "--max-tsdr", "9999999999999"], "--max-tsdr"),
        (&["--port", "/dev/ttyUSB99", "--max-tsdr", "soon"], "--max-tsdr"),
        (&["--port", "/dev/ttyUSB99", "--baud", "115200"], "PROFIBUS has these rates"),
        (&["--port", "dev/ttyUSB0"], "a device like /dev/ttyUSB0"),
    ] {
        let ended = end_of(program().arg("run").args(options));
        assert_eq!((ended.status, ended.output.as_str()), (Some(2), ""), "{options:?}: {}", ended.errors);
        assert!(ended.errors.contains(words), "{options:?}: {}", ended.errors);
    }
}
