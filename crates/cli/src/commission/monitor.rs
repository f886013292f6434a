//! `monitor`: position, velocity and acceleration as they come.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use sch108bex::functionality::Functionality;
use serde_json::{Value, json};

use super::listen::Listener;
use super::parameters::{Project, watchdog};
use super::place::Place;
use super::readings::{Extremes, Machine, Reader, Reading, Sample, Scale};
use super::session::{Session, meet, owner};
use super::watch::{Panel, bars};
use super::{Light, failed, find, seconds, until_stopped};
use crate::arguments::whole;
use crate::{Failure, output};

/// A line after so long, and a panel anew after so long.
const LINE_EVERY: Duration = Duration::from_millis(500);
const PANEL_EVERY: Duration = Duration::from_millis(50);
/// So many values are drawn as bars.
const BARS: usize = 60;
/// How long a station that is lost is left alone before the next start-up.
const AGAIN_AFTER: Duration = Duration::from_millis(500);

/// Position, velocity and acceleration as they come, in steps and in the machine's units
///
/// It starts the encoder up (Scancon 2.0 with the manual's defaults, if no parameters are given) and leaves it
/// free in the end. Of an encoder that belongs to another master it only reads the inputs (RD_Inp). With --listen it
/// sends nothing at all.
#[derive(Debug, Args)]
pub(crate) struct Monitor {
    /// The station, 0 to 125; without it the only one that answers
    #[arg(value_parser = whole::<u8>(0..=125), allow_negative_numbers = true)]
    address: Option<u8>,
    #[command(flatten)]
    place: Place,
    #[command(flatten)]
    project: Project,
    #[command(flatten)]
    machine: Machine,
    /// For so many seconds; without it until Ctrl-C
    #[arg(long, value_name = "N", value_parser = seconds)]
    seconds: Option<f64>,
    /// From request to request, in milliseconds
    #[arg(long, value_name = "MS", default_value_t = 10, value_parser = whole::<u16>(1..=10_000), allow_negative_numbers = true)]
    cycle: u16,
    /// After how many milliseconds without this master the station gives up; 0: never
    #[arg(long, value_name = "MS", default_value_t = 1_000, value_parser = whole::<u32>(0..=650_000), allow_negative_numbers = true)]
    watchdog: u32,
    /// Only listen to what another master exchanges with it; --port is then where to listen, as for `capture`
    #[arg(long, conflicts_with_all = ["gsd", "prm", "class", "units", "ident"])]
    listen: bool,
    /// Lines also on a terminal
    #[arg(long)]
    plain: bool,
    /// One object a line for each reading that is shown, and one with the sum at the end
    #[arg(long)]
    json: bool,
}

/// What was seen so far.
struct Seen<'a> {
    monitor: &'a Monitor,
    panel: Option<Panel>,
    begun: Instant,
    shown: Option<Instant>,
    reader: Reader,
    scale: Scale,
    readings: u64,
    last: Option<Duration>,
    cycle: Extremes,
    cycles: f64,
    position: Extremes,
    speed: Extremes,
    acceleration: Extremes,
    history: VecDeque<f64>,
    retries: u64,
    lost: u64,
}

impl Monitor {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        self.place.check(self.address)?;
        self.project.check()?;
        let stop = until_stopped()?;
        if self.listen {
            return self.listen(&stop);
        }
        self.place.with(|light| {
            let address = find::station(light, self.address, "its address behind `monitor`")?;
            let diagnosis = light.diagnosis(address).map_err(failed)?.octets.to_vec();
            match owner(&diagnosis).filter(|owner| *owner != self.place.own_address) {
                Some(owner) => self.read(light, address, owner, &stop),
                None => self.exchange(light, address, &stop),
            }
        })
    }

    fn goes_on(&self, seen: &Seen<'_>, stop: &AtomicBool) -> bool {
        !stop.load(Ordering::Relaxed)
            && self.seconds.is_none_or(|seconds| seen.begun.elapsed().as_secs_f64() < seconds)
    }

    fn seen(&self) -> Seen<'_> {
        Seen {
            monitor: self,
            panel: if self.json { None } else { Panel::new(self.plain) },
            begun: Instant::now(),
            shown: None,
            reader: Reader::default(),
            scale: Scale::default(),
            readings: 0,
            last: None,
            cycle: Extremes::default(),
            cycles: 0.0,
            position: Extremes::default(),
            speed: Extremes::default(),
            acceleration: Extremes::default(),
            history: VecDeque::with_capacity(BARS),
            retries: 0,
            lost: 0,
        }
    }

    /// As its master.
    fn exchange(&self, light: &mut Light, address: u8, stop: &AtomicBool) -> Result<(), Failure> {
        let diagnosis = meet(light, address)?;
        let mut slave = self.project.slave(address, self.place.baud, &diagnosis, Functionality::Scancon2)?;
        slave.parameters.watchdog = watchdog(self.watchdog)?;
        let mut session = Session::begin(light, slave, &diagnosis)?;
        let mut seen = self.seen();
        seen.scale = Scale::of(session.diagnosis(), &session.slave().parameters.set_prm());
        let before = session.light().counters().retries;
        let mut lost: Option<Failure> = None;
        while self.goes_on(&seen, stop) {
            let next = Instant::now() + Duration::from_millis(self.cycle.into());
            if lost.is_some() {
                session.wait(AGAIN_AFTER)?;
                if session.again().is_ok() {
                    lost = None;
                    seen.note(&format!("station {address} is back"));
                }
                continue;
            }
            match session.exchange() {
                Ok(inputs) => {
                    seen.retries = session.light().counters().retries - before;
                    seen.take(sample(address, &inputs)?);
                }
                Err(failure) if session.light().line().is_gone() => return Err(failure),
                Err(failure) => {
                    seen.note(&failure.to_string());
                    (seen.lost, seen.last, lost) = (seen.lost + 1, None, Some(failure));
                }
            }
            session.wait(next.saturating_duration_since(Instant::now()))?;
        }
        if let Some(failure) = lost {
            return Err(failure);
        }
        session.end();
        seen.sum();
        Ok(())
    }

    /// Beside its master.
    fn read(&self, light: &mut Light, address: u8, owner: u8, stop: &AtomicBool) -> Result<(), Failure> {
        output::aside(&format!(
            "station {address} belongs to master {owner}: its inputs are only read, and the time base of its velocity is not known"
        ));
        let mut seen = self.seen();
        let diagnosis = light.diagnosis(address).map_err(failed)?.octets.to_vec();
        seen.scale = Scale::of(&diagnosis, &[]);
        let before = light.counters().retries;
        while self.goes_on(&seen, stop) {
            let next = Instant::now() + Duration::from_millis(self.cycle.into());
            let inputs = light.read_inputs(address).map_err(failed)?.to_vec();
            seen.retries = light.counters().retries - before;
            seen.take(sample(address, &inputs)?);
            std::thread::sleep(next.saturating_duration_since(Instant::now()));
        }
        seen.sum();
        Ok(())
    }

    /// Without a word.
    fn listen(&self, stop: &AtomicBool) -> Result<(), Failure> {
        let mut listener = Listener::open(&self.place.port, self.place.baud, self.address)?;
        let mut seen = self.seen();
        while self.goes_on(&seen, stop) {
            for sample in listener.listen(PANEL_EVERY)? {
                (seen.scale, seen.retries) = (listener.scale, listener.retries);
                seen.take(sample);
            }
        }
        if seen.readings == 0 {
            let whom = listener
                .address()
                .or(self.address)
                .map_or_else(|| "any station".to_owned(), |address| format!("station {address}"));
            return Err(Failure::Failed(format!(
                "no position of {whom} was heard; does its master exchange data, and is --baud its rate?"
            )));
        }
        seen.sum();
        Ok(())
    }
}

fn sample(address: u8, inputs: &[u8]) -> Result<Sample, Failure> {
    Sample::of(inputs).ok_or_else(|| {
        Failure::Failed(format!(
            "station {address} gives {} octets of inputs, but a position has 4; choose another module",
            inputs.len()
        ))
    })
}

impl Seen<'_> {
    fn take(&mut self, sample: Sample) {
        let at = self.begun.elapsed();
        if let Some(last) = self.last.replace(at) {
            let cycle = at.saturating_sub(last).as_secs_f64() * 1e6;
            self.cycle.take(Some(cycle));
            self.cycles += cycle;
        }
        self.readings += 1;
        let reading = self.reader.read(at, sample, &self.scale);
        self.position.take(Some(f64::from(sample.position)));
        self.speed.take(reading.rpm);
        self.acceleration.take(reading.rpm_per_second);
        let every = if self.panel.is_some() { PANEL_EVERY } else { LINE_EVERY };
        if self.shown.is_some_and(|shown| shown.elapsed() < every) {
            return;
        }
        self.shown = Some(Instant::now());
        if self.history.len() == BARS {
            self.history.pop_front();
        }
        self.history.push_back(reading.rpm.unwrap_or_else(|| f64::from(sample.position)));
        self.show(at, &reading);
    }

    fn show(&mut self, at: Duration, reading: &Reading) {
        if self.monitor.json {
            output::json_line(&self.document(at, reading));
        } else if self.panel.is_some() {
            let lines = self.lines(reading);
            if let Some(panel) = &mut self.panel {
                panel.draw(&lines);
            }
        } else {
            output::line(&format!("{:9.3}  {}", at.as_secs_f64(), self.line(reading)));
        }
    }

    /// Turns or RPM in the machine's units, and how those are called.
    fn in_units(&self, turns: Option<f64>) -> Option<f64> {
        turns.zip(self.monitor.machine.units_per_turn).map(|(turns, units)| turns * units)
    }

    fn unit(&self) -> &str {
        &self.monitor.machine.unit
    }

    fn line(&self, reading: &Reading) -> String {
        let mut parts = vec![format!("position {}", reading.sample.position)];
        match self.in_units(reading.turns) {
            Some(value) => parts.push(format!("{value:.3} {}", self.unit())),
            None => parts.extend(reading.turns.map(|turns| format!("{turns:.3} turns"))),
        }
        parts.extend(self.speed_words(reading));
        parts.extend(self.acceleration_words(reading));
        parts.extend(self.mean_us().map(|mean| format!("cycle {mean:.0} us")));
        parts.push(format!("{} retries", self.retries));
        parts.join("  ")
    }

    fn speed_words(&self, reading: &Reading) -> Option<String> {
        let Some(rpm) = reading.rpm else {
            return reading.sample.velocity.map(|velocity| format!("velocity {velocity} in its time base"));
        };
        Some(match self.in_units(Some(rpm / 60.0)) {
            Some(speed) => format!("{speed:+.3} {}/s ({rpm:+.1} RPM)", self.unit()),
            None => format!("{rpm:+.1} RPM"),
        })
    }

    fn acceleration_words(&self, reading: &Reading) -> Option<String> {
        let rpm_per_second = reading.rpm_per_second?;
        Some(match self.in_units(Some(rpm_per_second / 60.0)) {
            Some(value) => format!("{value:+.3} {}/s2", self.unit()),
            None => format!("{rpm_per_second:+.1} RPM/s"),
        })
    }

    /// The panel.
    fn lines(&self, reading: &Reading) -> Vec<String> {
        let range = |extremes: Extremes, digits: usize| {
            extremes
                .0
                .map_or_else(String::new, |(least, most)| format!("{least:.digits$} to {most:.digits$}"))
        };
        let Sample { position, velocity, acceleration } = reading.sample;
        let raw = |value: Option<i32>| value.map_or_else(|| "-".to_owned(), |value| value.to_string());
        let place = self.in_units(reading.turns).map_or_else(
            || reading.turns.map_or_else(String::new, |turns| format!("{turns:.3} turns")),
            |value| format!("{value:.3} {}", self.unit()),
        );
        vec![
            format!("  position      {position:>12}   {place:24}  {}", range(self.position, 0)),
            format!(
                "  velocity      {:>12}   {:24}  {} RPM",
                raw(velocity),
                self.speed_words(reading).unwrap_or_default(),
                range(self.speed, 1)
            ),
            format!(
                "  acceleration  {:>12}   {:24}  {} RPM/s",
                raw(acceleration),
                self.acceleration_words(reading).unwrap_or_default(),
                range(self.acceleration, 1)
            ),
            format!("                {}", bars(self.history.iter())),
            format!(
                "  bus           cycle {} us, {:.0} on average; {} readings, {} retries, lost {} times",
                range(self.cycle, 0),
                self.mean_us().unwrap_or(0.0),
                self.readings,
                self.retries,
                self.lost
            ),
        ]
    }

    #[expect(clippy::cast_precision_loss, reason = "for reading only")]
    fn mean_us(&self) -> Option<f64> {
        self.cycle.0.map(|_| self.cycles / self.readings.saturating_sub(1 + self.lost).max(1) as f64)
    }

    fn document(&self, at: Duration, reading: &Reading) -> Value {
        let mut document = json!({
            "ms": u64::try_from(at.as_millis()).unwrap_or(u64::MAX),
            "position": reading.sample.position,
            "velocity": reading.sample.velocity,
            "acceleration": reading.sample.acceleration,
            "turns": reading.turns,
            "rpm": reading.rpm,
            "rpm_per_second": reading.rpm_per_second,
            "cycle_us": self.mean_us().map(f64::round),
            "retries": self.retries,
        });
        if self.monitor.machine.units_per_turn.is_some() {
            document["unit"] = self.unit().into();
            document["value"] = self.in_units(reading.turns).into();
            document["value_per_second"] = self.in_units(reading.rpm.map(|rpm| rpm / 60.0)).into();
        }
        document
    }

    /// Something beside the readings.
    fn note(&mut self, text: &str) {
        if self.monitor.json {
            output::json_line(&json!({"note": text}));
        } else {
            output::aside(text);
        }
    }

    fn sum(&self) {
        let extremes =
            |extremes: Extremes| extremes.0.map(|(least, most)| json!({"least": least, "most": most}));
        if self.monitor.json {
            let mut cycle = extremes(self.cycle);
            if let Some(cycle) = &mut cycle {
                cycle["mean"] = self.mean_us().into();
            }
            output::json_line(&json!({"sum": {
                "readings": self.readings, "retries": self.retries, "lost": self.lost, "cycle_us": cycle,
                "position": extremes(self.position), "rpm": extremes(self.speed),
                "rpm_per_second": extremes(self.acceleration),
            }}));
            return;
        }
        let told = |name: &str, extremes: Extremes, digits: usize, unit: &str| {
            extremes.0.map(|(least, most)| format!("{name} {least:.digits$} to {most:.digits$}{unit}"))
        };
        let mut parts = vec![format!("{} readings", self.readings)];
        parts.extend(told("position", self.position, 0, ""));
        parts.extend(told("velocity", self.speed, 1, " RPM"));
        parts.extend(told("acceleration", self.acceleration, 1, " RPM/s"));
        parts.extend(told("cycle", self.cycle, 0, " us"));
        parts.push(format!("{} retries", self.retries));
        output::line(&parts.join("; "));
    }
}
