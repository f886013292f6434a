//! A segment without its end: its stations, and the way of a telegram among them.

use profibus_dp::Station;
use profibus_dp::fdl::{Receiver, ReceiverMode, Window};
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};
use profibus_dp::wire::Telegram;
use profibus_dp::wire::telegram::{BROADCAST, MAX_OCTETS};

use crate::collision::collide;
use crate::segment::{Counters, DEFAULT_RATE, RateListener, Settings};
use crate::stations::Stations;

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
    /// When stations last heard telegrams of others.
    bus_life: Instant,
    /// A reply on its way that is not where its station keeps it.
    pub(crate) outgoing: [u8; MAX_OCTETS],
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
        Self {
            stations: Stations::new(),
            settings,
            counters: Counters::default(),
            receiver: Receiver::new(ReceiverMode::Stream, DEFAULT_RATE),
            rate: None,
            repliers: Repliers::default(),
            waiting: Waiting::Nothing,
            bus_life: Instant::ZERO,
            outgoing: [0; MAX_OCTETS],
        }
    }

    pub(crate) fn set_rate(&mut self, now: Instant, rate: Option<Baudrate>) {
        self.abandon();
        self.rate = rate;
        self.receiver.set_baudrate(self.bus_rate());
        for station in self.stations.as_mut_slice() {
            station.rate_found(now, rate);
        }
    }

    /// The master has gone: what he began will not be ended, what he waited for is not wanted.
    pub(crate) fn abandon(&mut self) {
        self.receiver.forget();
        self.waiting = Waiting::Nothing;
        self.repliers = Repliers::default();
    }

    /// A character with an error ended: whatever it belonged to is no telegram.
    #[cold]
    pub(crate) fn line_error(&mut self, now: Instant) {
        if self.waiting != Waiting::Nothing {
            self.waiting = Waiting::Nothing;
            self.counters.overtaken += 1;
        }
        self.repliers = Repliers::default();
        self.counters.line_errors += 1;
        self.receiver.line_error(now);
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
        let Self { stations, counters, receiver, rate, repliers, bus_life, waiting, .. } = self;
        // Whatever comes before a reply has been sent means that the master has gone on.
        if *waiting != Waiting::Nothing {
            *waiting = Waiting::Nothing;
            counters.overtaken += 1;
        }
        *repliers = Repliers::default();
        let ended = receiver.receive(now, octets, |now, telegram| {
            counters.telegrams += 1;
            counters.overtaken += u64::from(repliers.first.is_some());
            *repliers = indicate(stations, *rate, bus_life, now, telegram);
        });
        let (_, window) = repliers.first?;
        if !ended {
            counters.overtaken += 1;
            return None;
        }
        Some(window)
    }
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
    let mut next = stations.first_at(data.da);
    while let Some(at) = next {
        // Found before the call: it may change the address of this station.
        next = stations.next_at(at);
        repliers.add(at, hear(stations, at, rate, now, telegram));
    }
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

/// How long so many octets take.
pub(crate) fn characters(octets: usize) -> BitTimes {
    BitTimes(BitTimes::CHARACTER.0.saturating_mul(u32::try_from(octets).unwrap_or(u32::MAX)))
}
