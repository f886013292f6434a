//! A serial device as an end, as far as a pair of pseudo terminals can show it: settings, octets both
//! ways, times, echo. Parity and rates that a driver refuses take hardware; see docs/serial.md.

mod common;

use std::fs::File;
use std::io::{Read, Write};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::thread::{self, JoinHandle};
use std::time::{Duration as Time, Instant as Moment};

use bus::{
    Control, End, EndError, Event, Handler, LateReplies, News, Segment, SerialEnd, Settings, WallClock,
};
use common::{Listener, STATUS_11, STATUS_11_ANSWER, status, status_answer, wait_until};
use profibus_dp::fdl::BaudSetting;
use profibus_dp::time::{Baudrate, BitTimes, Duration};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{
    ControlModes, InputModes, LocalModes, OptionalActions, OutputModes, Termios, tcgetattr, tcsetattr,
};

const FIXED: BaudSetting = BaudSetting::Fixed(Baudrate::B500000);

/// The far side of a cable: what a bus would be.
struct Cable {
    far: File,
    path: PathBuf,
}

impl Cable {
    fn new() -> Self {
        let far = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
        grantpt(&far).unwrap();
        unlockpt(&far).unwrap();
        let path = PathBuf::from(ptsname(&far, Vec::new()).unwrap().into_string().unwrap());
        // As a careless user leaves it: it echoes, turns 0D into 0A, and has hardware handshake.
        let mut settings = tcgetattr(&far).unwrap();
        settings.control_modes |= ControlModes::CRTSCTS | ControlModes::CSTOPB;
        settings.input_modes |= InputModes::IXON | InputModes::ICRNL | InputModes::IGNPAR;
        settings.output_modes |= OutputModes::OPOST;
        settings.set_speed(115_200).unwrap();
        tcsetattr(&far, OptionalActions::Now, &settings).unwrap();
        Self { far: File::from(far), path }
    }

    fn settings(&self) -> Termios {
        tcgetattr(&self.far).unwrap()
    }

    fn send(&mut self, octets: &[u8]) {
        self.far.write_all(octets).unwrap();
    }

    /// What comes until nothing comes for so long.
    fn hear(&mut self, quiet: Time) -> Vec<u8> {
        let mut all = Vec::new();
        while self.is_ready(quiet) {
            let mut buffer = [0; 256];
            let count = self.far.read(&mut buffer).unwrap();
            all.extend_from_slice(&buffer[..count]);
        }
        all
    }

    /// So many octets, or what there is after some seconds.
    fn expect(&mut self, count: usize) -> Vec<u8> {
        let mut all = Vec::new();
        while all.len() < count && self.is_ready(Time::from_secs(5)) {
            let mut buffer = [0; 256];
            let count = self.far.read(&mut buffer).unwrap();
            all.extend_from_slice(&buffer[..count]);
        }
        all
    }

    fn is_ready(&self, within: Time) -> bool {
        let mut watch = [PollFd::new(&self.far, PollFlags::IN)];
        poll(&mut watch, Some(&Timespec::try_from(within).unwrap())).unwrap() > 0
    }
}

fn open(path: &Path) -> Result<SerialEnd, EndError> {
    SerialEnd::open(path, FIXED)
}

#[derive(Default)]
struct Host {
    news: Vec<News>,
}

impl Handler<Listener> for Host {
    type Command = ();

    fn command(&mut self, _: &mut Segment<Listener>, (): ()) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn news(&mut self, _: &mut Segment<Listener>, news: News) {
        self.news.push(news);
    }
}

type Ended = (Result<(), EndError>, Segment<Listener>, Vec<News>);

/// A segment on a device.
struct Running {
    control: Control<()>,
    thread: JoinHandle<Ended>,
}

fn start(path: &Path, stations: Vec<Listener>, settings: Settings) -> Running {
    let mut segment = Segment::new(Box::new(open(path).unwrap()), WallClock::new(), settings);
    for station in stations {
        segment.add(station);
    }
    let (control, commands) = segment.control();
    let thread = thread::spawn(move || {
        let mut host = Host::default();
        let result = segment.run(&commands, &mut host);
        (result, segment, host.news)
    });
    Running { control, thread }
}

/// A busy computer may be late, and masters here do not ask twice.
fn patient() -> Settings {
    Settings { reply_limit: Duration::from_secs(4), ..Settings::default() }
}

impl Running {
    fn end(self) -> (Segment<Listener>, Vec<News>) {
        self.control.stop();
        let (result, segment, news) = self.thread.join().unwrap();
        result.unwrap();
        (segment, news)
    }
}

#[test]
fn a_device_is_set_to_each_of_the_ten_rates_raw_and_with_marks_for_errors() {
    for rate in Baudrate::ALL {
        let cable = Cable::new();
        let end = SerialEnd::open(&cable.path, BaudSetting::Fixed(rate)).unwrap();
        let found = cable.settings();
        assert_eq!(found.output_speed(), rate.bits_per_second());
        assert_eq!(found.input_speed(), rate.bits_per_second());
        assert_eq!(found.input_modes, InputModes::INPCK | InputModes::PARMRK);
        assert!(!found.output_modes.contains(OutputModes::OPOST), "{found:?}");
        let cooked = LocalModes::ECHO | LocalModes::ICANON | LocalModes::ISIG | LocalModes::IEXTEN;
        assert!(!found.local_modes.intersects(cooked), "{found:?}");
        // A pseudo terminal drops the parity that was asked for.
        let modes = found.control_modes - ControlModes::HUPCL;
        let form = modes & (ControlModes::CSIZE | ControlModes::CSTOPB | ControlModes::CRTSCTS);
        assert_eq!(form, ControlModes::CS8);
        assert!(modes.contains(ControlModes::CREAD | ControlModes::CLOCAL));
        assert_eq!((end.rate(), end.is_pseudo_terminal()), (rate, true));
    }
}

#[test]
fn a_device_takes_another_rate_and_forgets_what_came_at_the_old_one() {
    let mut cable = Cable::new();
    let mut end = open(&cable.path).unwrap();
    let mut buffer = [0; 64];
    // Half a mark, and what was not read.
    cable.send(&[0x10, 0x0B]);
    assert_eq!(end.wait(Some(Duration::from_secs(5)), &mut buffer[..1]).unwrap(), Event::Octets(1));
    for rate in Baudrate::ALL {
        cable.send(&[0x68]);
        end.tune(rate).unwrap();
        assert_eq!(cable.settings().output_speed(), rate.bits_per_second());
        assert_eq!(end.wait(Some(Duration::from_millis(5)), &mut buffer).unwrap(), Event::TimedOut);
    }
    cable.send(&[0xE5]);
    assert_eq!(end.wait(Some(Duration::from_secs(5)), &mut buffer).unwrap(), Event::Octets(1));
    assert_eq!(buffer[0], 0xE5);
}

#[test]
fn several_stations_answer_on_a_device() {
    let mut cable = Cable::new();
    let running = start(&cable.path, [11, 12, 125].map(Listener::at).into(), patient());
    wait_until("the rate", || cable.settings().output_speed() == 500_000);
    for address in [11, 125, 12, 11, 12] {
        cable.send(&status(address));
        assert_eq!(cable.expect(6), status_answer(address));
    }
    cable.send(&status(13));
    assert_eq!(cable.hear(Time::from_millis(30)), []);
    let (segment, _) = running.end();
    assert_eq!(segment.counters().replies, 5);
    assert_eq!(segment.rate(), Some(Baudrate::B500000));
}

#[test]
fn a_reply_waits_for_min_tsdr() {
    let mut cable = Cable::new();
    // 50 ms at 500 kbit/s.
    let running = start(&cable.path, vec![Listener::at(11).with_min_tsdr(25_000)], patient());
    wait_until("the rate", || cable.settings().output_speed() == 500_000);
    let begun = Moment::now();
    cable.send(&STATUS_11);
    assert_eq!(cable.expect(6), STATUS_11_ANSWER);
    assert!(begun.elapsed() >= Time::from_millis(50), "{:?}", begun.elapsed());
    // Who goes on before is not answered.
    cable.send(&STATUS_11);
    thread::sleep(Time::from_millis(5));
    cable.send(&status(99));
    assert_eq!(cable.hear(Time::from_millis(150)), []);
    let (segment, _) = running.end();
    assert_eq!((segment.counters().replies, segment.counters().overtaken), (1, 1));
}

#[test]
fn late_replies_are_sent_counted_and_told_now_and_then() {
    let mut cable = Cable::new();
    let mut slow = Listener::at(11);
    slow.slow = Time::from_millis(4);
    let running = start(&cable.path, vec![slow], patient());
    wait_until("the rate", || cable.settings().output_speed() == 500_000);
    for _ in 0..5 {
        cable.send(&STATUS_11);
        assert_eq!(cable.expect(6), STATUS_11_ANSWER);
    }
    // Later than the last may have been told.
    thread::sleep(Time::from_millis(20));
    let (segment, news) = running.end();
    assert_eq!(segment.counters().after_max_tsdr, 5);
    let late: Vec<LateReplies> = news
        .into_iter()
        .filter_map(|news| if let News::LateReplies(late) = news { Some(late) } else { None })
        .collect();
    assert_eq!(late.iter().map(|late| late.count).collect::<Vec<_>>(), [1, 2, 4]);
    // 4 ms at 500 kbit/s are 2000 bit times; max T_SDR are 100.
    assert!(late.iter().all(|late| late.took >= BitTimes(2000) && late.limit == BitTimes(100)), "{late:?}");
    let text = late[1].to_string();
    assert!(
        text.starts_with("2 replies have started late, the newest ") && text.contains("slot time"),
        "{text}"
    );
}

#[test]
fn what_counts_as_late_can_be_chosen() {
    let mut cable = Cable::new();
    let mut slow = Listener::at(11);
    slow.slow = Time::from_millis(4);
    // Two seconds.
    let settings = Settings { max_tsdr: Some(BitTimes(1_000_000)), ..patient() };
    let running = start(&cable.path, vec![slow], settings);
    wait_until("the rate", || cable.settings().output_speed() == 500_000);
    cable.send(&STATUS_11);
    assert_eq!(cable.expect(6), STATUS_11_ANSWER);
    let (segment, news) = running.end();
    assert_eq!((segment.counters().after_max_tsdr, segment.counters().replies), (0, 1));
    assert!(!news.iter().any(|news| matches!(news, News::LateReplies(_))), "{news:?}");
}

#[test]
fn a_reply_that_missed_the_limit_is_not_sent() {
    let mut cable = Cable::new();
    let mut slow = Listener::at(11);
    slow.slow = Time::from_millis(60);
    let settings = Settings { reply_limit: Duration::from_millis(20), ..Settings::default() };
    let running = start(&cable.path, vec![slow], settings);
    wait_until("the rate", || cable.settings().output_speed() == 500_000);
    cable.send(&STATUS_11);
    assert_eq!(cable.hear(Time::from_millis(200)), []);
    let (segment, _) = running.end();
    assert_eq!((segment.counters().replies, segment.counters().late), (0, 1));
}

#[test]
fn stations_do_not_mind_their_own_echo() {
    let mut cable = Cable::new();
    let running = start(&cable.path, [11, 12].map(Listener::at).into(), patient());
    wait_until("the rate", || cable.settings().output_speed() == 500_000);
    for turn in 0..40_u8 {
        let address = 11 + turn % 2;
        cable.send(&status(address));
        let answer = cable.expect(6);
        assert_eq!(answer, status_answer(address));
        match turn % 4 {
            // All at once, octet by octet, or right in front of the next request.
            0 | 3 => cable.send(&answer),
            1 => {
                for octet in answer {
                    cable.send(&[octet]);
                }
            }
            _ => {
                let next = status(address);
                cable.send(&[&answer[..], &next[..]].concat());
                assert_eq!(cable.expect(6), status_answer(address));
            }
        }
    }
    assert_eq!(cable.hear(Time::from_millis(30)), []);
    let (segment, _) = running.end();
    let counters = segment.counters();
    assert_eq!((counters.replies, counters.overtaken, counters.collisions), (50, 0, 0));
    // Ten replies were not echoed.
    assert_eq!(counters.telegrams, 50 + 40);
}

#[test]
fn a_device_that_goes_ends_the_segment_with_a_sentence() {
    let cable = Cable::new();
    let path = cable.path.clone();
    let running = start(&path, vec![Listener::at(11)], patient());
    wait_until("the rate", || cable.settings().output_speed() == 500_000);
    drop(cable);
    let (result, _, _) = running.thread.join().unwrap();
    let error = result.unwrap_err().to_string();
    assert!(error.starts_with(&format!("cannot read from {}: ", path.display())), "{error}");
    assert!(error.contains("was it unplugged"), "{error}");
}

#[test]
fn a_waker_ends_the_wait_and_waiting_costs_nothing() {
    let cable = Cable::new();
    let mut end = open(&cable.path).unwrap();
    let waker = end.waker();
    let other = thread::spawn(move || {
        thread::sleep(Time::from_millis(50));
        waker.wake();
    });
    assert_eq!(end.wait(Some(Duration::from_secs(10)), &mut [0; 16]).unwrap(), Event::Woken);
    other.join().unwrap();
    let begun = Moment::now();
    assert_eq!(end.wait(Some(Duration::from_millis(40)), &mut [0; 16]).unwrap(), Event::TimedOut);
    assert!(begun.elapsed() >= Time::from_millis(40));
}

#[test]
fn two_programs_do_not_share_a_device() {
    let cable = Cable::new();
    let first = open(&cable.path).unwrap();
    let error = open(&cable.path).unwrap_err().to_string();
    assert!(error.contains("another program has it") && error.contains("fuser -v"), "{error}");
    drop(first);
    open(&cable.path).unwrap();
}

#[test]
fn what_is_no_device_is_named_with_its_remedy() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("file");
    std::fs::write(&file, "precious").unwrap();
    let dangling = directory.path().join("link");
    std::os::unix::fs::symlink(directory.path().join("gone"), &dangling).unwrap();
    let stale = {
        let cable = Cable::new();
        cable.path.clone()
    };
    for (path, words) in [
        (Path::new("/dev/ttyUSB99"), "look for adapters that are there in /dev/serial/by-id"),
        (&dangling, "look for adapters that are there in /dev/serial/by-id"),
        (&stale, "/dev/serial/by-id"),
        (&file, "it is no serial device"),
        (directory.path(), "it is no serial device"),
        (Path::new("/dev/null"), "it is no serial device; write the path of one, like /dev/ttyUSB0"),
    ] {
        let error = open(path).expect_err(&path.display().to_string()).to_string();
        assert!(error.contains(&path.display().to_string()) && error.contains(words), "{error}");
    }
    assert_eq!(std::fs::read(&file).unwrap(), b"precious");
}
