//! A station in data exchange, on the light master: start-up, exchange, and free again.

use ::master::request::Service;
use ::master::{Error, SlaveSettings};
use dissector::advice::StartUp;
use profibus_dp::time::Duration;
use profibus_dp::wire::StandardDiagnosis;
use sch108bex::diagnostics::{Class2Part, Diagnostics};

use super::{Light, failed, words};
use crate::Failure;
use crate::commission::place::core_span;

/// How often, 10 ms apart, a diagnosis is fetched until the station is ready.
const READY_TRIES: u32 = 50;

/// The outputs' bit that presets (manual 4.3.2).
pub(crate) const PRESET: u32 = 0x8000_0000;

/// Asks a station for its diagnosis, which must be free or this master's.
pub(crate) fn meet(light: &mut Light, address: u8) -> Result<Vec<u8>, Failure> {
    let octets = light.diagnosis(address).map_err(failed)?.octets.to_vec();
    match owner(&octets).filter(|owner| *owner != light.settings().address) {
        Some(owner) => Err(Failure::Failed(format!(
            "station {address} belongs to master {owner}; end that one, or wait for its watchdog"
        ))),
        None if address == 126 => Err(Failure::Failed(
            "at address 126 no station exchanges data; give it an address from 1 to 125 first, with `set-address 126 N`"
                .to_owned(),
        )),
        None => Ok(octets),
    }
}

/// Who owns a station that has this diagnosis.
pub(crate) fn owner(diagnosis: &[u8]) -> Option<u8> {
    StandardDiagnosis::parse(diagnosis)?.master_add
}

/// Why a station refuses what it was given, octet by octet; `diagnosis` and Get_Cfg tell.
pub(crate) fn refusal(
    address: u8,
    slave: &SlaveSettings,
    diagnosis: &[u8],
    get_cfg: Option<&[u8]>,
) -> Failure {
    let set_prm = slave.parameters.set_prm();
    let start_up = StartUp { set_prm: &set_prm, chk_cfg: &slave.configuration, diagnosis, get_cfg };
    let differences = start_up.differences();
    let standard = StandardDiagnosis::parse(diagnosis).unwrap_or_default();
    let what = match (standard.prm_fault, standard.cfg_fault) {
        (true, _) => "refuses the parameters (Prm_Fault)",
        (_, true) => "refuses the configuration (Cfg_Fault)",
        _ => "does not come into data exchange",
    };
    let why = if differences.is_empty() {
        "compare them with its manual, or with its GSD file".to_owned()
    } else {
        words::differences(&differences)
    };
    Failure::Failed(format!("station {address} {what}: {why}"))
}

/// A station that exchanges data with this master.
#[derive(Debug)]
pub(crate) struct Session<'a> {
    light: &'a mut Light,
    slave: SlaveSettings,
    outputs: Vec<u8>,
    diagnosis: Vec<u8>,
}

impl<'a> Session<'a> {
    /// The start-up: Set_Prm, Chk_Cfg, diagnosis. `diagnosis` is what [`meet`] has brought.
    pub(crate) fn begin(
        light: &'a mut Light,
        slave: SlaveSettings,
        diagnosis: &[u8],
    ) -> Result<Self, Failure> {
        check_ident(&slave, diagnosis)?;
        let diagnosis = start_up(light, &slave)?;
        let outputs = vec![0; slave.outputs.into()];
        Ok(Self { light, slave, outputs, diagnosis })
    }

    /// Outputs for inputs.
    pub(crate) fn exchange(&mut self) -> Result<Vec<u8>, Failure> {
        let inputs = self.light.exchange(self.slave.address, &self.outputs);
        inputs.map(|inputs| inputs.octets.to_vec()).map_err(failed)
    }

    /// The start-up once more, after the station was lost.
    pub(crate) fn again(&mut self) -> Result<(), Failure> {
        self.diagnosis = start_up(self.light, &self.slave)?;
        Ok(())
    }

    /// What is sent from now on.
    pub(crate) fn set_output(&mut self, value: u32) {
        if let Some(outputs) = self.outputs.first_chunk_mut() {
            *outputs = value.to_be_bytes();
        }
    }

    /// Fetches the diagnosis.
    pub(crate) fn fetch_diagnosis(&mut self) -> Result<&[u8], Failure> {
        self.diagnosis = self.light.diagnosis(self.slave.address).map_err(failed)?.octets.to_vec();
        Ok(&self.diagnosis)
    }

    /// The newest diagnosis.
    pub(crate) fn diagnosis(&self) -> &[u8] {
        &self.diagnosis
    }

    /// What it was given.
    pub(crate) fn slave(&self) -> &SlaveSettings {
        &self.slave
    }

    /// The master underneath.
    pub(crate) fn light(&mut self) -> &mut Light {
        self.light
    }

    /// Lets time pass.
    pub(crate) fn wait(&mut self, span: std::time::Duration) -> Result<(), Failure> {
        let waited = ::master::Line::wait(self.light.line_mut(), core_span(span));
        waited.map_err(|error| failed(Error::from(error)))
    }

    /// Leaves the station free for the next master.
    pub(crate) fn end(self) {
        // Where it does not hear that, its watchdog frees it.
        let _ = self.light.unlock(self.slave.address, self.slave.parameters.ident_number);
    }
}

/// Before anything is sent: parameters for another device.
pub(crate) fn check_ident(slave: &SlaveSettings, diagnosis: &[u8]) -> Result<(), Failure> {
    let sent = slave.parameters.ident_number;
    match StandardDiagnosis::parse(diagnosis) {
        Some(standard) if standard.ident_number != sent => Err(Failure::Failed(format!(
            "station {} has ident number {:04X}, but the parameters are for {sent:04X} (Set_Prm octets 5-6); take the \
             GSD file of this device, or its ident number",
            slave.address, standard.ident_number
        ))),
        _ => Ok(()),
    }
}

/// Set_Prm, Chk_Cfg, and the diagnosis until the station is ready; that diagnosis.
pub(crate) fn start_up(light: &mut Light, slave: &SlaveSettings) -> Result<Vec<u8>, Failure> {
    let address = slave.address;
    light.set_prm(address, &slave.parameters.set_prm()).map_err(failed)?;
    // A station that refuses the parameters refuses this too; its diagnosis tells which.
    match light.chk_cfg(address, &slave.configuration) {
        Ok(()) | Err(Error::Refused { service: Service::ChkCfg, .. }) => {}
        Err(error) => return Err(failed(error)),
    }
    let mut octets = Vec::new();
    for _ in 0..READY_TRIES {
        octets = light.diagnosis(address).map_err(failed)?.octets.to_vec();
        let standard = StandardDiagnosis::parse(&octets).unwrap_or_default();
        if !standard.prm_req && !standard.station_not_ready {
            return Ok(octets);
        }
        if standard.prm_fault || standard.cfg_fault || standard.prm_req {
            break;
        }
        let waited = ::master::Line::wait(light.line_mut(), Duration::from_nanos(10_000_000));
        waited.map_err(|error| failed(Error::from(error)))?;
    }
    let get_cfg = light.get_cfg(address).map(<[u8]>::to_vec).ok();
    Err(refusal(address, slave, &octets, get_cfg.as_deref()))
}

/// The encoder's part of a diagnosis, where it is one's.
pub(crate) fn encoder(diagnosis: &[u8]) -> Option<Diagnostics> {
    diagnosis.get(6..).and_then(Diagnostics::parse)
}

/// Octets 17-57, which class 2 and Scancon 2.0 have in data exchange.
pub(crate) fn class_2_part(diagnosis: &[u8]) -> Option<Class2Part> {
    encoder(diagnosis)?.class_2_part
}
