//! The description of the API: what is in it is there, and a tool that reads it finds nothing wrong.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::client::{demonstration, site};

#[path = "../../../cli/tests/tools/mod.rs"]
mod tools;

#[test]
fn the_server_gives_the_document_that_is_kept() {
    let site = site();
    let given = site.get("/api/openapi.json").json();
    let kept: serde_json::Value =
        serde_json::from_str(include_str!("../../openapi.json")).expect("the kept document");
    assert_eq!(given, kept);
}

#[test]
fn every_described_operation_is_there() {
    let site = site();
    let document = site.get("/api/openapi.json").json();
    let mut count = 0;
    for (path, operations) in document["paths"].as_object().expect("paths") {
        for (method, operation) in operations.as_object().expect("operations") {
            let asking = site.request(&method.to_uppercase(), &path.replace("{name}", "none"));
            let mut socket = asking.header("Connection", "close").open();
            let mut first = [0; 12];
            std::io::Read::read_exact(&mut socket, &mut first).expect("an answer");
            let status = String::from_utf8_lossy(&first[9..]).into_owned();
            assert!(operation["responses"].get(&status).is_some(), "{method} {path}: {status}");
            assert_ne!(status, "405", "{method} {path}");
            count += 1;
        }
    }
    assert_eq!(count, 13);
}

/// Schemathesis makes requests out of the document, right ones and wrong ones, and looks at the answers.
#[test]
fn schemathesis_finds_nothing() {
    const MOST: Duration = Duration::from_secs(90);
    let Some(python) = tools::schemathesis("schemathesis_finds_nothing") else {
        return;
    };
    let site = demonstration();
    let url = format!("http://{}", site.address);
    let mut child = Command::new(python)
        .args(["-m", "schemathesis.cli", "run", &format!("{url}/api/openapi.json"), "--url", &url])
        // The stream never ends, and a run of one test is to be the same as the next.
        .args(["--exclude-operation-id", "stream", "--seed", "1", "--no-color"])
        // What is right by its form can be refused for what is there.
        .args(["--exclude-checks", "positive_data_acceptance,unsupported_method"])
        .args(["--phases", "examples,coverage,fuzzing", "--max-examples", "25", "--request-timeout", "10"])
        .current_dir(std::env::temp_dir())
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("Python");
    let output = child.stdout.take().expect("a pipe");
    let reading = std::thread::spawn(move || std::io::read_to_string(output).unwrap_or_default());
    let begun = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().expect("a status") {
            break status;
        }
        if begun.elapsed() > MOST {
            let _ = child.kill();
            let _ = child.wait();
            panic!("it does not end: {}", reading.join().expect("text"));
        }
        std::thread::sleep(Duration::from_millis(50));
    };
    let text = reading.join().expect("text");
    assert!(status.success(), "{text}");
    // The server is as it was.
    assert_eq!(site.get("/api/snapshot").status, 200);
}
