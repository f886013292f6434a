//! A master that others wrote: pyprofibus 1.13 opens the bus as if it were a serial port.
//!
//! The scripts in `peers` write down what it sees, one fact a line; here is judged whether that is right.
//! They need a Python with the library, which `SCH108BEX_PYTHON` names.

use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::driver::{Program, end_of, run};
use crate::tools::python;

/// What a script saw.
struct Facts(Vec<Value>);

/// Runs a script against the bus of a program; it must come to its own end.
#[track_caller]
fn script(python: &Path, script: &str, program: &mut Program, arguments: &[&str]) -> Facts {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers").join(script);
    let mut command = Command::new(python);
    command.arg("-B").arg(path).arg(program.bus()).args(["--timeout", "8"]).args(arguments);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let ended = end_of(&mut command);
    assert_eq!(ended.status, Some(0), "{}\n{}", ended.output, ended.errors);
    let facts: Vec<Value> =
        ended.output.lines().map(|line| serde_json::from_str(line).expect("a fact")).collect();
    assert_eq!(facts.last().map(|fact| &fact["fact"]), Some(&"done".into()), "{}", ended.output);
    Facts(facts)
}

impl Facts {
    fn of<'a>(&'a self, kind: &'a str) -> impl Iterator<Item = &'a Value> {
        self.0.iter().filter(move |fact| fact["fact"] == kind)
    }

    /// The inputs of the slave at `address` as hex.
    fn inputs(&self, address: u8) -> Vec<&str> {
        self.of("inputs")
            .filter(|fact| fact["address"] == address)
            .map(|fact| text(&fact["octets"]))
            .collect()
    }
}

#[track_caller]
fn text(value: &Value) -> &str {
    value.as_str().expect("text")
}

#[track_caller]
fn position(octets: &str) -> u32 {
    u32::from_str_radix(&octets[..8], 16).expect("hex")
}

/// Defines a test for each functionality and rate.
macro_rules! data_exchange {
    ($($name:ident: $functionality:literal at $rate:literal;)*) => {$(
        #[test]
        fn $name() {
            if let Some(python) = python(concat!("pyprofibus::", stringify!($name))) {
                exchange_twice(&python, $functionality, $rate);
            }
        }
    )*};
}

data_exchange! {
    class_2_at_9600: "class2" at 9_600;
    class_2_at_19200: "class2" at 19_200;
    class_2_at_93750: "class2" at 93_750;
    class_2_at_500000: "class2" at 500_000;
    scancon_2_0_at_9600: "scancon" at 9_600;
    scancon_2_0_at_19200: "scancon" at 19_200;
    scancon_2_0_at_93750: "scancon" at 93_750;
    scancon_2_0_at_500000: "scancon" at 500_000;
}

/// Twice in a row on the same `run`: first closed and opened again at once by one script, then by another.
fn exchange_twice(python: &Path, functionality: &str, rate: u32) {
    // 12345678h
    let mut program = run(["--switches", "0B", "--shaft", "still@305419896"]);
    let rate = rate.to_string();
    let due = if functionality == "class2" { "12345678" } else { "123456780000000000000000" };
    for start in 0..2 {
        let arguments = ["--functionality", functionality, "--baud", &rate, "--runs", "2", "--cycles", "10"];
        let facts = script(python, "data_exchange.py", &mut program, &arguments);
        let inputs = facts.inputs(11);
        assert_eq!(inputs.len(), 20);
        assert!(inputs.iter().all(|octets| *octets == due), "{inputs:?}");
        for (number, fact) in facts.of("diagnoses").enumerate() {
            // As after power-on at first; what the run before left later. Then its own, without a fault.
            let first = if start == 0 && number == 0 { "020500FF108B" } else { "00040002108B" };
            let octets: Vec<_> = fact["octets"].as_array().expect("diagnoses").iter().map(text).collect();
            assert_eq!((octets.first(), octets.last()), (Some(&first), Some(&"00040002108B")), "{octets:?}");
            assert_eq!(fact["refusals"], 0);
        }
    }
    let opened = program.seen.len();
    program.wait_for_after(opened.saturating_sub(1), &["bus: the master has closed the bus"]);
    assert!(!program.seen.iter().any(|line| line.contains("refused")), "{:#?}", program.seen);
    program.end();
}

#[test]
fn both_masters_take_turns_on_one_encoder() {
    let Some(python) = python("pyprofibus::both_masters_take_turns_on_one_encoder") else { return };
    // 12345678h
    let mut program = run(["--switches", "0B", "--shaft", "still@305419896"]);
    let bus = program.bus();
    for turn in 0..3 {
        let arguments = ["--functionality", "scancon", "--cycles", "10"];
        let facts = script(&python, "data_exchange.py", &mut program, &arguments);
        let inputs = facts.inputs(11);
        assert_eq!(inputs.len(), 10, "turn {turn}");
        assert!(inputs.iter().all(|octets| *octets == "123456780000000000000000"), "{inputs:?}");
        // profirust, with the octets of the manual's Scancon 2.0 (manual 4.1).
        let mut profirust = crate::driver::program();
        profirust.arg("master").arg("--port").arg(&bus).args([
            "--address",
            "11",
            "--reply-within",
            "300",
            "run",
        ]);
        profirust.args(["--prm", "00 02 00010000 80000000 0000000000000000 01", "--cfg", "F1 D1 D1"]);
        let ended = end_of(profirust.args(["--seconds", "0.3"]));
        assert_eq!(ended.status, Some(0), "turn {turn}: {}", ended.errors);
        assert!(ended.output.contains("inputs 12 34 56 78 00 00 00 00 00 00 00 00"), "{}", ended.output);
    }
    program.end();
}

#[test]
fn a_turning_shaft() {
    let Some(python) = python("pyprofibus::a_turning_shaft") else { return };
    // 300 RPM are 5 turns a second: 327680 counts.
    let mut program = run(["--switches", "0B", "--shaft", "constant:300@1000"]);
    let arguments = ["--functionality", "scancon", "--cycles", "400"];
    let facts = script(&python, "data_exchange.py", &mut program, &arguments);
    let seen: Vec<(f64, u32, &str)> = facts
        .of("inputs")
        .map(|fact| {
            (fact["at"].as_f64().expect("seconds"), position(text(&fact["octets"])), text(&fact["octets"]))
        })
        .collect();
    let [(begun, from, _), .., (ended, to, last)] = seen[..] else { panic!("too few inputs") };
    assert!(seen.windows(2).all(|pair| pair[0].1 <= pair[1].1), "it turns clockwise");
    let turned = f64::from(to - from);
    let due = (ended - begun) * 327_680.0;
    // Either answer may have been late by 20 ms on a busy computer.
    assert!(due > 50_000.0 && (turned - due).abs() < 327_680.0 * 0.02, "{turned} counts, but {due} are due");
    // 32768 steps in 100 ms, 8000h, and no acceleration any more.
    assert_eq!(last[8..], *"0000800000000000");
}

#[test]
fn class_1() {
    let Some(python) = python("pyprofibus::class_1") else { return };
    let mut program = run(["--switches", "0B", "--shaft", "still@305419896"]);
    let facts = script(&python, "class_1.py", &mut program, &["--cycles", "20"]);
    let octets = |kind| facts.of(kind).map(|fact| text(&fact["octets"])).collect::<Vec<_>>();
    assert_eq!(octets("status"), ["10020B000D16"]);
    assert_eq!((octets("set_prm"), octets("chk_cfg")), (vec!["E5"], vec!["E5"]));
    // 16 octets before and after: no alarm, type 2, 65536 steps, 32768 turns (manual 4.2).
    let tail = "108B0A000002000100008000BD16";
    let due = ["020500FF", "00040002"].map(|first| format!("68151568828B083E3C{first}{tail}"));
    assert_eq!(octets("diagnosis"), due);
    assert_eq!(facts.inputs(11), ["12345678"; 20]);
}

#[test]
fn retries_are_answered_from_memory() {
    let Some(python) = python("pyprofibus::retries_are_answered_from_memory") else { return };
    // The shaft turns by some 1300 counts between a request and its retry.
    for functionality in ["class1", "class2", "scancon"] {
        let mut program = run(["--switches", "0B", "--shaft", "constant:60"]);
        let arguments = ["--functionality", functionality, "--cycles", "5"];
        let facts = script(&python, "retry.py", &mut program, &arguments);
        let mut answers = Vec::new();
        for fact in facts.of("retry") {
            assert_eq!((&fact["same_request"], &fact["first"]), (&true.into(), &fact["second"]), "{fact}");
            answers.push(text(&fact["first"]));
        }
        assert_eq!(answers.len(), 5);
        answers.dedup();
        assert_eq!(answers.len(), 5, "a new request gets a new answer");
    }
}

#[test]
fn a_preset_bit_that_stays_set_presets_once() {
    let Some(python) = python("pyprofibus::a_preset_bit_that_stays_set_presets_once") else { return };
    let mut program = run(["--switches", "0B", "--shaft", "constant:60"]);
    // Bit 31 and 1000 in all requests and their retries: it rises once.
    script(&python, "retry.py", &mut program, &["--outputs", "800003E8", "--cycles", "3"]);
    program.wait_for(&["the master has closed the bus"]);
    let presets = program.seen.iter().filter(|line| line.contains("preset: position")).count();
    assert_eq!(presets, 1, "{:#?}", program.seen);
}

#[test]
fn it_goes_on_after_lost_replies() {
    let Some(python) = python("pyprofibus::it_goes_on_after_lost_replies") else { return };
    let mut program = run(["--switches", "0B", "--shaft", "constant:60"]);
    let facts = script(&python, "lost_reply.py", &mut program, &["--losses", "3", "--cycles", "5"]);
    let lost: Vec<_> = facts.of("lost").collect();
    assert_eq!(lost.len(), 3);
    for fact in lost {
        // The same frame count bit, and the very answer that was lost.
        assert_eq!(fact["requests"][0], fact["requests"][1], "{fact}");
        assert_eq!(fact["reply"], fact["answer"], "{fact}");
    }
    let [went_on] = facts.of("went_on").collect::<Vec<_>>()[..] else { panic!("it did not") };
    assert_eq!((&went_on["new_start_ups"], &went_on["refusals"]), (&0.into(), &0.into()));
    // The five before, and five after each; the position goes on too.
    let positions: Vec<u32> = facts.inputs(11).into_iter().map(position).collect();
    assert_eq!(positions.len(), 20);
    assert!(positions.is_sorted());
}

#[test]
fn it_comes_back_after_the_watchdog_has_expired() {
    let Some(python) = python("pyprofibus::it_comes_back_after_the_watchdog_has_expired") else { return };
    let mut program = run(["--switches", "0B", "--shaft", "still@66051"]);
    let arguments = ["--watchdog", "100", "--stall", "0.3", "--stalls", "2", "--cycles", "5"];
    let facts = script(&python, "watchdog.py", &mut program, &arguments);
    let diagnoses = |fact: &Value| {
        fact["diagnoses"]
            .as_array()
            .expect("diagnoses")
            .iter()
            .map(|octets| text(octets).to_owned())
            .collect::<Vec<_>>()
    };
    // Octet 2, bit 3: WD_On.
    let start_up = ["020500FF108B", "000C0002108B"];
    let [before] = facts.of("before").collect::<Vec<_>>()[..] else { panic!("no start-up") };
    assert_eq!(diagnoses(before), start_up);
    let back: Vec<_> = facts.of("back").collect();
    assert_eq!(back.len(), 2);
    for fact in back {
        // In Wait_Prm, owned by nobody; then all over again.
        assert_eq!(diagnoses(fact), start_up, "{fact}");
        assert!(fact["refusals"].as_u64().expect("a count") > 0, "Data_Exchange was refused with RS");
    }
    // 66051 is 00010203h.
    assert_eq!(facts.inputs(11), ["00010203"; 15]);
    program.wait_for(&["the master has closed the bus"]);
    let expired = program.seen.iter().filter(|line| line.contains("the watchdog has expired")).count();
    assert!((2..=3).contains(&expired), "{:#?}", program.seen);
}

#[test]
fn several_encoders() {
    let Some(python) = python("pyprofibus::several_encoders") else { return };
    let mut program = run([
        "--switches",
        "0B",
        "--shaft",
        "still@1",
        "--encoder",
        "switches=0C,shaft=still@258",
        "--encoder",
        "switches=0D,shaft=still@66051",
    ]);
    let facts = script(&python, "several.py", &mut program, &["--addresses", "11,12,13", "--cycles", "10"]);
    for (address, due) in [(11, "00000001"), (12, "00000102"), (13, "00010203")] {
        assert_eq!(facts.inputs(address)[..10], [due; 10]);
        assert!(facts.inputs(address).iter().all(|octets| *octets == due));
    }
    let [connected] = facts.of("connected").collect::<Vec<_>>()[..] else { panic!("none is connected") };
    assert_eq!(connected["addresses"], serde_json::json!([11, 12, 13]));
}

/// Octets of upper case hex.
#[track_caller]
fn octets(hex: &Value) -> Vec<u8> {
    let hex = text(hex);
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).expect("hex")).collect()
}

// Octets by the manual: 4.1.1 to 4.1.5 with 2^n and 2^(n+m) as 4.1.2 and 4.1.3 have them.
#[test]
fn the_encoder_takes_what_the_library_makes_of_our_gsd() {
    let Some(python) = python("pyprofibus::the_encoder_takes_what_the_library_makes_of_our_gsd") else {
        return;
    };
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for (bits, values) in [
        ("16x15", "0001000080000000"),
        ("13x12", "0000200002000000"),
        ("12x12", "0000100001000000"),
        ("13x0", "0000200000002000"),
    ] {
        let mut command = Command::new(&python);
        command.arg("-B").arg(root.join("tests/peers/gsd.py"));
        command.arg(root.join(format!("../../gsd/sch108bex-{bits}.gsd")));
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let ended = end_of(&mut command);
        assert_eq!(ended.status, Some(0), "{}\n{}", ended.output, ended.errors);
        let facts: Vec<Value> =
            ended.output.lines().map(|line| serde_json::from_str(line).expect("a fact")).collect();
        assert_eq!(facts[0]["ident"], 0x108B);
        assert_eq!(facts[0]["faults"], 0, "a warning: {}", ended.output);
        assert_eq!(facts[0]["unknown"].as_array().map(Vec::len), Some(0), "{}", ended.output);
        assert_eq!(facts[0]["max_tsdr"], serde_json::json!([60, 60, 60, 60, 60, 100, 150, 250, 450, 800]));
        let class_2 = format!("0002{values}0000000000000000");
        let due = [("0000".to_owned(), "D1"), (class_2.clone(), "F1"), (format!("{class_2}01"), "F1D1D1")];
        assert_eq!(facts.len(), 4);
        for (module, (parameters, identifiers)) in facts[1..].iter().zip(due) {
            assert_eq!(
                (text(&module["parameters"]), text(&module["identifiers"])),
                (parameters.as_str(), identifiers)
            );
            let mut program = run(["--switches", "0B", "--bits", bits]);
            let diagnosis =
                program.master(11).start_up(&octets(&module["parameters"]), &octets(&module["identifiers"]));
            // In data exchange, no fault, owned by master 2.
            assert_eq!(diagnosis.octets(1..=4), [0x00, 0x04, 0x00, 0x02], "{bits} {identifiers}");
            program.end();
        }
    }
}
