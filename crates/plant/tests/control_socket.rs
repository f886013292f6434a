//! The control socket: bounded in every direction, whoever is at its far side.

mod common;

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::{Duration as Time, Instant as Moment};

use common::{Bench, bench, status_answer, wait_until};
use plant::control::{MOST_CONNECTIONS, MOST_OCTETS, Server, Subscriptions};
use serde_json::{Value, json};

/// A plant whose reports go to all subscriptions, and its socket.
struct Served {
    bench: Bench,
    server: Option<Server>,
    path: PathBuf,
    shutdowns: mpsc::Receiver<()>,
    _directory: tempfile::TempDir,
}

fn serve(encoders: u8) -> Served {
    let mut bench = bench(encoders);
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path().join("control");
    let subscriptions = Subscriptions::new();
    let publish = subscriptions.clone();
    let reports = std::mem::replace(&mut bench.reports, mpsc::channel().1);
    thread::spawn(move || reports.iter().for_each(|report| publish.publish(&report)));
    let (to, shutdowns) = mpsc::channel();
    let on_shutdown = move || {
        let _ = to.send(());
    };
    let server = Server::start(&path, bench.handle.clone(), subscriptions, on_shutdown).expect("a server");
    Served { bench, server: Some(server), path, shutdowns, _directory: directory }
}

/// A client that reads lines.
struct Client(BufReader<UnixStream>);

impl Client {
    fn connect(served: &Served) -> Self {
        let stream = UnixStream::connect(&served.path).expect("a server");
        stream.set_read_timeout(Some(Time::from_secs(20))).expect("a time");
        Self(BufReader::new(stream))
    }

    fn send(&mut self, line: impl AsRef<[u8]>) {
        self.0.get_mut().write_all(&[line.as_ref(), b"\n"].concat()).expect("it reads");
    }

    #[track_caller]
    fn read(&mut self) -> Value {
        let mut line = String::new();
        self.0.read_line(&mut line).expect("a line");
        serde_json::from_str(&line).unwrap_or_else(|error| panic!("{line:?}: {error}"))
    }

    #[track_caller]
    fn ask(&mut self, line: impl AsRef<[u8]>) -> Value {
        self.send(line);
        self.read()
    }

    fn has_ended(&mut self) -> bool {
        matches!(self.0.read(&mut [0; 64]), Ok(0) | Err(_))
    }
}

#[test]
fn the_socket_is_private_belongs_to_one_and_goes_at_the_end() {
    let mut served = serve(1);
    let mode = fs::symlink_metadata(&served.path).expect("a file").permissions().mode();
    assert_eq!(mode & 0o777, 0o600);
    let second = Server::start(&served.path, served.bench.handle.clone(), Subscriptions::new(), || ());
    let error = second.expect_err("one is there").to_string();
    assert!(error.contains("somebody listens there already"), "{error}");
    assert_eq!(Client::connect(&served).ask(r#"{"do":"supply","volts":20}"#), json!({"ok": true}));
    served.server = None;
    assert!(!served.path.exists());
}

#[test]
fn a_reply_has_the_id_of_its_request() {
    let served = serve(1);
    let mut client = Client::connect(&served);
    assert_eq!(client.ask(r#"{"id":7,"do":"supply","volts":20}"#), json!({"id": 7, "ok": true}));
    let snapshot = client.ask(r#"{"do":"snapshot","encoder":"encoder","id":"x"}"#);
    assert_eq!((&snapshot["id"], &snapshot["encoder"]["volts"]), (&json!("x"), &json!(20.0)));
    let refused = client.ask(r#"{"id":null,"do":"supply","volts":200}"#);
    assert_eq!(refused["ok"], false);
    assert!(refused["error"].as_str().is_some_and(|error| error.contains("from -100 to 100")), "{refused}");
}

#[test]
fn after_bad_lines_of_every_kind_the_connection_lives_on() {
    let served = serve(1);
    let mut client = Client::connect(&served);
    for line in [
        b"hello".to_vec(),
        vec![0xFF, 0x00, 0x80],
        b"[".repeat(30_000),
        b"{\"do\":\"supply\"}\r".to_vec(),
        vec![b'x'; MOST_OCTETS],
        vec![b'x'; MOST_OCTETS + 1],
        vec![b' '; 300_000],
    ] {
        let reply = client.ask(&line);
        assert_eq!(reply["ok"], false, "{} octets", line.len());
        assert!(reply["error"].as_str().is_some_and(|error| error.len() < 400), "{reply}");
    }
    client.send("");
    client.send("  \r");
    assert_eq!(client.ask(r#"{"do":"light","state":"ok"}"#)["ok"], true, "empty lines are none");
    // As long as a line may be.
    let mut longest = br#"{"do":"light","state":"ok"}"#.to_vec();
    longest.resize(MOST_OCTETS, b' ');
    assert_eq!(client.ask(&longest)["ok"], true);
    longest.push(b' ');
    let reply = client.ask(&longest);
    assert!(reply["error"].as_str().is_some_and(|error| error.contains("65536 octets at most")), "{reply}");
    // The last line of all may have no end.
    client.0.get_mut().write_all(br#"{"do":"light","state":"low"}"#).expect("it reads");
    client.0.get_ref().shutdown(std::net::Shutdown::Write).expect("a socket");
    assert_eq!(client.read()["ok"], true);
    assert!(client.has_ended());
}

#[test]
fn one_client_too_many_is_told_so_and_finds_room_later() {
    let served = serve(1);
    let mut clients: Vec<_> = (0..MOST_CONNECTIONS).map(|_| Client::connect(&served)).collect();
    for client in &mut clients {
        assert_eq!(client.ask(r#"{"do":"light","state":"ok"}"#)["ok"], true);
    }
    let mut one_more = Client::connect(&served);
    let told = one_more.read();
    assert!(told["error"].as_str().is_some_and(|error| error.contains("close one of them")), "{told}");
    assert!(one_more.has_ended());
    clients.pop();
    wait_until("room", || {
        let mut client = Client::connect(&served);
        client.send(r#"{"do":"light","state":"ok"}"#);
        client.read()["ok"] == true
    });
}

#[test]
fn what_happens_is_told_from_subscribe_to_unsubscribe() {
    let served = serve(2);
    let (mut reader, mut other) = (Client::connect(&served), Client::connect(&served));
    assert_eq!(reader.ask(r#"{"id":1,"do":"subscribe"}"#), json!({"id": 1, "ok": true}));
    assert_eq!(reader.ask(r#"{"id":2,"do":"subscribe"}"#)["ok"], true, "a second one changes nothing");
    other.ask(r#"{"do":"battery","encoder":2,"state":"low"}"#);
    let event = reader.read();
    assert!(event["at_ns"].as_u64().is_some_and(|at| at > 0));
    assert_eq!(
        (&event["event"], &event["who"], &event["kind"]),
        (&json!("report"), &json!("encoder 2"), &json!("warning_raised"))
    );
    assert_eq!(
        (&event["warnings"], &event["text"]),
        (&json!(["battery_charge"]), &json!("warning: battery below its limit"))
    );
    // Its own requests go on working meanwhile.
    assert_eq!(reader.ask(r#"{"do":"unsubscribe"}"#), json!({"ok": true}));
    other.ask(r#"{"do":"battery","encoder":2,"state":"ok"}"#);
    thread::sleep(Time::from_millis(50));
    assert_eq!(
        reader.ask(r#"{"id":3,"do":"light","encoder":1,"state":"ok"}"#)["id"],
        3,
        "no event came between"
    );
}

#[test]
fn a_reader_who_is_slow_is_told_how_much_he_missed_and_holds_nobody_up() {
    let served = serve(1);
    let mut slow = Client::connect(&served);
    slow.ask(r#"{"do":"subscribe"}"#);
    // Ten thousand events are more than sockets and queue hold.
    for _ in 0..5_000 {
        served.bench.done(r#"{"do":"light","state":"low"}"#);
        served.bench.done(r#"{"do":"light","state":"ok"}"#);
    }
    let mut quick = Client::connect(&served);
    assert_eq!(quick.ask(r#"{"do":"light","state":"ok"}"#)["ok"], true);
    let (mut told, mut dropped) = (0, 0);
    while told + dropped < 10_000 {
        let event = slow.read();
        match event["event"].as_str() {
            Some("report") => told += 1,
            Some("dropped") => dropped += event["count"].as_u64().expect("a number"),
            _ => panic!("{event}"),
        }
    }
    assert_eq!(told + dropped, 10_000, "none is lost without being counted");
    assert!(dropped > 0);
}

#[test]
fn floods_silence_and_deafness_do_not_disturb_the_bus() {
    let mut served = serve(8);
    let over = Arc::new(AtomicBool::new(false));
    let done = Arc::new(AtomicUsize::new(0));
    let _silent: Vec<_> = (0..4).map(|_| Client::connect(&served)).collect();
    // They ask for much and read nothing.
    let deaf: Vec<_> = (0..4).map(|_| Client::connect(&served)).collect();
    let mut threads: Vec<_> = deaf
        .into_iter()
        .map(|mut client| {
            let over = Arc::clone(&over);
            client.0.get_ref().set_write_timeout(Some(Time::from_millis(10))).expect("a time");
            thread::spawn(move || {
                while !over.load(Ordering::Relaxed) {
                    let _ = client.0.get_mut().write_all(b"{\"do\":\"snapshot\"}\n");
                }
            })
        })
        .collect();
    for _ in 0..4 {
        let (over, done, mut client) = (Arc::clone(&over), Arc::clone(&done), Client::connect(&served));
        threads.push(thread::spawn(move || {
            while !over.load(Ordering::Relaxed) {
                client.ask(r#"{"do":"snapshot"}"#);
                done.fetch_add(1, Ordering::Relaxed);
            }
        }));
    }
    let begun = Moment::now();
    for _ in 0..300 {
        assert_eq!(served.bench.status(11), status_answer(11));
    }
    let elapsed = begun.elapsed();
    over.store(true, Ordering::Relaxed);
    let requests = done.load(Ordering::Relaxed);
    // Two in a millisecond after the first 64.
    assert!(requests as u128 <= 64 + 8 + elapsed.as_millis() * 2, "{requests} in {elapsed:?}");
    assert!(elapsed < Time::from_secs(20), "{elapsed:?}");
    let begun = Moment::now();
    served.server = None;
    assert!(begun.elapsed() < Time::from_secs(4), "clients that do not read hold the end up");
    for thread in threads {
        let _ = thread.join();
    }
}

#[test]
fn shutdown_is_replied_to_and_passed_on() {
    let mut served = serve(1);
    let mut client = Client::connect(&served);
    assert_eq!(client.ask(r#"{"id":9,"do":"shutdown"}"#), json!({"id": 9, "ok": true}));
    served.shutdowns.recv_timeout(Time::from_secs(20)).expect("passed on");
    served.server = None;
    assert!(client.has_ended());
}
