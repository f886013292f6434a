//! Bus times of virtual segments, and the faults on them.

mod common;

use bus::virtual_segment::idle_time;
use bus::{Answer, Reply, ReplyFault, VirtualSegment};
use common::{Listener, STATUS_11, STATUS_11_ANSWER, status, status_answer};
use profibus_dp::fdl::{BaudSearch, BaudSetting, Station, Window};
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};
use profibus_dp::wire::Telegram;

fn segment(rate: Baudrate) -> VirtualSegment<Listener> {
    VirtualSegment::new(Instant::ZERO, rate)
}

fn reply(answer: Answer<'_>) -> Reply<'_> {
    match answer {
        Answer::Reply(reply) => reply,
        Answer::Silence { until } => panic!("silence until {until:?}"),
    }
}

fn silence(answer: &Answer<'_>) -> bool {
    matches!(answer, Answer::Silence { .. })
}

#[test]
fn octets_take_eleven_bit_times_and_replies_start_at_min_tsdr() {
    for rate in Baudrate::ALL {
        for min_tsdr in [11, 15, 60] {
            let mut bus = segment(rate);
            bus.add(Listener::at(11).at_rate(rate).with_min_tsdr(min_tsdr));
            let reply = reply(bus.send(&STATUS_11));
            assert_eq!(reply.octets, STATUS_11_ANSWER);
            let (start, end, damaged, delay) = (reply.start, reply.end, reply.damaged, reply.delay);
            // The master's idle time, six octets, and then the station.
            let asked = Instant::ZERO + rate.duration(idle_time(rate)) + rate.duration(BitTimes(66));
            assert_eq!(delay, rate.duration(BitTimes(min_tsdr)), "{rate} {min_tsdr}");
            assert_eq!(start, asked + delay);
            assert_eq!(end, start + rate.duration(BitTimes(66)));
            assert_eq!(bus.now(), end);
            assert!(!damaged);
        }
    }
}

#[test]
fn silence_lasts_for_the_slot_time() {
    let mut bus = segment(Baudrate::B1500000);
    bus.add(Listener::at(11).at_rate(Baudrate::B1500000));
    let asked = Baudrate::B1500000.duration(BitTimes(37)) + Baudrate::B1500000.duration(BitTimes(66));
    let until = Instant::ZERO + asked + Baudrate::B1500000.duration(BitTimes(300));
    assert_eq!(bus.send(&status(12)), Answer::Silence { until });
    assert_eq!(bus.now(), until);

    // A station that is not allowed to answer within the slot time is not heard.
    bus.stations_mut()[0].min_tsdr = BitTimes(301);
    assert!(silence(&bus.send(&STATUS_11)));
    bus.set_slot_time(BitTimes(301));
    assert_eq!(reply(bus.send(&STATUS_11)).octets, STATUS_11_ANSWER);
}

#[test]
fn stations_at_another_rate_get_line_errors_instead() {
    let mut bus = segment(Baudrate::B19200);
    bus.add(Listener::at(11).at_rate(Baudrate::B500000));
    assert!(silence(&bus.send(&STATUS_11)));
    assert_eq!(bus.stations()[0].line_errors, 6);
    assert!(bus.stations()[0].heard.is_empty());
    bus.set_rate(Baudrate::B500000);
    assert_eq!(reply(bus.send(&STATUS_11)).octets, STATUS_11_ANSWER);
    assert_eq!(bus.stations()[0].line_errors, 6);
}

#[test]
fn every_other_station_hears_requests_and_replies_but_none_its_own() {
    let mut bus = segment(Baudrate::B500000);
    for address in [11, 12] {
        bus.add(Listener::at(address));
    }
    reply(bus.send(&STATUS_11));
    let asked = bus.stations()[0].heard.clone();
    assert_eq!(asked.len(), 1);
    // The newest counts; station 12 is told of it before anybody looks.
    let ended = bus.now();
    assert_eq!(bus.stations_mut()[1].heard, [ended]);
    assert_eq!(bus.stations()[0].heard, asked);
    bus.wait(Duration::from_millis(1));
    bus.stations_mut();
    assert_eq!(bus.stations()[1].heard.len(), 1, "once");
}

#[test]
fn a_station_hears_of_the_bus_before_its_deadline() {
    let mut bus = segment(Baudrate::B500000);
    bus.add(Listener::at(11));
    bus.add(Listener::at(12).polled_every(Duration::from_millis(10)));
    reply(bus.send(&STATUS_11));
    let ended = bus.now();
    assert!(bus.stations()[1].heard.is_empty());
    bus.wait(Duration::from_millis(10));
    assert_eq!(bus.stations()[1].heard, [ended]);
    assert_eq!(bus.stations()[1].polls.len(), 1);
    // In the middle of a telegram too: that one has not ended yet.
    let early = Instant::from_millis(20) - Baudrate::B500000.duration(BitTimes(60));
    bus.wait(early.since(bus.now()));
    bus.send_only(&STATUS_11);
    assert_eq!(bus.stations()[1].polls, [Instant::from_millis(10), Instant::from_millis(20)]);
    assert_eq!(bus.stations()[1].heard, [ended]);
    let ended_again = bus.now();
    bus.wait(Duration::from_millis(10));
    assert_eq!(bus.stations()[1].heard, [ended, ended_again]);
}

// Six octets of 22 us. What ends before it changes it has heard, the third to sixth it cannot read.
#[test]
fn a_station_that_changes_its_rate_within_a_telegram_hears_errors_from_there_on() {
    let mut bus = segment(Baudrate::B500000);
    bus.add(Listener::at(11));
    bus.add(Listener::at(12).polled_every(Duration::from_millis(1)));
    bus.stations_mut()[1].retunes_to = Some(Baudrate::B93750);
    bus.wait(Duration::from_micros(1_000 - 50));
    bus.send_more(&STATUS_11);
    assert_eq!((bus.stations()[1].polls.len(), bus.stations()[1].line_errors), (1, 4));
    assert_eq!((bus.stations()[0].heard.len(), bus.stations()[0].line_errors), (1, 0));
    let ended = bus.now();
    assert_eq!(ended, Instant::from_micros(950 + 6 * 22));
    let Reply { octets, start, .. } = reply(bus.listen());
    assert_eq!((octets, start), (&STATUS_11_ANSWER[..], ended + Baudrate::B500000.duration(BitTimes(11))));
    assert_eq!(bus.stations()[1].line_errors, 10, "nor the answer");
    assert!(bus.stations()[1].heard.is_empty());
}

#[test]
fn deadlines_are_kept_to_the_nanosecond_however_close_they_are() {
    let mut bus = segment(Baudrate::B500000);
    for nanos in [1_000_000, 1_000_001, 1_003_000] {
        bus.add(Listener::at(11).polled_every(Duration::from_nanos(nanos)));
    }
    // One that never has enough does not hold up the others, nor time.
    bus.add(Listener::at(12).polled_every(Duration::ZERO));
    bus.wait(Duration::from_micros(2_500));
    for (station, nanos) in bus.stations().iter().zip([1_000_000, 1_000_001, 1_003_000]) {
        assert_eq!(station.polls, [1, 2].map(|count| Instant::from_nanos(count * nanos)));
    }
    let often: Vec<_> = (0..=25).map(|count| Instant::from_micros(count * 100)).collect();
    assert_eq!(bus.stations()[3].polls, often);
}

#[test]
fn a_broadcast_is_heard_at_once() {
    let mut bus = segment(Baudrate::B500000);
    for address in [11, 12] {
        bus.add(Listener::at(address));
    }
    // Global_Control: SDN to 127, SAP 58.
    bus.send_only(&[0x68, 0x07, 0x07, 0x68, 0xFF, 0x82, 0x46, 0x3A, 0x3E, 0x02, 0x00, 0x41, 0x16]);
    for station in bus.stations() {
        assert_eq!(station.heard, [bus.now()]);
    }
}

#[test]
fn stations_are_polled_when_they_want_to_be() {
    let mut bus = segment(Baudrate::B9600);
    bus.add(Listener::at(11).at_rate(Baudrate::B9600).polled_every(Duration::from_millis(1)));
    reply(bus.send(&STATUS_11));
    bus.wait(Instant::from_millis(100).since(bus.now()));
    let expected: Vec<_> = (1..=100).map(Instant::from_millis).collect();
    assert_eq!(bus.stations()[0].polls, expected);
}

#[test]
fn a_master_that_goes_on_gets_no_reply_to_what_was_before() {
    let mut bus = segment(Baudrate::B500000);
    for address in [11, 12] {
        bus.add(Listener::at(address));
    }
    bus.send_only(&STATUS_11);
    assert_eq!(reply(bus.send(&status(12))).octets, status_answer(12));
    bus.send_only(&STATUS_11);
    bus.send_more(&[0xE5]);
    assert!(silence(&bus.listen()));
}

#[test]
fn a_telegram_with_a_long_gap_in_it_does_not_exist() {
    let mut bus = segment(Baudrate::B500000);
    bus.add(Listener::at(11));
    bus.send_only(&STATUS_11[..3]);
    bus.send_more(&STATUS_11[3..]);
    assert_eq!(reply(bus.listen()).octets, STATUS_11_ANSWER);
    bus.send_only(&STATUS_11[..3]);
    bus.wait(Baudrate::B500000.duration(BitTimes(34)));
    bus.send_more(&STATUS_11[3..]);
    assert!(silence(&bus.listen()));
    assert_eq!(reply(bus.send(&STATUS_11)).octets, STATUS_11_ANSWER);
}

#[test]
fn two_stations_with_one_address_collide() {
    let mut bus = segment(Baudrate::B500000);
    bus.add(Listener::at(11));
    bus.add(Listener::at(11));
    let both = reply(bus.send(&STATUS_11));
    assert!(both.damaged);
    assert_eq!(both.octets.len(), 6);
    assert_ne!(both.octets, STATUS_11_ANSWER);
    assert_eq!(bus.collisions(), 1);
    // The slower one hears the faster one, and keeps still.
    bus.stations_mut()[1].min_tsdr = BitTimes(30);
    let one = reply(bus.send(&STATUS_11));
    assert!(!one.damaged);
    assert_eq!(one.octets, STATUS_11_ANSWER);
    assert_eq!(bus.collisions(), 1);
}

#[test]
fn replies_are_lost_damaged_or_doubled_as_asked() {
    let mut bus = segment(Baudrate::B500000);
    bus.add(Listener::at(11));
    for fault in [ReplyFault::Lose, ReplyFault::Corrupt { octet: 3, mask: 0x81 }, ReplyFault::Double] {
        bus.fail_next_reply(fault);
    }
    assert!(silence(&bus.send(&STATUS_11)));
    assert_eq!(reply(bus.send(&STATUS_11)).octets, [0x10, 0x02, 0x0B, 0x81, 0x0D, 0x16]);
    assert_eq!(reply(bus.send(&STATUS_11)).octets, &[STATUS_11_ANSWER, STATUS_11_ANSWER].concat());
    assert_eq!(reply(bus.send(&STATUS_11)).octets, STATUS_11_ANSWER);
}

#[test]
fn a_new_address_counts_from_the_next_telegram_on() {
    let mut bus = segment(Baudrate::B500000);
    bus.add(Listener::at(11));
    bus.stations_mut()[0].moves_to = Some(12);
    assert_eq!(reply(bus.send(&STATUS_11)).octets, STATUS_11_ANSWER);
    assert!(silence(&bus.send(&STATUS_11)));
    assert_eq!(reply(bus.send(&status(12))).octets, status_answer(12));
}

/// A station that searches.
#[derive(Debug)]
struct Searcher(BaudSearch, Listener);

impl Station for Searcher {
    fn receive(&mut self, _: Instant, _: &[u8]) -> Option<Window> {
        unreachable!("segments parse telegrams themselves");
    }

    fn indicate(&mut self, now: Instant, telegram: &Telegram<'_>) -> Option<Window> {
        if self.0.life(now) { None } else { self.1.indicate(now, telegram) }
    }

    fn line_error(&mut self, now: Instant) {
        self.0.line_error(now);
    }

    fn transmit(&mut self, now: Instant) -> Option<&[u8]> {
        self.1.transmit(now)
    }

    fn poll(&mut self, now: Instant) {
        self.0.poll(now, false);
    }

    fn next_deadline(&self) -> Option<Instant> {
        self.0.deadline(false)
    }

    fn listening_rate(&self) -> Baudrate {
        self.0.rate()
    }

    fn address(&self) -> Option<u8> {
        self.1.address()
    }
}

// The first telegram ends the search of all that hear it; who is asked next answers.
#[test]
fn a_telegram_for_another_station_ends_the_search_for_the_rate() {
    let mut bus = VirtualSegment::new(Instant::ZERO, Baudrate::B500000);
    for address in [11, 12] {
        let search = BaudSearch::new(Instant::ZERO, BaudSetting::Search(Baudrate::B500000));
        bus.add(Searcher(search, Listener::at(address)));
    }
    assert!(silence(&bus.send(&status(12))));
    assert_eq!(reply(bus.send(&STATUS_11)).octets, STATUS_11_ANSWER);
    // After a silence of more than 5 s they search again, and come by the rate again.
    bus.wait(Duration::from_secs(6));
    assert!(!bus.stations()[0].0.is_found());
    bus.wait(Duration::from_secs(20));
    while bus.stations()[0].0.rate() != Baudrate::B500000 {
        bus.wait(Duration::from_millis(10));
    }
    assert!(silence(&bus.send(&status(12))));
    assert_eq!(reply(bus.send(&STATUS_11)).octets, STATUS_11_ANSWER);
}
