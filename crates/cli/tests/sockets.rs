//! `sch108bex run` on TCP and Unix sockets, on this computer only.
//!
//! What goes over the bus is written here octet by octet; nothing of the program's own telegram code is used.

#[allow(dead_code, reason = "the other tests use the rest")]
#[path = "program/driver.rs"]
mod driver;
#[allow(dead_code, reason = "the other tests use the rest")]
#[path = "program/master.rs"]
mod master;
mod tools;

use std::fs;
use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rustix::process::Signal;
use tempfile::tempdir;

use driver::{Program, end_of, program, run};
use master::{CLASS_2, IDENT, MASTER, sd2, status, status_answer, sum};
use tools::python;

/// How long an answer may take before the request is repeated.
const ANSWER_WITHIN: Duration = Duration::from_millis(500);
const SLAVE: u8 = 11;
/// Slave_Diag, with the function code that begins a sequence: SRD high.
const SLAVE_DIAG: [u8; 2] = [60, 62];

/// A master's connection.
struct Wire(Box<dyn Socket>);

/// A socket of either kind.
trait Socket: Read + Write {
    fn close(&self);
}

impl Socket for TcpStream {
    fn close(&self) {
        let _ = self.shutdown(Shutdown::Both);
    }
}

impl Socket for UnixStream {
    fn close(&self) {
        let _ = self.shutdown(Shutdown::Both);
    }
}

impl Drop for Wire {
    /// Closes it for all: the tests beside this one start programs, and each has all that is open here for
    /// a moment.
    fn drop(&mut self) {
        self.0.close();
    }
}

fn tcp(place: &str) -> Wire {
    wire(TcpStream::connect(place).expect("somebody listens"))
}

fn wire(stream: TcpStream) -> Wire {
    stream.set_nodelay(true).unwrap();
    stream.set_read_timeout(Some(ANSWER_WITHIN)).unwrap();
    Wire(Box::new(stream))
}

fn unix(path: &Path) -> Wire {
    let stream = UnixStream::connect(path).expect("somebody listens");
    stream.set_read_timeout(Some(ANSWER_WITHIN)).unwrap();
    Wire(Box::new(stream))
}

/// Sends a request, again if it is not answered, and gives the answer.
#[track_caller]
fn ask(Wire(socket): &mut Wire, request: &[u8]) -> Vec<u8> {
    let mut answer = vec![0; 1];
    let answered = (0..8).any(|_| {
        socket.write_all(request).expect("a bus");
        match socket.read(&mut answer) {
            Ok(count) => count == 1,
            Err(error) if error.kind() == ErrorKind::WouldBlock => false,
            Err(error) => panic!("the bus is gone: {error}"),
        }
    });
    assert!(answered, "no answer to {request:02X?}");
    let more = match answer[0] {
        0xE5 => return answer,
        0x68 => {
            answer.push(0);
            socket.read_exact(&mut answer[1..]).expect("a length");
            usize::from(answer[1]) + 4
        }
        _ => 5,
    };
    let begun = answer.len();
    answer.resize(begun + more, 0);
    socket.read_exact(&mut answer[begun..]).expect("the rest of the answer");
    answer
}

fn service(fc: u8, sap: u8, data: &[u8]) -> Vec<u8> {
    sd2(SLAVE | 0x80, MASTER | 0x80, fc, &[&[sap, 62], data].concat())
}

/// FDL status and diagnosis of an encoder that no master has parameterized.
#[track_caller]
fn look(socket: &mut Wire) {
    assert_eq!(ask(socket, &status(SLAVE)), status_answer(SLAVE));
    let answer = ask(socket, &service(0x6D, SLAVE_DIAG[0], &[]));
    let end = answer.len() - 2;
    assert_eq!(answer[4..9], [MASTER | 0x80, SLAVE | 0x80, 0x08, 62, 60], "{answer:02X?}");
    // Not ready, wants parameters, owned by nobody, ident 108Bh; as delivered (manual 4.2).
    let due = [0x02, 0x05, 0x00, 0xFF, 0x10, 0x8B, 0x0A, 0, 0, 2, 0x00, 0x01, 0x00, 0x00, 0x80, 0x00];
    assert_eq!(answer[9..end], due);
    assert_eq!(answer[end..], [sum(&answer[4..end]), 0x16]);
}

/// From parameters to data exchange in class 2; gives the position.
#[track_caller]
fn read_position(socket: &mut Wire) -> u32 {
    ask(socket, &service(0x6D, SLAVE_DIAG[0], &[]));
    let parameters = [&[0x80, 1, 1, 11, IDENT[0], IDENT[1], 0], CLASS_2].concat();
    assert_eq!(ask(socket, &service(0x5D, 61, &parameters)), [0xE5]);
    assert_eq!(ask(socket, &service(0x7D, 62, &[0xF1])), [0xE5]);
    ask(socket, &service(0x5D, SLAVE_DIAG[0], &[]));
    let answer = ask(socket, &sd2(SLAVE, MASTER, 0x7D, &[0; 4]));
    u32::from_be_bytes(answer[7..11].try_into().expect("four inputs"))
}

/// An encoder with address 11, and where masters connect to.
fn encoder(port: &str, more: &[&str]) -> (Program, String) {
    let mut program = run(["--switches", "0B", "--port", port].iter().chain(more));
    let bus = program.seen[0].strip_prefix("bus: ").expect("where the bus is").to_owned();
    assert_eq!(program.seen[1], "ready");
    let place = bus.split_once(':').expect("a kind").1.to_owned();
    assert!(program.is_running());
    (program, place)
}

/// Whether the program has closed a connection, or will at once.
#[track_caller]
fn is_closed(mut wire: Wire) {
    match wire.0.read(&mut [0; 16]) {
        Ok(count) => assert_eq!(count, 0, "it is served"),
        Err(error) => assert_eq!(error.kind(), ErrorKind::ConnectionReset),
    }
}

#[test]
fn a_master_connects_over_tcp() {
    let (mut program, place) = encoder("tcp-listen:127.0.0.1:0", &["--shaft", "still@305419896"]);
    assert_eq!(program.seen[0], format!("bus: tcp:{place}"));
    let port = place.strip_prefix("127.0.0.1:").expect("loopback").parse::<u16>().expect("a port");
    assert_ne!(port, 0);
    let mut master = tcp(&place);
    look(&mut master);
    assert_eq!(read_position(&mut master), 0x1234_5678);
    program.wait_for(&["bus: a master has connected"]);
    drop(master);
    program.wait_for(&["bus: the master has closed the bus"]);
    program.end();
}

#[test]
fn masters_come_one_after_the_other_and_one_at_a_time() {
    let (mut program, place) = encoder("tcp-listen:127.0.0.1:0", &[]);
    for _ in 0..20 {
        let mut master = tcp(&place);
        look(&mut master);
        // Half a telegram goes with its master.
        master.0.write_all(&status(SLAVE)[..4]).unwrap();
    }
    let mut first = tcp(&place);
    look(&mut first);
    for _ in 0..3 {
        is_closed(tcp(&place));
        look(&mut first);
    }
    program.wait_for(&["bus: a second master was refused: one is connected already"]);
    drop(first);
    look(&mut tcp(&place));
    program.end();
}

#[test]
fn the_program_connects_to_a_master_that_comes_later() {
    let port = TcpListener::bind("127.0.0.1:0").unwrap();
    let place = port.local_addr().unwrap().to_string();
    drop(port);
    let (mut program, named) = encoder(&format!("tcp:{place}"), &[]);
    assert_eq!(named, place);
    program.wait_for(&["bus: no master can be reached yet (connection refused)"]);
    for _ in 0..2 {
        let before = program.lines_so_far();
        let listener = TcpListener::bind(&place).unwrap();
        let mut master = wire(listener.accept().unwrap().0);
        look(&mut master);
        program.wait_for_after(before, &["bus: a master has connected"]);
        drop((listener, master));
        program.wait_for_after(before, &["bus: the master has closed the bus"]);
        program.wait_for_after(before, &["no master can be reached yet"]);
    }
    // In the middle of a pause, it ends at once and in order.
    let begun = Instant::now();
    assert_eq!(program.end_with(Signal::TERM).code(), Some(0));
    assert!(begun.elapsed() < Duration::from_secs(2));
    let errors = program.take_errors();
    assert!(!errors.contains("error"), "what happens is no error: {errors}");
}

#[test]
fn a_master_connects_over_a_unix_socket() {
    let directory = tempdir().unwrap();
    let path = directory.path().join("bus");
    let port = format!("unix:{}", path.display());
    for (signal, left) in [(Signal::INT, 0), (Signal::KILL, 1), (Signal::TERM, 0)] {
        // What `kill -9` has left is replaced.
        let (mut program, place) = encoder(&port, &["--shaft", "still@7"]);
        assert_eq!(place, path.display().to_string());
        let mut master = unix(&path);
        look(&mut master);
        assert_eq!(read_position(&mut master), 7);
        is_closed(unix(&path));
        drop(master);
        let mut master = unix(&path);
        assert_eq!(ask(&mut master, &status(SLAVE)), status_answer(SLAVE));
        // While a master is there.
        program.end_with(signal);
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), left, "after {signal:?}");
    }
}

#[test]
fn several_encoders_answer_on_every_kind_of_socket() {
    let directory = tempdir().unwrap();
    let path = directory.path().join("bus");
    let elsewhere = TcpListener::bind("127.0.0.1:0").unwrap();
    let ports = [
        "tcp-listen:127.0.0.1:0".to_owned(),
        format!("tcp:{}", elsewhere.local_addr().unwrap()),
        format!("unix:{}", path.display()),
    ];
    for port in ports {
        let options =
            ["--port", &port, "--switches", "05", "--encoder", "switches=06", "--encoder", "switches=7D"];
        let mut program = run([&options[..], &["--reply-limit", "4000"]].concat());
        let bus = program.wait_for(&["bus: "]);
        let mut master = match (port.split_once(':').unwrap().0, bus.strip_prefix("bus: tcp:")) {
            ("tcp", _) => wire(elsewhere.accept().unwrap().0),
            (_, Some(place)) => tcp(place),
            _ => unix(&path),
        };
        for slave in [5, 6, 125, 6, 5] {
            assert_eq!(ask(&mut master, &status(slave)), status_answer(slave), "{port}");
        }
        drop(master);
        program.end();
    }
}

#[test]
fn a_paced_bus_takes_its_time_over_tcp_too() {
    let (program, place) = encoder("tcp-listen:127.0.0.1:0", &["--pace"]);
    let mut master = tcp(&place);
    let quickest = (0..20)
        .map(|_| {
            let begun = Instant::now();
            assert_eq!(ask(&mut master, &status(SLAVE)), status_answer(SLAVE));
            begun.elapsed()
        })
        .min();
    // Twelve characters of 11 bits and min T_SDR, 143 bits in all, at 500 kbit/s.
    assert!(quickest >= Some(Duration::from_micros(286)), "{quickest:?}");
    program.end();
}

#[test]
fn addresses_that_cannot_be_are_a_sentence_and_status_2() {
    for (port, parts) in [
        (
            "tcp-listen",
            ["tcp-listen", "write pty, tcp-listen:ADDRESS:PORT, tcp:ADDRESS:PORT, unix:PATH or a device"],
        ),
        ("udp:127.0.0.1:4000", ["udp", "write pty, tcp-listen:ADDRESS:PORT"]),
        ("tcp-listen:", ["tcp-listen:", "write an address and a port, like 127.0.0.1:4000"]),
        // Only who listens may leave it out: nobody is connected to by guess.
        ("tcp:4000", ["4000", "write an address and a port, like 127.0.0.1:4000"]),
        ("tcp-listen::4000", [":4000", "write an address and a port, like 127.0.0.1:4000"]),
        ("tcp-listen:127.0.0.1:", ["127.0.0.1:", "write an address and a port"]),
        ("tcp-listen:127.0.0.1:65536", ["65536", "a port is a number from 0 to 65535"]),
        ("tcp-listen:127.0.0.1:http", ["http", "a port is a number from 0 to 65535"]),
        ("tcp-listen:::1:4000", ["::1:4000", "write an IPv6 address in brackets, like [::1]:4000"]),
        (
            "tcp:127.0.0.1:0",
            ["127.0.0.1:0", "nobody listens on port 0; write the port where the other side listens"],
        ),
        ("unix:", ["unix:", "write the path of the socket, like unix:/tmp/bus"]),
        ("ttyUSB0", ["ttyUSB0", "or a device like /dev/ttyUSB0"]),
    ] {
        let ended = end_of(program().args(["run", "--port", port]));
        assert_eq!((ended.status, ended.output.as_str()), (Some(2), ""), "{port}: {}", ended.errors);
        assert!(parts.iter().all(|part| ended.errors.contains(part)), "{port}: {}", ended.errors);
    }
    let ended = end_of(program().args(["run", "--port", "tcp-listen:127.0.0.1:0", "--link", "encoder"]));
    assert_eq!((ended.status, ended.output.as_str()), (Some(2), ""));
    assert!(ended.errors.contains("leave --link out"), "{}", ended.errors);
}

#[test]
fn what_cannot_be_had_is_a_sentence_and_status_1() {
    let directory = tempdir().unwrap();
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let taken = (format!("tcp-listen:{}", taken.local_addr().unwrap()), taken);
    let at = |name: &str| format!("unix:{}", directory.path().join(name).display());
    fs::write(directory.path().join("file"), "precious").unwrap();
    let _live = UnixListener::bind(directory.path().join("live")).unwrap();
    for (port, parts) in [
        (taken.0.as_str(), ["in use", "another program listens there: end it, or choose another port"]),
        // RFC 5737: nobody's.
        ("tcp-listen:192.0.2.1:4000", ["192.0.2.1:4000", "this computer has no such address"]),
        ("tcp-listen:no-such-host.invalid:4000", ["no-such-host.invalid:4000", "check the name"]),
        ("tcp:no-such-host.invalid:4000", ["no-such-host.invalid:4000", "check the name"]),
        (&at("file"), ["something that is no socket is there", "remove it or choose another path"]),
        (&at("live"), ["somebody listens there already", "end the program that listens there"]),
        (&at("no/place"), ["No such file", "choose a path in a directory that exists"]),
        (&at(&"x".repeat(200)), ["cannot listen on unix:", "choose a shorter path"]),
    ] {
        let ended = end_of(program().args(["run", "--port", port]));
        assert_eq!((ended.status, ended.output.as_str()), (Some(1), ""), "{port}: {}", ended.errors);
        assert!(parts.iter().all(|part| ended.errors.contains(part)), "{port}: {}", ended.errors);
    }
    assert_eq!(fs::read(directory.path().join("file")).unwrap(), b"precious");
}

#[test]
fn pyprofibus_exchanges_data_over_tcp() {
    let Some(python) = python("sockets::pyprofibus_exchanges_data_over_tcp") else { return };
    let (mut program, place) = encoder("tcp-listen:127.0.0.1:0", &["--shaft", "still@305419896"]);
    let mut command = Command::new(python);
    command.arg("-B").arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers/socket_exchange.py"));
    command.arg(format!("socket://{place}"));
    command.args(["--functionality", "scancon", "--runs", "2", "--cycles", "10", "--timeout", "8"]);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let ended = end_of(&mut command);
    assert_eq!(ended.status, Some(0), "{}\n{}", ended.output, ended.errors);
    let inputs: Vec<&str> = ended.output.lines().filter(|line| line.contains("\"inputs\"")).collect();
    assert_eq!(inputs.len(), 20, "{}", ended.output);
    assert!(inputs.iter().all(|fact| fact.contains("\"123456780000000000000000\"")), "{inputs:?}");
    program.wait_for(&["bus: the master has closed the bus"]);
    let second = |line: &String| line.contains("refused");
    assert!(!program.seen.iter().any(second), "{:#?}", program.seen);
    program.end();
}
