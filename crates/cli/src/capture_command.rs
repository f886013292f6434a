//! `sch108bex capture`: listens to a bus and sends nothing.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant as Moment};

use bus::{End, Event, PortAddress, Sight, WallClock, WireTap, open_for_slaves};
use capture::{LinkType, Tap};
use clap::Args;
use dissector::splitter::{Piece, Splitter};
use profibus_dp::fdl::BaudSetting;
use profibus_dp::time::{Baudrate, Instant};
use serde::Serialize;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

use crate::arguments::{Baud, whole};
use crate::{Failure, output, recording};

/// How long to listen at a rate before the next one is tried: a master repeats itself within that.
const AT_A_RATE: Duration = Duration::from_millis(600);

/// The rates from fast to slow.
const RATES: [Baudrate; 10] = [
    Baudrate::B12000000,
    Baudrate::B6000000,
    Baudrate::B3000000,
    Baudrate::B1500000,
    Baudrate::B500000,
    Baudrate::B187500,
    Baudrate::B93750,
    Baudrate::B45450,
    Baudrate::B19200,
    Baudrate::B9600,
];

/// Listen to a bus without sending, and keep what is on it as pcapng
///
/// Prints `bus: WHERE` and `ready`, then listens until Ctrl-C or --for. The file can be read at any time,
/// also after `kill -9`.
#[derive(Debug, Args)]
pub(crate) struct Capture {
    /// Where to listen: a serial device (an adapter on any bus), pty, tcp-listen:ADDRESS:PORT,
    /// tcp:ADDRESS:PORT or unix:PATH
    #[arg(long, value_name = "PORT")]
    port: PortAddress,
    /// The file to write; one that is there is replaced
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The rate of a serial device: auto tries one after the other until telegrams are heard
    #[arg(long, default_value = "auto", value_name = "auto|RATE", allow_hyphen_values = true)]
    baud: Baud,
    /// What PROFIBUS is called in the file: 147 (USER0, for our Wireshark dissector) or 257 (PROFIBUS_DL)
    #[arg(long, default_value_t, value_name = "147|257")]
    link_type: LinkType,
    /// End after so many seconds
    #[arg(long = "for", value_name = "SECONDS", value_parser = whole::<u64>(1..=31_536_000), allow_hyphen_values = true)]
    seconds: Option<u64>,
    /// The result as a document
    #[arg(long)]
    json: bool,
}

/// What is printed at the end.
#[derive(Debug, Serialize)]
struct Heard {
    packets: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    bits_per_second: Option<u32>,
}

impl Capture {
    /// Listens until it is told to end.
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let failed = |error: &dyn std::fmt::Display| Failure::Failed(error.to_string());
        let setting = match self.baud {
            Baud::Auto => BaudSetting::Search(bus::segment::DEFAULT_RATE),
            Baud::Fixed(rate) => BaudSetting::Fixed(rate),
        };
        let end = open_for_slaves(&self.port, setting).map_err(|error| failed(&error))?;
        let ending = end_on_signals(end.as_ref())?;
        let recorder = recording::start(&self.file, self.link_type, end.name())?;
        if !self.json {
            output::line(&format!("bus: {}", end.name()));
            output::line("ready");
        }
        let mut listener = Listener {
            clock: WallClock::new(),
            tap: recorder.tap(),
            search: Search::new(end.as_ref(), self.baud),
            end,
        };
        let until = self.seconds.and_then(|seconds| Moment::now().checked_add(Duration::from_secs(seconds)));
        let outcome = listener.listen(&ending, until);
        let rate = listener.search.rate;
        drop(listener);
        let packets = recording::end(recorder, &self.file)?;
        outcome.map_err(|error| failed(&error))?;
        let bits_per_second = rate.map(Baudrate::bits_per_second);
        if self.json {
            output::json(&Heard { packets, bits_per_second });
        } else {
            let rate = bits_per_second.map_or_else(String::new, |rate| format!(" at {rate} bit/s"));
            output::line(&format!("{packets} packets{rate} in {}", self.file.display()));
        }
        Ok(())
    }
}

/// Ctrl-C and SIGTERM end the waiting.
fn end_on_signals(end: &dyn End) -> Result<Arc<AtomicBool>, Failure> {
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP])
        .map_err(|error| Failure::Failed(format!("cannot take note of Ctrl-C: {error}")))?;
    let ending = Arc::new(AtomicBool::new(false));
    let (told, waker) = (Arc::clone(&ending), end.waker());
    std::thread::spawn(move || {
        signals.forever().next();
        told.store(true, Ordering::SeqCst);
        waker.wake();
    });
    Ok(ending)
}

struct Listener {
    end: Box<dyn End>,
    clock: WallClock,
    tap: Tap,
    search: Search,
}

impl Listener {
    fn listen(&mut self, ending: &AtomicBool, until: Option<Moment>) -> Result<(), bus::EndError> {
        let mut buffer = vec![0; 4096];
        while !ending.load(Ordering::SeqCst) {
            let left = until.map(|until| until.saturating_duration_since(Moment::now()));
            if left.is_some_and(|left| left.is_zero()) {
                return Ok(());
            }
            if let Some(rate) = self.search.next_rate() {
                self.end.tune(rate)?;
                self.tap.saw(self.clock.now(), Sight::Rate(Some(rate)));
            }
            let least = left.unwrap_or(AT_A_RATE).min(AT_A_RATE);
            let event = self.end.wait(Some(core_duration(least)), &mut buffer)?;
            self.take(self.clock.now(), event, &buffer);
        }
        Ok(())
    }

    fn take(&mut self, now: Instant, event: Event, buffer: &[u8]) {
        match event {
            Event::Octets(count) => {
                let octets = buffer.get(..count).unwrap_or_default();
                self.tap.heard(now, octets);
                self.search.hear(octets);
            }
            Event::LineError => self.tap.saw(now, Sight::CharacterError),
            Event::Came(rate) => {
                self.search.told(rate);
                self.tap.saw(now, Sight::MasterCame(rate));
            }
            Event::Rate(rate) => {
                self.search.told(rate);
                self.tap.saw(now, Sight::Rate(rate));
            }
            Event::Left => self.tap.saw(now, Sight::MasterLeft),
            Event::Noted(note) => output::aside(&format!("note: {note}")),
            Event::Woken | Event::TimedOut => {}
        }
    }
}

/// The rate of a serial device: tried until telegrams are heard.
#[derive(Default)]
struct Search {
    rate: Option<Baudrate>,
    searching: bool,
    fixed: Option<Baudrate>,
    next: usize,
    since: Option<Moment>,
    splitter: Splitter,
}

impl Search {
    fn new(end: &dyn End, baud: Baud) -> Self {
        match (end.is_tunable(), baud) {
            (true, Baud::Auto) => Self { searching: true, ..Self::default() },
            (true, Baud::Fixed(rate)) => Self { rate: Some(rate), fixed: Some(rate), ..Self::default() },
            (false, _) => Self::default(),
        }
    }

    /// The rate to listen at from now on, if it is another.
    fn next_rate(&mut self) -> Option<Baudrate> {
        if let Some(rate) = self.fixed.take() {
            return Some(rate);
        }
        let over = self.since.is_none_or(|since| since.elapsed() >= AT_A_RATE);
        if !self.searching || !over {
            return None;
        }
        let rate = RATES[self.next % RATES.len()];
        (self.next, self.since, self.splitter) = (self.next + 1, Some(Moment::now()), Splitter::default());
        Some(rate)
    }

    /// A telegram with a check sum ends the search.
    fn hear(&mut self, octets: &[u8]) {
        if !self.searching {
            return;
        }
        let mut found = false;
        self.splitter.push(octets, &mut |piece| {
            found |= matches!(piece, Piece::Telegram { octets, .. } if octets.len() >= 6);
        });
        if found {
            self.searching = false;
            self.rate = RATES.get((self.next.max(1) - 1) % RATES.len()).copied();
        }
    }

    fn told(&mut self, rate: Option<Baudrate>) {
        if !self.searching {
            self.rate = rate.or(self.rate);
        }
    }
}

fn core_duration(span: Duration) -> profibus_dp::time::Duration {
    profibus_dp::time::Duration::from_nanos(u64::try_from(span.as_nanos()).unwrap_or(u64::MAX))
}
