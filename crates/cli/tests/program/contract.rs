//! What `run` promises: its first lines, its link, its end.

use std::fs;
use std::os::unix::fs::{FileTypeExt, symlink};
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

use rustix::process::Signal;
use tempfile::tempdir;

use crate::driver::{Program, end_of, program, run};
use crate::master::{Master, Terminal, sd1, status, status_answer};

fn wait_until_there(path: &Path) {
    let until = Instant::now() + Duration::from_secs(10);
    while fs::read_link(path).is_err() {
        assert!(Instant::now() < until, "{} does not appear", path.display());
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn it_prints_where_the_bus_is_and_then_ready() {
    let mut program = run::<&str>([]);
    assert_eq!(program.seen.len(), 2, "{:?}", program.seen);
    let number = program.seen[0].strip_prefix("bus: /dev/pts/").expect("a bus");
    assert!(number.bytes().all(|digit| digit.is_ascii_digit()), "{number}");
    assert_eq!(program.seen[1], "ready");
    assert!(fs::metadata(program.bus()).expect("a terminal").file_type().is_char_device());
    assert_eq!(program.terminal().ask(&status(126)), status_answer(126));
    program.end_with(Signal::INT);
    // The ident number is nobody's, and it says so; on standard error.
    let errors = program.take_errors();
    assert!(errors.contains("108B is a placeholder") && errors.contains("--ident"), "{errors}");
}

#[test]
fn an_ident_number_of_the_user_needs_no_note() {
    let mut program = run(["--ident", "0x4711"]);
    program.end_with(Signal::INT);
    assert_eq!(program.take_errors(), "");
}

#[test]
fn the_link_is_made_and_removed_at_the_end() {
    for signal in [Signal::INT, Signal::TERM] {
        let directory = tempdir().unwrap();
        let link = directory.path().join("encoder");
        let mut program = run(["--link".as_ref(), link.as_os_str()]);
        // Never the link itself.
        assert_eq!(fs::read_link(&link).unwrap(), program.bus());
        assert_eq!(Terminal::open(&link, 19_200).ask(&status(126)), status_answer(126));
        assert_eq!(program.end_with(signal).code(), Some(0));
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 0, "after {signal:?}");
    }
}

#[test]
fn a_stale_link_is_replaced() {
    let directory = tempdir().unwrap();
    let link = directory.path().join("encoder");
    symlink(directory.path().join("gone"), &link).unwrap();
    let mut program = run(["--link".as_ref(), link.as_os_str()]);
    assert_eq!(fs::read_link(&link).unwrap(), program.bus());
    // `kill -9` leaves such a link; the next one takes it.
    program.kill();
    let mut next = run(["--link".as_ref(), link.as_os_str()]);
    assert_eq!(fs::read_link(&link).unwrap(), next.bus());
}

#[test]
fn what_is_in_the_way_of_the_link_is_an_error_with_a_remedy() {
    let directory = tempdir().unwrap();
    let link = directory.path().join("encoder");
    fs::write(&link, "precious").unwrap();
    let ended = end_of(program().args(["run", "--link"]).arg(&link));
    assert_eq!((ended.status, ended.output.as_str()), (Some(1), ""));
    let named = format!("{}: something that is no link is there", link.display());
    assert!(ended.errors.contains(&named), "{}", ended.errors);
    assert!(ended.errors.contains("remove it or choose another path"), "{}", ended.errors);
    assert_eq!(fs::read(&link).unwrap(), b"precious");

    let ended = end_of(program().args(["run", "--link"]).arg(directory.path().join("no/such/place")));
    assert_eq!((ended.status, ended.output.as_str()), (Some(1), ""));
    assert!(ended.errors.contains("choose a path in a directory that exists"), "{}", ended.errors);
}

#[test]
fn a_link_that_another_run_uses_stays() {
    let directory = tempdir().unwrap();
    let link = directory.path().join("encoder");
    let mut first = run(["--link".as_ref(), link.as_os_str()]);
    let ended = end_of(program().args(["run", "--link"]).arg(&link));
    assert_eq!((ended.status, ended.output.as_str()), (Some(1), ""));
    assert!(ended.errors.contains("which is in use"), "{}", ended.errors);
    assert_eq!(fs::read_link(&link).unwrap(), first.bus());
}

#[test]
fn interrupt_and_termination_end_it_with_0() {
    for signal in [Signal::INT, Signal::TERM] {
        // Alone, and in the middle of a conversation.
        assert_eq!(run::<&str>([]).end_with(signal).code(), Some(0));
        let mut program = run::<&str>([]);
        let terminal = program.terminal();
        terminal.ask(&status(126));
        terminal.send(&status(126));
        assert_eq!(program.end_with(signal).code(), Some(0));
    }
}

#[test]
fn a_closed_standard_output_is_no_error() {
    let directory = tempdir().unwrap();
    let link = directory.path().join("encoder");
    // Closed while it runs: what happens then is printed to nobody.
    let mut command = program();
    command.args(["run", "--switches", "0B", "--link"]).arg(&link);
    let mut child = command.spawn().unwrap();
    let output = child.stdout.take().unwrap();
    wait_until_there(&link);
    drop(output);
    let mut program = Guard(child);
    let mut master = Master::new(Terminal::open(&link, 500_000), 11);
    // Refused parameters, data exchange, a preset: each is told.
    master.set_prm([0, 0], &[]);
    master.start_up(crate::master::CLASS_2, &[0xF1]);
    master.exchange(&[0x80, 0, 0, 1]);
    std::thread::sleep(Duration::from_millis(50));
    assert_eq!(master.position(), 1);
    assert!(program.0.try_wait().unwrap().is_none(), "it has ended");
    drop(program);

    // Full from the beginning.
    fs::remove_file(&link).unwrap();
    let mut command = crate::driver::program();
    command.args(["run", "--switches", "0B", "--link"]).arg(&link);
    command.stdout(fs::OpenOptions::new().write(true).open("/dev/full").unwrap());
    let mut program = Program::start(&mut command);
    wait_until_there(&link);
    let terminal = Terminal::open(&link, 500_000);
    assert_eq!(terminal.ask(&status(11)), status_answer(11));
    assert!(program.is_running());
    assert_eq!(program.end_with(Signal::TERM).code(), Some(0));

    // A pipe that nobody reads from the beginning.
    let mut command = crate::driver::program();
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    command.args(["run", "--switches", "0B", "--link"]).arg(&link).stdout(Stdio::from(writer));
    let mut program = Program::start(&mut command);
    wait_until_there(&link);
    assert_eq!(Terminal::open(&link, 500_000).ask(&status(11)), status_answer(11));
    assert_eq!(program.end_with(Signal::INT).code(), Some(0));
}

struct Guard(std::process::Child);

impl Drop for Guard {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn off_the_bus_it_says_why_and_is_ready_all_the_same() {
    for switches in ["00", "80", "FF", "7F"] {
        let mut program = run(["--switches", switches]);
        let why = &program.seen[1];
        assert!(why.contains("off the bus") && why.contains(&format!("at {switches} ")), "{why}");
        assert!(why.contains("01 to 7E") && why.contains("manual 3.4"), "{why}");
        assert_eq!(program.seen[2], "ready");
        let terminal = program.terminal();
        for address in [0, 126, 127] {
            assert!(terminal.is_silent(&status(address)), "switches {switches}, {address}");
        }
    }
}

#[test]
fn without_power_it_says_so_and_is_silent() {
    for supply in ["5", "0", "-24", "5.999"] {
        let mut program = run(["--switches", "0B", "--supply", supply]);
        let why = program.seen[1].clone();
        assert!(why.contains("off") && why.contains(&format!("{supply} V")), "{why}");
        assert_eq!(program.seen[2], "ready");
        assert!(program.terminal().is_silent(&status(11)), "{supply} V");
    }
    let mut program = run(["--switches", "0B", "--supply", "6"]);
    assert_eq!(program.terminal().ask(&status(11)), status_answer(11));
}

#[test]
fn as_delivered_it_answers_at_126_only_and_takes_no_parameters_there() {
    let mut program = run::<&str>([]);
    let terminal = program.terminal();
    for address in 0..=127 {
        let answer = if address == 126 {
            terminal.ask(&status(address))
        } else {
            terminal.send(&status(address));
            terminal.answer(Duration::from_millis(5))
        };
        let due = if address == 126 { status_answer(126) } else { Vec::new() };
        assert_eq!(answer, due, "{address}");
    }
    let mut master = Master::new(terminal, 126);
    // Diagnosis: not ready, wants parameters, owned by nobody; as delivered (manual 4.2).
    let due = [0x02, 0x05, 0x00, 0xFF, 0x10, 0x8B, 0x0A, 0, 0, 2, 0x00, 0x01, 0x00, 0x00, 0x80, 0x00];
    assert_eq!(master.diagnosis().0, due);
    let not_active = sd1(2, 126, 0x03);
    assert_eq!(master.set_prm(crate::master::IDENT, crate::master::CLASS_1), not_active);
    assert_eq!(master.chk_cfg(&[0xD1]), not_active);
    assert_eq!(master.diagnosis().0, due);
}

#[test]
fn the_switches_are_hexadecimal() {
    // Manual 3.4: X16 at 2 and X1 at A make 42.
    for (switches, address) in [("2A", 42), ("2a", 42), ("01", 1), ("7D", 125), ("7E", 126)] {
        let mut program = run(["--switches", switches]);
        assert_eq!(program.terminal().ask(&status(address)), status_answer(address), "{switches}");
    }
    assert_eq!(status_answer(42), [0x10, 0x02, 0x2A, 0x00, 0x2C, 0x16]);
}

#[test]
fn several_encoders_share_the_bus() {
    let mut program = run([
        "--switches",
        "0B",
        "--shaft",
        "still@1000",
        "--encoder",
        "switches=0C,serial=654321,shaft=still@2000",
        "--encoder",
        "switches=0D,bits=13x12",
        "--encoder",
        "switches=00",
    ]);
    let why = program.seen[1].clone();
    assert!(why.contains("encoder 4: off the bus"), "{why}");
    let mut terminal = program.terminal();
    for (slave, serial, position, revolution) in [
        (11, b"1234567   ", 1000, [0, 1, 0, 0, 0x80, 0]),
        (12, b"654321    ", 2000, [0, 1, 0, 0, 0x80, 0]),
        (13, b"1234567   ", 1000, [0, 0, 0x20, 0, 0x10, 0]),
    ] {
        let mut master = Master::new(terminal, slave);
        let diagnosis = master.start_up(crate::master::CLASS_2, &[0xF1]);
        assert_eq!(diagnosis.octets(48..=57), serial, "{slave}");
        assert_eq!(diagnosis.octets(11..=16), revolution, "{slave}");
        assert_eq!(master.position(), position, "{slave}");
        terminal = master.terminal;
    }
    assert!(terminal.is_silent(&status(0)));
}
