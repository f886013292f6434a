//! Cases 203 and 204 with the masters themselves: pyprofibus, and profirust in `sch108bex master`.
//!
//! 20 s here. `SCH108BEX_ENDURANCE` makes it another number of seconds: 600 was run once.

use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::ports::Encoder;
use crate::tools::python;

fn seconds() -> u64 {
    std::env::var("SCH108BEX_ENDURANCE").ok().and_then(|text| text.parse().ok()).unwrap_or(20)
}

#[test]
fn case_203_pyprofibus_exchanges_data_without_a_fault() {
    let Some(python) = python("masters::case_203_pyprofibus_exchanges_data_without_a_fault") else { return };
    let encoder = Encoder::run(&[]);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers/endure.py");
    let output = Command::new(python)
        .arg("-B")
        .arg(script)
        .arg(&encoder.port)
        .args(["--address", "5", "--functionality", "class2", "--seconds", &seconds().to_string()])
        .args(["--timeout", &(seconds() + 30).to_string()])
        .stdin(Stdio::null())
        .output()
        .expect("the script runs");
    let facts: Vec<Value> = String::from_utf8_lossy(&output.stdout)
        .lines()
        .map(|line| serde_json::from_str(line).expect("a fact"))
        .collect();
    let fact = |kind: &str| facts.iter().find(|fact| fact["fact"] == kind).unwrap_or(&Value::Null);
    assert_eq!(output.status.code(), Some(0), "{facts:?}");
    let count = fact("exchanges")["count"].as_u64().expect("a number");
    eprintln!("{count} exchanges in {} s", seconds());
    assert!(count > seconds() * 10, "only {count} exchanges");
    assert_eq!(fact("diagnoses")["refusals"], 0, "{facts:?}");
    let octets = fact("diagnoses")["octets"].as_array().expect("diagnoses");
    assert_eq!(octets.last(), Some(&"00040002108B".into()), "no fault, and no new start-up");
}

/// One functionality for `seconds()`, over a bus of its own.
fn profirust(prm: &str, cfg: &str, inputs: usize) {
    let encoder = Encoder::run(&[]);
    let output = Command::new(env!("CARGO_BIN_EXE_sch108bex"))
        .args(["master", "--port", &encoder.port, "--address", "5", "--json", "run"])
        .args(["--prm", prm, "--cfg", cfg, "--seconds", &seconds().to_string()])
        // Longer than a busy computer may keep the master from running.
        .args(["--watchdog", "10000"])
        .stdin(Stdio::null())
        .output()
        .expect("the program runs");
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{cfg}: {errors}");
    let printed = String::from_utf8_lossy(&output.stdout);
    assert!(!printed.contains("offline"), "{cfg}: {printed}");
    let documents: Vec<Value> =
        printed.lines().map(|line| serde_json::from_str(line).expect("a document")).collect();
    let octets = |document: &Value| document["inputs"].as_str().map(|hex| hex.split(' ').count());
    assert_eq!(documents.iter().find_map(octets), Some(inputs), "{cfg}: {printed}");
    let count = documents.last().and_then(|last| last["exchanges"].as_u64()).expect("a sum");
    eprintln!("{cfg}: {count} exchanges in {} s", seconds());
    assert!(count > seconds() * 10, "{cfg}: only {count} exchanges");
}

#[test]
fn case_204_profirust_exchanges_data_in_every_functionality() {
    // From octet 8 on: 2^16 units, a range of 2^31, 8 octets of 0; scaling off.
    let class_2 = format!("0002{:08X}{:08X}{}", 1 << 16, 1_u32 << 31, "00".repeat(8));
    let scancon = format!("{class_2}01");
    std::thread::scope(|scope| {
        scope.spawn(|| profirust("0000", "D1", 4));
        scope.spawn(|| profirust(&class_2, "F1", 4));
        scope.spawn(|| profirust(&scancon, "F1D1D1", 12));
    });
}
