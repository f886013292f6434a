//! Ports by the names users write: a segment at one end, a master at the other.

mod common;

use std::net::{TcpListener, TcpStream};
use std::ops::ControlFlow;
use std::thread::{self, JoinHandle};
use std::time::{Duration as Time, Instant as Moment};

use bus::{
    Control, End, EndError, Event, Handler, PortAddress, Segment, Settings, WallClock, Written,
    open_for_master, open_for_slaves,
};
use common::{Listener, STATUS_11, STATUS_11_ANSWER, status, status_answer};
use profibus_dp::fdl::BaudSetting;
use profibus_dp::time::{Baudrate, Duration};

const RATE: Baudrate = Baudrate::B93750;
const SEARCH: BaudSetting = BaudSetting::Search(Baudrate::B500000);
const SECOND: Option<Duration> = Some(Duration::from_secs(1));
const PATIENCE: Time = Time::from_secs(5);

fn port(text: &str) -> PortAddress {
    text.parse().unwrap()
}

fn dial(text: &str) -> Result<Box<dyn End>, EndError> {
    open_for_master(&port(text), RATE, Duration::ZERO)
}

/// The next event that is not only the time.
fn event(end: &mut dyn End, buffer: &mut [u8]) -> Event {
    let begun = Moment::now();
    while begun.elapsed() < PATIENCE {
        let event = end.wait(SECOND, buffer).unwrap();
        if event != Event::TimedOut {
            return event;
        }
    }
    Event::TimedOut
}

/// So many octets, in however many pieces.
fn octets(end: &mut dyn End, count: usize) -> Vec<u8> {
    let mut all = Vec::new();
    while all.len() < count {
        let mut buffer = [0; 256];
        match event(end, &mut buffer) {
            Event::Octets(count) => all.extend_from_slice(&buffer[..count]),
            other => panic!("{other:?} after {all:02X?}"),
        }
    }
    all
}

struct Quiet;

impl Handler<Listener> for Quiet {
    type Command = ();

    fn command(&mut self, _: &mut Segment<Listener>, (): ()) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// A segment with stations at 11 and 12.
struct Slaves {
    name: String,
    control: Control<()>,
    thread: JoinHandle<Vec<Listener>>,
}

impl Slaves {
    fn at(text: &str) -> Self {
        let end = open_for_slaves(&port(text), SEARCH).unwrap();
        let settings = Settings { reply_limit: Duration::from_secs(4), ..Settings::default() };
        let mut segment = Segment::new(end, WallClock::new(), settings);
        segment.add(Listener::at(11));
        segment.add(Listener::at(12));
        let name = segment.name().to_owned();
        let (control, commands) = segment.control();
        let thread = thread::spawn(move || {
            segment.run(&commands, &mut Quiet).unwrap();
            segment.into_stations()
        });
        Self { name, control, thread }
    }

    fn end(self) -> Vec<Listener> {
        self.control.stop();
        self.thread.join().unwrap()
    }
}

fn asks_both(master: &mut dyn End) {
    for address in [11, 12, 11] {
        assert_eq!(master.write(&status(address)).unwrap(), Written::All);
        assert_eq!(octets(master, 6), status_answer(address));
    }
}

#[test]
fn a_master_reaches_a_pseudo_terminal_at_his_rate() {
    let slaves = Slaves::at("pty");
    for rate in [Baudrate::B93750, Baudrate::B12000000, Baudrate::B45450] {
        // Twice the same, as nothing that a master sets stays behind.
        for _ in 0..2 {
            let mut master = open_for_master(&port(&slaves.name), rate, Duration::ZERO).unwrap();
            assert_eq!(event(&mut *master, &mut [0; 16]), Event::Came(Some(rate)));
            asks_both(&mut *master);
            assert_eq!(master.name(), slaves.name);
        }
    }
    let stations = slaves.end();
    assert_eq!(stations[0].rate, Baudrate::B45450);
    assert!(stations[0].rates.contains(&Some(Baudrate::B12000000)), "{:?}", stations[0].rates);
}

#[test]
fn every_octet_comes_over_a_pseudo_terminal_as_it_is() {
    let mut slave = open_for_slaves(&port("pty"), SEARCH).unwrap();
    let mut master = dial(slave.name()).unwrap();
    let all: Vec<u8> = (0..=255).chain([0xFF, 0x00, 0xFF, 0xFF, 0x00]).collect();
    assert_eq!(event(&mut *master, &mut [0; 16]), Event::Came(Some(RATE)));
    assert_eq!(master.write(&all).unwrap(), Written::All);
    assert_eq!(event(&mut *slave, &mut [0; 16]), Event::Came(Some(RATE)));
    assert_eq!(octets(&mut *slave, all.len()), all);
    assert_eq!(slave.write(&all).unwrap(), Written::All);
    assert_eq!(octets(&mut *master, all.len()), all);
}

#[test]
fn a_pseudo_terminal_has_one_master_at_a_time() {
    let slave = open_for_slaves(&port("pty"), SEARCH).unwrap();
    let first = dial(slave.name()).unwrap();
    let error = dial(slave.name()).unwrap_err().to_string();
    assert!(error.contains("another program has it") && error.contains("fuser -v /dev/pts/"), "{error}");
    drop(first);
    dial(slave.name()).unwrap();
}

#[test]
fn a_master_is_told_that_the_slaves_have_gone() {
    let slave = open_for_slaves(&port("pty"), SEARCH).unwrap();
    let mut master = dial(slave.name()).unwrap();
    assert_eq!(event(&mut *master, &mut [0; 16]), Event::Came(Some(RATE)));
    drop(slave);
    assert_eq!(event(&mut *master, &mut [0; 16]), Event::Left);
    assert_eq!(master.write(&STATUS_11).unwrap(), Written::Dropped(6));
    let begun = Moment::now();
    assert_eq!(master.wait(Some(Duration::from_millis(30)), &mut [0; 16]).unwrap(), Event::TimedOut);
    assert!(begun.elapsed() >= Time::from_millis(30), "it does not go round and round");
    master.waker().wake();
    assert_eq!(event(&mut *master, &mut [0; 16]), Event::Woken);
}

#[test]
fn a_master_connects_to_sockets() {
    let directory = tempfile::tempdir().unwrap();
    let unix = format!("unix:{}", directory.path().join("bus").display());
    for text in ["tcp-listen:127.0.0.1:0", &unix] {
        let slaves = Slaves::at(text);
        let mut master = dial(&slaves.name).unwrap();
        assert_eq!(event(&mut *master, &mut [0; 16]), Event::Came(None));
        asks_both(&mut *master);
        slaves.end();
        assert_eq!(event(&mut *master, &mut [0; 16]), Event::Left);
        assert_eq!(master.write(&STATUS_11).unwrap(), Written::Dropped(6));
        let begun = Moment::now();
        assert_eq!(master.wait(Some(Duration::from_millis(30)), &mut [0; 16]).unwrap(), Event::TimedOut);
        assert!(begun.elapsed() >= Time::from_millis(30), "it does not go round and round");
        master.waker().wake();
        assert_eq!(event(&mut *master, &mut [0; 16]), Event::Woken);
    }
}

#[test]
fn a_master_that_listens_waits_for_a_slave() {
    let mut master = dial("tcp-listen:127.0.0.1:0").unwrap();
    assert_eq!(master.wait(Some(Duration::ZERO), &mut [0; 16]).unwrap(), Event::TimedOut);
    let name = master.name().to_owned();
    let slaves = Slaves::at(&name);
    assert_eq!(event(&mut *master, &mut [0; 16]), Event::Came(None));
    asks_both(&mut *master);
    assert_eq!(STATUS_11_ANSWER, status_answer(11));
    slaves.end();
    assert_eq!(event(&mut *master, &mut [0; 16]), Event::Left);
}

#[test]
fn nobody_there_is_a_sentence() {
    let directory = tempfile::tempdir().unwrap();
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let left = directory.path().join("left");
    drop(std::os::unix::net::UnixListener::bind(&left).unwrap());
    let long = directory.path().join("x".repeat(200));
    for (text, words) in [
        (format!("tcp:{free}"), "nobody listens there: start the other side first"),
        (format!("unix:{}/none", directory.path().display()), "there is no such socket"),
        (format!("unix:{}", left.display()), "nobody listens on it"),
        (format!("unix:{}", long.display()), "choose a shorter path"),
        ("/dev/ttyUSB99".to_owned(), "/dev/serial/by-id"),
        ("/dev/null".to_owned(), "it is no serial device; write the path of one"),
        (directory.path().display().to_string(), "it is no serial device; write the path of one"),
        ("pty".to_owned(), "write the path that the slave's program printed, like /dev/pts/4"),
    ] {
        let begun = Moment::now();
        let error = dial(&text).expect_err(&text).to_string();
        assert!(error.contains(&text) && error.contains(words), "{text}: {error}");
        assert!(begun.elapsed() < Time::from_secs(3), "{text}");
    }
}

#[test]
fn a_patient_master_gets_the_slave_that_comes_later() {
    let held = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = held.local_addr().unwrap();
    drop(held);
    let later = thread::spawn(move || {
        thread::sleep(Time::from_millis(100));
        Slaves::at(&format!("tcp-listen:{address}"))
    });
    let mut master = open_for_master(&port(&format!("tcp:{address}")), RATE, Duration::from_secs(5)).unwrap();
    assert_eq!(event(&mut *master, &mut [0; 16]), Event::Came(None));
    asks_both(&mut *master);
    later.join().unwrap().end();
}

#[test]
fn patience_ends() {
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let begun = Moment::now();
    let error = open_for_master(&port(&format!("tcp:{free}")), RATE, Duration::from_millis(150));
    assert!(error.unwrap_err().to_string().contains("nobody listens there"));
    assert!((Time::from_millis(150)..PATIENCE).contains(&begun.elapsed()));
    assert!(TcpStream::connect(free).is_err());
}
