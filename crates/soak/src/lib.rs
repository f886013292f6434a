//! Hours on a bus within minutes: many encoders, two masters, errors on the line, power cuts, and what must
//! hold throughout.
//!
//! | what must hold | how it is looked at |
//! |---|---|
//! | every position is the shaft's at the newest latch before its request | each answer of Data_Exchange, against plain arithmetic |
//! | no confirmed preset is lost, none is executed twice or unasked | the offset that positions and diagnoses show, over power cuts too |
//! | the diagnosis is consistent | alarms, warnings, offset, operating time, owner, watchdog, Ext_Diag, Stat_Diag; and the priority of answers |
//! | the watchdog is exact | when a session ends that nobody ended, and that none goes on |
//! | an address set over the bus or by switches is the one | masters find the encoder there, and only there |
//! | data exchange comes back | within 3 s after anything |
//! | taking only the latches that matter changes nothing | shadows take all, 2000 a second, and give the same octets |
//!
//! A run is its seed: the same seed and duration give the same run.

#![forbid(unsafe_code)]

mod chance;
mod disturb;
mod encoder;
mod line;
mod setup;
mod shadow;
mod station;
mod truth;

use std::fmt;

use bus::{FaultCounters, Noise};
use master::Settings;
use profibus_dp::time::{Baudrate, Duration, Instant};

use chance::Chance;
use disturb::{Disturbances, disturb};
use encoder::{Encoder, Master};
use line::Shared;

/// What is to be run.
#[derive(Debug, Clone, Copy)]
pub struct Options {
    /// Time on the bus.
    pub span: Duration,
    /// Where all chance begins.
    pub seed: u64,
    /// 2 to 64.
    pub encoders: usize,
    /// How many of them have a shadow that takes every latch; two of every three can.
    pub shadows: usize,
    /// The rate.
    pub rate: Baudrate,
    /// The share of bits that flip on the line.
    pub bit_errors: f64,
}

impl Options {
    /// 32 encoders, two of them with shadows, at 1.5 Mbit/s with bit errors of 1e-5.
    pub const fn new(span: Duration, seed: u64) -> Self {
        Self { span, seed, encoders: 32, shadows: 2, rate: Baudrate::B1500000, bit_errors: 1e-5 }
    }
}

/// What came of a run in which everything held.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Report {
    /// Time on the bus.
    pub span: Duration,
    /// Answers of Data_Exchange, all of them checked.
    pub exchanges: u64,
    /// Diagnoses in data exchange, all of them checked.
    pub diagnoses: u64,
    /// Presets that were confirmed.
    pub presets: u64,
    /// Presets whose answer did not arrive.
    pub unconfirmed_presets: u64,
    /// How often a master began with an encoder.
    pub start_ups: u64,
    /// Addresses changed over the bus.
    pub moves: u64,
    /// Requests that were sent again.
    pub retries: u64,
    /// Watchdogs that ran out.
    pub watchdogs: u64,
    /// The longest from the end of a watchdog to when it showed.
    pub latest_watchdog: Duration,
    /// What was done to the encoders.
    pub disturbances: Disturbances,
    /// What went wrong on the line.
    pub faults: FaultCounters,
    /// Latches that shadows took.
    pub shadow_latches: u64,
    /// Replies that shadows compared.
    pub shadow_replies: u64,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Disturbances { shafts, worlds, power_cuts, outages, switches, pauses } = self.disturbances;
        writeln!(f, "exchanges checked         {}", self.exchanges)?;
        writeln!(f, "diagnoses checked         {}", self.diagnoses)?;
        writeln!(
            f,
            "presets confirmed         {}, not confirmed {}",
            self.presets, self.unconfirmed_presets
        )?;
        writeln!(
            f,
            "start-ups                 {}, addresses changed over the bus {}",
            self.start_ups, self.moves
        )?;
        writeln!(f, "requests sent again       {}", self.retries)?;
        writeln!(
            f,
            "characters damaged        {} of requests, {} of replies",
            self.faults.damaged_request_characters, self.faults.damaged_reply_characters
        )?;
        writeln!(f, "power cuts                {power_cuts}, outages {outages}, switches turned {switches}")?;
        writeln!(f, "other shafts              {shafts}, other worlds {worlds}, pauses of masters {pauses}")?;
        let micros = self.latest_watchdog.as_nanos() / 1_000;
        writeln!(f, "watchdogs run out         {}, seen {micros} us late at most", self.watchdogs)?;
        write!(f, "shadows: latches taken    {}, replies alike {}", self.shadow_latches, self.shadow_replies)
    }
}

/// Something that must hold did not.
#[derive(Debug, Clone)]
pub struct Violation {
    /// When, on the bus.
    pub at: Instant,
    /// The encoder, by its number from 0.
    pub encoder: usize,
    /// What.
    pub what: String,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let millis = self.at.as_nanos() / 1_000_000;
        write!(f, "encoder {} at {millis} ms: {}", self.encoder, self.what)
    }
}

impl std::error::Error for Violation {}

/// The bus with everybody on it.
struct Soak {
    line: Shared,
    masters: [Master; 2],
    encoders: Vec<Encoder>,
    chance: Chance,
    next_disturbance: Instant,
    disturbances: Disturbances,
}

/// Runs it, and calls `progress` after each hour.
///
/// # Errors
///
/// The first thing that did not hold.
pub fn run(options: &Options, mut progress: impl FnMut(Duration)) -> Result<Report, Violation> {
    let mut soak = Soak::new(options);
    let end = Instant::ZERO + options.span;
    let hour = Duration::from_secs(3_600);
    let mut next_hour = Instant::ZERO + hour;
    let mut now = Instant::ZERO;
    while now < end {
        now = soak.cycle()?;
        if now >= next_hour {
            progress(now.since(Instant::ZERO));
            next_hour += hour;
        }
    }
    Ok(soak.report(now))
}

impl Soak {
    fn new(options: &Options) -> Self {
        let mut chance = Chance::new(options.seed);
        let (mut segment, encoders) = setup::build(options, &mut chance);
        let noise = Noise { seed: options.seed, bit_errors: options.bit_errors, ..Noise::default() };
        segment.faults_mut().set_noise(noise).expect("a share from 0 to 1");
        let line = Shared::new(segment);
        let masters = setup::MASTERS.map(|address| {
            Master::new(line.clone(), Settings { address, retries: 1, ..Settings::default() })
        });
        Self {
            line,
            masters,
            encoders,
            chance,
            next_disturbance: Instant::from_millis(2_000),
            disturbances: Disturbances::default(),
        }
    }

    /// Each master in turn has the token, asks each of its encoders once, and passes it on.
    fn cycle(&mut self) -> Result<Instant, Violation> {
        let count = self.masters.len();
        for (own, master) in self.masters.iter_mut().enumerate() {
            for (at, encoder) in self.encoders.iter_mut().enumerate().skip(own).step_by(count) {
                let now = master.now();
                encoder.step(master, &mut self.chance, now).map_err(|what| Violation {
                    at: now,
                    encoder: at,
                    what,
                })?;
            }
            let [to, from] = [setup::MASTERS[(own + 1) % count], setup::MASTERS[own]];
            master::Line::tell(master.line_mut(), &[0xDC, to, from]).expect("a virtual line never breaks");
        }
        let now = self.masters[0].now();
        if let Some((encoder, what)) = self.told() {
            return Err(Violation { at: now, encoder, what });
        }
        if now >= self.next_disturbance {
            disturb(
                &mut self.line.bus().segment,
                &mut self.encoders,
                &mut self.chance,
                &mut self.disturbances,
            );
            self.next_disturbance = now + self.chance.millis(50, 350);
        }
        Ok(now)
    }

    /// What a station itself has found.
    fn told(&mut self) -> Option<(usize, String)> {
        let bus = self.line.bus();
        let mut stations = bus.segment.stations().iter().enumerate();
        stations.find_map(|(at, station)| Some((at, station.violation.clone()?)))
    }

    fn report(&self, now: Instant) -> Report {
        let bus = self.line.bus();
        let mut report = Report {
            span: now.since(Instant::ZERO),
            disturbances: self.disturbances,
            faults: bus.segment.faults().counters(),
            ..Report::default()
        };
        for encoder in &self.encoders {
            let counts = encoder.counts;
            report.exchanges += counts.exchanges;
            report.diagnoses += counts.diagnoses;
            report.presets += counts.presets;
            report.unconfirmed_presets += counts.unconfirmed;
            report.start_ups += counts.start_ups;
            report.moves += counts.moves;
        }
        for station in bus.segment.stations() {
            report.watchdogs += station.watched.expiries;
            report.latest_watchdog = report.latest_watchdog.max(station.watched.latest);
            if let Some(shadow) = &station.shadow {
                report.shadow_latches += shadow.latches;
                report.shadow_replies += shadow.replies;
            }
        }
        report.retries = self.masters.iter().map(|master| master.counters().retries).sum();
        report
    }
}
