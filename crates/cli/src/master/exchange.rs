//! `sch108bex master run`: a slave in data exchange, on profirust.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use ::master::commissioning::{Asked, Bus, Life, RealBus};
use ::master::{Commissioner, Gsd, MasterSettings, Parameters, Service, SlaveSettings, Watchdog};
use clap::Args;
use profibus_dp::time::{Duration, Instant};
use profibus_dp::wire::StandardDiagnosis;
use profibus_dp::wire::chk_cfg::Lengths;
use serde_json::json;
use signal_hook::consts::{SIGINT, SIGTERM};

use super::{Light, Master, failed, words};
use crate::arguments::{ident_number, whole};
use crate::{Failure, output};

/// A line with inputs after so long.
const REPORT_EVERY: Duration = Duration::from_millis(500);

/// Parameters, configuration, outputs, and for how long.
#[derive(Debug, Args)]
pub(super) struct Exchange {
    /// The GSD file of the device
    #[arg(long, value_name = "FILE", required_unless_present_all = ["prm", "cfg"], conflicts_with_all = ["prm", "cfg", "ident"])]
    gsd: Option<PathBuf>,
    /// The module, by its name in the GSD file
    #[arg(long, value_name = "NAME", requires = "gsd")]
    module: Option<String>,
    /// A parameter, by its name in the GSD file, and its value or text; may be repeated
    #[arg(long, value_name = "NAME=VALUE", requires = "gsd", value_parser = pair)]
    set: Vec<(String, String)>,
    /// Set_Prm from octet 8 on, in hex
    #[arg(long, value_name = "HEX", requires = "cfg", value_parser = octets)]
    prm: Option<Octets>,
    /// The identifier octets of Chk_Cfg, in hex
    #[arg(long, value_name = "HEX", requires = "prm", value_parser = octets)]
    cfg: Option<Octets>,
    /// The ident number that goes with --prm; without it the one in the diagnosis
    #[arg(long, value_name = "0xHHHH", value_parser = ident_number)]
    ident: Option<u16>,
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

/// Octets from the command line.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Octets(Vec<u8>);

fn octets(text: &str) -> Result<Octets, String> {
    dissector::hex::octets(text).map(Octets).map_err(|error| error.to_string())
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds| (0.1..=86_400.0).contains(seconds));
    seconds.ok_or_else(|| "write seconds between 0.1 and 86400, like 10".to_owned())
}

fn pair(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() => Ok((name.to_owned(), value.to_owned())),
        _ => Err("write a parameter's name, = and its value, like \"Code sequence=0\"".to_owned()),
    }
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
        if let (Some(Octets(cfg)), Some(Octets(outputs))) = (&self.cfg, &self.outputs) {
            let due = lengths(cfg)?.outputs;
            check_outputs(outputs, due)?;
        }
        Ok(())
    }

    pub(super) fn run(&self, master: &Master, mut light: Light, slave: u8) -> Result<(), Failure> {
        let found = light.diagnosis(slave).map_err(failed)?.standard;
        if let Some(owner) = found.master_add.filter(|owner| *owner != master.own_address) {
            return Err(Failure::Failed(format!(
                "station {slave} belongs to master {owner}; end that one, or wait for its watchdog"
            )));
        }
        let slave = self.slave(master, slave, found.ident_number)?;
        let settings = MasterSettings {
            address: master.own_address,
            rate: master.baud,
            slot_time: master.slot(),
            retries: master.retries,
        };
        let bus = RealBus::new(light.into_line().into_end(), master.baud).alone();
        let mut commissioner =
            Commissioner::new(bus, settings, &slave).map_err(|error| Failure::Usage(error.to_string()))?;
        if let Some(Octets(outputs)) = &self.outputs {
            check_outputs(outputs, slave.outputs)?;
            commissioner.outputs_mut().copy_from_slice(outputs);
        }
        let result = self.exchange(master, &mut commissioner, slave.address);
        // The next master finds it free.
        let [high, low] = slave.parameters.ident_number.to_be_bytes();
        let unlock =
            Asked { slave: slave.address, service: Service::SetPrm, data: vec![0x40, 0, 0, 0, high, low, 0] };
        if result.is_ok() {
            let _ = commissioner.ask_within(Duration::from_millis(500), unlock);
        }
        result
    }

    fn slave(&self, master: &Master, address: u8, found: u16) -> Result<SlaveSettings, Failure> {
        let mut slave = match (&self.gsd, &self.prm, &self.cfg) {
            (Some(path), ..) => {
                let wrong = |why: String| Failure::Failed(format!("--gsd {}: {why}", path.display()));
                let text = gsd_reader::read_text(path).map_err(|error| wrong(error.to_string()))?;
                let gsd = Gsd::parse(&path.display().to_string(), &text)
                    .map_err(|error| wrong(error.to_string()))?;
                gsd.slave(address, master.baud, self.module.as_deref(), &self.set)
                    .map_err(|error| wrong(error.to_string()))?
            }
            (None, Some(Octets(prm)), Some(Octets(cfg))) => {
                let Lengths { inputs, outputs } = lengths(cfg)?;
                SlaveSettings {
                    address,
                    parameters: Parameters {
                        ident_number: self.ident.unwrap_or(found),
                        user: prm.clone(),
                        ..Parameters::default()
                    },
                    configuration: cfg.clone(),
                    inputs,
                    outputs,
                    max_tsdr: u16::try_from(master.baud.max_tsdr().0).unwrap_or(u16::MAX),
                }
            }
            _ => return Err(Failure::Usage("give --gsd, or --prm and --cfg".to_owned())),
        };
        let ident = slave.parameters.ident_number;
        if ident != found {
            return Err(Failure::Failed(format!(
                "station {address} has ident number {found:04X}, but the parameters are for {ident:04X}; \
                 take the GSD file of this device, or its ident number"
            )));
        }
        slave.parameters.min_tsdr = 11;
        slave.parameters.watchdog = match self.watchdog {
            0 => None,
            millis => Some(
                Watchdog::at_least(Duration::from_millis(millis.into()))
                    .map_err(|error| Failure::Usage(format!("--watchdog {millis}: {error}")))?,
            ),
        };
        Ok(slave)
    }

    fn exchange(
        &self,
        master: &Master,
        commissioner: &mut Commissioner<'_, RealBus>,
        slave: u8,
    ) -> Result<(), Failure> {
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            signal_hook::flag::register(signal, Arc::clone(&stop))
                .map_err(|error| Failure::Failed(format!("cannot take note of Ctrl-C: {error}")))?;
        }
        let begun = commissioner.now();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0.1 to 86400 s")]
        let span = Duration::from_millis((self.seconds * 1e3) as u64);
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
                return Err(Failure::Failed(format!("the far side of {} has closed the line", master.port)));
            }
            let Some(event) = event else { continue };
            if event == Life::Exchanged && seen.exchanges == 0 {
                until = commissioner.now() + span;
                seen.reported = commissioner.now();
            }
            seen.take(master, commissioner, slave, event, begun)?;
        }
        if seen.exchanges == 0 {
            return Err(Failure::Failed(format!("station {slave} has not come into data exchange")));
        }
        if !commissioner.is_running() {
            return Err(Failure::Failed(format!("station {slave} was lost, and is not back yet")));
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
        slave: u8,
        event: Life,
        begun: Instant,
    ) -> Result<(), Failure> {
        let now = commissioner.now();
        match event {
            Life::Exchanged => self.exchanged(master, commissioner, now, begun),
            Life::ParametersRefused | Life::ConfigurationRefused => {
                if let Some(failure) = refused(master, commissioner, slave, event) {
                    return Err(failure);
                }
                // Its watchdog expired between Set_Prm and Chk_Cfg, say: it is given both again.
                tell(master, &json!({"event": "has no parameters any more", "address": slave}), || {
                    format!("station {slave} has no parameters any more, and gets them again")
                });
            }
            Life::Diagnosis => diagnosis(master, commissioner, slave),
            Life::Online | Life::Configured | Life::Offline => {
                self.offline = event == Life::Offline;
                if event == Life::Online {
                    self.retries_before = commissioner.bus().traffic().retries;
                }
                tell(master, &json!({"event": event.to_string(), "address": slave}), || {
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
        let document = json!({"ms": millis, "inputs": inputs, "cycle_us": cycle, "retries": retries});
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
            "exchanges": exchanges, "retries": retries,
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

/// The diagnosis that was fetched, in words.
fn diagnosis(master: &Master, commissioner: &mut Commissioner<'_, RealBus>, slave: u8) {
    let Some((standard, extended)) = commissioner.diagnosis() else {
        return;
    };
    let octets = [&standard.emit()[..], &extended].concat();
    let fields = words::fields(slave, master.own_address, words::SLAVE_DIAG, &octets);
    let document = json!({"diagnosis": words::hex(&octets)});
    tell(master, &document, || format!("diagnosis {}", words::text(&octets, &fields)));
}

/// Why a slave does not go on, as far as it says so; `None`: it has no fault to tell of.
fn refused(
    master: &Master,
    commissioner: &mut Commissioner<'_, RealBus>,
    slave: u8,
    event: Life,
) -> Option<Failure> {
    let asked = Asked { slave, service: Service::SlaveDiag, data: Vec::new() };
    let outcome = commissioner.ask_within(Duration::from_secs(2), asked);
    if let Ok(Some(::master::commissioning::Outcome::Answer(_, octets))) = outcome {
        let faults = StandardDiagnosis::parse(&octets);
        if faults.is_some_and(|faults| !(faults.prm_fault || faults.cfg_fault || faults.not_supported)) {
            return None;
        }
        let fields = words::fields(slave, master.own_address, words::SLAVE_DIAG, &octets);
        output::aside(&words::text(&octets, &fields));
    }
    Some(Failure::Failed(format!(
        "station {slave} {event}; compare them with its manual, or with its GSD file"
    )))
}

fn lengths(cfg: &[u8]) -> Result<Lengths, Failure> {
    Lengths::of(cfg).ok_or_else(|| {
        Failure::Usage(format!(
            "--cfg {}: these identifier octets are cut off, or ask for more than 244 octets",
            words::hex(cfg)
        ))
    })
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
