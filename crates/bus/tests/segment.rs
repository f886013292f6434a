//! Segments in real time, over memory.

mod common;

use std::ops::ControlFlow;
use std::thread::{self, JoinHandle};
use std::time::{Duration as Time, Instant as Moment};

use bus::memory::pair;
use bus::{Control, Counters, End, Event, Handler, MemoryEnd, News, Segment, Settings, WallClock};
use common::{Listener, STATUS_11, STATUS_11_ANSWER, status, status_answer, wait_until};
use profibus_dp::time::{Baudrate, Duration, Instant};

type Command = Box<dyn FnOnce(&mut Segment<Listener>) -> ControlFlow<()> + Send>;

#[derive(Default)]
struct Host {
    news: Vec<News>,
}

impl Handler<Listener> for Host {
    type Command = Command;

    fn command(&mut self, segment: &mut Segment<Listener>, command: Command) -> ControlFlow<()> {
        command(segment)
    }

    fn news(&mut self, _: &mut Segment<Listener>, news: News) {
        self.news.push(news);
    }
}

/// A segment on a thread of its own, and the master's end.
struct Running {
    master: MemoryEnd,
    control: Control<Command>,
    thread: JoinHandle<(Segment<Listener>, Vec<News>)>,
}

fn start(stations: Vec<Listener>, settings: Settings) -> Running {
    let (end, master) = pair();
    let mut segment = Segment::new(Box::new(end), WallClock::new(), settings);
    for station in stations {
        segment.add(station);
    }
    let (control, commands) = segment.control();
    let thread = thread::spawn(move || {
        let mut host = Host::default();
        segment.run(&commands, &mut host).unwrap();
        (segment, host.news)
    });
    Running { master, control, thread }
}

impl Running {
    fn send(&mut self, octets: &[u8]) {
        let _ = self.master.write(octets).unwrap();
    }

    /// What comes within 50 ms, or as soon as it is as much as expected.
    fn hear(&mut self, expected: usize) -> Vec<u8> {
        let mut heard = Vec::new();
        let mut buffer = [0; 512];
        let until = Moment::now() + if expected == 0 { Time::from_millis(50) } else { Time::from_secs(2) };
        while (expected == 0 || heard.len() < expected) && Moment::now() < until {
            if let Event::Octets(count) =
                self.master.wait(Some(Duration::from_millis(5)), &mut buffer).unwrap()
            {
                heard.extend_from_slice(&buffer[..count]);
            }
        }
        heard
    }

    fn ask(&mut self, octets: &[u8]) -> Vec<u8> {
        self.send(octets);
        self.hear(6)
    }

    fn stop(self) -> (Vec<Listener>, Counters, Vec<News>) {
        self.control.stop();
        let (segment, news) = self.thread.join().unwrap();
        let counters = segment.counters();
        (segment.into_stations(), counters, news)
    }
}

#[test]
fn stations_answer_at_their_addresses_and_nobody_else_does() {
    let mut bus = start((1..=125).map(Listener::at).collect(), Settings::default());
    for address in [1, 11, 125] {
        assert_eq!(bus.ask(&status(address)), status_answer(address));
    }
    bus.send(&status(126));
    assert!(bus.hear(0).is_empty());
    let (_, counters, news) = bus.stop();
    assert_eq!((counters.telegrams, counters.replies), (4, 3));
    assert_eq!(news, [News::MasterCame(None)]);
}

#[test]
fn dribbled_octets_make_a_telegram() {
    let mut bus = start(vec![Listener::at(11)], Settings::default());
    // A busy computer may make too long a pause in between; not five times.
    let answered = (0..5).any(|_| {
        for octet in STATUS_11 {
            bus.send(&[octet]);
            thread::sleep(Time::from_micros(500));
        }
        bus.hear(0) == STATUS_11_ANSWER
    });
    assert!(answered);
    bus.stop();
}

#[test]
fn a_good_telegram_after_garbage_and_a_pause_is_answered() {
    let mut bus = start(vec![Listener::at(11)], Settings::default());
    bus.send(&[0xFF, 0x68, 0xF9, 0xF9, 0x68, 0x00]);
    thread::sleep(Time::from_millis(30));
    assert_eq!(bus.ask(&STATUS_11), STATUS_11_ANSWER);
    // A false header hides nothing that is not inside it.
    bus.send(&[0x16, 0x68, 0x05, 0x05]);
    assert_eq!(bus.ask(&STATUS_11), STATUS_11_ANSWER);
    bus.stop();
}

#[test]
fn a_master_that_has_gone_on_is_not_answered_but_heard() {
    let mut bus = start(vec![Listener::at(11), Listener::at(12)], Settings::default());
    // The next request is under way.
    bus.send(&[&STATUS_11[..], &STATUS_11[..2]].concat());
    assert!(bus.hear(0).is_empty());
    bus.send(&STATUS_11[2..]);
    assert!(bus.hear(0).is_empty(), "its beginning is too old by now");
    // The next one is there: only that is answered.
    assert_eq!(bus.ask(&[&STATUS_11[..], &status(12)].concat()), status_answer(12));
    let (stations, counters, _) = bus.stop();
    assert_eq!(stations[0].heard.len(), 2);
    assert_eq!((counters.replies, counters.overtaken), (1, 2));
}

#[test]
fn stations_hear_broadcasts_all_and_others_now_and_then() {
    let mut bus = start(vec![Listener::at(11), Listener::at(12)], Settings::default());
    for _ in 0..3 {
        bus.send(&[0x68, 0x07, 0x07, 0x68, 0xFF, 0x82, 0x46, 0x3A, 0x3E, 0x02, 0x00, 0x41, 0x16]);
    }
    let begun = Moment::now();
    let mut exchanges = 0;
    while begun.elapsed() < Time::from_millis(300) {
        assert_eq!(bus.ask(&STATUS_11), STATUS_11_ANSWER);
        exchanges += 1;
    }
    let (stations, ..) = bus.stop();
    assert_eq!(stations[0].heard.len(), 3 + exchanges);
    let foreign = stations[1].heard.len() - 3;
    assert!((1..=7).contains(&foreign), "{foreign} of {exchanges}");
}

#[test]
fn a_reply_older_than_the_limit_is_not_sent() {
    let settings = Settings { reply_limit: Duration::from_millis(30), ..Settings::default() };
    let mut slow = Listener::at(11);
    slow.slow = Time::from_millis(45);
    let mut bus = start(vec![slow], settings);
    bus.send(&STATUS_11);
    assert!(bus.hear(0).is_empty());
    thread::sleep(Time::from_millis(45));
    bus.control
        .send(Box::new(|segment| {
            segment.stations_mut()[0].slow = Time::ZERO;
            ControlFlow::Continue(())
        }))
        .unwrap();
    assert_eq!(bus.ask(&STATUS_11), STATUS_11_ANSWER);
    let (_, counters, _) = bus.stop();
    assert_eq!((counters.late, counters.replies), (1, 1));
}

#[test]
fn paced_replies_end_when_they_would_on_a_bus() {
    let settings = Settings { pace: true, ..Settings::default() };
    let mut bus = start(vec![Listener::at(11).at_rate(Baudrate::B9600).with_min_tsdr(200)], settings);
    bus.master.set_rate(Some(Baudrate::B9600));
    let begun = Moment::now();
    assert_eq!(bus.ask(&STATUS_11), STATUS_11_ANSWER);
    // Six octets, min T_SDR and six octets: 332 bit times.
    let took = begun.elapsed();
    assert!((Time::from_micros(34_583)..Time::from_millis(200)).contains(&took), "{took:?}");
    // Who goes on before that gets nothing.
    bus.send(&STATUS_11);
    thread::sleep(Time::from_millis(3));
    bus.send(&status(12));
    assert!(bus.hear(0).is_empty());
    let (_, counters, news) = bus.stop();
    assert_eq!((counters.replies, counters.overtaken), (1, 1));
    assert_eq!(news, [News::MasterCame(Some(Baudrate::B9600))]);
}

#[test]
fn the_rate_of_the_master_is_told_and_who_listens_elsewhere_hears_noise() {
    let mut bus = start(vec![Listener::at(11).at_rate(Baudrate::B19200)], Settings::default());
    assert_eq!(bus.ask(&STATUS_11), STATUS_11_ANSWER, "an end without a rate");
    bus.master.set_rate(Some(Baudrate::B9600));
    bus.send(&STATUS_11);
    assert!(bus.hear(0).is_empty());
    bus.master.set_rate(Some(Baudrate::B19200));
    assert_eq!(bus.ask(&STATUS_11), STATUS_11_ANSWER);
    let (stations, _, news) = bus.stop();
    let rates = [None, Some(Baudrate::B9600), Some(Baudrate::B19200)];
    assert_eq!(stations[0].rates, rates);
    assert_eq!(stations[0].line_errors, 1);
    assert_eq!(news, [News::MasterCame(rates[0]), News::RateChanged(rates[1]), News::RateChanged(rates[2])]);
}

#[test]
fn two_stations_with_one_address_give_garbage() {
    let mut bus = start(vec![Listener::at(11), Listener::at(11)], Settings::default());
    let heard = bus.ask(&STATUS_11);
    assert_eq!(heard.len(), 6);
    assert_ne!(heard, STATUS_11_ANSWER);
    let (_, counters, _) = bus.stop();
    assert_eq!((counters.collisions, counters.replies), (1, 1));
}

#[test]
fn a_new_address_counts_from_the_next_telegram_on() {
    let mut mover = Listener::at(11);
    mover.moves_to = Some(12);
    let mut bus = start(vec![mover], Settings::default());
    assert_eq!(bus.ask(&STATUS_11), STATUS_11_ANSWER);
    bus.send(&STATUS_11);
    assert!(bus.hear(0).is_empty());
    assert_eq!(bus.ask(&status(12)), status_answer(12));
    bus.stop();
}

#[test]
fn stations_are_polled_at_their_deadlines_without_any_traffic() {
    let bus = start(vec![Listener::at(11).polled_every(Duration::from_millis(2))], Settings::default());
    // 250 times, were nothing else to run on this computer.
    thread::sleep(Time::from_millis(500));
    let (stations, ..) = bus.stop();
    let polls = &stations[0].polls;
    assert!(polls.len() >= 10, "{}", polls.len());
    for (number, at) in (1..).zip(polls) {
        assert!(*at >= Instant::from_millis(2 * number));
    }
}

#[test]
fn commands_reach_the_segment_while_it_sleeps_and_in_order() {
    let bus = start(vec![Listener::at(11)], Settings::default());
    let (sender, receiver) = std::sync::mpsc::channel();
    for number in 0..100 {
        let sender = sender.clone();
        bus.control
            .send(Box::new(move |segment| {
                sender.send((number, segment.stations().len())).unwrap();
                ControlFlow::Continue(())
            }))
            .unwrap();
        if number % 10 == 0 {
            thread::sleep(Time::from_millis(1));
        }
    }
    for number in 0..100 {
        assert_eq!(receiver.recv_timeout(Time::from_secs(2)).unwrap(), (number, 1));
    }
    let begun = Moment::now();
    bus.stop();
    assert!(begun.elapsed() < Time::from_secs(1));
}

#[test]
fn a_command_may_end_the_run_and_later_ones_come_back() {
    let bus = start(vec![Listener::at(11)], Settings::default());
    bus.control.send(Box::new(|_| ControlFlow::Break(()))).unwrap();
    wait_until("the segment to stop", || bus.thread.is_finished());
    let refused = bus.control.send(Box::new(|_| ControlFlow::Break(()))).unwrap_err();
    assert!(refused.to_string().contains("start it again"));
    bus.thread.join().unwrap();
}

#[test]
fn a_master_that_leaves_takes_his_half_telegram_along() {
    let mut bus = start(vec![Listener::at(11)], Settings::default());
    bus.send(&STATUS_11[..4]);
    drop(std::mem::replace(&mut bus.master, pair().0));
    thread::sleep(Time::from_millis(20));
    let (stations, counters, news) = bus.stop();
    assert!(stations[0].heard.is_empty());
    assert_eq!(counters, Counters::default());
    assert_eq!(news, [News::MasterCame(None), News::MasterLeft]);
}
