//! `sch108bex master run`: a slave in data exchange, on profirust.

use std::sync::atomic::Ordering;

use ::master::commissioning::{Asked, Bus, Life, RealBus};
use ::master::{Commissioner, MasterSettings, Service, SlaveSettings};
use clap::Args;
use profibus_dp::time::{Duration, Instant};
use profibus_dp::wire::StandardDiagnosis;
use sch108bex::functionality::Functionality;
use serde_json::json;

use super::Master;
use crate::arguments::whole;
use crate::commission::parameters::{Octets, Project, lengths, octets, watchdog};
use crate::commission::session::{check_ident, meet, refusal};
use crate::commission::{Light, seconds, span, until_stopped, words};
use crate::{Failure, output};

/// A line with inputs after so long.
const REPORT_EVERY: Duration = Duration::from_millis(500);

/// Parameters, configuration, outputs, and for how long.
#[derive(Debug, Args)]
pub(super) struct Exchange {
    #[command(flatten)]
    project: Project,
    /// The outputs, in hex; zeros without it
    #[arg(long, value_name = "HEX", value_parser = octets)]
    outputs: Option<Octets>,
    /// How long to exchange data, in seconds from 0.1 to 86400
    #[arg(long, value_name = "N", default_value = "10", value_parser = seconds)]
    seconds: f64,
    /// After how many milliseconds without this master the station gives up; 0: never
    #[arg(long, value_name = "MS", default_value_t = 1_000, value_parser = whole::<u32>(0..=650_000), allow_negative_numbers = true)]
    watchdog: u32,
}

/// What was seen.
#[derive(Debug)]
struct Seen {
    exchanges: u64,
    last: Option<Instant>,
    least: Duration,
    most: Duration,
    sum: Duration,
    retries_before: u64,
    reported: Instant,
    offline: bool,
}

impl Exchange {
    /// What can be said before a port is opened.
    pub(super) fn check(&self) -> Result<(), Failure> {
        self.project.check()?;
        if let (Some(Octets(cfg)), Some(Octets(outputs))) = (&self.project.cfg, &self.outputs) {
            let due = lengths(cfg)?.outputs;
            check_outputs(outputs, due)?;
        }
        Ok(())
    }

    pub(super) fn run(&self, master: &Master, mut light: Light, address: u8) -> Result<(), Failure> {
        let place = &master.place;
        let found = meet(&mut light, address)?;
        let mut slave = self.project.slave(address, place.baud, &found, Functionality::Scancon2)?;
        check_ident(&slave, &found)?;
        slave.parameters.watchdog = watchdog(self.watchdog)?;
        let settings = MasterSettings {
            address: place.own_address,
            rate: place.baud,
            slot_time: place.slot(),
            retries: place.retries,
        };
        let bus = RealBus::new(light.into_line().into_end(), place.baud).alone();
        let mut commissioner =
            Commissioner::new(bus, settings, &slave).map_err(|error| Failure::Usage(error.to_string()))?;
        if let Some(Octets(outputs)) = &self.outputs {
            check_outputs(outputs, slave.outputs)?;
            commissioner.outputs_mut().copy_from_slice(outputs);
        }
        let result = self.exchange(master, &mut commissioner, &slave);
        // The next master finds it free.
        let [high, low] = slave.parameters.ident_number.to_be_bytes();
        let unlock =
            Asked { slave: slave.address, service: Service::SetPrm, data: vec![0x40, 0, 0, 0, high, low, 0] };
        if result.is_ok() {
            let _ = commissioner.ask_within(Duration::from_millis(500), unlock);
        }
        result
    }

    fn exchange(
        &self,
        master: &Master,
        commissioner: &mut Commissioner<'_, RealBus>,
        slave: &SlaveSettings,
    ) -> Result<(), Failure> {
        let address = slave.address;
        let stop = until_stopped()?;
        let begun = commissioner.now();
        let span = span(self.seconds);
        let mut seen = Seen {
            exchanges: 0,
            last: None,
            least: Duration::from_secs(u64::MAX),
            most: Duration::ZERO,
            sum: Duration::ZERO,
            retries_before: 0,
            reported: begun,
            offline: false,
        };
        let mut until = begun + START_WITHIN;
        while commissioner.now() < until && !stop.load(Ordering::Relaxed) {
            let event = commissioner.poll().map_err(|error| Failure::Failed(error.to_string()))?;
            if commissioner.bus().is_gone() {
                return Err(Failure::Failed(format!(
                    "the far side of {} has closed the line",
                    master.place.port
                )));
            }
            let Some(event) = event else { continue };
            if event == Life::Exchanged && seen.exchanges == 0 {
                until = commissioner.now() + span;
                seen.reported = commissioner.now();
            }
            seen.take(master, commissioner, slave, event, begun)?;
        }
        if seen.exchanges == 0 {
            return Err(Failure::Failed(format!("station {address} has not come into data exchange")));
        }
        if !commissioner.is_running() {
            return Err(Failure::Failed(format!("station {address} was lost, and is not back yet")));
        }
        seen.sum_up(master, commissioner);
        Ok(())
    }
}

/// From the first poll to the first exchange.
const START_WITHIN: Duration = Duration::from_secs(15);

impl Seen {
    fn take(
        &mut self,
        master: &Master,
        commissioner: &mut Commissioner<'_, RealBus>,
        settings: &SlaveSettings,
        event: Life,
        begun: Instant,
    ) -> Result<(), Failure> {
        let (now, slave) = (commissioner.now(), settings.address);
        match event {
            Life::Exchanged => self.exchanged(master, commissioner, now, begun),
            Life::ParametersRefused | Life::ConfigurationRefused => {
                if let Some(failure) = refused(commissioner, settings, event) {
                    return Err(failure);
                }
                // Its watchdog expired between Set_Prm and Chk_Cfg, say: it is given both again.
                tell(master, &json!({"event": "parameters_lost", "address": slave}), || {
                    format!("station {slave} has no parameters any more, and gets them again")
                });
            }
            Life::Diagnosis => diagnosis(master, commissioner, slave),
            Life::Online | Life::Configured | Life::Offline => {
                self.offline = event == Life::Offline;
                if event == Life::Online {
                    self.retries_before = commissioner.bus().traffic().retries;
                }
                tell(master, &json!({"event": name(event), "address": slave}), || {
                    format!("station {slave} {event}")
                });
            }
        }
        Ok(())
    }

    fn exchanged(
        &mut self,
        master: &Master,
        commissioner: &mut Commissioner<'_, RealBus>,
        now: Instant,
        begun: Instant,
    ) {
        if let Some(last) = self.last.replace(now) {
            let cycle = now.since(last);
            (self.least, self.most) = (self.least.min(cycle), self.most.max(cycle));
            self.sum = self.sum + cycle;
        }
        self.exchanges += 1;
        if self.exchanges > 1 && now.since(self.reported) < REPORT_EVERY {
            return;
        }
        self.reported = now;
        let millis = now.since(begun).as_millis();
        let (cycle, retries) = (self.mean_us(), commissioner.bus().traffic().retries - self.retries_before);
        let inputs = words::hex(commissioner.inputs());
        let document = json!({"event": "exchanged", "ms": millis, "inputs": inputs, "cycle_us": cycle, "retries": retries});
        tell(master, &document, || {
            let seconds = std::time::Duration::from_millis(millis).as_secs_f64();
            let cycle = cycle.map_or_else(String::new, |cycle| format!("  cycle {cycle} us"));
            format!("{seconds:>9.3}  inputs {inputs}{cycle}  {retries} retries")
        });
    }

    /// From exchange to exchange; `None` until there are two.
    fn mean_us(&self) -> Option<u64> {
        (self.sum.as_nanos() / 1_000).checked_div(self.exchanges - 1)
    }

    fn sum_up(&self, master: &Master, commissioner: &Commissioner<'_, RealBus>) {
        let micros = |span: Duration| span.as_nanos() / 1_000;
        let exchanges = self.exchanges;
        let cycles = self.mean_us().map(|mean| (micros(self.least), mean, micros(self.most)));
        let retries = commissioner.bus().traffic().retries - self.retries_before;
        let document = json!({
            "event": "end", "exchanges": exchanges, "retries": retries,
            "cycle_us": cycles.map(|(least, mean, most)| json!({"least": least, "mean": mean, "most": most})),
        });
        tell(master, &document, || {
            let cycles = cycles.map_or_else(String::new, |(least, mean, most)| {
                format!("; cycle {least} to {most} us, {mean} us on average")
            });
            format!("{exchanges} exchanges{cycles}; {retries} retries")
        });
    }
}

/// A line of a stream.
fn tell(master: &Master, document: &serde_json::Value, text: impl FnOnce() -> String) {
    if master.json {
        output::json_line(document);
    } else {
        output::line(&text());
    }
}

/// What happened, as a word that does not change.
const fn name(event: Life) -> &'static str {
    match event {
        Life::Online => "online",
        Life::Configured => "configured",
        Life::ParametersRefused => "parameters_refused",
        Life::ConfigurationRefused => "configuration_refused",
        Life::Exchanged => "exchanged",
        Life::Diagnosis => "diagnosis",
        Life::Offline => "offline",
    }
}

/// The diagnosis that was fetched, in words.
fn diagnosis(master: &Master, commissioner: &mut Commissioner<'_, RealBus>, slave: u8) {
    let Some((standard, extended)) = commissioner.diagnosis() else {
        return;
    };
    let octets = [&standard.emit()[..], &extended].concat();
    let read = dissector::advice::Diagnosis::read(&octets);
    let findings = read.map(|read| read.findings).unwrap_or_default();
    let document = json!({
        "event": "diagnosis", "address": slave, "octets": words::hex(&octets), "findings": findings,
    });
    tell(master, &document, || {
        let fields = words::fields(slave, master.place.own_address, words::SLAVE_DIAG, &octets);
        format!("diagnosis {}", words::text(&octets, &fields))
    });
}

/// Why a slave does not go on, as far as it says so; `None`: it has no fault to tell of.
fn refused(
    commissioner: &mut Commissioner<'_, RealBus>,
    settings: &SlaveSettings,
    event: Life,
) -> Option<Failure> {
    let slave = settings.address;
    let mut ask = |service| {
        let asked = Asked { slave, service, data: Vec::new() };
        match commissioner.ask_within(Duration::from_secs(2), asked) {
            Ok(Some(::master::commissioning::Outcome::Answer(_, octets))) => Some(octets),
            _ => None,
        }
    };
    let Some(octets) = ask(Service::SlaveDiag) else {
        return Some(Failure::Failed(format!(
            "station {slave} {event}; compare them with its manual, or with its GSD file"
        )));
    };
    let faults = StandardDiagnosis::parse(&octets);
    if faults.is_some_and(|faults| !(faults.prm_fault || faults.cfg_fault || faults.not_supported)) {
        return None;
    }
    let get_cfg = ask(Service::GetCfg);
    output::aside(&words::text(&octets, &words::fields(slave, 0, words::SLAVE_DIAG, &octets)));
    Some(refusal(slave, settings, &octets, get_cfg.as_deref()))
}

fn check_outputs(outputs: &[u8], due: u8) -> Result<(), Failure> {
    if outputs.len() == usize::from(due) {
        return Ok(());
    }
    Err(Failure::Usage(format!(
        "--outputs has {} octets, but the configuration has {due}; write as many",
        outputs.len()
    )))
}
