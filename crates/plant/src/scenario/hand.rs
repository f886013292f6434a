//! What somebody can ask of the built-in masters of a bench while it runs, and what they answer.

use master::{Parameters as StandardPart, Watchdog};
use profibus_dp::time::Duration;
use sch108bex::event::Event;
use sch108bex::functionality::Functionality;
use sch108bex::parameterization::{CodeSequence, Parameters, TimeBase};
use sch108bex::specification::Variant;
use serde::Deserialize;
use serde_json::{Value, json};

use super::bench::Bench;
use super::poller::Poller;
use crate::control::Which;
use crate::report::{Report, What};

/// How long a slave that was parameterized here lives without hearing of its master.
const WATCHDOG: Duration = Duration::from_millis(200);
/// A preset has come to the encoder after so many cycles.
const CYCLES_OF_A_PRESET: u64 = 4;
/// Values that do not set output bit 31.
const MOST_PRESET: u32 = 0x7FFF_FFFF;

/// Something to ask of a built-in master. In JSON `do` names it. Where `encoder` is left out, the only one in the lists of the
/// masters is meant.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub enum MasterRequest {
    /// It presets an encoder: output bit 31 and the value, for two cycles (manual 4.3.2).
    Preset {
        /// Which encoder.
        encoder: Option<Which>,
        /// In scaled steps, 0 to 2147483647.
        value: u32,
    },
    /// It gives an encoder parameters, and exchanges data with it.
    Parameterize {
        /// Which encoder.
        encoder: Option<Which>,
        /// What Chk_Cfg asks for.
        functionality: FunctionalityName,
        /// Which way it counts up.
        #[serde(default)]
        code_sequence: CodeSequenceName,
        /// The two values below are in force.
        #[serde(default)]
        scaling: bool,
        /// Steps a turn; all of the disc if left out.
        measuring_units_per_revolution: Option<u32>,
        /// Steps in all; all turns if left out.
        total_measuring_range: Option<u32>,
        /// The unit of velocity, for Scancon 2.0.
        #[serde(default)]
        time_base: TimeBaseName,
    },
    /// It gives a station another address.
    SetAddress {
        /// Where the station is, 0 to 126.
        from: u8,
        /// Where it will be, 0 to 125.
        to: u8,
    },
    /// Outputs are held until the next sync (Global_Control to all).
    Sync {},
    /// That ends.
    Unsync {},
    /// Inputs are held until the next freeze (Global_Control to all).
    Freeze {},
    /// That ends.
    Unfreeze {},
    /// It frees an encoder for other masters, and leaves it alone until it is parameterized.
    Unlock {
        /// Which encoder.
        encoder: Option<Which>,
    },
}

/// How functionalities are called.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FunctionalityName {
    /// Class 1.
    #[serde(rename = "class_1")]
    Class1,
    /// Class 2.
    #[serde(rename = "class_2")]
    Class2,
    /// Scancon 2.0.
    #[serde(rename = "scancon_2")]
    Scancon2,
}

/// How code sequences are called.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CodeSequenceName {
    /// Clockwise.
    #[default]
    Clockwise,
    /// Counter-clockwise.
    CounterClockwise,
}

/// How time bases are called.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
pub enum TimeBaseName {
    /// Steps in 10 ms.
    #[serde(rename = "10_ms")]
    Per10Ms,
    /// Steps in 100 ms.
    #[default]
    #[serde(rename = "100_ms")]
    Per100Ms,
    /// Steps in a second.
    #[serde(rename = "1000_ms")]
    Per1000Ms,
    /// Revolutions per minute.
    #[serde(rename = "rpm")]
    Rpm,
}

/// Why a master did not do it.
#[derive(Debug, thiserror::Error)]
pub enum MasterRefusal {
    /// There is nobody to ask it of.
    #[error("{0}")]
    Nobody(String),
    /// The value is none.
    #[error("{0}")]
    Value(String),
    /// The encoder did not do it, or nobody answered.
    #[error("{0}")]
    Refused(String),
}

impl Bench {
    /// Whether a segment has a master with somebody in his list.
    pub fn has_master(&self) -> bool {
        self.segments.iter().any(|segment| !segment.poller.slaves().is_empty())
    }

    /// Has a master do something now, and says what came of it. Virtual time goes on by what that takes.
    ///
    /// # Errors
    ///
    /// Why it was not done; of the encoder's own words where it has some.
    pub fn ask(&mut self, request: &MasterRequest) -> Result<Value, MasterRefusal> {
        match request {
            MasterRequest::Preset { encoder, value } => self.preset(encoder.as_ref(), *value),
            MasterRequest::Parameterize { .. } => self.parameterize(request),
            MasterRequest::SetAddress { from, to } => self.set_address(*from, *to),
            MasterRequest::Sync {} => self.global_control(0x20, "sync"),
            MasterRequest::Unsync {} => self.global_control(0x10, "unsync"),
            MasterRequest::Freeze {} => self.global_control(0x08, "freeze"),
            MasterRequest::Unfreeze {} => self.global_control(0x04, "unfreeze"),
            MasterRequest::Unlock { encoder } => self.unlock(encoder.as_ref()),
        }
    }

    fn preset(&mut self, encoder: Option<&Which>, value: u32) -> Result<Value, MasterRefusal> {
        if value > MOST_PRESET {
            return Err(MasterRefusal::Value(format!("value is a number from 0 to {MOST_PRESET}")));
        }
        let name = self.polled(encoder)?;
        let poller = self.poller_mut(&name)?;
        let Some(slave) = poller.slave_mut(&name).filter(|slave| slave.exchanging) else {
            return Err(MasterRefusal::Refused(format!(
                "{name} exchanges no data with the master: parameterize it first"
            )));
        };
        if slave.plan.outputs == 0 {
            return Err(MasterRefusal::Refused(format!(
                "{name} runs as class 1, which has no outputs and so no preset: parameterize it as class_2 or scancon_2"
            )));
        }
        slave.preset(value);
        let events = self.go_through(&name, CYCLES_OF_A_PRESET)?;
        for event in events {
            match event {
                Event::PresetTaken { from, to, offset } => {
                    return Ok(json!({ "from": from, "to": to, "offset": offset }));
                }
                Event::PresetRefused(_) | Event::PresetBitHeld => {
                    return Err(MasterRefusal::Refused(event.to_string()));
                }
                _ => {}
            }
        }
        Err(MasterRefusal::Refused(format!(
            "{name} has taken no preset: under sync it takes one with the next sync only, and what is lost on the line \
             it never hears"
        )))
    }

    fn parameterize(&mut self, request: &MasterRequest) -> Result<Value, MasterRefusal> {
        let MasterRequest::Parameterize { encoder, functionality, .. } = request else {
            return Ok(Value::Null);
        };
        let name = self.polled(encoder.as_ref())?;
        let snapshot = self.handle().snapshot().map_err(|error| MasterRefusal::Refused(error.to_string()))?;
        let station = snapshot.encoders.iter().find(|station| station.name == name);
        let identity = station.map(|station| station.identity);
        let Some(identity) = identity else {
            return Err(MasterRefusal::Nobody(format!("there is no encoder {name}")));
        };
        let address = station.and_then(|station| station.device.as_ref()).and_then(|device| device.address);
        let functionality = functionality.meant();
        let standard = StandardPart {
            ident_number: identity.ident_number,
            watchdog: Watchdog::at_least(WATCHDOG).ok(),
            min_tsdr: 11,
            sync: true,
            freeze: true,
            user: user_parameters(request, functionality, identity.variant),
            ..StandardPart::default()
        };
        let poller = self.poller_mut(&name)?;
        if poller.slave(&name).is_some_and(|slave| slave.exchanging) {
            // In data exchange it would take no parameters that are shorter than the agreed ones (manual 4.1).
            let unlocked = poller.unlock(&name);
            unlocked.map_err(|error| MasterRefusal::Refused(error.to_string()))?;
        }
        if let Some(slave) = poller.slave_mut(&name) {
            slave.plan.set_prm = standard.set_prm();
            slave.plan.configuration = functionality.configuration().to_vec();
            slave.plan.outputs = usize::from(functionality.outputs());
            slave.begin_anew(address);
        }
        let events = self.go_through(&name, 2)?;
        for event in &events {
            if matches!(event, Event::PrmRefused(_) | Event::CfgRefused(_)) {
                return Err(MasterRefusal::Refused(event.to_string()));
            }
        }
        let slave = self.poller_mut(&name)?.slave(&name);
        match slave {
            Some(slave) if slave.exchanging => Ok(json!({ "exchanging": true })),
            Some(slave) => {
                let why = slave.trouble.clone().unwrap_or_else(|| "it does not answer".to_owned());
                Err(MasterRefusal::Refused(format!("{name}: {why}")))
            }
            None => Ok(Value::Null),
        }
    }

    fn set_address(&mut self, from: u8, to: u8) -> Result<Value, MasterRefusal> {
        if from > 126 || to > 125 {
            let text = "from is an address from 0 to 126, to one from 0 to 125".to_owned();
            return Err(MasterRefusal::Value(text));
        }
        let snapshot = self.handle().snapshot().map_err(|error| MasterRefusal::Refused(error.to_string()))?;
        let mut there = snapshot.encoders.iter();
        let found = there.find(|one| one.device.as_ref().and_then(|device| device.address) == Some(from));
        let Some((name, ident)) = found.map(|one| (one.name.clone(), one.identity.ident_number)) else {
            return Err(MasterRefusal::Nobody(format!("nobody answers at address {from}")));
        };
        let poller = self.poller_mut(&name)?;
        let asked = poller.set_address(from, to, ident);
        let events = self.events_of(&name);
        if let Some(event) = events.iter().find(|event| matches!(event, Event::AddressRefused(_))) {
            return Err(MasterRefusal::Refused(event.to_string()));
        }
        asked.map_err(|error| MasterRefusal::Refused(error.to_string()))?;
        if let Some(slave) = self.poller_mut(&name)?.slave_mut(&name) {
            slave.begin_anew(Some(to));
        }
        Ok(json!({ "encoder": name, "address": to }))
    }

    fn global_control(&mut self, command: u8, name: &str) -> Result<Value, MasterRefusal> {
        for segment in self.segments.iter_mut().filter(|segment| !segment.poller.slaves().is_empty()) {
            let told = segment.poller.global_control(command);
            told.map_err(|error| MasterRefusal::Refused(error.to_string()))?;
        }
        Ok(json!({ "sent": name }))
    }

    fn unlock(&mut self, encoder: Option<&Which>) -> Result<Value, MasterRefusal> {
        let name = self.polled(encoder)?;
        let unlocked = self.poller_mut(&name)?.unlock(&name);
        unlocked.map_err(|error| MasterRefusal::Refused(error.to_string()))?;
        Ok(json!({ "encoder": name }))
    }

    /// The name of the encoder that is meant, which a master asks.
    fn polled(&self, which: Option<&Which>) -> Result<String, MasterRefusal> {
        let slaves = self.segments.iter().flat_map(|segment| segment.poller.slaves());
        let polled: Vec<&str> = slaves.map(|slave| slave.plan.encoder.as_str()).collect();
        let there = polled.join(", ");
        let nobody = |asked: String| {
            MasterRefusal::Nobody(format!("the master asks no encoder {asked}; it asks {there}"))
        };
        let name = match which {
            None if polled.len() == 1 => polled[0].to_owned(),
            None => {
                let text = format!("the master asks several: add \"encoder\" with one of {there}");
                return Err(MasterRefusal::Nobody(text));
            }
            Some(Which::Name(name)) => name.clone(),
            Some(Which::Number(number)) => {
                let name = number.checked_sub(1).and_then(|at| self.handle().encoder_names().nth(at));
                name.map(str::to_owned).ok_or_else(|| nobody(number.to_string()))?
            }
        };
        if polled.contains(&name.as_str()) { Ok(name) } else { Err(nobody(format!("{name:?}"))) }
    }

    fn poller_mut(&mut self, encoder: &str) -> Result<&mut Poller, MasterRefusal> {
        let pollers = self.segments.iter_mut().map(|segment| &mut segment.poller);
        let poller = pollers.into_iter().find(|poller| poller.slave(encoder).is_some());
        poller.ok_or_else(|| MasterRefusal::Nobody(format!("no master asks {encoder}")))
    }

    /// Lets so many cycles pass; what the encoder tells meanwhile.
    fn go_through(&mut self, encoder: &str, cycles: u64) -> Result<Vec<Event>, MasterRefusal> {
        self.events_of(encoder);
        let poller = self.poller_mut(encoder)?;
        let until = poller.after_cycles(cycles);
        poller.advance_to(until).map_err(|error| MasterRefusal::Refused(error.to_string()))?;
        Ok(self.events_of(encoder))
    }

    /// What the encoder has told since reports were looked at last; they stay where they are.
    fn events_of(&mut self, encoder: &str) -> Vec<Event> {
        let news = self.look_at_reports();
        let own = news.iter().filter(|report| &*report.who == encoder);
        own.filter_map(|Report { what, .. }| if let What::Device(event) = what { Some(*event) } else { None })
            .collect()
    }
}

impl FunctionalityName {
    fn meant(self) -> Functionality {
        match self {
            Self::Class1 => Functionality::Class1,
            Self::Class2 => Functionality::Class2,
            Self::Scancon2 => Functionality::Scancon2,
        }
    }
}

/// Set_Prm from octet 8 on.
fn user_parameters(request: &MasterRequest, functionality: Functionality, variant: Variant) -> Vec<u8> {
    let MasterRequest::Parameterize {
        code_sequence,
        scaling,
        measuring_units_per_revolution,
        total_measuring_range,
        time_base,
        ..
    } = request
    else {
        return Vec::new();
    };
    let units = measuring_units_per_revolution.unwrap_or(variant.steps_per_revolution());
    let whole = u64::from(units) * u64::from(variant.revolutions());
    let parameters = Parameters {
        length: functionality.parameter_length(),
        code_sequence: match code_sequence {
            CodeSequenceName::Clockwise => CodeSequence::Clockwise,
            CodeSequenceName::CounterClockwise => CodeSequence::CounterClockwise,
        },
        scaling: *scaling,
        measuring_units_per_revolution: units,
        total_measuring_range: total_measuring_range.unwrap_or(u32::try_from(whole).unwrap_or(u32::MAX)),
        time_base: match time_base {
            TimeBaseName::Per10Ms => TimeBase::Per10Ms,
            TimeBaseName::Per100Ms => TimeBase::Per100Ms,
            TimeBaseName::Per1000Ms => TimeBase::Per1000Ms,
            TimeBaseName::Rpm => TimeBase::Rpm,
        },
    };
    let mut set_prm = [0; 26];
    let length = parameters.emit(&mut set_prm);
    // Octet 8 is the ASIC's.
    set_prm.get(7..length).unwrap_or_default().to_vec()
}
