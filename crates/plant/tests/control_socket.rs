//! The control socket: bounded in every direction, whoever is at its far side.

mod common;

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::{Duration as Time, Instant as Moment};

use common::{Bench, bench, status_answer, wait_until};
use plant::control::{ControlAddress, MOST_CONNECTIONS, MOST_OCTETS, Server, Subscriptions};
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
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path().join("control");
    serve_at(encoders, &ControlAddress::Path(path.clone()), path, directory)
}

fn serve_on_tcp(encoders: u8) -> Served {
    let directory = tempfile::tempdir().expect("a directory");
    let address = "tcp:127.0.0.1:0".parse().expect("an address");
    serve_at(encoders, &address, PathBuf::new(), directory)
}

fn serve_at(encoders: u8, address: &ControlAddress, path: PathBuf, directory: tempfile::TempDir) -> Served {
    let mut bench = bench(encoders);
    let subscriptions = Subscriptions::new();
    let publish = subscriptions.clone();
    let reports = std::mem::replace(&mut bench.reports, mpsc::channel().1);
    thread::spawn(move || reports.iter().for_each(|report| publish.publish(&report)));
    let (to, shutdowns) = mpsc::channel();
    let on_shutdown = move || {
        let _ = to.send(());
    };
    let server = Server::start(address, bench.handle.clone(), subscriptions, on_shutdown).expect("a server");
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
    let second = Server::start(
        &ControlAddress::Path(served.path.clone()),
        served.bench.handle.clone(),
        Subscriptions::new(),
        || (),
    );
    let error = second.expect_err("one is there").to_string();
    assert!(error.contains("somebody listens there already"), "{error}");
    assert_eq!(Client::connect(&served).ask(r#"{"do":"supply","volts":20}"#), json!({"ok": true}));
    served.server = None;
    assert!(!served.path.exists());
}

impl Served {
    fn tcp(&self) -> TcpStream {
        let Some(ControlAddress::Tcp(address)) = self.server.as_ref().map(Server::address) else {
            panic!("no TCP port");
        };
        assert!(address.ip().is_loopback() && address.port() > 0, "{address}");
        let stream = TcpStream::connect(address).expect("a server");
        stream.set_read_timeout(Some(Time::from_secs(20))).expect("a time");
        stream
    }
}

/// All that comes on a connection until it ends.
fn until_the_end(mut stream: TcpStream, octets: &[u8]) -> String {
    stream.write_all(octets).expect("it reads");
    let mut told = String::new();
    stream.read_to_string(&mut told).expect("it ends in order");
    told
}

#[test]
fn a_tcp_port_takes_the_same_requests() {
    let mut served = serve_on_tcp(1);
    let mut reader = BufReader::new(served.tcp());
    for (request, due) in [
        ("\r\n  {\"id\":1,\"do\":\"supply\",\"volts\":20}\n", json!({"id": 1, "ok": true})),
        ("{\"id\":2,\"do\":\"subscribe\"}\n", json!({"id": 2, "ok": true})),
    ] {
        reader.get_mut().write_all(request.as_bytes()).expect("it reads");
        let mut line = String::new();
        reader.read_line(&mut line).expect("a line");
        assert_eq!(serde_json::from_str::<Value>(&line).expect("JSON"), due);
    }
    // Once it has spoken as a client does, bad lines end nothing.
    for (request, told) in
        [("GET / HTTP/1.1\n", "no JSON object"), ("{\"do\":\"light\",\"state\":\"ok\"}\n", "true")]
    {
        reader.get_mut().write_all(request.as_bytes()).expect("it reads");
        let mut line = String::new();
        reader.read_line(&mut line).expect("a line");
        assert!(line.contains(told), "{line}");
    }
    assert_eq!(served.bench.snapshot()["encoders"][0]["volts"], 20.0);
    served.server = None;
    assert_eq!(reader.read_line(&mut String::new()).expect("an end"), 0);
}

#[test]
fn no_page_in_a_browser_steers_a_tcp_port() {
    let served = serve_on_tcp(1);
    let body = "{\"do\":\"supply\",\"volts\":8}\n";
    let post = format!(
        "POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: http://example.com\r\nContent-Type: text/plain\r\n\
         Content-Length: {}\r\n\r\n{body}",
        body.len()
    );
    // A page chooses the path as well, but not what is in front of it.
    let get = format!("GET /%0A{body} HTTP/1.1\r\n\r\n");
    for request in [&post, &get, &format!("\r\n\r\n{post}")] {
        let told = until_the_end(served.tcp(), request.as_bytes());
        assert!(told.contains("this is HTTP") && told.contains("nothing of it was done"), "{told}");
        assert_eq!(told.lines().count(), 1, "{told}");
    }
    // TLS, with a request in what a page chooses of it, and no end of a line before.
    let hello = [&b"\x16\x03\x01\x02\x00\x01"[..], b"\n", body.as_bytes()].concat();
    for request in [&hello[..], b"\x16\x03\x01", b"[1]\n", b"x"] {
        let told = until_the_end(served.tcp(), request);
        assert!(told.contains("the first line here is a JSON object"), "{told}");
    }
    assert_eq!(served.bench.snapshot()["encoders"][0]["volts"], 24.0);
}

#[test]
fn a_tcp_port_that_is_taken_is_told() {
    let served = serve_on_tcp(1);
    let address = served.server.as_ref().expect("a server").address();
    let second = Server::start(address, served.bench.handle.clone(), Subscriptions::new(), || ());
    let error = second.expect_err("one is there").to_string();
    assert!(error.contains("another program listens there"), "{error}");
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
