//! What `sch108bex run` opens to others, and what those who get in can do to it.
//!
//! docs/security.md names these tests.

#[allow(dead_code, reason = "the other tests use the rest")]
#[path = "program/driver.rs"]
mod driver;
#[allow(dead_code, reason = "the other tests use the rest")]
#[path = "program/master.rs"]
mod master;

use std::fs;
use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::{Duration, Instant};

use tempfile::tempdir;

use driver::{Program, run};
use master::{status, status_answer};

const SLAVE: u8 = 11;

/// So much more memory than before may be in use, in kilobytes: far less than any flood here brings.
const ROOM_KB: u64 = 4_096;

/// The most memory that the program has had so far, in kilobytes.
fn peak_kb(program: &Program) -> u64 {
    let status = fs::read_to_string(format!("/proc/{}/status", program.id())).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).expect("a peak");
    line.trim_end_matches("kB").trim().parse().unwrap()
}

/// What its file descriptors are.
fn open_files(program: &Program) -> Vec<String> {
    fs::read_dir(format!("/proc/{}/fd", program.id()))
        .unwrap()
        .filter_map(|entry| fs::read_link(entry.ok()?.path()).ok())
        .map(|target| target.to_string_lossy().into_owned())
        .collect()
}

/// Its sockets that others can reach: all of the network's, and those in a directory that let others in.
fn reachable(program: &Program) -> Vec<String> {
    let open = open_files(program);
    let own: Vec<&str> =
        open.iter().filter_map(|file| file.strip_prefix("socket:[")?.strip_suffix(']')).collect();
    let mut found = Vec::new();
    for table in ["tcp", "tcp6", "udp", "udp6", "unix"] {
        let lines = fs::read_to_string(format!("/proc/{}/net/{table}", program.id())).unwrap_or_default();
        for line in lines.lines() {
            let is_own = line.split_whitespace().any(|word| own.contains(&word));
            // The flag of a Unix socket that lets others in; a pair for signals has it not.
            let lets_in = table != "unix" || line.split_whitespace().nth(3) == Some("00010000");
            if is_own && lets_in {
                found.push(format!("{table}: {line}"));
            }
        }
    }
    found
}

fn encoder(port: &str, more: &[&str]) -> (Program, String) {
    let program = run(["--switches", "0B", "--port", port].iter().chain(more));
    let bus = program.seen[0].strip_prefix("bus: tcp:").expect("a TCP port").to_owned();
    (program, bus)
}

fn connect(place: &str) -> TcpStream {
    let stream = TcpStream::connect(place).expect("somebody listens");
    stream.set_read_timeout(Some(Duration::from_millis(500))).unwrap();
    stream.set_write_timeout(Some(Duration::from_millis(500))).unwrap();
    stream
}

/// Whether FDL status is answered, within some attempts and connections.
fn answers(place: &str) -> bool {
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(20) {
        let mut stream = connect(place);
        let mut answer = [0; 6];
        // Somebody else may still be there.
        if stream.write_all(&status(SLAVE)).is_ok()
            && stream.read_exact(&mut answer).is_ok()
            && answer[..] == status_answer(SLAVE)[..]
        {
            return true;
        }
    }
    false
}

// Reachable is only what was asked for.
#[test]
fn without_being_asked_it_opens_nothing_to_others() {
    let program = run(["--switches", "0B"]);
    assert!(program.seen[0].starts_with("bus: /dev/pts/"), "{:?}", program.seen);
    assert_eq!(reachable(&program), Vec::<String>::new());
    program.end();
    // Asked for, it is found.
    let (program, _) = encoder("tcp-listen:0", &[]);
    assert_eq!(reachable(&program).len(), 1);
    program.end();
}

#[test]
fn a_tcp_port_without_an_address_is_for_this_computer() {
    let (program, place) = encoder("tcp-listen:0", &[]);
    let (address, port) = place.rsplit_once(':').expect("address and port");
    assert_eq!(address, "127.0.0.1");
    // The system's own list: 127.0.0.1 is 0100007F there, and 0A means that it listens.
    let port: u16 = port.parse().unwrap();
    let table = fs::read_to_string(format!("/proc/{}/net/tcp", program.id())).unwrap();
    let own = format!(":{port:04X} ");
    let listening: Vec<_> =
        table.lines().filter(|line| line.contains(&own) && line.contains(" 0A ")).collect();
    assert_eq!(listening.len(), 1, "{table}");
    assert!(listening[0].contains(&format!("0100007F{own}")), "{listening:?}");
    program.end();
}

/// Writes as much as goes within a time; says how much.
fn flood(stream: &mut impl Write, octets: &[u8], most: usize, span: Duration) -> usize {
    let (begun, mut written) = (Instant::now(), 0);
    while written < most && begun.elapsed() < span {
        match stream.write(octets) {
            Ok(0) => break,
            Ok(count) => written += count,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => break,
        }
    }
    written
}

// Noise, the beginnings of telegrams, and requests whose answers nobody reads.
#[test]
fn a_flood_on_the_bus_takes_no_memory_and_leaves_it_alive() {
    let (program, place) = encoder("tcp-listen:127.0.0.1:0", &[]);
    assert!(answers(&place));
    let before = peak_kb(&program);
    let noise: Vec<u8> = (0..65_536_u32).map(|at| at.wrapping_mul(2_654_435_761).to_be_bytes()[0]).collect();
    let beginnings = [0x68, 0xF9, 0xF9, 0x68].repeat(16_384);
    let requests = status(SLAVE).repeat(10_000);
    for kind in [noise, beginnings, requests] {
        let mut stream = connect(&place);
        let written = flood(&mut stream, &kind, 32 << 20, Duration::from_secs(10));
        assert!(written > 1 << 20, "only {written} octets of a flood");
        drop(stream);
        assert!(answers(&place), "after a flood");
    }
    let after = peak_kb(&program);
    assert!(after < before + ROOM_KB, "{before} kB before, {after} kB after");
    program.end();
}

#[test]
fn hundreds_of_connections_are_closed_and_cost_nothing() {
    let (program, place) = encoder("tcp-listen:127.0.0.1:0", &[]);
    let mut first = connect(&place);
    let mut answer = [0; 6];
    first.write_all(&status(SLAVE)).unwrap();
    first.read_exact(&mut answer).unwrap();
    let (before, files) = (peak_kb(&program), open_files(&program).len());
    for _ in 0..500 {
        drop(connect(&place));
    }
    let others: Vec<TcpStream> = (0..200).map(|_| connect(&place)).collect();
    first.write_all(&status(SLAVE)).unwrap();
    first.read_exact(&mut answer).unwrap();
    assert_eq!(answer[..], status_answer(SLAVE)[..], "the first goes on");
    for mut other in others {
        match other.read(&mut answer) {
            Ok(count) => assert_eq!(count, 0, "closed, not served"),
            Err(error) => assert_eq!(error.kind(), ErrorKind::ConnectionReset),
        }
    }
    assert!(open_files(&program).len() <= files + 1, "{:?}", open_files(&program));
    assert!(peak_kb(&program) < before + ROOM_KB);
    program.end();
}

// Whoever connects and says nothing holds the place, as a master that is switched on. Once he goes there
// is room again.
#[test]
fn a_silent_peer_holds_the_place_until_he_goes() {
    let (program, place) = encoder("tcp-listen:127.0.0.1:0", &[]);
    let silent = connect(&place);
    std::thread::sleep(Duration::from_millis(300));
    let mut other = connect(&place);
    let _ = other.write_all(&status(SLAVE));
    assert!(!matches!(other.read(&mut [0; 6]), Ok(1..)), "there is one master at a time");
    drop(silent);
    assert!(answers(&place));
    program.end();
}

fn control(path: &Path) -> UnixStream {
    let stream = UnixStream::connect(path).expect("the control socket");
    stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    stream.set_write_timeout(Some(Duration::from_millis(200))).unwrap();
    stream
}

// Lines without end, requests that nobody reads the replies of, and silence, all at once.
#[test]
fn a_flood_on_the_control_socket_takes_no_memory_and_leaves_the_bus_alive() {
    let directory = tempdir().unwrap();
    let path = directory.path().join("control");
    let (program, place) = encoder("tcp-listen:127.0.0.1:0", &["--control", path.to_str().unwrap()]);
    let mode = fs::metadata(&path).unwrap().permissions().mode();
    assert_eq!(mode & 0o077, 0, "for its user alone: {mode:o}");
    assert!(answers(&place));
    let before = peak_kb(&program);
    let mut clients: Vec<UnixStream> = (0..14).map(|_| control(&path)).collect();
    let endless = vec![b'x'; 65_536];
    let requests = b"{\"do\":\"snapshot\"}\n".repeat(1_000);
    for (at, client) in clients.iter_mut().enumerate().skip(2) {
        let kind = if at % 2 == 0 { &endless } else { &requests };
        flood(client, kind, 16 << 20, Duration::from_millis(800));
    }
    assert!(answers(&place), "while the floods go on");
    let after = peak_kb(&program);
    // Sixteen threads with a line of 64 kB each.
    assert!(after < before + 16 * 256 + ROOM_KB, "{before} kB before, {after} kB after");
    drop(clients);
    program.end();
}
