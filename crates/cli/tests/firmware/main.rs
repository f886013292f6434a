//! The firmware in an emulator as one more station for the program's commands, and for a master that others wrote.

#[path = "../tools/mod.rs"]
mod tools;

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use bus::PortAddress;
use emulated_board::{Beginning, Board, Bridge, Live, Setup};
use plant::control::{Server, Subscriptions};
use serde_json::Value;

/// 12345678h: where the shafts stand.
const RAW: &str = "still@305419896";

/// A board at address 5 whose time goes on.
fn live([program, image]: [PathBuf; 2]) -> Live {
    let board = Board::start(&Setup { program, image, bus: None }).expect("an emulated board");
    let beginning = Beginning { switches: "05".into(), bits: "16x15".into(), shaft: RAW.into() };
    Live::start(board, &beginning).expect("a board that runs")
}

fn unix_port(live: &Live) -> String {
    format!("unix:{}", live.bus().display())
}

fn text(octets: &[u8]) -> String {
    String::from_utf8_lossy(octets).into_owned()
}

/// At most so long, whatever happens.
fn ran(program: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new("timeout");
    command.args(["-k", "2", "120"]).arg(program).args(arguments).stdin(Stdio::null());
    command.output().expect("the program runs")
}

fn sch108bex(arguments: &[&str]) -> Output {
    ran(Path::new(env!("CARGO_BIN_EXE_sch108bex")), arguments)
}

// By the manual's octets (4.1, 4.3): the position first, no velocity while the shaft stands.
#[test]
fn profirust_exchanges_data_in_all_functionalities() {
    let test = "firmware::profirust_exchanges_data_in_all_functionalities";
    let Some(tools) = tools::firmware(test) else { return };
    let live = live(tools);
    let port = unix_port(&live);
    let class_2 = "00 02 00010000 80000000 0000000000000000";
    let scancon = format!("{class_2} 01");
    for (prm, cfg, inputs) in [
        ("00 00", "D1", "inputs 12 34 56 78"),
        (class_2, "F1", "inputs 12 34 56 78"),
        (&scancon, "F1 D1 D1", "inputs 12 34 56 78 00 00 00 00 00 00 00 00"),
    ] {
        let master = ["master", "--port", &port, "--address", "5", "--reply-within", "1000", "run"];
        let given = ["--prm", prm, "--cfg", cfg, "--seconds", "1"];
        let ended = sch108bex(&[&master[..], &given].concat());
        let output = text(&ended.stdout);
        assert_eq!(ended.status.code(), Some(0), "{cfg}: {output}{}", text(&ended.stderr));
        assert!(output.lines().any(|line| line.contains(inputs)), "{cfg}: {output}");
    }
    assert_eq!(live.broken(), None);
}

#[test]
fn pyprofibus_exchanges_data_in_all_functionalities_over_a_pseudo_terminal() {
    let test = "firmware::pyprofibus_exchanges_data_in_all_functionalities_over_a_pseudo_terminal";
    let (Some(tools), Some(python)) = (tools::firmware(test), tools::python(test)) else { return };
    let live = live(tools);
    let bridge = Bridge::start(&PortAddress::Pty, &live.bus()).expect("a bridge");
    for (script, functionality, inputs) in [
        ("class_1.py", "class1", "12345678"),
        ("data_exchange.py", "class2", "12345678"),
        ("data_exchange.py", "scancon", "123456780000000000000000"),
    ] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers").join(script);
        let path = path.to_str().expect("text");
        let arguments = ["-B", path, bridge.name(), "--timeout", "60", "--functionality", functionality];
        let ended = ran(&python, &[&arguments[..], &["--address", "5", "--cycles", "10"]].concat());
        let output = text(&ended.stdout);
        assert_eq!(ended.status.code(), Some(0), "{functionality}: {output}{}", text(&ended.stderr));
        let facts: Vec<Value> =
            output.lines().map(|line| serde_json::from_str(line).expect("a fact")).collect();
        let seen: Vec<_> = facts.iter().filter(|fact| fact["fact"] == "inputs").collect();
        assert_eq!(seen.len(), 10, "{output}");
        assert!(seen.iter().all(|fact| fact["octets"] == inputs), "{output}");
    }
    assert_eq!(live.broken(), None);
}

/// Some cases of each file, with power, world and faults by the control socket; all of them are played by the tests
/// of `emulated-board`, with the clock in hand.
#[test]
fn the_command_checks_it_with_all_its_controls() {
    const CASES: &str = "1,2,3,6,13,18,25,N014,47,66,72,85,105,117,123,127,143,154,187,E001,E003,E010,E040,131,E050,\
                         E070,E077,E090,E096,E100";
    let test = "firmware::the_command_checks_it_with_all_its_controls";
    let Some(tools) = tools::firmware(test) else { return };
    let live = live(tools);
    let folder = tempfile::tempdir().expect("a folder");
    let control = folder.path().join("control");
    let control = control.to_str().expect("text");
    let address = control.parse().expect("an address");
    let _server = Server::start(&address, live.clone(), Subscriptions::new(), || ()).expect("a server");
    let port = unix_port(&live);
    let arguments = ["conformance", "--port", &port, "--control", control, "--hears-idle", "--json"];
    let ended = sch108bex(&[&arguments[..], &["--case", CASES]].concat());
    let document: Value = serde_json::from_slice(&ended.stdout).expect("one JSON document");
    let cases = document["cases"].as_array().expect("a list");
    let failed: Vec<_> = cases.iter().filter(|case| case["result"] == "fail").collect();
    assert!(failed.is_empty(), "{failed:#?}");
    let passed = cases.iter().filter(|case| case["result"] == "pass").count();
    assert_eq!(passed, CASES.split(',').count(), "{cases:#?}");
}

#[test]
fn what_a_board_cannot_do_is_told() {
    let Some(tools) = tools::firmware("firmware::what_a_board_cannot_do_is_told") else { return };
    let live = live(tools);
    let folder = tempfile::tempdir().expect("a folder");
    let control = folder.path().join("control");
    let control = control.to_str().expect("text");
    let address = control.parse().expect("an address");
    let _server = Server::start(&address, live, Subscriptions::new(), || ()).expect("a server");
    let ended = sch108bex(&["ctl", control, "supply", "8.5"]);
    assert_eq!(ended.status.code(), Some(0), "{}", text(&ended.stderr));
    let ended = sch108bex(&["ctl", control, "raw", r#"{"do":"lose_replies","count":2}"#]);
    assert_eq!(ended.status.code(), Some(1));
    let told = text(&ended.stdout) + &text(&ended.stderr);
    assert!(told.contains("lose_replies is nothing that an emulated board can do"), "{told}");
}
