//! Faults of the line as stations and masters see them, in virtual and in real time.

mod common;

use std::ops::ControlFlow;
use std::thread::{self, JoinHandle};
use std::time::{Duration as Time, Instant as Moment};

use bus::memory::pair;
use bus::{
    Answer, Control, End, Event, FaultCounters, Handler, MemoryEnd, Noise, ReplyFault, RequestFault, Segment,
    Settings, VirtualSegment, WallClock,
};
use common::{Listener, STATUS_11, STATUS_11_ANSWER, status};
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};

const RATE: Baudrate = Baudrate::B500000;

fn segment() -> VirtualSegment<Listener> {
    let mut bus = VirtualSegment::new(Instant::ZERO, RATE);
    bus.add(Listener::at(11));
    bus
}

fn octets(answer: Answer<'_>) -> Option<Vec<u8>> {
    match answer {
        Answer::Reply(reply) => Some(reply.octets.to_vec()),
        Answer::Silence { .. } => None,
    }
}

#[test]
fn a_request_with_a_character_error_does_not_exist() {
    let mut bus = segment();
    assert!(bus.faults_mut().fail_next_request(RequestFault::CharacterError { octet: 2 }));
    assert_eq!(octets(bus.send(&STATUS_11)), None);
    assert_eq!(bus.stations()[0].line_errors, 1);
    assert!(bus.stations()[0].heard.is_empty());
    assert_eq!(octets(bus.send(&STATUS_11)), Some(STATUS_11_ANSWER.to_vec()));
}

#[test]
fn requests_are_lost_damaged_or_doubled_as_asked_and_those_to_others_are_left_alone() {
    let mut bus = segment();
    for fault in [RequestFault::Lose, RequestFault::Corrupt { octet: 4, mask: 1 }, RequestFault::Double] {
        assert!(bus.faults_mut().fail_next_request(fault));
    }
    assert_eq!(octets(bus.send(&status(12))), None);
    assert_eq!(bus.faults().waiting(), (3, 0));
    assert_eq!(octets(bus.send(&STATUS_11)), None);
    // What was for station 12 has been told by now.
    let heard = bus.stations_mut()[0].heard.len();
    assert_eq!(octets(bus.send(&STATUS_11)), None, "the check sum is wrong");
    assert_eq!(bus.stations()[0].heard.len(), heard);
    assert_eq!(octets(bus.send(&STATUS_11)), Some(STATUS_11_ANSWER.to_vec()));
    assert_eq!(bus.stations()[0].heard.len(), heard + 2);
    assert_eq!(bus.stations()[0].line_errors, 0);
    let due = FaultCounters {
        lost_requests: 1,
        doubled_requests: 1,
        damaged_request_characters: 1,
        ..FaultCounters::default()
    };
    assert_eq!(bus.faults().counters(), due);
}

#[test]
fn a_late_reply_is_late_by_as_much_as_asked() {
    let mut bus = segment();
    bus.fail_next_reply(ReplyFault::Late(Duration::from_micros(100)));
    let Answer::Reply(reply) = bus.send(&STATUS_11) else { panic!("it is within the slot time") };
    assert_eq!(reply.delay.as_nanos(), RATE.duration(BitTimes::MIN_TSDR).as_nanos() + 100_000);
    assert_eq!(
        reply.start.since(Instant::ZERO).as_nanos() + 66 * 2_000,
        reply.end.since(Instant::ZERO).as_nanos()
    );
    // The slot time is 400 us.
    bus.fail_next_reply(ReplyFault::Late(Duration::from_micros(400)));
    assert_eq!(octets(bus.send(&STATUS_11)), None);
    assert_eq!(octets(bus.send(&STATUS_11)), Some(STATUS_11_ANSWER.to_vec()));
}

#[test]
fn the_same_seed_gives_the_same_conversation_and_another_does_not() {
    let talk = |seed| {
        let mut bus = segment();
        let noise = Noise {
            seed,
            bit_errors: 1e-3,
            character_errors: 1e-3,
            lost_requests: 0.05,
            lost_replies: 0.05,
            doubled_requests: 0.05,
            doubled_replies: 0.05,
            late_replies: 0.05,
            late_by: Duration::from_micros(50),
            ..Noise::default()
        };
        bus.faults_mut().set_noise(noise).unwrap();
        let answers: Vec<_> = (0..500).map(|_| format!("{:?}", bus.send(&STATUS_11))).collect();
        (answers, bus.faults().counters(), bus.stations()[0].line_errors)
    };
    let (answers, counters, line_errors) = talk(1);
    assert_eq!(talk(1), (answers.clone(), counters, line_errors));
    assert_ne!(talk(2).0, answers);
    assert!(line_errors > 0);
    let FaultCounters {
        lost_requests,
        doubled_requests,
        damaged_request_characters,
        lost_replies,
        doubled_replies,
        late_replies,
        damaged_reply_characters,
    } = counters;
    for (count, due) in [
        (lost_requests, 10..50),
        (doubled_requests, 10..50),
        (damaged_request_characters, 10..80),
        (lost_replies, 8..50),
        (doubled_replies, 8..50),
        (late_replies, 8..50),
        (damaged_reply_characters, 10..80),
    ] {
        assert!(due.contains(&count), "{counters:?}");
    }
}

#[test]
fn with_every_bit_wrong_nothing_is_heard() {
    let mut bus = segment();
    bus.faults_mut().set_noise(Noise { bit_errors: 1.0, ..Noise::default() }).unwrap();
    assert_eq!(octets(bus.send(&STATUS_11)), None);
    assert_eq!(bus.stations()[0].line_errors, 6);
    bus.faults_mut().set_noise(Noise::default()).unwrap();
    assert_eq!(octets(bus.send(&STATUS_11)), Some(STATUS_11_ANSWER.to_vec()));
}

struct Host;

type Command = Box<dyn FnOnce(&mut Segment<Listener>) + Send>;

impl Handler<Listener> for Host {
    type Command = Command;

    fn command(&mut self, segment: &mut Segment<Listener>, command: Command) -> ControlFlow<()> {
        command(segment);
        ControlFlow::Continue(())
    }
}

struct Running {
    master: MemoryEnd,
    control: Control<Command>,
    thread: JoinHandle<Segment<Listener>>,
}

fn start() -> Running {
    let (end, master) = pair();
    let mut segment = Segment::new(Box::new(end), WallClock::new(), Settings::default());
    segment.add(Listener::at(11));
    let (control, commands) = segment.control();
    let thread = thread::spawn(move || {
        segment.run(&commands, &mut Host).unwrap();
        segment
    });
    Running { master, control, thread }
}

impl Running {
    fn set(&mut self, set: impl FnOnce(&mut Segment<Listener>) + Send + 'static) {
        let (to, done) = std::sync::mpsc::channel();
        let command: Command = Box::new(move |segment| {
            set(segment);
            let _ = to.send(());
        });
        self.control.send(command).unwrap();
        done.recv_timeout(Time::from_secs(10)).unwrap();
    }

    /// What comes of a request, until nothing has come for 60 ms.
    fn ask(&mut self, request: &[u8]) -> Vec<u8> {
        let _ = self.master.write(request).unwrap();
        let (mut got, mut buffer) = (Vec::new(), [0; 512]);
        loop {
            match self.master.wait(Some(Duration::from_millis(60)), &mut buffer).unwrap() {
                Event::Octets(count) => got.extend_from_slice(&buffer[..count]),
                Event::TimedOut => return got,
                _ => {}
            }
        }
    }

    fn end(self) -> Segment<Listener> {
        self.control.stop();
        self.thread.join().unwrap()
    }
}

#[test]
fn in_real_time_faults_by_request_meet_the_next_telegrams() {
    let mut bus = start();
    assert_eq!(bus.ask(&STATUS_11), STATUS_11_ANSWER);
    bus.set(|segment| {
        let faults = segment.faults_mut();
        for fault in [ReplyFault::Lose, ReplyFault::Corrupt { octet: 3, mask: 0x81 }, ReplyFault::Double] {
            assert!(faults.fail_next_reply(fault));
        }
    });
    assert_eq!(bus.ask(&STATUS_11), []);
    assert_eq!(bus.ask(&STATUS_11), [0x10, 0x02, 0x0B, 0x81, 0x0D, 0x16]);
    assert_eq!(bus.ask(&STATUS_11), [STATUS_11_ANSWER, STATUS_11_ANSWER].concat());
    bus.set(|segment| {
        let faults = segment.faults_mut();
        for fault in [RequestFault::Lose, RequestFault::CharacterError { octet: 1 }, RequestFault::Double] {
            assert!(faults.fail_next_request(fault));
        }
    });
    assert_eq!(bus.ask(&STATUS_11), []);
    assert_eq!(bus.ask(&STATUS_11), []);
    assert_eq!(bus.ask(&STATUS_11), STATUS_11_ANSWER);
    assert_eq!(bus.ask(&STATUS_11), STATUS_11_ANSWER);
    let segment = bus.end();
    assert_eq!(segment.stations()[0].line_errors, 1);
    // One before, three with faults at their replies, the doubled one, and the last.
    assert_eq!(segment.stations()[0].heard.len(), 1 + 3 + 2 + 1);
    assert_eq!(segment.counters().dropped, 0);
}

#[test]
fn in_real_time_a_late_reply_comes_later_and_not_at_all_once_the_master_has_gone_on() {
    let mut bus = start();
    bus.set(|segment| {
        assert!(segment.faults_mut().fail_next_reply(ReplyFault::Late(Duration::from_millis(20))));
    });
    let begun = Moment::now();
    let _ = bus.master.write(&STATUS_11).unwrap();
    let mut buffer = [0; 64];
    while !matches!(bus.master.wait(Some(Duration::from_secs(5)), &mut buffer).unwrap(), Event::Octets(6)) {}
    assert!(begun.elapsed() >= Time::from_millis(20));
    bus.set(|segment| {
        assert!(segment.faults_mut().fail_next_reply(ReplyFault::Late(Duration::from_secs(5))));
    });
    assert_eq!(bus.ask(&STATUS_11), []);
    assert_eq!(bus.ask(&STATUS_11), STATUS_11_ANSWER);
    assert_eq!(bus.end().counters().overtaken, 1);
}

/// A telegram for us in the data of another one whose head is damaged.
#[test]
fn in_real_time_what_stands_behind_a_character_error_is_no_telegram() {
    let mut bus = start();
    let mut request = vec![0x68, 9, 9, 0x68, 11, 2, 0x7D];
    request.extend(STATUS_11);
    let sum = request[4..].iter().fold(0u8, |sum, octet| sum.wrapping_add(*octet));
    request.extend([sum, 0x16]);
    bus.set(|segment| {
        assert!(segment.faults_mut().fail_next_request(RequestFault::CharacterError { octet: 5 }));
        segment.faults_mut().set_noise(Noise { lost_replies: 1e-9, ..Noise::default() }).unwrap();
    });
    assert_eq!(bus.ask(&request), []);
    assert_eq!(bus.ask(&STATUS_11), STATUS_11_ANSWER);
    assert_eq!(bus.end().stations()[0].heard.len(), 1);
}

#[test]
fn a_command_to_a_segment_that_ends_is_never_left_waiting() {
    for _ in 0..200 {
        let bus = start();
        let control = bus.control.clone();
        let asker = thread::spawn(move || {
            while {
                let (to, done) = std::sync::mpsc::channel::<()>();
                let command: Command = Box::new(move |_| drop(to));
                control.send(command).is_ok()
                    && done.recv_timeout(Time::from_secs(20)).is_err_and(|error| {
                        assert_ne!(error, std::sync::mpsc::RecvTimeoutError::Timeout, "left in the queue");
                        true
                    })
            } {}
        });
        bus.end();
        asker.join().unwrap();
    }
}
