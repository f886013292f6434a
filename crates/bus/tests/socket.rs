//! TCP and Unix sockets as ends, on this computer only: masters that come, go, and come in the way of each
//! other.

mod common;

use std::fs;
use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::ops::ControlFlow;
use std::os::unix::net::{UnixDatagram, UnixListener, UnixStream};
use std::path::Path;
use std::thread::{self, JoinHandle};
use std::time::{Duration as Time, Instant as Moment};

use bus::{
    Control, Counters, End, Event, Handler, News, Note, Segment, Settings, SocketEnd, TcpAddress, WallClock,
    Written,
};
use common::{Listener, STATUS_11, STATUS_11_ANSWER, wait_until};
use profibus_dp::time::Duration;

const SECOND: Option<Duration> = Some(Duration::from_secs(1));
const SOON: Option<Duration> = Some(Duration::from_millis(20));
/// Longer than anything takes on a busy computer.
const PATIENCE: Time = Time::from_secs(5);

fn address(text: &str) -> TcpAddress {
    text.parse().unwrap()
}

fn listening() -> SocketEnd {
    SocketEnd::listen_tcp(&address("127.0.0.1:0")).unwrap()
}

/// Where masters connect to: what follows `tcp:`.
fn place(end: &dyn End) -> String {
    end.name().strip_prefix("tcp:").unwrap().to_owned()
}

fn connect(place: &str) -> TcpStream {
    let stream = TcpStream::connect(place).unwrap();
    stream.set_nodelay(true).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream
}

fn connect_unix(path: &Path) -> UnixStream {
    let stream = UnixStream::connect(path).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream
}

/// A master of any kind.
trait Stream: Read + Write {}
impl<T: Read + Write> Stream for T {}

fn ask(stream: &mut impl Stream, octets: &[u8]) -> [u8; 6] {
    stream.write_all(octets).unwrap();
    let mut answer = [0; 6];
    stream.read_exact(&mut answer).unwrap();
    answer
}

/// Whether the far side has closed, without another octet.
fn is_closed(stream: &mut impl Stream) -> bool {
    match stream.read(&mut [0; 16]) {
        Ok(count) => count == 0,
        Err(error) => matches!(error.kind(), ErrorKind::ConnectionReset | ErrorKind::BrokenPipe),
    }
}

/// The next event that is not only the time.
fn event(end: &mut SocketEnd, buffer: &mut [u8]) -> Event {
    let begun = Moment::now();
    while begun.elapsed() < PATIENCE {
        let event = end.wait(SECOND, buffer).unwrap();
        if event != Event::TimedOut {
            return event;
        }
    }
    Event::TimedOut
}

fn is_quiet(end: &mut SocketEnd) -> bool {
    (0..3).all(|_| end.wait(SOON, &mut [0; 16]).unwrap() == Event::TimedOut)
}

#[derive(Default)]
struct Host {
    news: Vec<News>,
    commands: usize,
}

impl Handler<Listener> for Host {
    type Command = ();

    fn command(&mut self, _: &mut Segment<Listener>, (): ()) -> ControlFlow<()> {
        self.commands += 1;
        ControlFlow::Continue(())
    }

    fn news(&mut self, segment: &mut Segment<Listener>, news: News) {
        assert!(!segment.has_rate());
        self.news.push(news);
    }
}

/// A segment with a tiny station at 11.
struct Running {
    name: String,
    control: Control<()>,
    thread: JoinHandle<(Segment<Listener>, Host)>,
}

fn start_with(end: SocketEnd, settings: Settings) -> Running {
    let name = end.name().to_owned();
    let mut segment = Segment::new(Box::new(end), WallClock::new(), settings);
    segment.add(Listener::at(11));
    let (control, commands) = segment.control();
    let thread = thread::spawn(move || {
        let mut host = Host::default();
        segment.run(&commands, &mut host).unwrap();
        (segment, host)
    });
    Running { name, control, thread }
}

/// A busy computer may be late, and masters here do not ask twice.
fn settings(pace: bool) -> Settings {
    Settings { pace, reply_limit: Duration::from_secs(4), ..Settings::default() }
}

fn start(end: SocketEnd) -> Running {
    start_with(end, settings(false))
}

impl Running {
    fn connect(&self) -> TcpStream {
        connect(self.name.strip_prefix("tcp:").unwrap())
    }

    fn stop(self) -> (Listener, Counters, Host) {
        self.control.stop();
        let (segment, host) = self.thread.join().unwrap();
        let counters = segment.counters();
        (segment.into_stations().remove(0), counters, host)
    }
}

#[test]
fn a_free_port_is_named_and_every_octet_passes_both_ways() {
    let mut end = listening();
    let port: u16 = end.name().strip_prefix("tcp:127.0.0.1:").unwrap().parse().unwrap();
    assert!(port > 0 && !end.has_rate());
    let mut master = connect(&place(&end));
    let mut buffer = [0; 512];
    assert_eq!(event(&mut end, &mut buffer), Event::Came(None));
    let all: Vec<u8> = (0..=255).collect();
    master.write_all(&all).unwrap();
    assert_eq!(event(&mut end, &mut buffer), Event::Octets(256));
    assert_eq!(buffer[..256], all);
    assert_eq!(end.write(&all).unwrap(), Written::All);
    let mut heard = [0; 256];
    master.read_exact(&mut heard).unwrap();
    assert_eq!(heard[..], all);
    drop(master);
    assert_eq!(event(&mut end, &mut buffer), Event::Left);
    // Nobody is there: nothing is kept for who comes next.
    assert_eq!(end.write(&[1, 2]).unwrap(), Written::Dropped(2));
    assert!(is_quiet(&mut end));
}

#[test]
fn an_ipv6_port_is_named_with_brackets() {
    // Not every computer has IPv6.
    let Ok(mut end) = SocketEnd::listen_tcp(&address("[::1]:0")) else { return };
    assert!(end.name().starts_with("tcp:[::1]:"), "{}", end.name());
    let _master = connect(&place(&end));
    assert_eq!(event(&mut end, &mut [0; 16]), Event::Came(None));
}

#[test]
fn a_station_answers_over_tcp_and_bus_times_are_those_of_500_kbit_per_second() {
    let bus = start(listening());
    let mut master = bus.connect();
    for _ in 0..100 {
        assert_eq!(ask(&mut master, &STATUS_11), STATUS_11_ANSWER);
    }
    drop(master);
    let (station, counters, host) = bus.stop();
    assert_eq!(station.rates, [None]);
    assert_eq!((counters.replies, counters.dropped, counters.refused), (100, 0, 0));
    assert_eq!(host.news[0], News::MasterCame(None));
}

#[test]
fn a_reply_is_not_paced_unless_it_is_to_be() {
    for pace in [false, true] {
        let bus = start_with(listening(), settings(pace));
        let mut master = bus.connect();
        let quickest = (0..50)
            .map(|_| {
                let begun = Moment::now();
                assert_eq!(ask(&mut master, &STATUS_11), STATUS_11_ANSWER);
                begun.elapsed()
            })
            .min()
            .unwrap();
        // Twelve characters of 11 bits, and 11 bits of silence: 143 bits at 500 kbit/s are 286 us.
        if pace {
            assert!(quickest >= Time::from_micros(286), "{quickest:?}");
        } else {
            assert!(quickest < Time::from_micros(286), "{quickest:?}");
        }
        bus.stop();
    }
}

#[test]
fn small_telegrams_are_sent_at_once() {
    // Without TCP_NODELAY the second of two in a row waits for the acknowledgement of the first, which the
    // master delays by 40 ms.
    let mut end = listening();
    let mut master = connect(&place(&end));
    let mut buffer = [0; 64];
    assert_eq!(event(&mut end, &mut buffer), Event::Came(None));
    let average = (0..20)
        .map(|_| {
            let begun = Moment::now();
            master.write_all(&[1]).unwrap();
            assert_eq!(event(&mut end, &mut buffer), Event::Octets(1));
            for octet in 0..3 {
                assert_eq!(end.write(&[octet]).unwrap(), Written::All);
            }
            master.read_exact(&mut [0; 3]).unwrap();
            begun.elapsed()
        })
        .sum::<Time>()
        / 20;
    assert!(average < Time::from_millis(20), "{average:?}");
}

#[test]
fn half_a_telegram_goes_with_its_master() {
    let bus = start(listening());
    for _ in 0..10 {
        let mut master = bus.connect();
        master.write_all(&STATUS_11[..4]).unwrap();
        drop(master);
        let mut master = bus.connect();
        master.write_all(&STATUS_11[4..]).unwrap();
        master.set_read_timeout(Some(Time::from_millis(30))).unwrap();
        assert!(master.read(&mut [0; 16]).is_err(), "it was closed, or it was answered");
        // After the rest of a telegram a master would pause anyway.
        thread::sleep(Time::from_millis(5));
        master.set_read_timeout(Some(PATIENCE)).unwrap();
        assert_eq!(ask(&mut master, &STATUS_11), STATUS_11_ANSWER);
    }
    let (station, counters, _) = bus.stop();
    assert_eq!((station.heard.len(), counters.refused), (10, 0));
}

#[test]
fn a_master_may_close_and_connect_again_at_once() {
    let bus = start(listening());
    for round in 0..200 {
        // What pyserial does when its rate is changed.
        drop(bus.connect());
        let mut master = bus.connect();
        assert_eq!(ask(&mut master, &STATUS_11), STATUS_11_ANSWER, "{round}");
        // And with an answer unread.
        master.write_all(&STATUS_11).unwrap();
    }
    let (_, counters, host) = bus.stop();
    assert_eq!(counters.refused, 0);
    let came = host.news.iter().filter(|news| matches!(news, News::MasterCame(None))).count();
    assert!(came >= 200, "{came}");
}

#[test]
fn nobody_reads_the_replies_to_the_master_before() {
    let bus = start_with(listening(), settings(true));
    for _ in 0..20 {
        // Gone before the answer is due.
        bus.connect().write_all(&STATUS_11).unwrap();
        let mut master = bus.connect();
        master.set_read_timeout(Some(Time::from_millis(20))).unwrap();
        assert!(master.read(&mut [0; 16]).is_err());
    }
    bus.stop();
}

#[test]
fn a_master_that_only_stops_sending_still_gets_its_answer() {
    // `printf ... | nc -N`
    let bus = start(listening());
    let mut master = bus.connect();
    master.write_all(&STATUS_11).unwrap();
    master.shutdown(Shutdown::Write).unwrap();
    let mut answer = Vec::new();
    master.read_to_end(&mut answer).unwrap();
    assert_eq!(answer, STATUS_11_ANSWER);
    bus.stop();
}

#[test]
fn a_second_master_is_closed_at_once_and_the_first_goes_on() {
    let bus = start(listening());
    let mut first = bus.connect();
    assert_eq!(ask(&mut first, &STATUS_11), STATUS_11_ANSWER);
    for _ in 0..5 {
        let mut second = bus.connect();
        let _ = second.write_all(&STATUS_11);
        assert!(is_closed(&mut second));
        assert_eq!(ask(&mut first, &STATUS_11), STATUS_11_ANSWER);
    }
    drop(first);
    assert_eq!(ask(&mut bus.connect(), &STATUS_11), STATUS_11_ANSWER);
    let (_, counters, host) = bus.stop();
    assert_eq!(counters.refused, 5);
    assert_eq!(host.news[1..6], [News::Noted(Note::Refused); 5]);
    assert!(Note::Refused.to_string().contains("second master"));
}

#[test]
fn a_second_master_does_not_disturb_a_telegram_of_the_first() {
    let bus = start(listening());
    let mut first = bus.connect();
    first.set_read_timeout(Some(Time::from_millis(50))).unwrap();
    // A busy computer may make too long a pause in between; not ten times.
    let answered = (0..10).any(|_| {
        first.write_all(&STATUS_11[..3]).unwrap();
        assert!(is_closed(&mut bus.connect()));
        first.write_all(&STATUS_11[3..]).unwrap();
        let mut answer = [0; 6];
        first.read_exact(&mut answer).is_ok() && answer == STATUS_11_ANSWER
    });
    assert!(answered);
    bus.stop();
}

#[test]
fn a_second_master_is_refused_while_the_first_asks_as_fast_as_it_can() {
    let mut end = listening();
    let place = place(&end);
    let mut first = connect(&place);
    let mut buffer = [0; 16];
    assert_eq!(event(&mut end, &mut buffer), Event::Came(None));
    // There is always something to read already.
    let mut next = || {
        first.write_all(&[1]).unwrap();
        event(&mut end, &mut buffer)
    };
    assert!((0..100).all(|_| next() == Event::Octets(1)));
    let mut second = connect(&place);
    let refused = (0..1000).any(|_| next() == Event::Noted(Note::Refused));
    assert!(refused && is_closed(&mut second));
}

#[test]
fn who_comes_when_the_first_has_closed_waits_for_what_that_has_sent() {
    let mut end = listening();
    let mut buffer = [0; 4];
    let mut first = connect(&place(&end));
    assert_eq!(event(&mut end, &mut buffer), Event::Came(None));
    first.write_all(&[1, 2, 3, 4, 5, 6]).unwrap();
    drop(first);
    let mut second = connect(&place(&end));
    second.write_all(&[7]).unwrap();
    assert_eq!(event(&mut end, &mut buffer), Event::Octets(4));
    assert_eq!(event(&mut end, &mut buffer), Event::Octets(2));
    assert_eq!(event(&mut end, &mut buffer), Event::Left);
    assert_eq!(event(&mut end, &mut buffer), Event::Came(None));
    assert_eq!(event(&mut end, &mut buffer), Event::Octets(1));
    assert_eq!(end.write(&[8]).unwrap(), Written::All);
    second.read_exact(&mut [0; 1]).unwrap();
}

#[test]
fn a_master_that_does_not_read_is_not_waited_for() {
    let mut tcp = listening();
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bus");
    let mut unix = SocketEnd::listen_unix(&path).unwrap();
    let masters: [Box<dyn Stream>; 2] = [Box::new(connect(&place(&tcp))), Box::new(connect_unix(&path))];
    let mut buffer = [0; 16];
    for (end, mut master) in [&mut tcp, &mut unix].into_iter().zip(masters) {
        assert_eq!(event(end, &mut buffer), Event::Came(None));
        let begun = Moment::now();
        let mut taken = 0;
        let dropped = (0..1_000_000).find_map(|_| match end.write(&[0x55; 255]).unwrap() {
            Written::All => {
                taken += 255;
                None
            }
            Written::Dropped(count) => Some((count, 255 - count)),
        });
        let (count, part) = dropped.expect("for ever");
        assert!((1..=255).contains(&count) && taken > 1000, "{taken} octets taken");
        assert!(begun.elapsed() < Time::from_secs(2));
        assert!(is_quiet(end));
        // When he reads again, he finds what was kept, and is served as ever.
        let mut kept = vec![0; taken + part];
        master.read_exact(&mut kept).unwrap();
        master.write_all(&[2]).unwrap();
        assert_eq!(event(end, &mut buffer), Event::Octets(1));
        wait_until("room", || end.write(&[9]).unwrap() == Written::All);
        master.read_exact(&mut [0; 1]).unwrap();
    }
}

#[test]
fn writing_to_a_master_that_has_gone_is_no_error() {
    let mut end = listening();
    let mut buffer = [0; 16];
    let mut master = connect(&place(&end));
    assert_eq!(event(&mut end, &mut buffer), Event::Came(None));
    // Something unread: the far side resets the connection instead of closing it.
    let _ = end.write(&[1; 100]).unwrap();
    master.read_exact(&mut [0; 1]).unwrap();
    drop(master);
    for _ in 0..3 {
        let _ = end.write(&[1; 100]).unwrap();
    }
    assert_eq!(event(&mut end, &mut buffer), Event::Left);
}

#[test]
fn dribbled_octets_make_a_telegram() {
    let bus = start(listening());
    let mut master = bus.connect();
    master.set_read_timeout(Some(Time::from_millis(50))).unwrap();
    // A busy computer may make too long a pause in between; not five times.
    let answered = (0..5).any(|_| {
        for octet in STATUS_11 {
            master.write_all(&[octet]).unwrap();
            thread::sleep(Time::from_micros(500));
        }
        let mut answer = [0; 6];
        master.read_exact(&mut answer).is_ok() && answer == STATUS_11_ANSWER
    });
    assert!(answered);
    bus.stop();
}

#[test]
fn a_unix_socket_serves_one_master_after_the_other_and_goes_at_the_end() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bus");
    let end = SocketEnd::listen_unix(&path).unwrap();
    assert_eq!(end.name(), format!("unix:{}", path.display()));
    let bus = start(end);
    for _ in 0..100 {
        let mut master = connect_unix(&path);
        assert_eq!(ask(&mut master, &STATUS_11), STATUS_11_ANSWER);
    }
    let mut first = connect_unix(&path);
    assert_eq!(ask(&mut first, &STATUS_11), STATUS_11_ANSWER);
    assert!(is_closed(&mut connect_unix(&path)));
    assert_eq!(ask(&mut first, &STATUS_11), STATUS_11_ANSWER);
    let (_, counters, _) = bus.stop();
    assert_eq!(counters.refused, 1);
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 0);
}

#[test]
fn a_stale_socket_is_replaced() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bus");
    // What `kill -9` leaves.
    drop(UnixListener::bind(&path).unwrap());
    assert!(fs::symlink_metadata(&path).is_ok());
    let mut end = SocketEnd::listen_unix(&path).unwrap();
    let _master = connect_unix(&path);
    assert_eq!(event(&mut end, &mut [0; 16]), Event::Came(None));
    drop(end);
    assert!(fs::symlink_metadata(&path).is_err());
}

#[test]
fn what_is_in_the_way_of_a_socket_stays_and_is_named() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    fs::write(at("file"), "precious").unwrap();
    std::os::unix::fs::symlink(at("nowhere"), at("link")).unwrap();
    let _live = UnixListener::bind(at("live")).unwrap();
    let _datagram = UnixDatagram::bind(at("datagram")).unwrap();
    let long = "x".repeat(120);
    for (name, parts) in [
        ("file", ["something that is no socket is there", "remove it or choose another path"]),
        ("link", ["something that is no socket is there", "remove it or choose another path"]),
        ("live", ["somebody listens there already", "end the program that listens there"]),
        ("datagram", ["somebody listens there already", "end the program that listens there"]),
        ("no/such/place", ["No such file", "choose a path in a directory that exists"]),
        ("file/below", ["Not a directory", "choose a path in a directory that exists"]),
        (&long, ["", "choose a shorter path"]),
    ] {
        let error = SocketEnd::listen_unix(&at(name)).unwrap_err().to_string();
        let begin = format!("cannot listen on unix:{}: ", at(name).display());
        assert!(error.starts_with(&begin) && parts.iter().all(|part| error.contains(part)), "{error}");
    }
    assert_eq!(fs::read(at("file")).unwrap(), b"precious");
    assert!(UnixStream::connect(at("live")).is_ok());
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 4);
}

#[test]
fn a_socket_that_is_no_longer_ours_stays() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bus");
    let end = SocketEnd::listen_unix(&path).unwrap();
    fs::remove_file(&path).unwrap();
    let other = SocketEnd::listen_unix(&path).unwrap();
    drop(end);
    assert!(UnixStream::connect(&path).is_ok());
    drop(other);
    assert!(fs::symlink_metadata(&path).is_err());
}

#[test]
fn a_port_that_cannot_be_had_is_an_error_with_a_remedy() {
    let taken = listening();
    for (text, parts) in [
        (place(&taken).as_str(), ["in use", "another program listens there: end it, or choose another port"]),
        // RFC 5737: nobody's.
        ("192.0.2.1:0", ["annot assign", "this computer has no such address"]),
        ("no-such-host.invalid:0", ["", "check the name"]),
    ] {
        let error = SocketEnd::listen_tcp(&address(text)).unwrap_err().to_string();
        assert!(error.contains(text) && parts.iter().all(|part| error.contains(part)), "{error}");
    }
    let error = SocketEnd::connect_tcp(&address("no-such-host.invalid:1")).unwrap_err().to_string();
    assert!(error.contains("check the name"), "{error}");
}

#[test]
fn a_port_can_be_had_again_at_once() {
    let mut end = listening();
    let place = place(&end);
    let master = connect(&place);
    assert_eq!(event(&mut end, &mut [0; 16]), Event::Came(None));
    // The connection stays in TIME_WAIT at our side.
    drop(end);
    drop(master);
    let mut end = SocketEnd::listen_tcp(&address(&place)).unwrap();
    let _master = connect(&place);
    assert_eq!(event(&mut end, &mut [0; 16]), Event::Came(None));
}

#[test]
fn the_connect_side_waits_for_its_master_and_tells_once_that_it_does() {
    let port = TcpListener::bind("127.0.0.1:0").unwrap();
    let place = port.local_addr().unwrap().to_string();
    drop(port);
    let mut end = SocketEnd::connect_tcp(&address(&place)).unwrap();
    assert_eq!(end.name(), format!("tcp:{place}"));
    let mut buffer = [0; 64];
    let refused = Note::Unreachable(ErrorKind::ConnectionRefused);
    assert_eq!(event(&mut end, &mut buffer), Event::Noted(refused));
    assert!(refused.to_string().contains("connection refused"), "{refused}");
    assert!(is_quiet(&mut end));
    assert_eq!(end.write(&[1]).unwrap(), Written::Dropped(1));

    for _ in 0..3 {
        let port = TcpListener::bind(&place).unwrap();
        assert_eq!(event(&mut end, &mut buffer), Event::Came(None));
        let (mut master, _) = port.accept().unwrap();
        master.write_all(&[1, 2, 3]).unwrap();
        assert_eq!(event(&mut end, &mut buffer), Event::Octets(3));
        assert_eq!(end.write(&[4]).unwrap(), Written::All);
        master.read_exact(&mut [0; 1]).unwrap();
        drop(port);
        drop(master);
        assert_eq!(event(&mut end, &mut buffer), Event::Left);
        // Told again, as it is news again.
        assert_eq!(event(&mut end, &mut buffer), Event::Noted(refused));
    }
}

#[test]
fn the_connect_side_serves_and_connects_again() {
    let port = TcpListener::bind("localhost:0").unwrap();
    let place = format!("localhost:{}", port.local_addr().unwrap().port());
    let bus = start(SocketEnd::connect_tcp(&address(&place)).unwrap());
    for _ in 0..5 {
        let (mut master, _) = port.accept().unwrap();
        master.set_read_timeout(Some(PATIENCE)).unwrap();
        for _ in 0..10 {
            assert_eq!(ask(&mut master, &STATUS_11), STATUS_11_ANSWER);
        }
        master.write_all(&STATUS_11[..4]).unwrap();
    }
    let (_, counters, _) = bus.stop();
    assert_eq!(counters.replies, 50);
}

#[test]
fn who_hangs_up_again_and_again_is_asked_less_and_less() {
    let port = TcpListener::bind("127.0.0.1:0").unwrap();
    let mut end = SocketEnd::connect_tcp(&address(&port.local_addr().unwrap().to_string())).unwrap();
    port.set_nonblocking(true).unwrap();
    let begun = Moment::now();
    let (mut came, mut buffer) = (0, [0; 16]);
    while begun.elapsed() < Time::from_millis(500) {
        came += u32::from(end.wait(SOON, &mut buffer).unwrap() == Event::Came(None));
        drop(port.accept());
    }
    // After 10, 20, 40, 80, 160 and 320 ms.
    assert!((2..=8).contains(&came), "{came}");
}

#[test]
fn waiting_costs_nothing() {
    let processor_time = || {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        Time::new(u64::try_from(time.tv_sec).unwrap(), u32::try_from(time.tv_nsec).unwrap())
    };
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let mut served = listening();
    let _master = connect(&place(&served));
    assert_eq!(event(&mut served, &mut [0; 16]), Event::Came(None));
    for mut end in [listening(), served, SocketEnd::connect_tcp(&address(&port.to_string())).unwrap()] {
        let (begun, before) = (Moment::now(), processor_time());
        while begun.elapsed() < Time::from_millis(300) {
            let _ = end.wait(Some(Duration::from_millis(300)), &mut [0; 16]).unwrap();
        }
        let used = processor_time().checked_sub(before).unwrap();
        assert!(used < Time::from_millis(10), "{}: {used:?}", end.name());
    }
}

#[test]
fn a_waker_ends_the_wait_whoever_is_there() {
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let mut served = listening();
    let mut master = connect(&place(&served));
    assert_eq!(event(&mut served, &mut [0; 16]), Event::Came(None));
    let mut connecting = SocketEnd::connect_tcp(&address(&port.to_string())).unwrap();
    assert!(matches!(event(&mut connecting, &mut [0; 16]), Event::Noted(_)));
    for end in [&mut listening(), &mut served, &mut connecting] {
        let waker = end.waker();
        let thread = thread::spawn(move || {
            thread::sleep(Time::from_millis(30));
            waker.wake();
        });
        let begun = Moment::now();
        assert_eq!(event(end, &mut [0; 16]), Event::Woken);
        assert!(begun.elapsed() < Time::from_millis(900), "{:?}", begun.elapsed());
        thread.join().unwrap();
    }
    // A wake-up and octets at the same time: neither is lost.
    master.write_all(&[1]).unwrap();
    served.waker().wake();
    assert_eq!(event(&mut served, &mut [0; 16]), Event::Woken);
    assert_eq!(event(&mut served, &mut [0; 16]), Event::Octets(1));
}

#[test]
fn commands_get_through_while_the_master_asks_as_fast_as_it_can() {
    let bus = start(listening());
    let mut master = bus.connect();
    let control = bus.control.clone();
    let commander = thread::spawn(move || {
        for _ in 0..100 {
            control.send(()).unwrap();
            thread::sleep(Time::from_millis(1));
        }
    });
    let mut exchanges = 0;
    while !commander.is_finished() {
        assert_eq!(ask(&mut master, &STATUS_11), STATUS_11_ANSWER);
        exchanges += 1;
    }
    commander.join().unwrap();
    let (.., counters, host) = bus.stop();
    assert_eq!((host.commands, counters.replies), (100, exchanges));
}

#[test]
fn a_private_socket_is_for_its_user_alone_and_goes_with_its_file() {
    use std::os::unix::fs::PermissionsExt;

    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("control");
    let socket = bus::UnixSocket::listen_privately(&path).unwrap();
    let mode = fs::symlink_metadata(&path).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o600);
    let error = bus::UnixSocket::listen_privately(&path).unwrap_err().to_string();
    assert!(error.contains("somebody listens there already"), "{error}");
    assert!(path.exists());
    drop(socket);
    assert!(!path.exists());
    // What kill -9 leaves behind is taken over.
    drop(UnixListener::bind(&path).unwrap());
    let socket = bus::UnixSocket::listen_privately(&path).unwrap();
    drop(socket);
    assert!(!path.exists());
    let long = directory.path().join("x".repeat(120));
    let error = bus::UnixSocket::listen_privately(&long).unwrap_err().to_string();
    assert!(error.contains("choose a shorter path"), "{error}");
}
