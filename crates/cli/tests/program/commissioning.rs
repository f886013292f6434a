//! `sch108bex master` against `sch108bex run`.

use std::process::Command;

use serde_json::Value;

use crate::driver::{Ended, Program, end_of, program, run};

/// 12345678h
const SHAFT: &str = "still@305419896";
/// Octets 8 on of Set_Prm for Scancon 2.0, 16 and 15 bits, not scaled (manual 4.1).
const SCANCON: &str = "00 02 00010000 80000000 0000000000000000 01";
const INPUTS: &str = "12 34 56 78 00 00 00 00 00 00 00 00";

/// The command with its port; replies have time enough for a busy computer.
fn master(bus: &str, arguments: &[&str]) -> Command {
    let mut command = program();
    command.args(["master", "--port", bus, "--reply-within", "300"]).args(arguments);
    command
}

fn bus(program: &mut Program) -> String {
    program.bus().to_str().expect("text").to_owned()
}

#[track_caller]
fn good(bus: &str, arguments: &[&str]) -> String {
    let Ended { status, output, errors } = end_of(&mut master(bus, arguments));
    assert_eq!((status, errors.as_str()), (Some(0), ""), "{arguments:?}: {output}");
    output
}

#[track_caller]
fn document(bus: &str, arguments: &[&str]) -> Value {
    let output = good(bus, &[&["--json"], arguments].concat());
    serde_json::from_str(&output).expect("a document")
}

#[track_caller]
fn bad(bus: &str, arguments: &[&str], due: i32, words: &[&str]) {
    let Ended { status, output, errors } = end_of(&mut master(bus, arguments));
    assert_eq!((status, output.as_str()), (Some(due), ""), "{arguments:?}: {errors}");
    for words in words {
        assert!(errors.contains(words), "{arguments:?}: no `{words}` in {errors}");
    }
}

#[test]
fn a_new_encoder_is_found_gets_an_address_and_is_read() {
    let mut encoder = run(["--shaft", SHAFT]);
    let bus = bus(&mut encoder);
    // A live list waits for 126 addresses.
    let quick = ["--reply-within", "40"];
    let mut list = program();
    let found = end_of(list.args(["master", "--port", &bus]).args(quick).arg("live-list"));
    assert_eq!((found.status, found.output.trim()), (Some(0), "126  slave"), "{}", found.errors);
    assert_eq!(good(&bus, &["--address", "126", "set-address", "5"]), "station 126 is at address 5 now");
    assert_eq!(document(&bus, &["--address", "5", "status"])["station"], "slave");
    bad(&bus, &["--address", "126", "status"], 1, &["nobody answers at address 126"]);

    let diagnosis = good(&bus, &["--address", "5", "diag"]);
    assert!(diagnosis.starts_with("02 05 00 FF 10 8B 0A 00 00 02 00 01 00 00 80 00"), "{diagnosis}");
    assert!(diagnosis.contains("Prm_Req = 1  parameters are needed"), "{diagnosis}");
    assert!(!diagnosis.contains("Sync_Mode"), "bits that say nothing: {diagnosis}");
    assert_eq!(document(&bus, &["--address", "5", "get-cfg"])["octets"], "D1");
    bad(&bus, &["--address", "5", "read-inputs"], 1, &["refuses RD_Inp: RS", "exchanges no data"]);

    let exchanged =
        good(&bus, &["--address", "5", "run", "--prm", SCANCON, "--cfg", "F1 D1 D1", "--seconds", "0.3"]);
    for claim in ["station 5 answers", "has taken parameters and configuration", INPUTS, "retries"] {
        assert!(exchanged.contains(claim), "no `{claim}` in {exchanged}");
    }
    encoder.wait_for(&["data exchange with master 2 begins"]);
    // It is left free.
    assert_eq!(document(&bus, &["--address", "5", "diag"])["octets"].as_str().expect("hex")[9..11], *"FF");
    encoder.end();
}

#[test]
fn a_gsd_file_says_how_to_talk_to_it() {
    let gsd = concat!(env!("CARGO_MANIFEST_DIR"), "/../../gsd/sch108bex-16x15.gsd");
    let mut encoder = run(["--switches", "05", "--shaft", SHAFT]);
    let bus = bus(&mut encoder);
    let module = ["--address", "5", "--json", "run", "--gsd", gsd, "--module", "Class 2 Multiturn"];
    // Without scaling; then 4096 units a turn: 12345678h / 16.
    for (set, due) in [
        (&[][..], "12 34 56 78"),
        (
            &[
                "--set",
                "Scaling function control=1",
                "--set",
                "Measuring units per revolution=4096",
                "--set",
                "Total measuring range=134217728",
            ],
            "01 23 45 67",
        ),
    ] {
        let lines =
            good(&bus, &[&module[..], set, &["--seconds", "0.2", "--outputs", "00 00 00 00"]].concat());
        let lines: Vec<Value> =
            lines.lines().map(|line| serde_json::from_str(line).expect("a document")).collect();
        assert!(lines.iter().any(|line| line["inputs"] == due), "{lines:?}");
        let last = lines.last().expect("a summary");
        assert!(last["exchanges"].as_u64() > Some(1) && last["cycle_us"]["mean"].is_u64(), "{last}");
    }
    bad(&bus, &["--address", "5", "run", "--gsd", gsd], 1, &["3 modules", "\"Scancon 2.0 Multiturn\""]);
    let wrong = [&module[..], &["--set", "Scaling function control=2"]].concat();
    bad(&bus, &wrong, 1, &["cannot be 2: it takes 0"]);
    encoder.end();
}

#[test]
fn what_a_station_refuses_is_explained() {
    let mut encoder = run(["--switches", "05"]);
    let bus = bus(&mut encoder);
    for (prm, cfg, words) in
        [("00 F0", "D1", "refuses the parameters"), ("00 00", "10", "refuses the configuration")]
    {
        let arguments = ["--address", "5", "run", "--prm", prm, "--cfg", cfg];
        let Ended { status, errors, .. } = end_of(&mut master(&bus, &arguments));
        assert_eq!(status, Some(1), "{errors}");
        assert!(errors.contains(words) && errors.contains("Fault = 1"), "{errors}");
    }
    let ident = ["--address", "5", "run", "--prm", "00 00", "--cfg", "D1", "--ident", "0x4711"];
    bad(&bus, &ident, 1, &["ident number 108B, but the parameters are for 4711"]);
    bad(&bus, &["--address", "5", "set-address", "6"], 1, &["refuses Set_Slave_Add: RS", "switches"]);
    encoder.end();
}

#[test]
fn the_only_station_needs_no_address_and_several_are_listed() {
    let mut encoders = run(["--switches", "05", "--encoder", "switches=07"]);
    let bus = bus(&mut encoders);
    let mut command = program();
    command.args(["master", "--port", &bus, "--reply-within", "40", "diag"]);
    let Ended { status, errors, .. } = end_of(&mut command);
    assert_eq!(status, Some(1));
    assert!(errors.contains("several stations, at 5, 7; choose one with --address"), "{errors}");
    bad(&bus, &["--address", "5", "set-address", "7"], 1, &["there is a station at address 7 already"]);
    bad(&bus, &["--address", "5", "set-address", "5"], 1, &["at that address already"]);
    encoders.end();
}

#[test]
fn it_works_over_sockets_too() {
    let directory = tempfile::tempdir().expect("a directory");
    let socket = format!("unix:{}", directory.path().join("bus").display());
    for port in ["tcp-listen:127.0.0.1:0", &socket] {
        let mut encoder = run(["--switches", "05", "--shaft", SHAFT, "--port", port]);
        let bus = encoder.wait_for(&["bus: "])["bus: ".len()..].to_owned();
        let arguments = ["--address", "5", "run", "--prm", SCANCON, "--cfg", "F1 D1 D1", "--seconds", "0.3"];
        let output = good(&bus, &arguments);
        assert!(output.contains(INPUTS), "{output}");
        assert_eq!(document(&bus, &["--address", "5", "get-cfg"])["octets"], "F1 D1 D1");
        encoder.end();
    }
}

#[test]
fn a_master_can_wait_for_its_slaves() {
    let mut waiting = program();
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = listener.local_addr().expect("an address").port();
    drop(listener);
    let here = format!("tcp-listen:127.0.0.1:{port}");
    waiting.args([
        "master",
        "--port",
        &here,
        "--address",
        "5",
        "--reply-within",
        "300",
        "--wait",
        "10",
        "status",
    ]);
    let waiting = std::thread::spawn(move || end_of(&mut waiting));
    let there = format!("tcp:127.0.0.1:{port}");
    let encoder = run(["--switches", "05", "--port", &there]);
    let Ended { status, output, errors } = waiting.join().expect("it ends");
    assert_eq!((status, output.as_str()), (Some(0), "station 5: slave"), "{errors}");
    encoder.end();
    let mut alone = program();
    alone.args(["master", "--port", "tcp-listen:127.0.0.1:0", "--wait", "0", "live-list"]);
    let Ended { status, errors, .. } = end_of(&mut alone);
    assert_eq!(status, Some(1));
    assert!(errors.contains("nobody has connected") && errors.contains("--wait"), "{errors}");
    // Any port that is free is told, or nobody could connect.
    let here =
        errors.lines().find_map(|line| line.strip_prefix("waiting for the slave's side at tcp:127.0.0.1:"));
    assert!(here.is_some_and(|port| port.parse::<u16>().is_ok_and(|port| port > 0)), "{errors}");
}

#[test]
fn wrong_arguments_are_sentences() {
    for (arguments, words) in [
        (&["status"][..], "--port"),
        (&["--port", "pty", "--address", "127", "status"], "from 0 to 126"),
        (&["--port", "nowhere", "status"], "write pty"),
        (&["--port", "/dev/null", "--baud", "auto", "status"], "has to know its rate"),
        (&["--port", "/dev/null", "--baud", "115200", "status"], "PROFIBUS has these rates"),
        (&["--port", "/dev/null", "--address", "2", "status"], "--master-address"),
        (&["--port", "/dev/null", "set-address", "127"], "from 0 to 126"),
        (&["--port", "/dev/null", "run", "--units", "360"], "--range"),
        (&["--port", "/dev/null", "run", "--class", "2", "--gsd", "x"], "cannot be used with"),
        (&["--port", "pty", "status"], "nobody is behind"),
        (&["--port", "/dev/null", "run", "--prm", "00"], "--cfg"),
        (&["--port", "/dev/null", "run", "--prm", "0", "--cfg", "D1"], "two digits"),
        (&["--port", "/dev/null", "run", "--prm", "00", "--cfg", "40", "--outputs", "00"], "cut off"),
        (
            &["--port", "/dev/null", "run", "--prm", "00", "--cfg", "F1", "--outputs", "00"],
            "configuration has 4",
        ),
        (&["--port", "/dev/null", "run", "--prm", "00", "--cfg", "D1", "--seconds", "0"], "0.1 and 86400"),
        (&["--port", "/dev/null", "run", "--gsd", "x", "--set", "=1"], "a parameter's name"),
    ] {
        let Ended { status, output, errors } = end_of(program().arg("master").args(arguments));
        assert_eq!((status, output.as_str()), (Some(2), ""), "{arguments:?}: {errors}");
        assert!(errors.contains(words), "{arguments:?}: no `{words}` in {errors}");
    }
    for (port, words) in [("/dev/null", "/dev/null"), ("unix:/nowhere", "nowhere")] {
        let mut command = program();
        let Ended { status, errors, .. } =
            end_of(command.args(["master", "--port", port, "--wait", "0", "status"]));
        assert_eq!(status, Some(1), "{port}: {errors}");
        assert!(errors.contains(words), "{errors}");
    }
}
