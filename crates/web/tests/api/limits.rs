//! Sizes, connections, streams, and those who do not read.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use web::server::{MOST_CONNECTIONS, MOST_OCTETS, MOST_STREAMS};

use crate::client::{Answer, PATIENCE, Stream, site};

#[test]
fn a_long_body_is_refused_whether_announced_or_not() {
    let site = site();
    let fits = format!("{}{}", r#"{"do":"help"}"#, " ".repeat(MOST_OCTETS - 13));
    assert_eq!(fits.len(), MOST_OCTETS);
    assert_eq!(site.post("/api/commands", &fits).status, 200);
    let detail = site.post("/api/commands", &format!("{fits} ")).problem(413);
    assert!(detail.contains("65536"), "{detail}");
    // In chunks nobody announces how much comes.
    let asking = site.request("POST", "/api/commands").header("Content-Type", "application/json");
    let mut socket = asking.header("Transfer-Encoding", "chunked").header("Connection", "close").open();
    for _ in 0..17 {
        let chunk = format!("1000\r\n{}\r\n", " ".repeat(0x1000));
        if socket.write_all(chunk.as_bytes()).is_err() {
            break;
        }
    }
    let _ = socket.write_all(b"0\r\n\r\n");
    Answer::read(&mut socket).problem(413);
}

#[test]
fn a_long_head_is_refused() {
    let site = site();
    let asking = site.request("GET", "/api/snapshot").header("X-Long", &"x".repeat(20_000));
    let mut socket = asking.header("Connection", "close").open();
    let mut octets = Vec::new();
    let _ = socket.read_to_end(&mut octets);
    let text = String::from_utf8_lossy(&octets);
    assert!(text.is_empty() || text.starts_with("HTTP/1.1 431"), "{text}");
    assert_eq!(site.get("/api/snapshot").status, 200);
}

#[test]
fn more_connections_than_there_are_places_are_told_so() {
    let site = site();
    let mut open: Vec<_> =
        (0..MOST_CONNECTIONS).map(|_| TcpStream::connect(site.address).expect("it listens")).collect();
    // The server has let all of them in once the last is answered.
    let last = open.last_mut().expect("one");
    write!(last, "GET / HTTP/1.1\r\nHost: {}\r\n\r\n", site.address).expect("it reads");
    assert!(last.read(&mut [0; 1024]).expect("an answer") > 0);
    let detail = site.get("/api/snapshot").problem(503);
    assert!(detail.contains("64"), "{detail}");
    drop(open);
    let begun = Instant::now();
    while site.get("/api/snapshot").status != 200 {
        assert!(begun.elapsed() < PATIENCE, "their places are free again");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn more_streams_than_there_are_places_are_told_so() {
    let site = site();
    let mut open: Vec<Stream> = (0..MOST_STREAMS).map(|_| site.stream("/api/stream")).collect();
    let detail = site.get("/api/stream").problem(429);
    assert!(detail.contains("16"), "{detail}");
    assert_eq!(site.get("/api/snapshot").status, 200, "others are served");
    open.pop();
    let begun = Instant::now();
    loop {
        let mut socket = site.request("GET", "/api/stream").open();
        let mut first = [0; 12];
        socket.read_exact(&mut first).expect("an answer");
        if &first == b"HTTP/1.1 200" {
            break;
        }
        assert!(begun.elapsed() < PATIENCE, "its place is free again");
        std::thread::sleep(Duration::from_millis(10));
    }
}
