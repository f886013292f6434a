//! `--http`: every example of docs/http.md with the real program, and its options.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use rustix::process::Signal;
use serde_json::Value;

use crate::driver::{Program, end_of, program, run};

const PATIENCE: Duration = Duration::from_secs(10);

/// The address and the rest behind it that the program has printed.
fn address(program: &mut Program) -> (String, String) {
    let line = program.wait_for(&["http: http://"]);
    let url = line.strip_prefix("http: http://").expect("an address").to_owned();
    let (address, rest) = url.split_once('/').expect("a path");
    (address.to_owned(), rest.to_owned())
}

/// The status and the body of an answer.
fn ask(address: &str, method: &str, path: &str, body: &str) -> (u16, Value) {
    let mut socket = TcpStream::connect(address).expect("it listens");
    socket.set_read_timeout(Some(PATIENCE)).expect("a time");
    let media = if body.is_empty() { "" } else { "Content-Type: application/json\r\n" };
    let length = body.len();
    write!(
        socket,
        "{method} {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n{media}Content-Length: {length}\r\n\r\n{body}"
    )
    .expect("it reads");
    let mut text = String::new();
    socket.read_to_string(&mut text).expect("an answer");
    let status = text.split(' ').nth(1).and_then(|status| status.parse().ok()).expect("a status");
    let body = text.split_once("\r\n\r\n").map_or("", |(_, body)| body);
    (status, serde_json::from_str(body).unwrap_or_default())
}

/// Whether all of `due` is in `is`; of lists as many as are named.
fn holds(is: &Value, due: &Value) -> bool {
    match (is, due) {
        (Value::Object(is), Value::Object(due)) => {
            due.iter().all(|(name, due)| is.get(name).is_some_and(|is| holds(is, due)))
        }
        (Value::Array(is), Value::Array(due)) => {
            is.len() >= due.len() && is.iter().zip(due).all(|(is, due)| holds(is, due))
        }
        _ => is == due,
    }
}

#[test]
fn every_example_of_the_page_on_http_is_so() {
    let mut program = Program::start(program().args(["demo", "--http", "0"]));
    let (address, _) = address(&mut program);
    program.wait_for(&["ready"]);
    let begun = Instant::now();
    while ask(&address, "GET", "/api/snapshot", "").1["encoders"][0]["device"]["state"] != "data_exchange" {
        assert!(begun.elapsed() < PATIENCE, "it exchanges data");
    }
    let page = include_str!("../../../../docs/http.md");
    let (mut inside, mut count, mut answer) = (false, 0, (0, Value::Null));
    for line in page.lines() {
        if line.starts_with("```") {
            inside = line == "```http";
        } else if let Some(request) = line.strip_prefix("> ").filter(|_| inside) {
            let mut words = request.splitn(3, ' ');
            let mut word = || words.next().unwrap_or_default();
            answer = ask(&address, word(), word(), word());
        } else if let Some(due) = line.strip_prefix("< ").filter(|_| inside) {
            let (status, due) = due.split_once(' ').expect("a status and JSON");
            let due: Value = serde_json::from_str(due).expect("JSON");
            assert_eq!(answer.0.to_string(), status, "{line}: {}", answer.1);
            assert!(holds(&answer.1, &due), "{line}\n{}", answer.1);
            count += 1;
        }
    }
    assert!(count > 25, "{count} examples");
    let begun = Instant::now();
    assert_eq!(program.end_with(Signal::INT).code(), Some(0));
    assert!(begun.elapsed() < Duration::from_secs(2), "{:?}", begun.elapsed());
}

#[test]
fn the_bench_stands_beside_the_bus() {
    let mut program = run(["--switches", "05", "--http", "127.0.0.1:0"]);
    let (address, rest) = address(&mut program);
    assert_eq!(rest, "", "no token on this computer alone");
    let (status, snapshot) = ask(&address, "GET", "/api/snapshot", "");
    assert_eq!((status, &snapshot["stage"]["kind"]), (200, &Value::from("run")));
    assert_eq!(snapshot["encoders"][0]["device"]["address"], 5);
    let (status, _) = ask(&address, "POST", "/api/commands", r#"{"do":"shutdown"}"#);
    assert_eq!(status, 200);
    let ended = program.ended();
    assert_eq!(ended.status, Some(0), "{}", ended.errors);
}

#[test]
fn other_computers_are_let_in_with_a_token_only() {
    let refused = end_of(program().args(["run", "--http", "0.0.0.0:0"]));
    assert_eq!(refused.status, Some(2));
    assert!(refused.errors.contains("--http-open"), "{}", refused.errors);
    let lonely = end_of(program().args(["run", "--http-open"]));
    assert_eq!(lonely.status, Some(2));
    let short = end_of(program().args(["run", "--http", "0", "--http-open", "--http-token", "short"]));
    assert_eq!(short.status, Some(2));
    assert!(short.errors.contains("16 to 128"), "{}", short.errors);
    let mut program = run(["--switches", "05", "--http", "127.0.0.1:0", "--http-open"]);
    let (address, rest) = address(&mut program);
    let token = rest.strip_prefix("?token=").expect("a token");
    assert_eq!(token.len(), 32);
    assert_eq!(ask(&address, "GET", "/api/snapshot", "").0, 401);
    assert_eq!(ask(&address, "GET", &format!("/?token={token}"), "").0, 303);
    program.end();
}
