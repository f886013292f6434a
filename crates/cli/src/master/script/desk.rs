//! What the commands of a script do.

use std::time::{Duration, Instant};

use ::master::SlaveSettings;
use ::master::light::StationKind;
use clap::ValueEnum;
use dissector::advice::Diagnosis;
use profibus_dp::time::Baudrate;
use sch108bex::functionality::Functionality;
use serde_json::{Value, json};

use super::command::{Command, HELP};
use crate::Failure;
use crate::commission::address::Change;
use crate::commission::parameters::{Class, Octets, Project, watchdog};
use crate::commission::session::{PRESET, check_ident, meet, start_up};
use crate::commission::{Light, failed, find, words};

/// From exchange to exchange while a script waits.
const CYCLE: Duration = Duration::from_millis(10);

/// What came of a command.
#[derive(Debug)]
pub(super) struct Answer {
    pub(super) text: String,
    pub(super) document: Value,
}

/// A station that exchanges data with this master.
#[derive(Debug)]
struct Running {
    slave: SlaveSettings,
    outputs: Vec<u8>,
}

/// A master, and what it was told so far.
pub(super) struct Desk<'a> {
    light: &'a mut Light,
    rate: Baudrate,
    station: Option<u8>,
    project: Project,
    /// In milliseconds; 0: off.
    watchdog: u32,
    groups: u8,
    /// Sync and Freeze in Set_Prm; `None`: as the device has them.
    modes: Option<(bool, bool)>,
    running: Option<Running>,
    /// What `expect` looks at.
    last: String,
}

impl<'a> Desk<'a> {
    pub(super) fn new(light: &'a mut Light, station: Option<u8>, rate: Baudrate) -> Self {
        Self {
            light,
            rate,
            station,
            project: Project::default(),
            watchdog: 1_000,
            groups: 0,
            modes: None,
            running: None,
            last: String::new(),
        }
    }

    /// Between two commands.
    pub(super) fn keep_alive(&mut self) -> Result<(), Failure> {
        if self.running.is_some() { self.exchange().map(|_| ()) } else { Ok(()) }
    }

    /// At the end.
    pub(super) fn leave(&mut self) {
        if let Some(Running { slave, .. }) = self.running.take() {
            // Where it does not hear that, its watchdog frees it.
            let _ = self.light.unlock(slave.address, slave.parameters.ident_number);
        }
    }

    pub(super) fn act(&mut self, command: &Command) -> Result<Answer, Failure> {
        let answer = self.answer(command)?;
        if !matches!(command, Command::Expect(_) | Command::Help) {
            self.last.clone_from(&answer.text);
        }
        Ok(answer)
    }

    fn answer(&mut self, command: &Command) -> Result<Answer, Failure> {
        match command {
            Command::List => self.list(),
            Command::Status => self.status(),
            Command::Diag => self.diag(),
            Command::Cfg => {
                let address = self.address()?;
                let octets = self.light.get_cfg(address).map_err(failed)?.to_vec();
                let fields = words::fields(address, 0, words::GET_CFG, &octets);
                Ok(Answer {
                    text: words::text(&octets, &fields),
                    document: json!({"configuration": words::hex(&octets)}),
                })
            }
            Command::Gsd { .. } | Command::Class { .. } | Command::Hex { .. } => {
                self.project = project(command);
                self.project.check()?;
                Ok(silent())
            }
            Command::Station(_) | Command::Watchdog(_) | Command::Groups(_) | Command::Modes { .. } => {
                self.set(command)
            }
            Command::Start => self.start(),
            Command::Exchange(count) => {
                let mut inputs = Vec::new();
                for _ in 0..*count {
                    inputs = self.exchange()?;
                }
                Ok(octets("inputs", &inputs))
            }
            Command::Outputs(octets) => self.outputs(octets),
            Command::Preset(value) => self.preset(*value),
            Command::Control { name, octet, groups } => {
                self.light.global_control(*octet, *groups).map_err(failed)?;
                let to = if *groups == 0 { "all".to_owned() } else { format!("groups {groups:08b}b") };
                Ok(told(
                    format!("{name} to {to}"),
                    json!({"global_control": format!("{octet:02X} {groups:02X}")}),
                ))
            }
            Command::Inputs => {
                let address = self.address()?;
                let inputs = self.light.read_inputs(address).map_err(failed)?.to_vec();
                Ok(octets("inputs", &inputs))
            }
            Command::ReadOutputs => {
                let address = self.address()?;
                let outputs = self.light.read_outputs(address).map_err(failed)?.to_vec();
                Ok(octets("outputs", &outputs))
            }
            Command::Wait(millis) => self.wait(Duration::from_millis(*millis)),
            Command::Stop => self.stop(),
            Command::Unlock => self.unlock(),
            Command::SetAddress(to) => {
                let change = Change { ident: None, no_further_change: false };
                let from = self.address()?;
                let changed = change.change(self.light, from, *to)?;
                self.station = Some(*to);
                Ok(told(changed.text(), json!(changed)))
            }
            Command::Expect(text) if self.last.contains(text.as_str()) => Ok(silent()),
            Command::Expect(text) => {
                Err(Failure::Failed(format!("\"{text}\" is not in the answer before:\n{}", self.last)))
            }
            Command::Help => Ok(told(HELP.to_owned(), json!({"help": HELP}))),
            Command::Quit => Ok(silent()),
        }
    }

    fn set(&mut self, command: &Command) -> Result<Answer, Failure> {
        if self.running.is_some() && matches!(command, Command::Station(_)) {
            return Err(Failure::Failed("a station exchanges data; `stop` first".to_owned()));
        }
        match command {
            Command::Station(address) if *address == self.light.settings().address => {
                return Err(Failure::Failed("this is the master's own address".to_owned()));
            }
            Command::Station(address) => self.station = Some(*address),
            Command::Watchdog(millis) => {
                watchdog(*millis)?;
                self.watchdog = *millis;
            }
            Command::Groups(groups) => self.groups = *groups,
            Command::Modes { sync, freeze } => self.modes = Some((*sync, *freeze)),
            _ => {}
        }
        Ok(silent())
    }

    /// The station that is meant.
    fn address(&mut self) -> Result<u8, Failure> {
        let address = find::station(self.light, self.station, "`station N`")?;
        self.station = Some(address);
        Ok(address)
    }

    fn list(&mut self) -> Result<Answer, Failure> {
        if self.running.is_some() {
            return Err(Failure::Failed(
                "a station exchanges data, and its watchdog would expire; `stop` first".to_owned(),
            ));
        }
        let found = find::live_list(self.light)?;
        let line = |(address, kind): &(u8, StationKind)| format!("{address:3}  {}", words::kind(*kind));
        let document =
            found.iter().map(|(address, kind)| json!({"address": address, "station": words::kind(*kind)}));
        let document = json!({"stations": document.collect::<Vec<_>>()});
        let text = if found.is_empty() {
            find::NOBODY.to_owned()
        } else {
            found.iter().map(line).collect::<Vec<_>>().join("\n")
        };
        Ok(told(text, document))
    }

    fn status(&mut self) -> Result<Answer, Failure> {
        let address = self.address()?;
        let kind = self.light.status(address).map_err(failed)?;
        let words = kind.map_or("nobody answers", words::kind);
        Ok(told(
            format!("station {address}: {words}"),
            json!({"address": address, "station": kind.map(|_| words)}),
        ))
    }

    fn diag(&mut self) -> Result<Answer, Failure> {
        let address = self.address()?;
        let octets = self.light.diagnosis(address).map_err(failed)?.octets.to_vec();
        let Some(read) = Diagnosis::read(&octets) else { return Ok(self::octets("diagnosis", &octets)) };
        let findings: Vec<_> = read.findings.iter().map(words::finding).collect();
        let text =
            format!("station {address}: {}\n{}\noctets {}", read.summary, findings.join("\n"), read.octets);
        let document = json!({
            "address": address, "octets": read.octets, "summary": read.summary, "findings": read.findings,
        });
        Ok(told(text, document))
    }

    fn start(&mut self) -> Result<Answer, Failure> {
        self.leave();
        let address = self.address()?;
        let diagnosis = meet(self.light, address)?;
        let mut slave = self.project.slave(address, self.rate, &diagnosis, Functionality::Scancon2)?;
        check_ident(&slave, &diagnosis)?;
        let by_device = !matches!((&self.project.gsd, &self.project.prm), (None, Some(_)));
        let (sync, freeze) = self.modes.unwrap_or((by_device, by_device));
        slave.parameters.sync = sync;
        slave.parameters.freeze = freeze;
        slave.parameters.groups = self.groups;
        slave.parameters.watchdog = watchdog(self.watchdog)?;
        let octets = start_up(self.light, &slave)?;
        let summary = Diagnosis::read(&octets).map(|read| read.summary).unwrap_or_default();
        let document = json!({
            "address": address, "set_prm": words::hex(&slave.parameters.set_prm()),
            "chk_cfg": words::hex(&slave.configuration), "diagnosis": words::hex(&octets), "summary": summary,
        });
        let outputs = vec![0; slave.outputs.into()];
        self.running = Some(Running { slave, outputs });
        Ok(told(format!("station {address}: {summary}"), document))
    }

    fn exchange(&mut self) -> Result<Vec<u8>, Failure> {
        let Running { slave, outputs } = self.running.as_ref().ok_or_else(not_running)?;
        let inputs = self.light.exchange(slave.address, outputs);
        inputs.map(|inputs| inputs.octets.to_vec()).map_err(failed)
    }

    fn outputs(&mut self, octets: &[u8]) -> Result<Answer, Failure> {
        let running = self.running.as_mut().ok_or_else(not_running)?;
        if octets.len() != running.outputs.len() {
            return Err(Failure::Failed(format!(
                "{} octets of outputs, but the configuration has {}; write as many",
                octets.len(),
                running.outputs.len()
            )));
        }
        running.outputs.copy_from_slice(octets);
        let inputs = self.exchange()?;
        Ok(self::octets("inputs", &inputs))
    }

    /// Bit 31 down, up, and down: only the rising edge counts.
    fn preset(&mut self, value: u32) -> Result<Answer, Failure> {
        let running = self.running.as_ref().ok_or_else(not_running)?;
        if running.outputs.len() != 4 {
            return Err(Failure::Failed(
                "a preset needs 4 octets of outputs; class 1 has none: start as class 2 or scancon"
                    .to_owned(),
            ));
        }
        let mut inputs = Vec::new();
        for outputs in [0, PRESET | value, 0] {
            if let Some(running) = &mut self.running {
                running.outputs.copy_from_slice(&u32::to_be_bytes(outputs));
            }
            self.exchange()?;
            std::thread::sleep(CYCLE);
            inputs = self.exchange()?;
        }
        Ok(octets("inputs", &inputs))
    }

    fn wait(&mut self, span: Duration) -> Result<Answer, Failure> {
        let until = Instant::now() + span;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(silent());
            }
            self.keep_alive()?;
            std::thread::sleep(left.min(CYCLE));
        }
    }

    fn stop(&mut self) -> Result<Answer, Failure> {
        let running = self.running.take().ok_or_else(not_running)?;
        let (address, ident) = (running.slave.address, running.slave.parameters.ident_number);
        self.light.unlock(address, ident).map_err(failed)?;
        Ok(told(
            format!("station {address} belongs to no master now"),
            json!({"address": address, "free": true}),
        ))
    }

    fn unlock(&mut self) -> Result<Answer, Failure> {
        if self.running.is_some() {
            return self.stop();
        }
        let address = self.address()?;
        let ident = self.light.diagnosis(address).map_err(failed)?.standard.ident_number;
        self.light.unlock(address, ident).map_err(failed)?;
        let owner = self.light.diagnosis(address).map_err(failed)?.standard.master_add;
        match owner {
            None => Ok(told(
                format!("station {address} belongs to no master now"),
                json!({"address": address, "free": true}),
            )),
            Some(owner) => Err(Failure::Failed(format!(
                "station {address} still belongs to master {owner}; only its owner can free it"
            ))),
        }
    }
}

/// The parameters that a command names.
fn project(command: &Command) -> Project {
    match command {
        Command::Gsd { file, module, set } => {
            Project { gsd: Some(file.into()), module: module.clone(), set: set.clone(), ..Project::default() }
        }
        Command::Hex { prm, cfg } => {
            Project { prm: Some(Octets(prm.clone())), cfg: Some(Octets(cfg.clone())), ..Project::default() }
        }
        Command::Class { class, scaling, counter_clockwise } => Project {
            class: Class::from_str(class, true).ok(),
            units: scaling.map(|(units, _)| units),
            range: scaling.map(|(_, range)| range),
            counter_clockwise: *counter_clockwise,
            ..Project::default()
        },
        _ => Project::default(),
    }
}

fn not_running() -> Failure {
    Failure::Failed("no station exchanges data; `start` first".to_owned())
}

fn silent() -> Answer {
    told(String::new(), json!({}))
}

fn told(text: String, document: Value) -> Answer {
    Answer { text, document }
}

fn octets(name: &str, octets: &[u8]) -> Answer {
    let hex = words::hex(octets);
    told(format!("{name} {hex}"), json!({name: hex}))
}
