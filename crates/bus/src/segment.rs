//! A segment in real time: one thread, one end, any number of stations.
//!
//! A telegram costs at most one poll, one read and one write; nothing is allocated, locked or logged on
//! its way.

mod news;

use std::num::NonZeroU64;
use std::ops::ControlFlow;

use profibus_dp::Station;
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};

use crate::clock::WallClock;
use crate::collision::collide;
use crate::control::{self, Commands, Control};
use crate::end::{End, EndError, Event, Note, Written};
use crate::faults::{FaultCounters, Faults};
use crate::line::{InStore, Line, Repliers, Waiting, characters, garbage, within};
use crate::wire_tap::{self, Sight, WireTap};
pub use news::{Counters, LateReplies, News};

/// The rate by which bus times are counted at an end that has none.
pub const DEFAULT_RATE: Baudrate = Baudrate::B500000;

/// A station that can be told the rate, where the end of its segment knows it.
pub trait RateListener {
    /// The master's rate, as the end has it: it counts as found at once.
    ///
    /// `None`: a rate that is none of the ten, or an end that has no rate; bus times are then
    /// those of [`DEFAULT_RATE`]. A station with a fixed rate ignores this.
    fn rate_found(&mut self, now: Instant, rate: Option<Baudrate>);
}

/// How a segment treats replies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Settings {
    /// Send a reply only when its last octet would have ended on a bus of the rate in force,
    /// instead of at once.
    pub pace: bool,
    /// A reply that would start later than this is not sent; the master's retry gets it.
    pub reply_limit: Duration,
    /// A reply on a serial device that starts later than this after its request is counted, and told as
    /// [`News::LateReplies`]. `None`: max T_SDR of the rate, or min T_SDR where a master has set that
    /// higher, and 11 bit times.
    pub max_tsdr: Option<BitTimes>,
}

impl Default for Settings {
    /// At once, or within 10 ms.
    fn default() -> Self {
        Self { pace: false, reply_limit: Duration::from_millis(10), max_tsdr: None }
    }
}

/// What the owner of a running segment does on the segment's thread.
pub trait Handler<S> {
    /// What other threads may ask for.
    type Command;

    /// Carries out a command; `Break` ends [`Segment::run`].
    fn command(&mut self, segment: &mut Segment<S>, command: Self::Command) -> ControlFlow<()>;

    /// Takes note of masters that come and go.
    fn news(&mut self, segment: &mut Segment<S>, news: News) {
        let _ = (segment, news);
    }
}

/// Stations on an end that somebody else opens, in real time.
#[derive(Debug)]
pub struct Segment<S> {
    end: Box<dyn End>,
    /// The end hears one rate at a time.
    tunable: bool,
    clock: WallClock,
    line: Line<S>,
    buffer: Box<[u8]>,
}

impl<S: Station + RateListener> Segment<S> {
    /// A segment without stations.
    pub fn new(end: Box<dyn End>, clock: WallClock, settings: Settings) -> Self {
        let line = Line::new(settings);
        let tunable = end.is_tunable();
        Self { end, tunable, clock, line, buffer: vec![0; 4096].into_boxed_slice() }
    }

    /// Adds a station, and says by which number it is known here.
    pub fn add(&mut self, station: S) -> usize {
        self.line.stations.push(station)
    }

    /// The stations, in the order they were added.
    pub fn stations(&self) -> &[S] {
        self.line.stations.as_slice()
    }

    /// The stations. What has changed counts once the handler or the caller has returned.
    pub fn stations_mut(&mut self) -> &mut [S] {
        self.line.stations.as_mut_slice()
    }

    /// Ends the segment and gives its stations back.
    pub fn into_stations(self) -> Vec<S> {
        self.line.stations.into_vec()
    }

    /// What a user opens to get to the segment.
    pub fn name(&self) -> &str {
        self.end.name()
    }

    /// The time that stations are told.
    pub fn now(&self) -> Instant {
        self.clock.now()
    }

    /// The rate of the master, where the end knows it.
    pub fn rate(&self) -> Option<Baudrate> {
        self.line.rate
    }

    /// Whether masters set a rate at this end (see [`End::has_rate`]).
    pub fn has_rate(&self) -> bool {
        self.end.has_rate()
    }

    /// What was counted so far.
    pub fn counters(&self) -> Counters {
        self.line.counters
    }

    /// What goes wrong on the line.
    pub fn faults(&self) -> &Faults {
        &self.line.faults
    }

    /// What goes wrong on the line, to be changed.
    pub fn faults_mut(&mut self) -> &mut Faults {
        &mut self.line.faults
    }

    /// Lets somebody listen, instead of whoever did before; `None`: nobody.
    pub fn set_tap(&mut self, tap: Option<Box<dyn WireTap>>) {
        self.line.tap = tap;
    }

    /// Somebody listens beside those who do.
    pub fn add_tap(&mut self, tap: Box<dyn WireTap>) {
        wire_tap::add(&mut self.line.tap, tap);
    }

    /// A way for other threads to reach this segment while it runs.
    pub fn control<C>(&self) -> (Control<C>, Commands<C>) {
        control::channel(self.end.waker())
    }

    /// Runs the segment on this thread until it is told to stop.
    ///
    /// # Errors
    ///
    /// The end broke.
    pub fn run<H: Handler<S>>(
        &mut self,
        commands: &Commands<H::Command>,
        handler: &mut H,
    ) -> Result<(), EndError> {
        // Without it the kernel lets timers be 50 us late. Where it is refused, they are.
        let _ = rustix::thread::set_current_timer_slack(NonZeroU64::new(1));
        self.line.stations.refresh_all();
        // Commands given before are waiting already.
        let mut woken = true;
        let mut now = self.clock.now();
        loop {
            if woken && self.obey(commands, handler).is_break() {
                return Ok(());
            }
            if now >= self.line.stations.earliest() {
                self.line.stations.poll(now);
            }
            self.go_on_waiting(now)?;
            if self.tunable {
                self.see_to_device(handler)?;
            }
            let until = self.line.waiting.until().min(self.line.stations.earliest());
            let timeout = (until != Instant::MAX).then(|| until.since(now));
            let event = self.end.wait(timeout, &mut self.buffer)?;
            now = self.clock.now();
            woken = event == Event::Woken;
            match event {
                Event::Octets(count) => self.octets(now, count)?,
                Event::LineError => self.line.line_error(now),
                Event::TimedOut | Event::Woken => {}
                Event::Came(_) | Event::Rate(_) | Event::Left | Event::Noted(_) => {
                    self.news(now, event, handler);
                }
            }
        }
    }

    /// What only an end that hears one rate at a time asks for.
    fn see_to_device<H: Handler<S>>(&mut self, handler: &mut H) -> Result<(), EndError> {
        if let Some(late) = self.line.late_replies.take() {
            handler.news(self, News::LateReplies(late));
            self.line.stations.refresh_all();
        }
        let wanted = self.line.wanted_rate();
        if wanted != self.line.rate
            && let Some(rate) = wanted
        {
            self.end.tune(rate)?;
            self.line.retune(rate);
            if let Some(tap) = &mut self.line.tap {
                tap.saw(self.clock.now(), Sight::Rate(Some(rate)));
            }
        }
        Ok(())
    }

    #[cold]
    fn obey<H: Handler<S>>(&mut self, commands: &Commands<H::Command>, handler: &mut H) -> ControlFlow<()> {
        while let Some(command) = commands.next() {
            let flow = handler.command(self, command);
            self.line.stations.refresh_all();
            flow?;
        }
        if commands.stopped() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    #[cold]
    fn news<H: Handler<S>>(&mut self, now: Instant, event: Event, handler: &mut H) {
        let news = match event {
            Event::Came(rate) => News::MasterCame(rate),
            Event::Rate(rate) => News::RateChanged(rate),
            Event::Noted(note) => News::Noted(note),
            _ => News::MasterLeft,
        };
        match news {
            News::MasterCame(rate) | News::RateChanged(rate) => {
                self.line.set_rate(now, rate);
            }
            News::MasterLeft => self.line.abandon(),
            News::LateReplies(_) => {}
            News::Noted(note) => self.line.counters.refused += u64::from(note == Note::Refused),
        }
        let sight = match news {
            News::MasterCame(rate) => Some(Sight::MasterCame(rate)),
            News::RateChanged(rate) => Some(Sight::Rate(rate)),
            News::MasterLeft => Some(Sight::MasterLeft),
            News::LateReplies(_) | News::Noted(_) => None,
        };
        if let (Some(sight), Some(tap)) = (sight, &mut self.line.tap) {
            tap.saw(now, sight);
        }
        handler.news(self, news);
        self.line.stations.refresh_all();
    }

    /// The path of a telegram: from its octets to those of the reply.
    #[inline]
    fn octets(&mut self, now: Instant, count: usize) -> Result<(), EndError> {
        let octets = self.buffer.get(..count).unwrap_or_default();
        let Some(window) = self.line.receive(now, octets) else {
            return Ok(());
        };
        if self.tunable {
            // They took their time, and the computer has heard of it late: this is the least delay.
            self.line.waiting = Waiting::Start(window.not_before);
            return Ok(());
        }
        if self.line.settings.pace {
            // The octets came all at once; on a bus they would have come one by one until later.
            let request = self.line.bus_rate().duration(characters(count));
            self.line.waiting = Waiting::Start(window.not_before + request);
            return Ok(());
        }
        self.reply(now)
    }

    /// Goes on with a reply that waits, if its time has come.
    #[inline]
    fn go_on_waiting(&mut self, now: Instant) -> Result<(), EndError> {
        match self.line.waiting {
            Waiting::Start(due) if due <= now => self.reply(due),
            Waiting::End(due, length) if due <= now => {
                self.line.waiting = Waiting::Nothing;
                let Line { outgoing, counters, tap, in_store, .. } = &mut self.line;
                let octets = outgoing.get(..length).unwrap_or_default();
                let written = self.end.write(octets)?;
                counters.count_reply(written);
                if let Some(tap) = tap {
                    let InStore { faults, collision } = std::mem::take(in_store);
                    tap.saw(now, Sight::Reply { octets, faults, collision, written });
                }
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// Hands out the reply that was due at `due`, and sends it unless that takes time.
    #[inline]
    fn reply(&mut self, due: Instant) -> Result<(), EndError> {
        let Line {
            stations,
            settings,
            counters,
            repliers,
            waiting,
            outgoing,
            rate,
            faults,
            tap,
            in_store,
            ..
        } = &mut self.line;
        let Repliers { first, second } = std::mem::take(repliers);
        *waiting = Waiting::Nothing;
        let Some((at, window)) = first else {
            return Ok(());
        };
        let now = self.clock.now();
        if now.since(due) > settings.reply_limit {
            counters.late += 1;
            if let Some(tap) = tap {
                tap.saw(now, Sight::TooLate);
            }
            return Ok(());
        }
        *in_store = InStore::default();
        if let Some(second) = second {
            counters.collisions += 1;
            let length = garbage(stations, now, [(at, window), second], outgoing);
            in_store.collision = true;
            *waiting = Waiting::End(now, length);
            return Ok(());
        }
        let Some(octets) = stations.as_mut_slice()[at].transmit(within(window, now)) else {
            stations.refresh(at);
            return Ok(());
        };
        if faults.is_active() {
            let length = collide(outgoing, 0, octets);
            stations.refresh(at);
            return self.reply_through_faults(now, length);
        }
        if settings.pace {
            let reply = rate.unwrap_or(DEFAULT_RATE).duration(characters(octets.len()));
            *waiting = Waiting::End(now + reply, collide(outgoing, 0, octets));
        } else {
            let written = self.end.write(octets)?;
            counters.count_reply(written);
            if let Some(tap) = tap {
                let faults = FaultCounters::default();
                tap.saw(now, Sight::Reply { octets, faults, collision: false, written });
            }
        }
        // Handing out the reply may have changed the address of its station.
        stations.refresh(at);
        if self.tunable {
            self.line.judge_start(window, self.clock.now());
        }
        Ok(())
    }

    /// The reply in `outgoing`, on a line where something can go wrong.
    #[cold]
    fn reply_through_faults(&mut self, now: Instant, length: usize) -> Result<(), EndError> {
        let rate = self.line.bus_rate();
        let Line { settings, counters, waiting, outgoing, faults, tap, in_store, .. } = &mut self.line;
        let before = faults.counters();
        let given = outgoing.get(..length).unwrap_or_default();
        let arrival = faults.reply(given);
        let faults = faults.counters().since(&before);
        if arrival.characters.is_empty() {
            if let Some(tap) = tap {
                let written = Written::Dropped(length);
                tap.saw(now, Sight::Reply { octets: given, faults, collision: false, written });
            }
            return Ok(());
        }
        in_store.faults = faults;
        let octets: Vec<u8> = arrival.characters.iter().map(|character| character.octet).collect();
        let length = collide(outgoing, 0, &octets);
        let mut due = now + arrival.late_by;
        if settings.pace {
            due += rate.duration(characters(length));
        }
        if due > now {
            *waiting = Waiting::End(due, length);
            return Ok(());
        }
        let written = self.end.write(&octets)?;
        counters.count_reply(written);
        if let Some(tap) = tap {
            tap.saw(now, Sight::Reply { octets: &octets, faults, collision: false, written });
        }
        Ok(())
    }
}
