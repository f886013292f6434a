//! A segment without its end: its stations, and the way of a telegram among them.

use profibus_dp::Station;
use profibus_dp::fdl::{Receiver, ReceiverMode, Window};
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};
use profibus_dp::wire::Telegram;
use profibus_dp::wire::telegram::{BROADCAST, MAX_OCTETS};

use crate::collision::collide;
use crate::faults::{FaultCounters, Faults};
use crate::segment::{Counters, DEFAULT_RATE, LateReplies, RateListener, Settings};
use crate::stations::Stations;
use crate::wire_tap::{Sight, WireTap};

/// How often a station gets to hear telegrams of others. They only tell it that the bus is alive
/// at its rate, which it wants to know within seconds; 125 stations need not hear each.
const BUS_LIFE: Duration = Duration::from_millis(50);

/// All of a segment but its end.
#[derive(Debug)]
pub(crate) struct Line<S> {
    pub(crate) stations: Stations<S>,
    pub(crate) settings: Settings,
    pub(crate) counters: Counters,
    receiver: Receiver,
    pub(crate) rate: Option<Baudrate>,
    pub(crate) repliers: Repliers,
    pub(crate) waiting: Waiting,
    /// When the newest request was there.
    asked: Instant,
    /// To be told.
    pub(crate) late_replies: Option<LateReplies>,
    /// When stations last heard telegrams of others.
    bus_life: Instant,
    /// A reply on its way that is not where its station keeps it.
    pub(crate) outgoing: [u8; 2 * MAX_OCTETS],
    pub(crate) faults: Faults,
    /// Who listens.
    pub(crate) tap: Option<Box<dyn WireTap>>,
    /// For the tap: what is special about the reply in `outgoing`.
    pub(crate) in_store: InStore,
    /// For the tap: the newest octets after what the fault layer did to them.
    arrived: Vec<u8>,
    /// A character error was on the line, and it has not been idle since.
    deaf: bool,
    /// The newest octets ended a telegram.
    ended: bool,
    /// When octets came last that went through the fault layer.
    last_octets: Instant,
}

/// A reply that is not to be sent at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Waiting {
    Nothing,
    /// For the time when it may start.
    Start(Instant),
    /// For the time when its last octet would have ended; so many are in `outgoing`.
    End(Instant, usize),
}

/// What is special about a reply that waits.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct InStore {
    pub(crate) faults: FaultCounters,
    pub(crate) collision: bool,
}

/// Who answers the newest telegram.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Repliers {
    pub(crate) first: Option<(usize, Window)>,
    /// A second one at once; a third makes it no worse.
    pub(crate) second: Option<(usize, Window)>,
}

impl Waiting {
    #[inline]
    pub(crate) fn until(self) -> Instant {
        match self {
            Self::Nothing => Instant::MAX,
            Self::Start(due) | Self::End(due, _) => due,
        }
    }
}

impl<S: Station + RateListener> Line<S> {
    /// A line without stations, whose master is unknown.
    pub(crate) fn new(settings: Settings) -> Self {
        let mut faults = Faults::default();
        faults.set_rate(DEFAULT_RATE);
        Self {
            stations: Stations::new(),
            settings,
            counters: Counters::default(),
            receiver: Receiver::new(ReceiverMode::Stream, DEFAULT_RATE),
            rate: None,
            repliers: Repliers::default(),
            waiting: Waiting::Nothing,
            asked: Instant::ZERO,
            late_replies: None,
            bus_life: Instant::ZERO,
            outgoing: [0; 2 * MAX_OCTETS],
            faults,
            tap: None,
            in_store: InStore::default(),
            arrived: Vec::new(),
            deaf: false,
            ended: true,
            last_octets: Instant::ZERO,
        }
    }

    pub(crate) fn set_rate(&mut self, now: Instant, rate: Option<Baudrate>) {
        self.abandon();
        self.rate = rate;
        self.receiver.set_baudrate(self.bus_rate());
        self.faults.set_rate(self.bus_rate());
        for station in self.stations.as_mut_slice() {
            station.rate_found(now, rate);
        }
    }

    /// The rate at which an end that hears only one has to listen: that of the first station which is
    /// on the bus. `None`: there is no station.
    ///
    /// Stations that search go through the rates together, as they hear the same. Should they part (one
    /// whose watchdog runs keeps its rate, another has had its power cut), those that listen elsewhere
    /// hear errors, and come by on their search.
    pub(crate) fn wanted_rate(&self) -> Option<Baudrate> {
        let stations = self.stations.as_slice();
        let leader = stations.iter().find(|station| station.address().is_some());
        leader.or(stations.first()).map(Station::listening_rate)
    }

    /// The end hears this rate from now on. Stations are not told: they find it by themselves.
    #[cold]
    pub(crate) fn retune(&mut self, rate: Baudrate) {
        self.abandon();
        self.rate = Some(rate);
        self.receiver.set_baudrate(rate);
        self.faults.set_rate(rate);
    }

    /// Counts a reply that left at `now`, if that is later than it may be.
    pub(crate) fn judge_start(&mut self, window: Window, now: Instant) {
        let rate = self.bus_rate();
        let (latest, limit) = match self.settings.max_tsdr {
            Some(bits) => (self.asked + rate.duration(bits), bits),
            None => (window.not_after, rate.max_tsdr()),
        };
        if now <= latest {
            return;
        }
        self.counters.after_max_tsdr += 1;
        let count = self.counters.after_max_tsdr;
        if count.is_power_of_two() {
            let took = bits(rate, now.since(self.asked));
            self.late_replies = Some(LateReplies { count, took, limit });
        }
    }

    /// The master has gone: what he began will not be ended, what he waited for is not wanted.
    pub(crate) fn abandon(&mut self) {
        self.receiver.forget();
        self.waiting = Waiting::Nothing;
        self.repliers = Repliers::default();
    }

    /// A character with an error ended: whatever it belonged to is no telegram.
    ///
    /// What follows is looked at again from its first octet: a computer does not see when a line is idle.
    #[cold]
    pub(crate) fn line_error(&mut self, now: Instant) {
        let overtaken = self.waiting != Waiting::Nothing;
        self.counters.overtaken += u64::from(overtaken);
        self.counters.line_errors += 1;
        if let Some(tap) = &mut self.tap {
            if overtaken {
                tap.saw(now, Sight::Overtaken);
            }
            tap.saw(now, Sight::CharacterError);
        }
        self.abandon();
        self.receiver.line_error(now);
        self.tell_line_error(now);
    }

    fn tell_line_error(&mut self, now: Instant) {
        for at in 0..self.stations.as_slice().len() {
            self.stations.call(at, |station| station.line_error(now));
        }
    }

    /// The rate by which bus times are counted.
    pub(crate) fn bus_rate(&self) -> Baudrate {
        self.rate.unwrap_or(DEFAULT_RATE)
    }

    /// Takes octets from the master; when they end with a request that somebody answers, says in
    /// which window.
    #[inline]
    pub(crate) fn receive(&mut self, now: Instant, octets: &[u8]) -> Option<Window> {
        self.asked = now;
        if self.tap.is_some() {
            return self.receive_tapped(now, octets);
        }
        self.receive_untapped(now, octets)
    }

    #[inline]
    fn receive_untapped(&mut self, now: Instant, octets: &[u8]) -> Option<Window> {
        if self.faults.is_active() {
            self.receive_through_faults(now, octets)
        } else {
            self.hear::<false>(now, octets)
        }
    }

    /// The same while somebody listens.
    #[cold]
    fn receive_tapped(&mut self, now: Instant, octets: &[u8]) -> Option<Window> {
        let waited = self.waiting != Waiting::Nothing;
        let (before, overtaken) = (self.faults.counters(), self.counters.overtaken);
        self.arrived.clear();
        let window = self.receive_untapped(now, octets);
        let faults = self.faults.counters().since(&before);
        let Self { tap: Some(tap), arrived, counters, .. } = self else {
            return window;
        };
        let octets = if arrived.is_empty() { octets } else { arrived };
        let overtaken = counters.overtaken - overtaken;
        // What had waited was overtaken by the first of these octets, the others within them.
        let at_first = u64::from(waited).min(overtaken);
        for _ in 0..at_first {
            tap.saw(now, Sight::Overtaken);
        }
        tap.saw(now, Sight::Request { octets, faults });
        for _ in at_first..overtaken {
            tap.saw(now, Sight::Overtaken);
        }
        window
    }

    /// The same past the fault layer; `FAILING`: whole telegrams may still be lost or doubled.
    #[inline]
    fn hear<const FAILING: bool>(&mut self, now: Instant, octets: &[u8]) -> Option<Window> {
        let Self { stations, counters, receiver, rate, repliers, bus_life, waiting, faults, .. } = self;
        // Whatever comes before a reply has been sent means that the master has gone on.
        if *waiting != Waiting::Nothing {
            *waiting = Waiting::Nothing;
            counters.overtaken += 1;
        }
        *repliers = Repliers::default();
        let ended = receiver.receive(now, octets, |now, telegram| {
            counters.telegrams += 1;
            counters.overtaken += u64::from(repliers.first.is_some());
            let times = if FAILING { faults.times_heard(is_ours(stations, telegram)) } else { 1 };
            *repliers = Repliers::default();
            for _ in 0..times {
                *repliers = indicate(stations, *rate, bus_life, now, telegram);
            }
        });
        if FAILING {
            self.ended = ended;
        }
        let (_, window) = self.repliers.first?;
        if !ended {
            self.counters.overtaken += 1;
            return None;
        }
        Some(window)
    }

    /// Octets on a line where something can go wrong.
    #[cold]
    fn receive_through_faults(&mut self, now: Instant, octets: &[u8]) -> Option<Window> {
        let idle = now.since(self.last_octets) > LINE_IDLE.max(self.bus_rate().duration(BitTimes::SYN));
        self.last_octets = now;
        let begins = (idle || self.ended) && starts_ours(&self.stations, octets);
        let characters = self.faults.request(octets, begins);
        if self.tap.is_some() {
            self.arrived.extend(characters.iter().map(|character| character.octet));
        }
        self.deaf &= !idle;
        if self.deaf {
            return None;
        }
        let good: Vec<u8> = characters
            .iter()
            .take_while(|character| !character.error)
            .map(|character| character.octet)
            .collect();
        let window = if good.is_empty() { None } else { self.hear::<true>(now, &good) };
        if good.len() == characters.len() {
            return window;
        }
        // What stands behind a character error is no telegram until the line has been idle.
        self.deaf = true;
        self.ended = false;
        self.abandon();
        self.tell_line_error(now);
        None
    }
}

/// Octets that come after a pause of at least so long begin something new, where the octets of an end
/// come in pieces.
const LINE_IDLE: Duration = Duration::from_micros(500);

/// Whether octets begin with a request to one of the stations, or to all.
pub(crate) fn starts_ours<S: Station>(stations: &Stations<S>, octets: &[u8]) -> bool {
    let da = match octets {
        [0x10 | 0xA2, da, ..] | [0x68, _, _, _, da, ..] => da & 0x7F,
        _ => return false,
    };
    da == BROADCAST || stations.first_at(da).is_some()
}

/// Whether a telegram is to one of the stations, or to all.
pub(crate) fn is_ours<S: Station>(stations: &Stations<S>, telegram: &Telegram<'_>) -> bool {
    matches!(telegram, Telegram::Data(data) if data.da == BROADCAST || stations.first_at(data.da).is_some())
}

/// Hands a telegram to the stations that it is for, and says who answers.
#[inline]
fn indicate<S: Station>(
    stations: &mut Stations<S>,
    rate: Option<Baudrate>,
    bus_life: &mut Instant,
    now: Instant,
    telegram: &Telegram<'_>,
) -> Repliers {
    let mut repliers = Repliers::default();
    let Telegram::Data(data) = telegram else {
        return repliers;
    };
    if data.da == BROADCAST || now.since(*bus_life) >= BUS_LIFE {
        *bus_life = now;
        for at in 0..stations.as_slice().len() {
            repliers.add(at, hear(stations, at, rate, now, telegram));
        }
        return repliers;
    }
    stations.each_for(data.da, |stations, at| repliers.add(at, hear(stations, at, rate, now, telegram)));
    repliers
}

#[inline]
fn hear<S: Station>(
    stations: &mut Stations<S>,
    at: usize,
    rate: Option<Baudrate>,
    now: Instant,
    telegram: &Telegram<'_>,
) -> Option<Window> {
    stations.call(at, |station| {
        if rate.is_some_and(|rate| rate != station.listening_rate()) {
            station.line_error(now);
            return None;
        }
        station.indicate(now, telegram)
    })
}

impl Repliers {
    #[inline]
    fn add(&mut self, at: usize, window: Option<Window>) {
        let Some(window) = window else {
            return;
        };
        if self.first.is_none() {
            self.first = Some((at, window));
        } else {
            self.second = Some((at, window));
        }
    }
}

/// Two stations answer at once: what the master gets is neither.
#[cold]
pub(crate) fn garbage<S: Station>(
    stations: &mut Stations<S>,
    now: Instant,
    repliers: [(usize, Window); 2],
    line: &mut [u8],
) -> usize {
    repliers.into_iter().fold(0, |length, (at, window)| {
        stations.call(at, |station| match station.transmit(within(window, now)) {
            Some(octets) => collide(line, length, octets),
            None => length,
        })
    })
}

/// The time that the station is told when it hands out its reply. On ends where octets take no
/// time the reply leaves when the master can have it, be that before or after the bus would allow
/// it; the reply limit has seen to those that are too old.
#[inline]
pub(crate) fn within(window: Window, now: Instant) -> Instant {
    now.max(window.not_before).min(window.not_after)
}

/// How many whole bit times these are.
fn bits(rate: Baudrate, span: Duration) -> BitTimes {
    let bits = u128::from(span.as_nanos()) * u128::from(rate.bits_per_second()) / 1_000_000_000;
    BitTimes(u32::try_from(bits).unwrap_or(u32::MAX))
}

/// How long so many octets take.
pub(crate) fn characters(octets: usize) -> BitTimes {
    BitTimes(BitTimes::CHARACTER.0.saturating_mul(u32::try_from(octets).unwrap_or(u32::MAX)))
}

#[cfg(test)]
mod tests;
