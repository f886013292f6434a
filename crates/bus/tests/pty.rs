//! The traps of pseudo terminals, each with a real one.

mod common;

use std::ops::ControlFlow;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::thread::{self, JoinHandle};
use std::time::{Duration as Time, Instant as Moment};

use bus::{Control, Counters, End, Event, Handler, News, PtyEnd, Segment, Settings, WallClock, Written};
use common::{Listener, STATUS_11, STATUS_11_ANSWER};
use profibus_dp::time::{Baudrate, Duration};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::termios::{ControlModes, OptionalActions, Termios, tcgetattr, tcsetattr};

const SECOND: Option<Duration> = Some(Duration::from_secs(1));
/// Long enough for another thread to have run, on a busy computer too.
const AWHILE: Time = Time::from_millis(50);
const SOON: Option<Duration> = Some(Duration::from_millis(20));

/// A terminal as a master opens it.
fn open(path: &Path) -> OwnedFd {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    rustix::fs::open(path, flags, Mode::empty()).unwrap()
}

/// What pyserial does for 8E1 at `rate`: raw, with parity, and glibc's answer to it. That is
/// `EINVAL` when the terminal has not got what was wanted and has not changed at all.
fn set_8e1(terminal: &OwnedFd, rate: u32) -> Result<(), Errno> {
    let before = tcgetattr(terminal)?;
    let mut wanted = before.clone();
    wanted.make_raw();
    wanted.control_modes |=
        ControlModes::CLOCAL | ControlModes::CREAD | ControlModes::CS8 | ControlModes::PARENB;
    wanted.control_modes -= ControlModes::PARODD;
    wanted.set_speed(rate)?;
    tcsetattr(terminal, OptionalActions::Now, &wanted)?;
    let got = tcgetattr(terminal)?;
    let same = |one: &Termios, other: &Termios| {
        one.control_modes == other.control_modes
            && one.local_modes == other.local_modes
            && one.input_modes == other.input_modes
            && one.output_modes == other.output_modes
            && one.output_speed() == other.output_speed()
    };
    let kept = got.control_modes.contains(ControlModes::PARENB);
    if !kept && same(&got, &before) { Err(Errno::INVAL) } else { Ok(()) }
}

fn open_8e1(path: &Path, rate: u32) -> OwnedFd {
    let terminal = open(path);
    set_8e1(&terminal, rate).unwrap();
    terminal
}

fn write(terminal: &OwnedFd, octets: &[u8]) {
    assert_eq!(rustix::io::write(terminal, octets).unwrap(), octets.len());
}

/// What comes within 50 ms, or as soon as it is as much as expected.
fn read(terminal: &OwnedFd, expected: usize) -> Vec<u8> {
    let mut heard = Vec::new();
    let mut buffer = [0; 4096];
    let until = Moment::now() + if expected == 0 { Time::from_millis(50) } else { Time::from_secs(2) };
    while (expected == 0 || heard.len() < expected) && Moment::now() < until {
        let wait = Timespec { tv_sec: 0, tv_nsec: 5_000_000 };
        poll(&mut [PollFd::new(terminal, PollFlags::IN)], Some(&wait)).unwrap();
        match rustix::io::read(terminal, &mut buffer) {
            Ok(count) => heard.extend_from_slice(&buffer[..count]),
            Err(Errno::AGAIN) => {}
            Err(error) => panic!("{error}"),
        }
    }
    heard
}

fn ask(terminal: &OwnedFd, octets: &[u8]) -> Vec<u8> {
    write(terminal, octets);
    read(terminal, 6)
}

/// The next event that is not only the time.
fn event(end: &mut PtyEnd, buffer: &mut [u8]) -> Event {
    let begun = Moment::now();
    while begun.elapsed() < Time::from_secs(2) {
        let event = end.wait(SECOND, buffer).unwrap();
        if event != Event::TimedOut {
            return event;
        }
    }
    Event::TimedOut
}

/// Whether nothing happens for a while.
fn is_quiet(end: &mut PtyEnd) -> bool {
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

    fn news(&mut self, _: &mut Segment<Listener>, news: News) {
        self.news.push(news);
    }
}

struct Running {
    path: PathBuf,
    control: Control<()>,
    thread: JoinHandle<(Segment<Listener>, Host)>,
}

fn start(station: Listener) -> Running {
    let end = PtyEnd::open().unwrap();
    let path = end.path().to_owned();
    let mut segment = Segment::new(Box::new(end), WallClock::new(), Settings::default());
    segment.add(station);
    let (control, commands) = segment.control();
    let thread = thread::spawn(move || {
        let mut host = Host::default();
        segment.run(&commands, &mut host).unwrap();
        (segment, host)
    });
    Running { path, control, thread }
}

impl Running {
    fn stop(self) -> (Listener, Counters, Host) {
        self.control.stop();
        let (segment, host) = self.thread.join().unwrap();
        let counters = segment.counters();
        (segment.into_stations().remove(0), counters, host)
    }
}

#[test]
fn a_new_terminal_is_raw_has_8n1_at_50_baud_and_does_not_echo() {
    let mut end = PtyEnd::open().unwrap();
    assert_eq!(end.name(), end.path().to_str().unwrap());
    let terminal = open(end.path());
    let settings = tcgetattr(&terminal).unwrap();
    let mut raw = settings.clone();
    raw.make_raw();
    assert_eq!(settings.local_modes, raw.local_modes);
    assert_eq!(settings.input_modes, raw.input_modes);
    assert_eq!(settings.output_modes, raw.output_modes);
    assert_eq!((settings.input_speed(), settings.output_speed()), (50, 50));
    assert!(settings.control_modes.contains(ControlModes::CS8 | ControlModes::CREAD));
    assert!(!settings.control_modes.intersects(ControlModes::PARENB | ControlModes::CSTOPB));

    // Every octet passes, both ways, and none comes back.
    let all: Vec<u8> = (0..=255).collect();
    write(&terminal, &all);
    let mut buffer = [0; 512];
    assert_eq!(event(&mut end, &mut buffer), Event::Came(None));
    assert_eq!(event(&mut end, &mut buffer), Event::Octets(256));
    assert_eq!(buffer[..256], all);
    assert!(read(&terminal, 0).is_empty());
    assert_eq!(end.write(&all).unwrap(), Written::All);
    assert_eq!(read(&terminal, 256), all);
}

#[test]
fn a_terminal_that_has_its_rate_refuses_even_parity() {
    // The trap itself, without which the cure would prove nothing.
    let end = PtyEnd::open().unwrap();
    let terminal = open(end.path());
    set_8e1(&terminal, 9600).unwrap();
    assert_eq!(set_8e1(&terminal, 9600), Err(Errno::INVAL));
}

#[test]
fn masters_with_even_parity_come_and_go_at_any_rate() {
    let bus = start(Listener::at(11));
    for rate in [9600, 9600, 19_200, 93_750, 93_750, 45_450, 500_000, 12_000_000, 12_000_000] {
        let terminal = open_8e1(&bus.path, rate);
        assert_eq!(ask(&terminal, &STATUS_11), STATUS_11_ANSWER, "{rate}");
        // Once it has talked, a master may set what it has set before.
        set_8e1(&terminal, rate).unwrap();
        drop(terminal);
        thread::sleep(AWHILE);
    }
    let (.., Host { news, .. }) = bus.stop();
    let came: Vec<_> = news.iter().filter(|news| matches!(news, News::MasterCame(_))).collect();
    assert_eq!(came.len(), 9, "{news:?}");
    assert_eq!(news[4], News::MasterCame(Some(Baudrate::B19200)));
    assert_eq!(news[1], News::MasterLeft);
}

#[test]
fn a_master_may_close_and_open_again_at_once() {
    let bus = start(Listener::at(11));
    for _ in 0..200 {
        // What pyprofibus does: first at 9600, and at its own rate within a millisecond.
        drop(open_8e1(&bus.path, 9600));
        let terminal = open_8e1(&bus.path, 19_200);
        assert_eq!(ask(&terminal, &STATUS_11), STATUS_11_ANSWER);
    }
    let (station, counters, _) = bus.stop();
    assert_eq!((counters.replies, counters.dropped), (200, 0));
    assert!(station.rates.contains(&Some(Baudrate::B19200)));
}

#[test]
fn a_master_may_open_again_at_the_same_rate_at_once() {
    let bus = start(Listener::at(11));
    let mut terminal = open_8e1(&bus.path, 9600);
    for _ in 0..200 {
        assert_eq!(ask(&terminal, &STATUS_11), STATUS_11_ANSWER);
        drop(terminal);
        // No script and no program is faster than that.
        thread::sleep(Time::from_micros(200));
        terminal = open_8e1(&bus.path, 9600);
    }
    bus.stop();
}

#[test]
fn the_rate_is_known_before_the_first_octets_and_after_every_change() {
    let mut end = PtyEnd::open().unwrap();
    let mut buffer = [0; 64];
    let terminal = open_8e1(end.path(), 93_750);
    write(&terminal, &[1]);
    assert_eq!(event(&mut end, &mut buffer), Event::Came(Some(Baudrate::B93750)));
    assert_eq!(event(&mut end, &mut buffer), Event::Octets(1));
    for (rate, known) in [(115_200, None), (45_450, Some(Baudrate::B45450)), (9600, Some(Baudrate::B9600))] {
        thread::sleep(Time::from_millis(1));
        set_8e1(&terminal, rate).unwrap();
        write(&terminal, &[1]);
        assert_eq!(event(&mut end, &mut buffer), Event::Rate(known));
        assert_eq!(event(&mut end, &mut buffer), Event::Octets(1));
    }
    // The same again is no news.
    thread::sleep(Time::from_millis(1));
    set_8e1(&terminal, 9600).unwrap();
    write(&terminal, &[1]);
    assert_eq!(event(&mut end, &mut buffer), Event::Octets(1));
    thread::sleep(Time::from_millis(1));
    write(&terminal, &[1]);
    assert_eq!(event(&mut end, &mut buffer), Event::Octets(1));
}

#[test]
fn what_a_master_sets_for_himself_stays() {
    use rustix::termios::SpecialCodeIndex;
    let mut end = PtyEnd::open().unwrap();
    let terminal = open(end.path());
    let mut settings = tcgetattr(&terminal).unwrap();
    settings.special_codes[SpecialCodeIndex::VMIN] = 0;
    settings.special_codes[SpecialCodeIndex::VTIME] = 7;
    settings.set_speed(19_200).unwrap();
    tcsetattr(&terminal, OptionalActions::Now, &settings).unwrap();
    write(&terminal, &[1]);
    assert_eq!(event(&mut end, &mut [0; 16]), Event::Came(Some(Baudrate::B19200)));
    let settings = tcgetattr(&terminal).unwrap();
    assert_eq!(settings.special_codes[SpecialCodeIndex::VMIN], 0);
    assert_eq!(settings.special_codes[SpecialCodeIndex::VTIME], 7);
}

#[test]
fn a_master_that_leaves_is_noticed_and_the_terminal_parked() {
    let mut end = PtyEnd::open().unwrap();
    let mut buffer = [0; 64];
    let terminal = open_8e1(end.path(), 9600);
    // His own idea of a terminal.
    let mut cooked = tcgetattr(&terminal).unwrap();
    cooked.local_modes |= rustix::termios::LocalModes::ECHO;
    tcsetattr(&terminal, OptionalActions::Now, &cooked).unwrap();
    write(&terminal, &STATUS_11[..3]);
    drop(terminal);
    assert_eq!(event(&mut end, &mut buffer), Event::Came(Some(Baudrate::B9600)));
    assert_eq!(event(&mut end, &mut buffer), Event::Octets(3));
    // Octets that came together with the hang-up are read, but a reply is for nobody.
    assert_eq!(end.write(&[1, 2]).unwrap(), Written::Dropped(2));
    assert_eq!(event(&mut end, &mut buffer), Event::Left);
    assert_eq!(end.write(&[1, 2]).unwrap(), Written::Dropped(2));
    assert!(is_quiet(&mut end));
    let settings = tcgetattr(open(end.path())).unwrap();
    assert_eq!(settings.output_speed(), 50);
    assert!(!settings.local_modes.contains(rustix::termios::LocalModes::ECHO));
}

#[test]
fn opening_and_closing_without_a_word_parks_too() {
    let mut end = PtyEnd::open().unwrap();
    for _ in 0..3 {
        drop(open_8e1(end.path(), 9600));
        assert!(is_quiet(&mut end));
        assert_eq!(tcgetattr(open(end.path())).unwrap().output_speed(), 50);
        assert!(is_quiet(&mut end));
    }
}

#[test]
fn half_a_telegram_goes_with_its_master() {
    let bus = start(Listener::at(11));
    let terminal = open_8e1(&bus.path, 9600);
    write(&terminal, &STATUS_11[..4]);
    drop(terminal);
    thread::sleep(AWHILE);
    let terminal = open_8e1(&bus.path, 9600);
    write(&terminal, &STATUS_11[4..]);
    assert!(read(&terminal, 0).is_empty());
    assert_eq!(ask(&terminal, &STATUS_11), STATUS_11_ANSWER);
    let (station, ..) = bus.stop();
    assert_eq!(station.heard.len(), 1);
}

#[test]
fn nobody_reads_the_replies_to_the_master_before() {
    let bus = start(Listener::at(11));
    for _ in 0..5 {
        let terminal = open_8e1(&bus.path, 9600);
        write(&terminal, &STATUS_11);
        // The answer arrives, and is not read.
        poll(&mut [PollFd::new(&terminal, PollFlags::IN)], Some(&Timespec { tv_sec: 1, tv_nsec: 0 }))
            .unwrap();
        drop(terminal);
        thread::sleep(AWHILE);
        let terminal = open_8e1(&bus.path, 9600);
        assert_eq!(rustix::io::read(&terminal, &mut [0; 16]), Err(Errno::AGAIN));
        drop(terminal);
        thread::sleep(AWHILE);
    }
    let (.., counters, _) = bus.stop();
    assert_eq!(counters.replies, 5);
}

#[test]
fn a_master_that_does_not_read_is_not_waited_for() {
    let mut end = PtyEnd::open().unwrap();
    let mut buffer = [0; 16];
    let terminal = open_8e1(end.path(), 9600);
    write(&terminal, &[1]);
    assert_eq!(event(&mut end, &mut buffer), Event::Came(Some(Baudrate::B9600)));
    assert_eq!(event(&mut end, &mut buffer), Event::Octets(1));
    let begun = Moment::now();
    let mut taken = 0;
    let dropped = (0..1000).find_map(|_| match end.write(&[0x55; 255]).unwrap() {
        Written::All => {
            taken += 255;
            None
        }
        Written::Dropped(count) => Some(count),
    });
    assert!(dropped.is_some_and(|count| count <= 255), "{taken} octets taken");
    assert!(begun.elapsed() < Time::from_secs(2));
    // When he reads again, he finds what was kept, and then is heard and served as ever.
    let kept = read(&terminal, 0);
    assert!(kept.len() >= taken, "{} of {taken}", kept.len());
    write(&terminal, &[2]);
    assert_eq!(event(&mut end, &mut buffer), Event::Octets(1));
    assert_eq!(end.write(&STATUS_11_ANSWER).unwrap(), Written::All);
    assert_eq!(read(&terminal, 6), STATUS_11_ANSWER);
}

#[test]
fn an_end_that_nobody_uses_costs_nothing() {
    let processor_time = || {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        Time::new(u64::try_from(time.tv_sec).unwrap(), u32::try_from(time.tv_nsec).unwrap())
    };
    let mut end = PtyEnd::open().unwrap();
    let terminal = open_8e1(end.path(), 9600);
    write(&terminal, &[1]);
    let mut buffer = [0; 16];
    assert_eq!(event(&mut end, &mut buffer), Event::Came(Some(Baudrate::B9600)));
    assert_eq!(event(&mut end, &mut buffer), Event::Octets(1));
    drop(terminal);
    assert_eq!(event(&mut end, &mut buffer), Event::Left);
    let (begun, before) = (Moment::now(), processor_time());
    let mut waits = 0;
    while begun.elapsed() < Time::from_millis(300) {
        assert_eq!(end.wait(Some(Duration::from_millis(300)), &mut buffer).unwrap(), Event::TimedOut);
        waits += 1;
    }
    assert!(waits <= 4, "{waits} waits");
    let used = processor_time().checked_sub(before).unwrap();
    assert!(used < Time::from_millis(5), "{used:?}");

    // And whoever comes then is served at once.
    let path = end.path().to_owned();
    let master = thread::spawn(move || {
        thread::sleep(Time::from_millis(50));
        let terminal = open_8e1(&path, 19_200);
        let sent = Moment::now();
        write(&terminal, &[1]);
        (terminal, sent)
    });
    assert_eq!(event(&mut end, &mut buffer), Event::Came(Some(Baudrate::B19200)));
    let came = Moment::now();
    let (_terminal, sent) = master.join().unwrap();
    assert!(came.saturating_duration_since(sent) < Time::from_millis(20));
}

#[test]
fn a_waker_ends_the_wait_whoever_is_there() {
    let mut end = PtyEnd::open().unwrap();
    let mut buffer = [0; 16];
    let waker = end.waker();
    let wake_soon = || {
        let waker = waker.clone();
        thread::spawn(move || {
            thread::sleep(Time::from_millis(10));
            waker.wake();
        })
    };
    let thread = wake_soon();
    assert_eq!(end.wait(Some(Duration::from_secs(5)), &mut buffer).unwrap(), Event::Woken);
    thread.join().unwrap();

    // A wake-up and octets at the same time: neither is lost.
    let terminal = open_8e1(end.path(), 9600);
    write(&terminal, &[1]);
    thread::sleep(Time::from_millis(5));
    waker.wake();
    assert_eq!(event(&mut end, &mut buffer), Event::Woken);
    assert_eq!(event(&mut end, &mut buffer), Event::Came(Some(Baudrate::B9600)));
    assert_eq!(event(&mut end, &mut buffer), Event::Octets(1));
    waker.wake();
    assert_eq!(event(&mut end, &mut buffer), Event::Woken);
    drop(terminal);
    assert_eq!(event(&mut end, &mut buffer), Event::Left);
    let thread = wake_soon();
    assert_eq!(event(&mut end, &mut buffer), Event::Woken);
    thread.join().unwrap();
}

#[test]
fn commands_get_through_while_the_master_asks_as_fast_as_it_can() {
    let bus = start(Listener::at(11));
    let terminal = open_8e1(&bus.path, 500_000);
    let control = bus.control.clone();
    let commander = thread::spawn(move || {
        for _ in 0..100 {
            control.send(()).unwrap();
            thread::sleep(Time::from_millis(1));
        }
    });
    let mut exchanges = 0;
    while !commander.is_finished() {
        assert_eq!(ask(&terminal, &STATUS_11), STATUS_11_ANSWER);
        exchanges += 1;
    }
    commander.join().unwrap();
    let (.., counters, host) = bus.stop();
    assert_eq!((host.commands, counters.replies), (100, exchanges));
}

#[test]
fn dribbled_octets_make_a_telegram() {
    let bus = start(Listener::at(11));
    let terminal = open_8e1(&bus.path, 9600);
    // A busy computer may make too long a pause in between; not five times.
    let answered = (0..5).any(|_| {
        for octet in STATUS_11 {
            write(&terminal, &[octet]);
            thread::sleep(Time::from_micros(500));
        }
        read(&terminal, 0) == STATUS_11_ANSWER
    });
    assert!(answered);
    bus.stop();
}
