//! `run --control` and `ctl`, from a shell and as docs/control.md has them.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

use serde_json::Value;

use crate::driver::{Ended, Program, end_of, program, run};
use crate::master::{SCANCON, SILENCE, status, status_answer};

/// A program that takes requests at `control` in a directory that goes with it.
struct Controlled {
    program: Program,
    directory: tempfile::TempDir,
}

fn controlled(arguments: &[&str]) -> Controlled {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path().join("control");
    let path = path.to_str().expect("text");
    let program = run([&["--control", path], arguments].concat());
    Controlled { program, directory }
}

impl Controlled {
    fn path(&self) -> std::path::PathBuf {
        self.directory.path().join("control")
    }

    fn ctl(&self, arguments: &[&str]) -> Ended {
        ctl(self.path(), arguments)
    }

    /// What `ctl` prints, when it goes well.
    #[track_caller]
    fn done(&self, arguments: &[&str]) -> String {
        let ended = self.ctl(arguments);
        assert_eq!((ended.status, ended.errors.as_str()), (Some(0), ""), "{arguments:?}");
        ended.output
    }

    /// Everything as JSON has it.
    fn snapshot(&self) -> Value {
        let reply: Value = serde_json::from_str(&self.done(&["snapshot", "--json"])).expect("JSON");
        reply["snapshot"].clone()
    }
}

fn ctl(path: impl AsRef<std::ffi::OsStr>, arguments: &[&str]) -> Ended {
    end_of(program().arg("ctl").arg(path.as_ref()).args(arguments))
}

// Octet 8 bit 1 of the diagnosis (manual 4.2.2).
#[test]
fn a_supply_of_8_5_v_is_an_alarm_on_the_bus() {
    let mut controlled = controlled(&["--switches", "05"]);
    let mut master = controlled.program.master(5);
    assert_eq!(master.diagnosis().octet(8), 0x00);
    assert_eq!(controlled.done(&["supply", "8.5"]), "");
    assert_eq!(master.diagnosis().octet(8), 0x02);
    controlled.program.wait_for(&["encoder: alarm: supply voltage"]);
    assert_eq!(controlled.done(&["supply", "-24"]), "");
    assert!(master.terminal.is_silent(&status(5)));
    controlled.program.end();
}

#[test]
fn a_position_error_shows_in_data_exchange_and_a_power_cycle_clears_it() {
    let mut controlled = controlled(&["--switches", "05", "--shaft", "still@1000"]);
    let mut master = controlled.program.master(5);
    master.start_up(SCANCON, &[0xF1, 0xD1, 0xD1]);
    assert_eq!(master.position(), 1_000);
    controlled.done(&["sensor", "once"]);
    // Stat_Diag is octet 2 bit 1; the alarm is octet 8 bit 0.
    let diagnosis = master.diagnosis();
    assert_eq!((diagnosis.octet(2) & 0x02, diagnosis.octet(8)), (0x02, 0x01));
    controlled.done(&["power", "cycle"]);
    assert_eq!(master.diagnosis().octet(8), 0x00);
    controlled.program.end();
}

// Octets 28-31 are tenths of an hour (manual 4.2.13): 87600.1 h are 876001 = 0D5DE1h. The warning is bit
// 4 of octets 20-21, strictly above 87600 h (manual 4.2.9).
#[test]
fn an_encoder_of_ten_years_warns_on_the_bus() {
    let mut controlled = controlled(&["--switches", "05"]);
    let mut master = controlled.program.master(5);
    for (hours, warnings, tenths) in
        [("87600", [0x00, 0x00], [0, 0x0D, 0x5D, 0xE0]), ("87600.1", [0x00, 0x10], [0, 0x0D, 0x5D, 0xE1])]
    {
        controlled.done(&["power", "off"]);
        assert!(master.terminal.is_silent(&status(5)));
        controlled.done(&["operating-time", hours]);
        controlled.done(&["power", "on"]);
        let diagnosis = master.start_up(SCANCON, &[0xF1, 0xD1, 0xD1]);
        assert_eq!(diagnosis.octets(20..=21), warnings);
        assert_eq!(diagnosis.octets(28..=31), tenths);
    }
    controlled.program.end();
}

#[test]
fn telegrams_are_lost_and_damaged_as_asked() {
    let mut controlled = controlled(&["--switches", "05"]);
    let terminal = controlled.program.terminal();
    assert_eq!(terminal.ask(&status(5)), status_answer(5));
    controlled.done(&["lose-replies", "2"]);
    assert!(terminal.is_silent(&status(5)) && terminal.is_silent(&status(5)));
    controlled.done(&["character-error", "3"]);
    assert!(terminal.is_silent(&status(5)));
    // FDL status of 5 to 2, its third octet with the highest bit flipped.
    controlled.done(&["damage-reply", "3", "80"]);
    terminal.send(&status(5));
    assert_eq!(terminal.answer(Duration::from_secs(5)), [0x10, 0x02, 0x85, 0x00, 0x07, 0x16]);
    controlled.done(&["line", "seed=3", "lost_requests=1"]);
    assert!(terminal.is_silent(&status(5)));
    controlled.done(&["line", "off"]);
    assert_eq!(terminal.ask(&status(5)), status_answer(5));
    assert_eq!(controlled.snapshot()["segments"][0]["faults"]["lost_replies"], 2);
    assert!(SILENCE > Duration::ZERO);
    controlled.program.end();
}

#[test]
fn a_state_file_that_is_damaged_while_it_runs_is_the_encoders_to_deal_with() {
    let directory = tempfile::tempdir().expect("a directory");
    let state = directory.path().join("state");
    let mut controlled = controlled(&["--switches", "05", "--state", state.to_str().expect("text")]);
    let mut master = controlled.program.master(5);
    controlled.done(&["memory", "lost_at_power_on"]);
    controlled.done(&["power", "cycle"]);
    assert_eq!(master.diagnosis().octet(8), 0x01);
    controlled.done(&["power", "cycle"]);
    assert_eq!(master.diagnosis().octet(8), 0x00);
    controlled.program.end();
}

#[test]
fn what_is_no_request_is_2_and_what_is_refused_is_1() {
    let controlled = controlled(&["--switches", "05", "--encoder", "switches=06"]);
    for (arguments, status, told) in [
        (&["supply", "volts"][..], 2, "invalid value"),
        (&["supply", "inf"], 2, "write a number like 8.5"),
        (&["supply", "500"], 2, "from -100 to 100"),
        (&["power", "maybe"], 2, "off, on, cycle"),
        (&["explode"], 2, "`sch108bex ctl --help` lists"),
        (&["shaft", "turning"], 2, "write still@RAW"),
        (&["switches", "5"], 2, "two hexadecimal digits"),
        (&["line"], 2, "required"),
        (&["line", "lost_replies"], 2, "NAME=VALUE"),
        (&["line", "lost_replies=x"], 2, "the value is no number"),
        (&["line", "lost_replies=2"], 2, "from 0 to 1"),
        (&["line", "loss=1"], 2, "expected one of"),
        (&["line", "do=1"], 2, "cannot be given here"),
        (&["lose-replies", "0"], 2, "from 1 to 1000"),
        (&["lose-replies", "--encoder", "1"], 2, "leave it out"),
        (&["damage-reply", "1", "G0"], 2, "two hexadecimal digits"),
        (&["brown-out", "8"], 2, "<SECONDS>"),
        (&["brown-out", "8", "0"], 2, "for_s is a number from 0.001"),
        (&["supply-profile", "0:24", "24"], 2, "\"24\" is no SECONDS:VOLTS; write for example 0:24 2:24"),
        (&["supply-profile", "1:24", "0:24"], 2, "no point is earlier"),
        (&["supply-profile"], 2, "required"),
        (&["thermal", "400"], 2, "ambient is a number from -300 to 300"),
        (&["thermal", "40", "--watts", "-1"], 2, "watts is a number from 0 to 1000"),
        (&["led-ageing", "-1"], 2, "hours is a number from 0"),
        (&["discharge", "0"], 2, "hours_without_power is a number"),
        (&["discharge", "1", "--charge", "101"], 2, "charge is a number from 0 to 100"),
        (&["endurance", "many"], 2, "write one like 100000, or any"),
        (&["units", "per_turn"], 2, "is no NAME=VALUE"),
        (&["units", "per_turn=0"], 2, "per_turn is a number, and not 0"),
        (&["units", "per_turn=1", "per_turn=2"], 2, "not twice"),
        (&["units", "per_turn=1", "lines=2"], 2, "missing field"),
        (&["units", "per_turn=x"], 2, "the value is no number"),
        (&["units", "colour=1"], 2, "unknown field `colour`"),
        (&["termination", "maybe"], 2, "on, off, one"),
        (&["cut", "128"], 2, "from 0 to 127"),
        (&["cut", "1", "--encoder", "1"], 2, "cut is not about an encoder; leave it out"),
        (&["supply", "24", "--segment", "bus"], 2, "supply is not about a segment; leave it out"),
        (&["shutdown", "--segment", "bus"], 2, "leave it out"),
        (&["mend", "--segment", "rig"], 1, "there is no segment \"rig\""),
        (&["raw", "hello"], 2, "write one on each line"),
        (&["raw", r#"{"do":"supply"}"#], 2, "write for example"),
        (&["raw", r#"{"do":"help"}"#, "--encoder", "1"], 2, "in the request"),
        (&["supply", "24"], 1, "there are several"),
        (&["supply", "24", "--encoder", "7"], 1, "there is no encoder 7"),
        (&["shaft", "still@2147483648", "--encoder", "1"], 1, "0 to 2147483647"),
        (&["operating-time", "1", "--encoder", "1"], 1, "switch it off first"),
    ] {
        let ended = controlled.ctl(arguments);
        assert_eq!(ended.status, Some(status), "{arguments:?}: {}", ended.errors);
        assert!(ended.errors.contains(told), "{arguments:?}: {}", ended.errors);
        assert_eq!(ended.output, "", "{arguments:?}");
    }
    let nobody = ctl(controlled.directory.path().join("nobody"), &["snapshot"]);
    assert_eq!(nobody.status, Some(1));
    assert!(nobody.errors.contains("start `sch108bex run --control"), "{}", nobody.errors);
    controlled.program.end();
}

#[test]
fn a_tcp_port_of_this_computer_takes_what_a_socket_takes() {
    let mut running = run(["--switches", "05", "--control", "tcp:127.0.0.1:0"]);
    let address = running.wait_for(&["control: tcp:127.0.0.1:"])["control: ".len()..].to_owned();
    let mut master = running.master(5);
    assert_eq!(ctl(&address, &["supply", "8.5"]).status, Some(0));
    assert_eq!(master.diagnosis().octet(8), 0x02);
    let mut stream = TcpStream::connect(&address["tcp:".len()..]).expect("a server");
    let page = b"POST / HTTP/1.1\r\n\r\n{\"do\":\"supply\",\"volts\":24}\n";
    stream.write_all(page).expect("it reads");
    let mut told = String::new();
    std::io::Read::read_to_string(&mut stream, &mut told).expect("it ends");
    assert!(told.contains("here is no web server"), "{told}");
    assert_eq!(master.diagnosis().octet(8), 0x02);
    let taken = end_of(program().args(["run", "--control", &address]));
    assert_eq!(taken.status, Some(1));
    assert!(taken.errors.contains("another program listens there"), "{}", taken.errors);
    assert_eq!(ctl(&address, &["shutdown"]).status, Some(0));
    assert_eq!(running.ended().status, Some(0));
    let nobody = ctl(&address, &["snapshot"]);
    assert_eq!(nobody.status, Some(1));
    assert!(nobody.errors.contains("start `sch108bex run --control tcp:127.0.0.1:0`"), "{}", nobody.errors);
    let elsewhere = ctl("tcp:192.0.2.1:4000", &["snapshot"]);
    assert_eq!(elsewhere.status, Some(2));
    assert!(elsewhere.errors.contains("through a tunnel"), "{}", elsewhere.errors);
}

/// What each command by name does, as the snapshot has it.
#[test]
fn commands_by_name_do_what_they_say() {
    let controlled = controlled(&["--switches", "05", "--encoder", "switches=06"]);
    let encoder = |number: usize, arguments: &[&str]| {
        controlled.done(&[arguments, &["--encoder", &number.to_string()]].concat());
        controlled.snapshot()["encoders"][number - 1].clone()
    };
    assert_eq!(encoder(1, &["supply-profile", "0:23", "0:22.5"])["volts"], 22.5);
    assert_eq!(encoder(1, &["brown-out", "8", "1000"])["volts"], 8.0);
    assert_eq!(encoder(1, &["supply", "24"])["volts"], 24.0);
    assert_eq!(encoder(1, &["led-ageing", "0"])["light"], "low");
    assert_eq!(encoder(1, &["discharge", "1", "--charge", "0"])["battery"], "empty");
    assert_eq!(encoder(1, &["discharge", "1", "--charge", "19"])["battery"], "low");
    assert_eq!(encoder(1, &["discharge", "1", "--charge", "19", "--low", "18"])["battery"], "ok");
    assert_eq!(encoder(1, &["endurance", "7"])["injected"]["endurance"], 7);
    assert_eq!(encoder(1, &["endurance", "any"])["injected"]["endurance"], Value::Null);
    assert_eq!(encoder(1, &["memory", "torn_write"])["injected"]["torn_write"], true);
    assert_eq!(encoder(1, &["memory", "off"])["injected"]["torn_write"], false);
    encoder(1, &["shaft", "still@98304"]);
    // One and a half turns, half a metre each; and from the middle of the first turn on.
    assert_eq!(encoder(1, &["units", "unit=m", "per_turn=0.5"])["machine"]["position"], 0.75);
    assert_eq!(encoder(1, &["units", "per_turn=0.5", "zero=32768"])["machine"]["position"], 0.5);
    let drum = ["units", "drum_diameter=0.76", "rope_diameter=0.035", "turns_per_layer=37"];
    assert_eq!(encoder(1, &drum)["machine"]["rope_layer"], 1);
    assert_eq!(encoder(1, &["units", "off"])["machine"], Value::Null);
    // Two encoders behind the master: the last one terminates the bus (manual 3.3).
    let segment = || controlled.snapshot()["segments"][0].clone();
    assert_eq!(segment()["termination"], serde_json::json!([]));
    for state in ["off", "one"] {
        encoder(2, &["termination", state]);
        assert_eq!(segment()["termination"].as_array().map(Vec::len), Some(1), "{state}");
    }
    controlled.done(&["reflections", "on"]);
    assert_eq!(segment()["cable"]["reflections"], true);
    controlled.done(&["reflections", "off", "--segment", "1"]);
    assert_eq!(segment()["cable"]["reflections"], false);
    encoder(2, &["termination", "on"]);
    assert_eq!(segment()["termination"], serde_json::json!([]));
    let cut_off = || {
        let encoders = controlled.snapshot()["encoders"].clone();
        [0, 1].map(|at| encoders[at]["injected"]["cut_off"] == true)
    };
    controlled.done(&["cut", "2", "--segment", "bus"]);
    assert_eq!(cut_off(), [false, true]);
    // The master is last: the first encoder is on the far side.
    controlled.done(&["cut", "1", "--master-after", "2"]);
    assert_eq!(cut_off(), [true, false]);
    controlled.done(&["mend"]);
    assert_eq!(cut_off(), [false, false]);
    // It runs after 120 degrees with a time constant of a tenth of a second.
    encoder(1, &["thermal", "120", "--time-constant", "0.1"]);
    let until = std::time::Instant::now() + Duration::from_secs(10);
    while controlled.snapshot()["encoders"][0]["celsius"].as_f64() < Some(119.0) {
        assert!(std::time::Instant::now() < until, "it does not get warm");
        std::thread::sleep(Duration::from_millis(20));
    }
    controlled.program.end();
}

#[test]
fn somebody_who_is_no_encoder_is_told_apart() {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path().join("other");
    let listener = UnixListener::bind(&path).expect("a socket");
    std::thread::spawn(move || {
        for answer in [&b""[..], b"hello\n", b"{\"ok\":1}\n", b"7\n"] {
            let (mut stream, _) = listener.accept().expect("a client");
            let _ = BufReader::new(&stream).read_line(&mut String::new());
            let _ = stream.write_all(answer);
        }
    });
    for _ in 0..4 {
        let ended = ctl(&path, &["snapshot"]);
        assert_eq!(ended.status, Some(1));
        assert!(ended.errors.contains("does not reply as"), "{}", ended.errors);
    }
}

#[test]
fn events_come_as_run_prints_them_or_in_json_until_the_end() {
    let controlled = controlled(&["--switches", "05"]);
    let start = |json: bool| {
        let mut command = program();
        command.arg("ctl").arg(controlled.path()).arg("events");
        if json {
            command.arg("--json");
        }
        Program::start(&mut command)
    };
    let (mut people, mut machines) = (start(false), start(true));
    // Until both are there.
    while people.lines_so_far() == 0 || machines.lines_so_far() == 0 {
        controlled.done(&["light", "low"]);
        controlled.done(&["light", "ok"]);
    }
    controlled.done(&["battery", "low"]);
    people.wait_for(&["encoder: warning: battery below its limit"]);
    let line = machines.wait_for(&["battery_charge"]);
    let event: Value = serde_json::from_str(&line).expect("JSON");
    assert_eq!(event["kind"], "warning_raised");
    assert_eq!(controlled.done(&["shutdown"]), "");
    let Controlled { program: mut running, directory } = controlled;
    while running.is_running() || people.is_running() || machines.is_running() {
        std::thread::sleep(Duration::from_millis(2));
    }
    assert!(!directory.path().join("control").exists());
}

#[test]
fn snapshots_and_requests_are_for_people_too() {
    let controlled = controlled(&["--switches", "05", "--encoder", "switches=06,shaft=still@7"]);
    let all = controlled.done(&["snapshot"]);
    for part in ["segment 1: bus", "encoder 1: encoder", "encoder 2: encoder 2", "address: 6", "volts: 24"] {
        assert!(all.contains(part), "{part}: {all}");
    }
    let one = controlled.done(&["snapshot", "--encoder", "encoder 2"]);
    assert!(one.contains("shaft: still@7") && !one.contains("address: 5"), "{one}");
    let requests = controlled.done(&["requests"]);
    assert!(requests.contains(r#"{"do":"power","state":"cycle"}"#), "{requests}");
    let raw = controlled.done(&["raw", "{\"do\":\n\"snapshot\",\"encoder\":1}", "--json"]);
    assert!(raw.starts_with(r#"{"ok":true,"encoder":{"name":"encoder""#), "{raw}");
    controlled.program.end();
}

#[test]
fn a_control_socket_that_cannot_be_had_is_told() {
    let first = controlled(&["--switches", "05"]);
    let path = first.path();
    let path = path.to_str().expect("text");
    for (path, status, told) in [
        (path, 1, "end the program that listens there"),
        ("", 2, "write the path of a socket, or tcp:127.0.0.1:PORT"),
        ("tcp:", 2, "write an address and a port"),
        ("tcp:0.0.0.0:4000", 2, "0.0.0.0 is no address that only this computer reaches"),
        ("tcp:192.0.2.1:0", 2, "write tcp:127.0.0.1:0, and come from elsewhere through a tunnel"),
        ("/no/such/directory/control", 1, "directory that exists"),
    ] {
        let ended = end_of(program().args(["run", "--switches", "06", "--control", path]));
        assert_eq!(ended.status, Some(status), "{path}: {}", ended.errors);
        assert!(ended.errors.contains(told), "{path}: {}", ended.errors);
    }
    first.program.end();
}

#[test]
fn a_socket_left_behind_by_kill_9_is_taken_over() {
    let mut first = controlled(&["--switches", "05"]);
    first.program.kill();
    assert!(first.path().exists());
    let path = first.path();
    let second = run(["--switches", "05", "--control", path.to_str().expect("text")]);
    assert_eq!(ctl(&path, &["light", "low"]).status, Some(0));
    second.end();
    assert!(!path.exists());
}

/// The page that explains it.
fn page() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/control.md");
    fs::read_to_string(path).expect("docs/control.md")
}

/// A line of an example that is sent, with those that come back.
struct Example {
    request: String,
    due: Vec<Value>,
}

fn examples(page: &str) -> Vec<Example> {
    let mut examples: Vec<Example> = Vec::new();
    for block in page.split("```control\n").skip(1) {
        let block = block.split("```").next().unwrap_or_default();
        for line in block.lines() {
            if let Some(request) = line.strip_prefix("> ") {
                examples.push(Example { request: request.to_owned(), due: Vec::new() });
            } else {
                let due = line.strip_prefix("< ").unwrap_or_else(|| panic!("{line}"));
                let due = serde_json::from_str(due).unwrap_or_else(|error| panic!("{line}: {error}"));
                examples.last_mut().expect("a request before").due.push(due);
            }
        }
    }
    examples
}

/// Whether what came is what the page has: all the same names, and the same values but those that count
/// time or traffic. An empty list stands for any.
#[track_caller]
fn assert_as_documented(name: &str, came: &Value, due: &Value) {
    const OTHERS: [&str; 3] = ["at_ns", "memory_writes", "port"];
    match (came, due) {
        (Value::Object(came), Value::Object(due)) => {
            let names = |object: &serde_json::Map<String, Value>| object.keys().cloned().collect::<Vec<_>>();
            assert_eq!(names(came), names(due), "{name}");
            for (name, due) in due {
                assert_as_documented(name, &came[name], due);
            }
        }
        (Value::Array(came), Value::Array(due)) => {
            if !due.is_empty() {
                assert_eq!(came.len(), due.len(), "{name}");
            }
            came.iter().zip(due).for_each(|(came, due)| assert_as_documented(name, came, due));
        }
        (Value::Number(_), Value::Number(_)) | (Value::String(_), Value::String(_))
            if OTHERS.contains(&name) => {}
        _ => assert_eq!(came, due, "{name}"),
    }
}

#[test]
fn every_example_of_the_page_does_what_the_page_says() {
    let Controlled { mut program, directory } = controlled(&["--switches", "05", "--encoder", "switches=06"]);
    let stream = UnixStream::connect(directory.path().join("control")).expect("a server");
    stream.set_read_timeout(Some(Duration::from_secs(10))).expect("a time");
    let mut reader = BufReader::new(stream);
    let examples = examples(&page());
    for Example { request, due } in &examples {
        reader.get_mut().write_all(format!("{request}\n").as_bytes()).expect("it reads");
        let mut came: Vec<Value> = due
            .iter()
            .map(|_| {
                let mut line = String::new();
                reader.read_line(&mut line).unwrap_or_else(|error| panic!("{request}: {error}"));
                serde_json::from_str(&line).unwrap_or_else(|error| panic!("{request}: {line:?}: {error}"))
            })
            .collect();
        // Events and replies come on two ways.
        came.sort_by_key(|line| line["event"].is_null());
        assert_eq!(came.len(), due.len());
        for (came, due) in came.iter().zip(due) {
            assert_as_documented(request, came, due);
        }
    }
    assert!(!program_goes_on(&mut program), "the last example ends it");
    let names: Vec<_> = plant::control::COMMANDS.iter().map(|command| command.name).collect();
    for name in names {
        let shown = examples.iter().any(|example| example.request.contains(&format!(r#""do":"{name}""#)));
        assert!(shown, "docs/control.md has no example of {name}");
    }
}

fn program_goes_on(program: &mut Program) -> bool {
    let until = std::time::Instant::now() + Duration::from_secs(10);
    while program.is_running() && std::time::Instant::now() < until {
        std::thread::sleep(Duration::from_millis(2));
    }
    program.is_running()
}

/// Each of these stands in the page's section for shells.
#[test]
fn every_command_of_the_page_is_one() {
    let controlled = controlled(&["--switches", "05", "--encoder", "switches=06"]);
    let page = page();
    let section = page.split("## From a shell").nth(1).expect("a section");
    let block = section.split("```\n").nth(1).expect("a block");
    let path = controlled.path();
    let path = path.to_str().expect("text");
    let mut count = 0;
    for line in block.lines().filter(|line| !line.contains("events")) {
        let line = line.replace("sch108bex ctl", "").replace("/tmp/control", path);
        let script = format!("\"$0\" ctl {line}");
        let ended = end_of(
            std::process::Command::new("sh")
                .args(["-c", &script, env!("CARGO_BIN_EXE_sch108bex")])
                .stdin(Stdio::null())
                .stdout(Stdio::piped())
                .stderr(Stdio::piped()),
        );
        assert_eq!(ended.status, Some(0), "{line}: {}", ended.errors);
        count += 1;
    }
    assert!(count >= 40, "{block}");
    for command in plant::control::COMMANDS {
        let by_name = format!("/tmp/control {} ", command.name.replace('_', "-"));
        let is_shown = block.lines().any(|line| format!("{line} ").contains(&by_name));
        // What a shell calls otherwise, or has no use for.
        let is_other = ["help", "subscribe", "unsubscribe"].contains(&command.name);
        assert!(is_shown || is_other, "the page does not show {} from a shell", command.name);
    }
    assert_eq!(controlled.program.ended().status, Some(0), "the last one ends it");
}
