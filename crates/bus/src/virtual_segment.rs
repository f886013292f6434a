//! A segment under a virtual clock, with bus times kept exactly.
//!
//! Every octet takes eleven bit times, replies start where their window opens, stations are polled
//! at their deadlines, and nothing else takes any time.

mod hearing;

use profibus_dp::Station;
use profibus_dp::fdl::{Receiver, ReceiverMode};
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};
use profibus_dp::wire::telegram::MAX_OCTETS;

use crate::clock::VirtualClock;
use crate::collision::collide;
use crate::end::Written;
use crate::faults::{FaultCounters, Faults, ReplyFault};
use crate::overheard::Overheard;
use crate::stations::Stations;
use crate::wire_tap::{self, Sight, WireTap};

/// What a master hears after a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answer<'a> {
    /// Octets that started within the slot time.
    Reply(Reply<'a>),
    /// None, until the slot time was over.
    Silence {
        /// When the master stopped waiting.
        until: Instant,
    },
}

/// Octets on the line, with their times.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reply<'a> {
    /// What a master makes of the octets; after a collision or a fault, not what was sent.
    pub octets: &'a [u8],
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
///
/// What an exchange costs does not grow with the number of stations: those that a telegram is not for
/// are told of it before it can matter to them, and only of the newest.
#[derive(Debug)]
pub struct VirtualSegment<S> {
    stations: Stations<S>,
    clock: VirtualClock,
    rate: Baudrate,
    slot: Duration,
    idle: Duration,
    receiver: Receiver,
    /// End of the last octet on the line.
    quiet_since: Instant,
    faults: Faults,
    collisions: u64,
    /// For each station, whether it listens at the right rate from the start of what is sent.
    tuned: Vec<bool>,
    repliers: Vec<(Instant, usize)>,
    /// All stations listen at the master's rate; `false`: perhaps.
    all_tuned: bool,
    /// Somebody else may have changed stations.
    touched: bool,
    /// The last octets were not a whole telegram.
    unfinished: bool,
    overheard: Overheard,
    tap: Option<Box<dyn WireTap>>,
    /// The newest reply; long enough for one that comes twice.
    line: Vec<u8>,
}

impl<S: Station> VirtualSegment<S> {
    /// A bus without stations at time `now`, quiet for long.
    pub fn new(now: Instant, rate: Baudrate) -> Self {
        let mut faults = Faults::default();
        faults.set_rate(rate);
        Self {
            stations: Stations::new(),
            clock: VirtualClock::new(now),
            rate,
            slot: rate.duration(slot_time(rate)),
            idle: rate.duration(idle_time(rate)),
            receiver: Receiver::new(ReceiverMode::Idle, rate),
            quiet_since: Instant::ZERO,
            faults,
            collisions: 0,
            tuned: Vec::new(),
            repliers: Vec::new(),
            all_tuned: false,
            touched: true,
            unfinished: false,
            overheard: Overheard::new(),
            tap: None,
            line: vec![0; 2 * MAX_OCTETS],
        }
    }

    /// Adds a station, and says by which number it is known here.
    pub fn add(&mut self, station: S) -> usize {
        self.touched = true;
        self.overheard.add(self.clock.now());
        self.stations.push(station)
    }

    /// The stations, in the order they were added.
    pub fn stations(&self) -> &[S] {
        self.stations.as_slice()
    }

    /// The stations, to be changed.
    pub fn stations_mut(&mut self) -> &mut [S] {
        self.touched = true;
        self.overheard.tell_all(&mut self.stations);
        self.stations.as_mut_slice()
    }

    /// Ends the segment and gives its stations back.
    pub fn into_stations(mut self) -> Vec<S> {
        self.overheard.tell_all(&mut self.stations);
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
        self.slot = rate.duration(slot_time(rate));
        self.idle = rate.duration(idle_time(rate));
        self.receiver.set_baudrate(rate);
        self.faults.set_rate(rate);
        (self.all_tuned, self.unfinished) = (false, false);
    }

    /// How long the master waits for the start of a reply.
    pub fn set_slot_time(&mut self, slot: BitTimes) {
        self.slot = self.rate.duration(slot);
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

    /// Lets somebody listen, instead of whoever did before; `None`: nobody.
    pub fn set_tap(&mut self, tap: Option<Box<dyn WireTap>>) {
        self.tap = tap;
    }

    /// Somebody listens beside those who do.
    pub fn add_tap(&mut self, tap: Box<dyn WireTap>) {
        wire_tap::add(&mut self.tap, tap);
    }

    /// How often two stations answered at once.
    pub fn collisions(&self) -> u64 {
        self.collisions
    }

    /// How long nothing has been on the line.
    pub fn quiet_for(&self) -> Duration {
        self.now().since(self.quiet_since)
    }

    /// Whether a station is about to answer what was sent last.
    pub fn is_answered(&self) -> bool {
        !self.repliers.is_empty()
    }

    /// Lets time pass, with nothing on the line.
    pub fn wait(&mut self, span: Duration) {
        self.settle();
        self.advance_to(self.now() + span);
    }

    /// The master sends octets after the idle time that a request needs, and listens until a reply
    /// has ended or the slot time is over.
    pub fn send(&mut self, octets: &[u8]) -> Answer<'_> {
        self.send_only(octets);
        self.listen()
    }

    /// The master sends octets and does not listen: a request that nobody answers, or a master that
    /// goes on before the reply. Time stands at the end of the last octet.
    pub fn send_only(&mut self, octets: &[u8]) {
        self.settle();
        self.advance_to(self.quiet_since + self.idle);
        let start = self.now();
        self.repliers.clear();
        self.put_request_on_line(start, octets, true);
    }

    /// The master sends octets straight after those before, as the rest of what he began, or without
    /// regard to the idle time.
    pub fn send_more(&mut self, octets: &[u8]) {
        self.settle();
        self.repliers.clear();
        self.put_request_on_line(self.now(), octets, false);
    }

    /// The master listens until a reply has ended or the slot time is over.
    pub fn listen(&mut self) -> Answer<'_> {
        self.settle();
        let asked = self.quiet_since;
        let until = asked + self.slot;
        self.repliers.sort_unstable();
        let Some(&(start, first)) = self.repliers.first().filter(|(start, _)| *start <= until) else {
            self.advance_to(until);
            return Answer::Silence { until };
        };
        let start = start.max(self.now());
        self.advance_to(start);
        let mut length = self.hand_out(first, 0);
        // Who starts before the first octet of the other has ended knows nothing of it.
        let mut damaged = false;
        if self.repliers.len() > 1 {
            let blind = start + self.rate.duration(BitTimes::CHARACTER);
            (length, damaged) = self.collide(blind, length);
        }
        self.repliers.clear();
        if length == 0 {
            self.advance_to(until);
            return Answer::Silence { until };
        }
        if !self.faults.leaves_reply(&self.line[..length]) {
            return self.deliver_with_faults(Delivery { start, asked, until, length, damaged }, first);
        }
        if self.tap.is_some() {
            self.tap_reply(start, length, FaultCounters::default(), damaged);
        }
        let line = std::mem::take(&mut self.line);
        self.put_on_line(start, &line[..length], Some(first), false);
        self.line = line;
        let octets = &self.line[..length];
        Answer::Reply(Reply { octets, start, end: self.clock.now(), delay: start.since(asked), damaged })
    }

    /// The way of a reply to the master and to the other stations, with the faults on it.
    #[cold]
    fn deliver_with_faults(&mut self, delivery: Delivery, sender: usize) -> Answer<'_> {
        let Delivery { asked, until, length, damaged: collision, .. } = delivery;
        let before = self.faults.counters();
        let arrival = self.faults.reply(&self.line[..length]);
        let faults = self.faults.counters().since(&before);
        let start = delivery.start + arrival.late_by;
        if arrival.characters.is_empty() || start > until {
            self.tap_reply(delivery.start, length, faults, collision);
            self.advance_to(until);
            return Answer::Silence { until };
        }
        self.advance_to(start);
        let damaged = delivery.damaged | arrival.characters.iter().any(|character| character.error);
        let length = arrival.characters.len();
        self.line.resize(self.line.len().max(length), 0);
        for (place, character) in self.line.iter_mut().zip(&arrival.characters) {
            *place = character.octet;
        }
        self.tap_reply(start, length, faults, collision);
        if damaged {
            self.put_characters_on_line(start, &arrival.characters, Some(sender), false);
        } else {
            let line = std::mem::take(&mut self.line);
            self.put_on_line(start, &line[..length], Some(sender), false);
            self.line = line;
        }
        let octets = &self.line[..length];
        Answer::Reply(Reply { octets, start, end: self.clock.now(), delay: start.since(asked), damaged })
    }

    /// Others answer before the first could be heard: what comes of it, and whether it is anything new.
    #[cold]
    fn collide(&mut self, blind: Instant, mut length: usize) -> (usize, bool) {
        let damaged = self.repliers.get(1).is_some_and(|(second, _)| *second < blind);
        if damaged {
            self.collisions += 1;
            for at in 1..self.repliers.len() {
                let (second, station) = self.repliers[at];
                if second < blind {
                    self.advance_to(second);
                    length = self.hand_out(station, length);
                }
            }
        }
        (length, damaged)
    }

    fn hand_out(&mut self, station: usize, length: usize) -> usize {
        let Self { stations, clock, line, .. } = self;
        stations.call(station, |station| match station.transmit(clock.now()) {
            Some(octets) => collide(&mut line[..MAX_OCTETS], length, octets),
            None => length,
        })
    }

    /// The reply in `line`.
    #[cold]
    fn tap_reply(&mut self, at: Instant, length: usize, faults: FaultCounters, collision: bool) {
        if let Some(tap) = &mut self.tap {
            let lost = faults.lost_replies > 0;
            let written = if lost { Written::Dropped(length) } else { Written::All };
            tap.saw(at, Sight::Reply { octets: &self.line[..length], faults, collision, written });
        }
    }

    /// Sees to what others may have changed.
    #[inline]
    fn settle(&mut self) {
        if std::mem::take(&mut self.touched) {
            self.all_tuned = false;
            self.stations.refresh_all();
        }
    }

    /// Moves the clock on, polling stations at their deadlines.
    #[inline]
    fn advance_to(&mut self, until: Instant) {
        while self.stations.earliest() <= until {
            self.poll();
        }
        self.clock.advance_to(until);
    }

    /// The same, but stops where a station begins to listen at another rate, and says whether none did.
    #[inline]
    fn advance_in_tune(&mut self, until: Instant) -> bool {
        while self.stations.earliest() <= until {
            self.poll();
            if !self.all_tuned {
                return false;
            }
        }
        self.clock.advance_to(until);
        true
    }

    /// Goes on to the earliest deadline.
    #[cold]
    fn poll(&mut self) {
        let Self { stations, clock, overheard, all_tuned, rate, .. } = self;
        clock.advance_to(stations.earliest());
        let now = clock.now();
        stations.each_due(now, |stations, at| {
            overheard.tell(stations, at);
            // What it has heard may have put its deadline off.
            if stations.is_due(at, now) {
                stations.call(at, |station| station.poll(now));
                overheard.was_polled(at);
            }
            *all_tuned &= stations.as_slice()[at].listening_rate() == *rate;
        });
    }
}

/// A reply that a station has handed out, on its way.
#[derive(Debug, Clone, Copy)]
struct Delivery {
    start: Instant,
    /// The end of the request.
    asked: Instant,
    /// The end of the slot time.
    until: Instant,
    length: usize,
    damaged: bool,
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
