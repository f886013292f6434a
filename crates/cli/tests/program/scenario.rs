//! `sch108bex scenario`, and `run FILE`.

use std::path::PathBuf;

use rustix::process::Signal;
use serde_json::Value;

use crate::driver::{Ended, Program, end_of, program};
use crate::master::{Master, Terminal};

const SCENARIO: &str = r#"
[[segment]]
name = "crane"

[[segment.encoder]]
name = "hoist"
switches = "05"

[[segment.encoder]]
name = "slew"
switches = "06"
joined = false

[segment.master]

[[segment.master.poll]]
encoder = "hoist"

[[event]]
at = "0.2 s"
do = "battery"
encoder = "crane.hoist"
state = "low"

[[expect]]
event = "warning_raised"
"#;

fn file(folder: &tempfile::TempDir, text: impl AsRef<[u8]>) -> PathBuf {
    let path = folder.path().join("scenario.toml");
    std::fs::write(&path, text).expect("a file");
    path
}

fn scenario(arguments: &[&str], path: &std::path::Path) -> Ended {
    end_of(program().arg("scenario").args(arguments).arg(path))
}

#[test]
fn a_scenario_that_holds_ends_with_0_and_one_that_does_not_with_1() {
    let folder = tempfile::tempdir().expect("a folder");
    let good = scenario(&["run", "--virtual"], &file(&folder, SCENARIO));
    assert_eq!(good.status, Some(0), "{good:?}");
    assert!(
        good.output
            .contains("ok   line 25: warning_raised comes; found: at 200 ms crane.hoist: warning: battery"),
        "{}",
        good.output
    );
    assert!(good.output.contains("1 of 1 expectations hold"), "{}", good.output);
    let path = file(&folder, SCENARIO.replace("\"warning_raised\"", "\"warning_raised\"\nseen = false"));
    let bad = scenario(&["run", "--speed", "5"], &path);
    assert_eq!(bad.status, Some(1), "{bad:?}");
    assert!(bad.output.contains("FAIL line 25: warning_raised does not come"), "{}", bad.output);
    assert!(bad.errors.contains("1 of 1 expectations do not hold"), "{}", bad.errors);
    let json = scenario(&["run", "--virtual", "--json"], &path);
    let outcome: Value = serde_json::from_str(&json.output).expect("JSON");
    assert_eq!((json.status, &outcome["passed"]), (Some(1), &Value::Bool(false)));
    assert_eq!(outcome["expectations"][0]["line"], 25);
    assert!(outcome["segments"][0]["octets"].as_u64() > Some(1000), "{outcome}");
}

#[test]
fn a_file_that_is_no_scenario_ends_with_2_and_tells_every_mistake() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = file(&folder, SCENARIO.replace("switches", "switch"));
    for arguments in [&["check"][..], &["run", "--virtual"]] {
        let ended = scenario(arguments, &path);
        assert_eq!((ended.status, ended.output.as_str()), (Some(2), ""), "{ended:?}");
        assert_eq!(ended.errors.matches("is `switches` meant?").count(), 2, "{}", ended.errors);
        assert!(
            ended.errors.contains("scenario.toml:7:1: an encoder has no key \"switch\""),
            "{}",
            ended.errors
        );
    }
    let json = scenario(&["check", "--json"], &path);
    let checked: Value = serde_json::from_str(&json.output).expect("JSON");
    assert_eq!(checked["valid"], false);
    assert_eq!((&checked["faults"][0]["line"], &checked["faults"][0]["column"]), (&7.into(), &1.into()));
    let live = end_of(program().arg("run").arg(&path));
    assert_eq!(live.status, Some(2), "{live:?}");
}

#[test]
fn files_that_cannot_be_read_are_told() {
    let folder = tempfile::tempdir().expect("a folder");
    let missing = scenario(&["check"], &folder.path().join("nothing.toml"));
    assert_eq!(missing.status, Some(2));
    assert!(missing.errors.contains("nothing.toml cannot be read"), "{}", missing.errors);
    assert_eq!(scenario(&["check"], folder.path()).status, Some(2));
    let binary = scenario(&["check"], &file(&folder, [0x7F, b'E', b'L', b'F', 0xFF]));
    assert_eq!(binary.status, Some(2));
    assert!(binary.errors.contains("octet FF in line 1"), "{}", binary.errors);
    let endless = scenario(&["check"], std::path::Path::new("/dev/zero"));
    assert_eq!(endless.status, Some(2));
    assert!(endless.errors.contains("4194304 is the most"), "{}", endless.errors);
}

#[test]
fn check_says_what_is_in_a_scenario_and_schema_is_json() {
    let folder = tempfile::tempdir().expect("a folder");
    let checked = scenario(&["check"], &file(&folder, SCENARIO));
    assert_eq!(checked.status, Some(0), "{checked:?}");
    assert_eq!(checked.output, "a scenario: 1 segment, 2 encoders, 1 event, 1 expectation, 1.2 s long");
    let schema = end_of(program().args(["scenario", "schema"]));
    let schema: Value = serde_json::from_str(&schema.output).expect("JSON");
    assert_eq!(schema["properties"]["segment"]["type"], "array");
}

#[test]
fn run_puts_each_segment_on_its_port_and_lets_events_happen() {
    let folder = tempfile::tempdir().expect("a folder");
    let two = SCENARIO.replace("[[event]]", "[[segment]]\nname = \"rig\"\n[[segment.encoder]]\nname = \"drum\"\nswitches = \"07\"\n[[event]]\nat = \"0.5 s\"\ndo = \"join\"\nencoder = \"crane.slew\"\n[[event]]");
    let mut running = Program::start(program().arg("run").arg(file(&folder, two)));
    running.wait_for(&["ready"]);
    let port = |running: &mut Program, name: &str| {
        let line = running.wait_for(&[name, "/dev/pts/"]);
        PathBuf::from(line.split_once(": ").expect("a name and a path").1)
    };
    let (crane, rig) = (port(&mut running, "crane: "), port(&mut running, "rig: "));
    running.wait_for(&["crane.hoist: warning: battery"]);
    running.wait_for(&["crane.slew: on the bus, station address 6"]);
    let mut master = Master::new(Terminal::open(&crane, 500_000), 6);
    assert_eq!(master.diagnosis().octet(10), 2, "an encoder with electronic turn count");
    let mut master = Master::new(Terminal::open(&rig, 500_000), 7);
    assert_eq!(master.diagnosis().octet(10), 2, "an encoder with electronic turn count");
    assert_eq!(running.end_with(Signal::INT).code(), Some(0));
    assert!(running.take_errors().contains("the built-in one, and events for it, are for `scenario run`"));
}

#[test]
fn files_of_a_scenario_are_in_its_folder() {
    let folder = tempfile::tempdir().expect("a folder");
    let gsd =
        end_of(program().args(["gsd", "--ident", "0x4711", "--output"]).arg(folder.path().join("own.gsd")));
    assert_eq!(gsd.status, Some(0), "{gsd:?}");
    std::fs::write(folder.path().join("trip.csv"), "0,0\n1,2\n").expect("a file");
    let keys = "switches = \"05\"\ngsd = \"own.gsd\"\nshaft = \"playback:file=trip.csv\"";
    let source = SCENARIO.replace("switches = \"05\"", keys);
    let holds = format!(
        "{source}[[expect]]\nat = 1.1\nencoder = \"crane.hoist\"\nexchanging = true\nposition = 131072\n\
         diagnosis = {{ octet = 5, bit = 0 }}\n"
    );
    // Octets 5 and 6 of a diagnosis are the ident number: 47h, 11h.
    let ended = scenario(&["run", "--virtual"], &file(&folder, &holds));
    assert_eq!(ended.status, Some(0), "{ended:?}");
    assert_eq!(scenario(&["check"], &file(&folder, &holds)).status, Some(0));
    let mut running = Program::start(program().arg("run").arg(file(&folder, &source)));
    running.wait_for(&["ready"]);
    let port = running.wait_for(&["crane: /dev/pts/"]);
    let mut master = Master::new(Terminal::open(std::path::Path::new(&port["crane: ".len()..]), 500_000), 5);
    assert_eq!(master.diagnosis().octets(5..=6), [0x47, 0x11]);
    running.end();
    for missing in ["own.gsd", "trip.csv"] {
        std::fs::remove_file(folder.path().join(missing)).expect("a file");
        let ended = scenario(&["check"], &file(&folder, &holds));
        assert_eq!(ended.status, Some(2), "{ended:?}");
        assert!(ended.errors.contains(missing) && ended.errors.contains("hint: "), "{}", ended.errors);
    }
}

/// Telegrams of a service in a capture.
fn in_capture(path: &std::path::Path, service: &str) -> Vec<Value> {
    let ended = end_of(program().args(["decode", "--json", "--service", service]).arg(path));
    ended.output.lines().map(|line| serde_json::from_str(line).expect("a document")).collect()
}

#[test]
fn a_scenario_that_is_played_can_be_steered_and_captured() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = SCENARIO.replace("event = \"warning_raised\"", "event = \"alarm_raised\"");
    let path = file(&folder, format!("duration = 60\n{text}"));
    let capture = folder.path().join("bus.pcapng");
    let mut command = program();
    command.args(["scenario", "run", "--events", "--speed", "2", "--control", "tcp:127.0.0.1:0"]);
    let mut running = Program::start(
        command.arg("--capture").arg(&capture).arg(&path).stderr(std::process::Stdio::piped()),
    );
    running.wait_for(&["crane.hoist: warning: battery"]);
    // Where it is, it says on standard error, which is read at the end: the port is found by its file.
    let id = running.id();
    let address = listening(id);
    let ctl = |arguments: &[&str]| end_of(program().arg("ctl").arg(&address).args(arguments));
    assert_eq!(ctl(&["supply", "8.5", "--encoder", "crane.hoist"]).status, Some(0));
    running.wait_for(&["crane.hoist: alarm: supply voltage"]);
    assert_eq!(ctl(&["shutdown"]).status, Some(0));
    let ended = running.ended();
    // It was ended before its time, which makes it none that holds.
    assert_eq!(ended.status, Some(1), "{ended:?}");
    assert!(ended.errors.contains(&format!("control: {address}")), "{}", ended.errors);
    assert!(ended.errors.contains("it was ended before its time"), "{}", ended.errors);
    assert!(in_capture(&capture, "Data_Exchange").len() > 10);
}

/// The TCP port that a process listens on, from the system.
fn listening(id: u32) -> String {
    let sockets: Vec<String> = std::fs::read_dir(format!("/proc/{id}/fd"))
        .expect("a process")
        .filter_map(|entry| std::fs::read_link(entry.ok()?.path()).ok()?.to_str().map(str::to_owned))
        .filter_map(|link| Some(link.strip_prefix("socket:[")?.strip_suffix(']')?.to_owned()))
        .collect();
    let table = std::fs::read_to_string("/proc/net/tcp").expect("a table");
    let port = table.lines().skip(1).find_map(|line| {
        let fields: Vec<_> = line.split_whitespace().collect();
        let ours = fields[3] == "0A" && sockets.iter().any(|inode| inode == fields[9]);
        ours.then(|| u16::from_str_radix(fields[1].rsplit(':').next()?, 16).ok()).flatten()
    });
    format!("tcp:127.0.0.1:{}", port.expect("it listens"))
}

#[test]
fn a_capture_of_virtual_time_has_a_file_for_each_segment_and_the_times_of_the_scenario() {
    let folder = tempfile::tempdir().expect("a folder");
    let two = SCENARIO.replace("[[event]]", "[[segment]]\nname = \"rig\"\n[[segment.encoder]]\nname = \"drum\"\nswitches = \"07\"\n[segment.master]\nstart = \"0.5 s\"\n[[segment.master.poll]]\nencoder = \"drum\"\n[[event]]");
    let path = file(&folder, two);
    let capture = folder.path().join("bus.pcapng");
    let arguments = ["run", "--virtual", "--capture", capture.to_str().expect("text")];
    let ended = scenario(&arguments, &path);
    assert_eq!(ended.status, Some(0), "{ended:?}");
    assert!(!capture.exists());
    for (name, first) in [("bus-crane.pcapng", 0), ("bus-rig.pcapng", 500_000_000)] {
        let packets = in_capture(&folder.path().join(name), "Set_Prm");
        let nanos = packets[0]["nanos"].as_u64().expect("a time");
        // Within the first cycle of 10 ms of its master.
        assert!((first..first + 10_000_000).contains(&nanos), "{name}: {nanos}");
    }
    let both = [&arguments[..], &["--control", "tcp:127.0.0.1:0"]].concat();
    let ended = scenario(&both, &path);
    assert_eq!(ended.status, Some(2), "{ended:?}");
    assert!(ended.errors.contains("leave one of them out"), "{}", ended.errors);
}

#[test]
fn run_file_captures_what_your_master_says() {
    let folder = tempfile::tempdir().expect("a folder");
    let capture = folder.path().join("bus.pcapng");
    let control = folder.path().join("control");
    let mut command = program();
    command
        .arg("run")
        .arg(file(&folder, SCENARIO))
        .arg("--capture")
        .arg(&capture)
        .arg("--control")
        .arg(&control);
    let mut running = Program::start(&mut command);
    running.wait_for(&["ready"]);
    running.wait_for(&["control: ", control.to_str().expect("text")]);
    let port = running.wait_for(&["crane: /dev/pts/"]);
    let mut master = Master::new(Terminal::open(std::path::Path::new(&port["crane: ".len()..]), 500_000), 5);
    assert_eq!(master.diagnosis().octet(8), 0);
    let ended =
        end_of(program().arg("ctl").arg(&control).args(["supply", "8.5", "--encoder", "crane.hoist"]));
    assert_eq!(ended.status, Some(0), "{ended:?}");
    assert_eq!(master.diagnosis().octet(8), 2);
    assert_eq!(running.end_with(Signal::INT).code(), Some(0));
    let diagnoses = in_capture(&capture, "Slave_Diag");
    assert!(diagnoses.len() >= 4, "{diagnoses:?}");
}

#[test]
fn a_file_goes_with_no_other_option_of_run_but_control_and_capture() {
    let folder = tempfile::tempdir().expect("a folder");
    let ended = end_of(program().arg("run").arg(file(&folder, SCENARIO)).args(["--switches", "05"]));
    assert_eq!(ended.status, Some(2), "{ended:?}");
    assert!(ended.errors.contains("--switches"), "{}", ended.errors);
}
