//! Ends that hear one rate at a time: stations that search, and characters with errors.

mod common;

use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::sync::{Arc, Condvar, Mutex};
use std::thread;
use std::time::{Duration as Time, Instant as Moment};

use bus::end::Wake;
use bus::{
    Control, Counters, End, EndError, Event, Handler, RateListener, Segment, Settings, Waker, WallClock,
    Written,
};
use common::{Listener, STATUS_11, STATUS_11_ANSWER, status, status_answer, wait_until};
use profibus_dp::fdl::{BaudSearch, BaudSetting, Station, Window};
use profibus_dp::time::{Baudrate, Duration, Instant};
use profibus_dp::wire::Telegram;

/// A line with a master of one rate. Who listens at another gets nothing but errors.
#[derive(Debug)]
struct Wire {
    shared: Arc<(Mutex<Shared>, Condvar)>,
}

#[derive(Debug)]
struct Shared {
    rate: Baudrate,
    tuned: Vec<Baudrate>,
    /// `None`: a character that is broken at every rate.
    coming: VecDeque<Option<u8>>,
    sent: Vec<u8>,
    woken: bool,
}

impl Wire {
    fn new(rate: Baudrate) -> (Self, Self) {
        let shared =
            Shared { rate, tuned: Vec::new(), coming: VecDeque::new(), sent: Vec::new(), woken: false };
        let shared = Arc::new((Mutex::new(shared), Condvar::new()));
        (Self { shared: Arc::clone(&shared) }, Self { shared })
    }

    fn with<R>(&self, work: impl FnOnce(&mut Shared) -> R) -> R {
        let result = work(&mut self.shared.0.lock().unwrap());
        self.shared.1.notify_all();
        result
    }

    fn send(&self, octets: impl IntoIterator<Item = Option<u8>>) {
        self.with(|shared| shared.coming.extend(octets));
    }

    fn send_good(&self, octets: &[u8]) {
        self.send(octets.iter().copied().map(Some));
    }

    fn take_sent(&self) -> Vec<u8> {
        self.with(|shared| std::mem::take(&mut shared.sent))
    }

    fn expect(&self, octets: &[u8]) {
        let mut all = Vec::new();
        wait_until("a reply", || {
            all.extend(self.take_sent());
            all.len() >= octets.len()
        });
        assert_eq!(all, octets);
    }

    /// The first telegram that a station hears ends its search, and is not answered.
    fn end_search_of(&self, addresses: &[u8]) {
        for &address in addresses {
            self.send_good(&status(address));
            thread::sleep(Time::from_millis(20));
            assert_eq!(self.take_sent(), []);
        }
    }

    /// Asks again and again until there is an answer.
    fn ask_until_answered(&self, request: &[u8], pause: Time) -> Vec<u8> {
        let begun = Moment::now();
        loop {
            self.send_good(request);
            thread::sleep(pause);
            let sent = self.take_sent();
            if !sent.is_empty() {
                return sent;
            }
            assert!(begun.elapsed() < Time::from_secs(20), "no answer: {:?}", self.with(|s| s.tuned.clone()));
        }
    }
}

impl Wake for Wire {
    fn wake(&self) {
        self.with(|shared| shared.woken = true);
    }
}

impl End for Wire {
    fn wait(&mut self, timeout: Option<Duration>, buffer: &mut [u8]) -> Result<Event, EndError> {
        let mut shared = self.shared.0.lock().unwrap();
        let idle = |shared: &mut Shared| shared.coming.is_empty() && !shared.woken;
        let limit = timeout.unwrap_or(Duration::from_secs(30)).into();
        shared = self.shared.1.wait_timeout_while(shared, limit, idle).unwrap().0;
        if std::mem::take(&mut shared.woken) {
            return Ok(Event::Woken);
        }
        let tuned = shared.tuned.last() == Some(&shared.rate);
        let mut count = 0;
        while let Some(next) = shared.coming.front().copied() {
            match next.filter(|_| tuned) {
                Some(octet) => buffer[count] = octet,
                None if count > 0 => break,
                None => {
                    shared.coming.pop_front();
                    return Ok(Event::LineError);
                }
            }
            count += 1;
            shared.coming.pop_front();
        }
        Ok(if count > 0 { Event::Octets(count) } else { Event::TimedOut })
    }

    fn write(&mut self, octets: &[u8]) -> Result<Written, EndError> {
        self.with(|shared| shared.sent.extend_from_slice(octets));
        Ok(Written::All)
    }

    fn name(&self) -> &'static str {
        "wire"
    }

    fn is_tunable(&self) -> bool {
        true
    }

    fn tune(&mut self, rate: Baudrate) -> Result<(), EndError> {
        self.with(|shared| {
            shared.tuned.push(rate);
            shared.coming.clear();
        });
        Ok(())
    }

    fn waker(&self) -> Waker {
        Waker::new(Arc::new(Self { shared: Arc::clone(&self.shared) }))
    }
}

/// A station that searches.
#[derive(Debug)]
struct Searcher {
    search: BaudSearch,
    station: Listener,
    errors: usize,
}

impl Searcher {
    fn at(address: Option<u8>, first: Baudrate) -> Self {
        let mut station = Listener::at(11);
        station.address = address;
        Self { search: BaudSearch::new(Instant::ZERO, BaudSetting::Search(first)), station, errors: 0 }
    }
}

impl Station for Searcher {
    fn receive(&mut self, _: Instant, _: &[u8]) -> Option<Window> {
        unreachable!("segments parse telegrams themselves");
    }

    fn indicate(&mut self, now: Instant, telegram: &Telegram<'_>) -> Option<Window> {
        if self.search.life(now) {
            return None;
        }
        self.station.indicate(now, telegram)
    }

    fn line_error(&mut self, now: Instant) {
        self.errors += 1;
        self.search.line_error(now);
    }

    fn transmit(&mut self, now: Instant) -> Option<&[u8]> {
        self.station.transmit(now)
    }

    fn poll(&mut self, now: Instant) {
        self.search.poll(now, false);
    }

    fn next_deadline(&self) -> Option<Instant> {
        self.search.deadline(false)
    }

    fn listening_rate(&self) -> Baudrate {
        self.search.rate()
    }

    fn address(&self) -> Option<u8> {
        self.station.address
    }
}

impl RateListener for Searcher {
    fn rate_found(&mut self, _: Instant, _: Option<Baudrate>) {
        panic!("the end does not know the rate");
    }
}

struct Quiet;

impl Handler<Searcher> for Quiet {
    type Command = ();

    fn command(&mut self, _: &mut Segment<Searcher>, (): ()) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

struct Running {
    control: Control<()>,
    thread: thread::JoinHandle<(Vec<Searcher>, Counters)>,
}

fn start(end: Wire, stations: Vec<Searcher>) -> Running {
    let settings = Settings { reply_limit: Duration::from_secs(4), ..Settings::default() };
    let mut segment = Segment::new(Box::new(end), WallClock::new(), settings);
    for station in stations {
        segment.add(station);
    }
    let (control, commands) = segment.control();
    let thread = thread::spawn(move || {
        segment.run(&commands, &mut Quiet).unwrap();
        let counters = segment.counters();
        (segment.into_stations(), counters)
    });
    Running { control, thread }
}

impl Running {
    fn end(self) -> (Vec<Searcher>, Counters) {
        self.control.stop();
        self.thread.join().unwrap()
    }
}

#[test]
fn a_character_with_an_error_spoils_its_telegram_and_reaches_every_station() {
    let (end, wire) = Wire::new(Baudrate::B500000);
    let first = Baudrate::B500000;
    let running = start(end, vec![Searcher::at(Some(11), first), Searcher::at(Some(12), first)]);
    wait_until("the rate", || wire.with(|shared| shared.tuned == [first]));
    wire.end_search_of(&[11, 12]);
    // A good telegram with one error in it, at every place; then a good one straight after.
    for at in 0..STATUS_11.len() {
        let broken = STATUS_11.iter().enumerate().map(|(other, &octet)| (other != at).then_some(octet));
        wire.send(broken);
        thread::sleep(Time::from_millis(20));
        assert_eq!(wire.take_sent(), [], "broken at {at}");
    }
    wire.send_good(&status(12));
    wire.expect(&status_answer(12));
    // An error among the octets is no octet: around it there is no telegram either.
    wire.send(STATUS_11[..3].iter().copied().map(Some).chain([None]));
    wire.send_good(&STATUS_11[3..]);
    thread::sleep(Time::from_millis(20));
    assert_eq!(wire.take_sent(), []);
    let (stations, counters) = running.end();
    assert_eq!(counters.line_errors, 7);
    assert_eq!(stations.iter().map(|station| station.errors).collect::<Vec<_>>(), [7, 7]);
    assert_eq!(counters.replies, 1);
}

#[test]
fn an_error_after_a_request_means_that_the_master_has_gone_on() {
    let (end, wire) = Wire::new(Baudrate::B9600);
    let mut station = Searcher::at(Some(11), Baudrate::B9600);
    // 100 ms, so that no reply is out before the error.
    station.station = station.station.at_rate(Baudrate::B9600).with_min_tsdr(960);
    let running = start(end, vec![station]);
    wait_until("the rate", || wire.with(|shared| !shared.tuned.is_empty()));
    wire.end_search_of(&[11]);
    wire.send(STATUS_11.iter().copied().map(Some).chain([None]));
    thread::sleep(Time::from_millis(200));
    assert_eq!(wire.take_sent(), []);
    wire.send_good(&STATUS_11);
    wire.expect(&STATUS_11_ANSWER);
    let (_, counters) = running.end();
    assert_eq!((counters.replies, counters.overtaken, counters.line_errors), (1, 1, 1));
}

#[test]
fn errors_lead_the_search_to_the_rate_of_the_master() {
    let (end, wire) = Wire::new(Baudrate::B187500);
    let first = Baudrate::B500000;
    let running = start(end, vec![Searcher::at(Some(11), first), Searcher::at(Some(12), first)]);
    // Six errors for each request, twenty for each rate.
    let answer = wire.ask_until_answered(&status(12), Time::from_millis(5));
    assert_eq!(answer, status_answer(12));
    let due = [
        Baudrate::B500000,
        Baudrate::B12000000,
        Baudrate::B6000000,
        Baudrate::B3000000,
        Baudrate::B1500000,
        Baudrate::B500000,
        Baudrate::B187500,
    ];
    assert_eq!(wire.with(|shared| shared.tuned.clone()), due);
    wire.take_sent();
    thread::sleep(Time::from_millis(20));
    wire.take_sent();
    wire.send_good(&STATUS_11);
    wire.expect(&STATUS_11_ANSWER);
    running.end();
}

#[test]
fn silence_leads_the_search_on_and_the_end_goes_along() {
    let (end, wire) = Wire::new(Baudrate::B6000000);
    let running = start(end, vec![Searcher::at(Some(11), Baudrate::B12000000)]);
    let begun = Moment::now();
    wait_until("6 Mbit/s", || wire.with(|shared| shared.tuned.last() == Some(&Baudrate::B6000000)));
    assert!(begun.elapsed() >= BaudSearch::listening_time(Baudrate::B12000000).into());
    wire.end_search_of(&[11]);
    wire.send_good(&STATUS_11);
    wire.expect(&STATUS_11_ANSWER);
    running.end();
}

#[test]
fn the_end_follows_the_first_station_that_is_on_the_bus() {
    let (end, wire) = Wire::new(Baudrate::B93750);
    let stations = vec![
        Searcher::at(None, Baudrate::B1500000),
        Searcher::at(Some(11), Baudrate::B93750),
        // Parted from the other: it comes by on its search.
        Searcher::at(Some(12), Baudrate::B9600),
    ];
    let running = start(end, stations);
    wait_until("the rate", || wire.with(|shared| shared.tuned == [Baudrate::B93750]));
    wire.end_search_of(&[11]);
    wire.send_good(&STATUS_11);
    wire.expect(&STATUS_11_ANSWER);
    let answer = wire.ask_until_answered(&status(12), Time::from_millis(10));
    assert_eq!(answer, status_answer(12));
    assert_eq!(wire.with(|shared| shared.tuned.clone()), [Baudrate::B93750], "the end stays where it was");
    running.end();
}
