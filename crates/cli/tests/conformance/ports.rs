//! The command: against the encoder over a pseudo terminal and TCP, and against slaves that are
//! wrong, silent or not there.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

use conformance::{Device, Options, Outcome, PortRig, Runner};
use profibus_dp::time::{Baudrate, Duration};
use serde_json::Value;

/// `sch108bex run` while it runs.
pub(crate) struct Encoder {
    child: Child,
    pub(crate) port: String,
}

impl Encoder {
    pub(crate) fn run(arguments: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_sch108bex"))
            .args(["run", "--switches", "05"])
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("the program starts");
        let mut lines = BufReader::new(child.stdout.take().expect("a pipe")).lines().map_while(Result::ok);
        let port = lines.find_map(|line| line.strip_prefix("bus: ").map(str::to_owned)).expect("a bus");
        // Whatever it tells is read, or it would wait for a reader.
        std::thread::spawn(move || lines.for_each(drop));
        Self { child, port }
    }
}

impl Drop for Encoder {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn conformance(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_sch108bex"))
        .arg("conformance")
        .args(arguments)
        .stdin(Stdio::null())
        .output()
        .expect("the program runs")
}

fn text(octets: &[u8]) -> String {
    String::from_utf8_lossy(octets).into_owned()
}

/// The results of a `--json` run; none may have failed.
fn without_failure(output: &Output) -> Vec<Value> {
    let document: Value = serde_json::from_slice(&output.stdout).expect("one JSON document");
    let cases = document["cases"].as_array().expect("a list").clone();
    let failed: Vec<_> = cases.iter().filter(|case| case["result"] == "fail").collect();
    assert!(failed.is_empty(), "{failed:#?}");
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    cases
}

fn passed(cases: &[Value]) -> usize {
    cases.iter().filter(|case| case["result"] == "pass").count()
}

#[test]
fn the_encoder_passes_over_a_pseudo_terminal_with_all_its_controls() {
    let directory = tempfile::tempdir().expect("a directory");
    let socket = directory.path().join("control");
    let (xml, page) = (directory.path().join("report.xml"), directory.path().join("report.html"));
    let [socket, xml, page] = [&socket, &xml, &page].map(|path| path.to_str().expect("text"));
    let encoder = Encoder::run(&["--control", socket]);
    let output = conformance(&[
        "--port",
        &encoder.port,
        "--control",
        socket,
        "--json",
        "--junit",
        xml,
        "--html",
        page,
    ]);
    let cases = without_failure(&output);
    assert_eq!(cases.len(), conformance::cases().len());
    assert!(passed(&cases) >= 360, "only {} could be tried", passed(&cases));
    for case in cases.iter().filter(|case| case["result"] == "skip") {
        assert!(!case["reason"].as_str().expect("text").is_empty(), "{case}");
    }
    let read = |path| std::fs::read_to_string(path).expect("a report");
    assert!(read(xml).contains(&format!("tests=\"{}\" failures=\"0\"", cases.len())));
    assert!(read(page).contains("could be tried passed."));
}

#[test]
fn the_encoder_passes_over_tcp_without_any_control() {
    let encoder = Encoder::run(&["--port", "tcp-listen:127.0.0.1:0"]);
    let output = conformance(&["--port", &encoder.port, "--profile", "dp-v0", "--json"]);
    let cases = without_failure(&output);
    assert!(passed(&cases) >= 200, "only {} could be tried", passed(&cases));
    let power = cases.iter().find(|case| case["id"] == "127").expect("case 127");
    assert_eq!(
        (&power["result"], &power["reason"]),
        (&"skip".into(), &"it needs control of the device's power".into())
    );
}

#[test]
fn an_encoder_with_fewer_bits_passes_without_its_gsd() {
    let encoder = Encoder::run(&["--port", "tcp-listen:127.0.0.1:0", "--bits", "13x12"]);
    let output = conformance(&["--port", &encoder.port, "--profile", "encoder", "--json"]);
    let cases = without_failure(&output);
    assert!(passed(&cases) >= 40, "only {} could be tried", passed(&cases));
}

#[test]
fn what_was_sent_came_and_was_due_is_printed_in_hex() {
    let encoder = Encoder::run(&[]);
    let output = conformance(&["--port", &encoder.port, "--case", "1"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let printed = text(&output.stdout);
    for part in ["pass 1", "sent 10 05 02 49 50 16", "came 10 02 05 00 07 16", "due  OK", "rule: 2.4"] {
        assert!(printed.contains(part), "{part} is missing in {printed}");
    }
    let brief = text(&conformance(&["--port", &encoder.port, "--case", "1", "--brief"]).stdout);
    assert!(
        brief.starts_with("pass 1     FDL status is answered while the slave waits for Set_Prm\n\narea"),
        "{brief}"
    );
}

#[test]
fn the_parameters_of_a_gsd_are_used() {
    let directory = tempfile::tempdir().expect("a directory");
    let gsd = directory.path().join("SCAN108B.GSD");
    let gsd = gsd.to_str().expect("text");
    let made = Command::new(env!("CARGO_BIN_EXE_sch108bex"))
        .args(["gsd", "--output", gsd])
        .status()
        .expect("the program runs");
    assert!(made.success());
    let encoder = Encoder::run(&[]);
    let output = conformance(&[
        "--port",
        &encoder.port,
        "--gsd",
        gsd,
        "--json",
        "--case",
        "210",
        "143",
        "E022",
        "130",
    ]);
    assert_eq!(passed(&without_failure(&output)), 4);
    let other = conformance(&["--port", &encoder.port, "--ident", "0x4711", "--case", "1"]);
    assert_eq!(other.status.code(), Some(1));
    let errors = text(&other.stderr);
    assert!(errors.contains("has ident number 108B, not 4711"), "{errors}");
}

/// A slave that answers Slave_Diag with six octets, and nothing else. `owner`: whose it is, FF nobody's.
fn poor_slave(owner: u8) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = listener.local_addr().expect("an address").port();
    std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().expect("a master");
        let mut telegram = [0; 256];
        while let Ok(count @ 1..) = stream.read(&mut telegram) {
            answer(&mut stream, &telegram[..count], owner);
        }
    });
    format!("tcp:127.0.0.1:{port}")
}

fn answer(stream: &mut TcpStream, request: &[u8], owner: u8) {
    let mut reply = [
        0x68, 0x0B, 0x0B, 0x68, 0x82, 0x85, 0x08, 0x3E, 0x3C, 0x02, 0x05, 0x00, 0xFF, 0x12, 0x34, 0xD5, 0x16,
    ];
    (reply[12], reply[15]) = (owner, 0xD6_u8.wrapping_add(owner));
    if request.get(7) == Some(&0x3C) {
        let _ = stream.write_all(&reply);
    }
}

#[test]
fn a_slave_that_breaks_a_rule_is_told_and_ends_with_1() {
    let port = poor_slave(0xFF);
    let output = conformance(&[
        "--port",
        &port,
        "--profile",
        "dp-v0",
        "--reply-within",
        "50",
        "--case",
        "1",
        "2",
        "128",
    ]);
    assert_eq!(output.status.code(), Some(1));
    let (printed, errors) = (text(&output.stdout), text(&output.stderr));
    assert!(printed.contains("fail 1 "), "{printed}");
    assert!(
        printed.contains("before the case could begin: Set_Prm was not acknowledged: silence"),
        "{printed}"
    );
    assert!(printed.contains("Set_Prm, on the way\n             sent 68 "), "{printed}");
    assert!(errors.contains("cases failed: 1"), "{errors}");
}

#[test]
fn a_slave_that_another_master_owns_is_left_alone() {
    let output = conformance(&["--port", &poor_slave(7), "--case", "1"]);
    assert_eq!(output.status.code(), Some(1));
    let errors = text(&output.stderr);
    assert!(errors.contains("master 7 owns the slave at 5: end that master first"), "{errors}");
    assert!(output.stdout.is_empty(), "no case was tried");
}

// A real serial device is a line: octets take time, and a pause ends a telegram.
#[test]
fn a_line_is_given_its_times() {
    let encoder = Encoder::run(&[]);
    let port = encoder.port.parse().expect("a port");
    let end = bus::port::open_for_master(&port, Baudrate::B9600, Duration::from_secs(5)).expect("an end");
    let mut rig = PortRig::new(end, Baudrate::B9600, false);
    let device = Device { ident: Some(0x108B), ..Device::encoder(5, 16, 15) };
    let options = Options { rate: Baudrate::B9600, ..Options::default() };
    let mut runner = Runner::new(&device, &mut rig, options).expect("a mode");
    // The longest telegram, one in two reads, and a silence: at 9600 bit/s 255 octets take 292 ms.
    for (id, least) in [("10", 0.292), ("18", 0.1), ("2", 0.0)] {
        let case = conformance::cases().iter().find(|case| case.id == id).expect("the case");
        let result = runner.run(case).expect("the port works");
        assert_eq!(result.outcome, Outcome::Pass, "case {id}: {}", result.reason);
        assert!(result.seconds >= least, "case {id} took {} s", result.seconds);
    }
}

#[test]
fn whoever_is_not_there_is_told_with_what_to_look_at() {
    let encoder = Encoder::run(&[]);
    let output = conformance(&["--port", &encoder.port, "--address", "9", "--reply-within", "50"]);
    assert_eq!(output.status.code(), Some(1));
    let errors = text(&output.stderr);
    assert!(
        errors.contains("no diagnosis from station 9: silence; check address, port and rate"),
        "{errors}"
    );
    let output = conformance(&["--port", &encoder.port, "--control", "/nowhere/at/all"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("--control /nowhere/at/all"));
}

#[test]
fn a_wrong_command_line_ends_with_2() {
    for (arguments, told) in [
        (&["--case", "1"][..], "--port"),
        (&["--port", "/dev/pts/0", "--case", "4711"], "there is no case 4711"),
        (&["--port", "/dev/pts/0", "--profile", "encoder", "--case", "1"], "none of these cases"),
        (&["--port", "nowhere"], "write pty"),
        (&["--port", "/dev/pts/0", "--baud", "115200"], "PROFIBUS has these rates"),
        (&["--port", "/dev/pts/0", "--address", "126"], "126"),
        (&["--port", "/dev/pts/0", "--encoder", "a"], "--control"),
    ] {
        let output = conformance(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(text(&output.stderr).contains(told), "{arguments:?}: {}", text(&output.stderr));
    }
}

// The page is changed by copying what the command prints between the two marks.
#[test]
fn the_page_has_the_table_that_the_command_prints() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/conformance.md");
    let page = std::fs::read_to_string(page).expect("the page");
    let table = page
        .split_once("<!-- conformance --list -->\n")
        .and_then(|(_, rest)| rest.split_once("<!-- end -->"))
        .expect("the two marks")
        .0;
    let output = conformance(&["--list"]);
    assert_eq!(output.status.code(), Some(0));
    assert!(text(&output.stdout) == table, "docs/conformance.md is behind `sch108bex conformance --list`");
}

#[test]
fn another_slave_at_126_is_told_of() {
    let others = "a station answers at address 126 too";
    let crowded = Encoder::run(&["--encoder", "switches=7E"]);
    let output = conformance(&["--port", &crowded.port, "--case", "1"]);
    assert!(text(&output.stderr).contains(others), "{}", text(&output.stderr));
    let alone = Encoder::run(&[]);
    let output = conformance(&["--port", &alone.port, "--case", "1"]);
    assert!(!text(&output.stderr).contains(others), "{}", text(&output.stderr));
}
