//! A segment under a virtual clock, with bus times kept exactly.
//!
//! Every octet takes eleven bit times, replies start where their window opens, stations are polled
//! at their deadlines, and nothing else takes any time.

use profibus_dp::Station;
use profibus_dp::fdl::{Receiver, ReceiverMode};
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};
use profibus_dp::wire::telegram::MAX_OCTETS;

use crate::clock::VirtualClock;
use crate::collision::collide;
use crate::faults::{Character, Faults, ReplyFault};
use crate::line::{characters, is_ours, starts_ours};
use crate::stations::Stations;

/// What a master hears after a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Answer {
    /// Octets that started within the slot time.
    Reply(Reply),
    /// None, until the slot time was over.
    Silence {
        /// When the master stopped waiting.
        until: Instant,
    },
}

/// Octets on the line, with their times.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reply {
    /// What a master makes of the octets; after a collision or a fault, not what was sent.
    pub octets: Vec<u8>,
    /// The first edge of the first octet.
    pub start: Instant,
    /// The end of the last octet's stop bit.
    pub end: Instant,
    /// From the end of the request to `start`.
    pub delay: Duration,
    /// The master's receiver sees character errors.
    pub damaged: bool,
}

/// Stations on a bus in virtual time, with one master that gives octets.
#[derive(Debug)]
pub struct VirtualSegment<S> {
    stations: Stations<S>,
    clock: VirtualClock,
    rate: Baudrate,
    slot: BitTimes,
    receiver: Receiver,
    /// End of the last octet on the line.
    quiet_since: Instant,
    faults: Faults,
    collisions: u64,
    /// For each station, whether it listens at the right rate from the start of what is sent.
    tuned: Vec<bool>,
    repliers: Vec<(Instant, usize)>,
}

impl<S: Station> VirtualSegment<S> {
    /// A bus without stations at time `now`, quiet for long.
    pub fn new(now: Instant, rate: Baudrate) -> Self {
        Self {
            stations: Stations::new(),
            clock: VirtualClock::new(now),
            rate,
            slot: slot_time(rate),
            receiver: Receiver::new(ReceiverMode::Idle, rate),
            quiet_since: Instant::ZERO,
            faults: Faults::default(),
            collisions: 0,
            tuned: Vec::new(),
            repliers: Vec::new(),
        }
    }

    /// Adds a station, and says by which number it is known here.
    pub fn add(&mut self, station: S) -> usize {
        self.stations.push(station)
    }

    /// The stations, in the order they were added.
    pub fn stations(&self) -> &[S] {
        self.stations.as_slice()
    }

    /// The stations, to be changed.
    pub fn stations_mut(&mut self) -> &mut [S] {
        self.stations.as_mut_slice()
    }

    /// Ends the segment and gives its stations back.
    pub fn into_stations(self) -> Vec<S> {
        self.stations.into_vec()
    }

    /// The time on the bus.
    pub fn now(&self) -> Instant {
        self.clock.now()
    }

    /// The master's rate.
    pub fn rate(&self) -> Baudrate {
        self.rate
    }

    /// The master goes on at another rate, with its usual slot time.
    pub fn set_rate(&mut self, rate: Baudrate) {
        self.rate = rate;
        self.slot = slot_time(rate);
        self.receiver.set_baudrate(rate);
    }

    /// How long the master waits for the start of a reply.
    pub fn set_slot_time(&mut self, slot: BitTimes) {
        self.slot = slot;
    }

    /// What happens to the next reply that has no fault in store yet.
    ///
    /// Nothing happens where [`MOST_WAITING`](crate::faults::MOST_WAITING) wait already.
    pub fn fail_next_reply(&mut self, fault: ReplyFault) {
        let _ = self.faults.fail_next_reply(fault);
    }

    /// What goes wrong on the line.
    pub fn faults(&self) -> &Faults {
        &self.faults
    }

    /// What goes wrong on the line, to be changed.
    pub fn faults_mut(&mut self) -> &mut Faults {
        &mut self.faults
    }

    /// How often two stations answered at once.
    pub fn collisions(&self) -> u64 {
        self.collisions
    }

    /// Lets time pass, with nothing on the line.
    pub fn wait(&mut self, span: Duration) {
        self.stations.refresh_all();
        self.advance_to(self.now() + span);
    }

    /// The master sends octets after the idle time that a request needs, and listens until a reply
    /// has ended or the slot time is over.
    pub fn send(&mut self, octets: &[u8]) -> Answer {
        self.send_only(octets);
        self.listen()
    }

    /// The master sends octets and does not listen: a request that nobody answers, or a master that
    /// goes on before the reply. Time stands at the end of the last octet.
    pub fn send_only(&mut self, octets: &[u8]) {
        self.stations.refresh_all();
        self.advance_to(self.quiet_since + self.rate.duration(idle_time(self.rate)));
        let start = self.now();
        self.repliers.clear();
        self.put_request_on_line(start, octets, true);
    }

    /// The master sends octets straight after those before, as the rest of what he began.
    pub fn send_more(&mut self, octets: &[u8]) {
        self.stations.refresh_all();
        self.repliers.clear();
        self.put_request_on_line(self.now(), octets, false);
    }

    /// The master listens until a reply has ended or the slot time is over.
    pub fn listen(&mut self) -> Answer {
        self.stations.refresh_all();
        let asked = self.quiet_since;
        let until = asked + self.rate.duration(self.slot);
        self.repliers.sort_unstable();
        let Some(&(start, first)) = self.repliers.first().filter(|(start, _)| *start <= until) else {
            self.advance_to(until);
            return Answer::Silence { until };
        };
        let start = start.max(self.now());
        self.advance_to(start);
        let mut line = [0; MAX_OCTETS];
        let mut length = self.hand_out(first, 0, &mut line);
        // Who starts before the first octet of the other has ended knows nothing of it.
        let blind = start + self.rate.duration(BitTimes::CHARACTER);
        let damaged = self.repliers.get(1).is_some_and(|(second, _)| *second < blind);
        if damaged {
            self.collisions += 1;
            for at in 1..self.repliers.len() {
                let (second, station) = self.repliers[at];
                if second < blind {
                    self.advance_to(second);
                    length = self.hand_out(station, length, &mut line);
                }
            }
        }
        self.repliers.clear();
        if length == 0 {
            self.advance_to(until);
            return Answer::Silence { until };
        }
        self.deliver(
            Reply { octets: line[..length].to_vec(), start, end: start, delay: start.since(asked), damaged },
            first,
            until,
        )
    }

    fn hand_out(&mut self, station: usize, length: usize, line: &mut [u8]) -> usize {
        let now = self.now();
        self.stations.call(station, |station| match station.transmit(now) {
            Some(octets) => collide(line, length, octets),
            None => length,
        })
    }

    /// The way of a reply to the master and to the other stations, with the faults on it.
    fn deliver(&mut self, mut reply: Reply, sender: usize, until: Instant) -> Answer {
        let mut characters = None;
        if self.faults.is_active() {
            let arrival = self.faults.reply(&reply.octets);
            reply.start += arrival.late_by;
            reply.delay = Duration::from_nanos(reply.delay.as_nanos() + arrival.late_by.as_nanos());
            if arrival.characters.is_empty() || reply.start > until {
                self.advance_to(until);
                return Answer::Silence { until };
            }
            self.advance_to(reply.start);
            reply.damaged |= arrival.characters.iter().any(|character| character.error);
            reply.octets = arrival.characters.iter().map(|character| character.octet).collect();
            characters = Some(arrival.characters);
        }
        if let Some(characters) = characters {
            self.put_characters_on_line(reply.start, &characters, Some(sender), false);
        } else {
            let octets = std::mem::take(&mut reply.octets);
            self.put_on_line(reply.start, &octets, Some(sender));
            reply.octets = octets;
        }
        reply.end = self.now();
        Answer::Reply(reply)
    }

    /// Octets of the master on the line from `start` on, `fresh` ones after idle time.
    fn put_request_on_line(&mut self, start: Instant, octets: &[u8], fresh: bool) {
        if !self.faults.is_active() {
            return self.put_on_line(start, octets, None);
        }
        let begins = fresh && starts_ours(&self.stations, octets);
        let characters = self.faults.request(octets, begins);
        self.put_characters_on_line(start, &characters, None, true);
    }

    /// Octets on the line from `start` on; everybody but `sender` hears them.
    fn put_on_line(&mut self, start: Instant, octets: &[u8], sender: Option<usize>) {
        let rate = self.rate;
        self.tuned.clear();
        self.tuned.extend(self.stations.as_slice().iter().map(|station| station.listening_rate() == rate));
        for (at, octet) in octets.iter().enumerate() {
            // From the start each time, so that nothing is rounded twice.
            self.advance_to(start + rate.duration(characters(at + 1)));
            self.one_octet(*octet, sender, false);
        }
        self.quiet_since = self.now();
    }

    /// The same for octets that may have suffered; `failing`: whole telegrams may still be lost or
    /// doubled.
    #[cold]
    fn put_characters_on_line(
        &mut self,
        start: Instant,
        arriving: &[Character],
        sender: Option<usize>,
        failing: bool,
    ) {
        let rate = self.rate;
        self.tuned.clear();
        self.tuned.extend(self.stations.as_slice().iter().map(|station| station.listening_rate() == rate));
        for (at, character) in arriving.iter().enumerate() {
            self.advance_to(start + rate.duration(characters(at + 1)));
            if !character.error {
                self.one_octet(character.octet, sender, failing);
                continue;
            }
            let now = self.now();
            self.receiver.line_error(now);
            self.repliers.clear();
            for at in (0..self.stations.as_slice().len()).filter(|&at| Some(at) != sender) {
                self.stations.call(at, |station| station.line_error(now));
            }
        }
        self.quiet_since = self.now();
    }

    fn one_octet(&mut self, octet: u8, sender: Option<usize>, failing: bool) {
        let Self { stations, clock, receiver, tuned, repliers, rate, faults, .. } = self;
        let now = clock.now();
        for (at, tuned) in tuned.iter_mut().enumerate() {
            if *tuned && stations.as_slice()[at].listening_rate() == *rate {
                continue;
            }
            // Who changes to the right rate now has missed the beginning.
            *tuned = false;
            if Some(at) != sender {
                stations.call(at, |station| station.line_error(now));
            }
        }
        receiver.receive(now, &[octet], |now, telegram| {
            let times = if failing { faults.times_heard(is_ours(stations, telegram)) } else { 1 };
            repliers.clear();
            for _ in 0..times {
                repliers.clear();
                let hearing = tuned.iter().enumerate().filter(|&(at, tuned)| *tuned && Some(at) != sender);
                for (at, _) in hearing {
                    if let Some(window) = stations.call(at, |station| station.indicate(now, telegram)) {
                        repliers.push((window.not_before, at));
                    }
                }
            }
        });
    }

    /// Moves the clock on, polling stations at their deadlines.
    fn advance_to(&mut self, until: Instant) {
        while self.stations.earliest() <= until {
            self.clock.advance_to(self.stations.earliest());
            self.stations.poll(self.clock.now());
        }
        self.clock.advance_to(until);
    }
}

/// The slot time that masters use at this rate.
#[doc(alias = "Tsl")]
pub const fn slot_time(rate: Baudrate) -> BitTimes {
    BitTimes(match rate {
        Baudrate::B9600 | Baudrate::B19200 | Baudrate::B45450 | Baudrate::B93750 | Baudrate::B187500 => 100,
        Baudrate::B500000 => 200,
        Baudrate::B1500000 => 300,
        Baudrate::B3000000 => 400,
        Baudrate::B6000000 => 600,
        Baudrate::B12000000 => 1000,
    })
}

/// How long masters leave the line idle before a request: Tsyn and the safety margin.
#[doc(alias = "Tid1")]
pub const fn idle_time(rate: Baudrate) -> BitTimes {
    // 2 + 2 Tset + Tqui
    let margin = match rate {
        Baudrate::B12000000 => 43,
        Baudrate::B6000000 => 24,
        Baudrate::B3000000 => 13,
        _ => 4,
    };
    BitTimes(BitTimes::SYN.0 + margin)
}
