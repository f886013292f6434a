//! A master that brings a slave into data exchange and keeps it there: profirust over our lines.
//!
//! profirust has the token ring, the start-up of a slave and its cycle. Here is what it lacks: a
//! [`Bus`] for it to live on, in real and in virtual time, and services between its cycles
//! ([`Commissioner::ask`]).
//!
//! It counts time in microseconds. In virtual time above 1.5 Mbit/s its own idle times are therefore
//! only nearly those of a bus; the times of slaves are exact.

mod application;
mod bus;
mod ledger;

use std::fmt;

use ::bus::EndError;
use profibus_dp::time::{Baudrate, Duration, Instant};
use profibus_dp::wire::StandardDiagnosis;
use profibus_dp::wire::telegram::MAX_PDU;
use profirust::dp::{DpMaster, Peripheral, PeripheralEvent, PeripheralHandle, PeripheralOptions};
use profirust::fdl::{FdlActiveStation, ParametersBuilder};

use crate::parameters::{Parameters, Watchdog, WatchdogOutOfRange};
use crate::request::Service;

use application::Application;
pub use application::{Asked, Outcome};
pub use bus::{Bus, RealBus, VirtualBus, VirtualTimes};
pub use ledger::Traffic;

/// The slave to be brought into data exchange.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SlaveSettings {
    /// Its address, 0 to 125.
    pub address: u8,
    /// What it is given; the watchdog and min T_SDR too.
    pub parameters: Parameters,
    /// Its identifier octets.
    pub configuration: Vec<u8>,
    /// How many octets it sends, and takes.
    pub inputs: u8,
    /// 0: it has no outputs.
    pub outputs: u8,
    /// max T_SDR in bit times.
    pub max_tsdr: u16,
}

/// The master and its bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MasterSettings {
    /// Its own address, 0 to 125.
    pub address: u8,
    /// The rate by which it counts.
    pub rate: Baudrate,
    /// How long a reply may take, in bit times; as much as is usual at the rate at least. profirust
    /// counts to 65535.
    pub slot_time: Duration,
    /// How often a request is repeated, 1 to 15.
    pub retries: u8,
}

/// Why there can be no such master.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SettingsError {
    /// An address is none.
    #[error("address {0} cannot exchange data; a master and its slave have addresses from 0 to 125")]
    Address(u8),
    /// Both have the same.
    #[error("master and slave are both at address {0}; give one of them another")]
    SameAddress(u8),
    /// More than a telegram can take.
    #[error("{octets} octets of {what} do not fit in a telegram; {most} do")]
    TooLong {
        /// Of what.
        what: Service,
        /// How many there are.
        octets: usize,
        /// How many fit.
        most: usize,
    },
    /// The slave may answer later than the master waits.
    #[error(
        "the slave may answer after {max_tsdr} bit times, but the slot time is {slot}; it has to be longer \
         by 15 at least"
    )]
    SlotTime {
        /// From the slave.
        max_tsdr: u16,
        /// From the master.
        slot: u16,
    },
    /// The number of retries.
    #[error("{0} retries cannot be; 1 to 15 can")]
    Retries(u8),
    /// min T_SDR
    #[error("min T_SDR of {0} bit times cannot be; 11 to 255 can")]
    MinTsdr(u8),
    /// The watchdog.
    #[error(transparent)]
    Watchdog(#[from] WatchdogOutOfRange),
}

/// What has happened to the slave.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Life {
    /// It answers.
    Online,
    /// It has taken parameters and configuration.
    Configured,
    /// It does not like the parameters; they are given again and again.
    ParametersRefused,
    /// It does not like the configuration; it is given again and again.
    ConfigurationRefused,
    /// Outputs went, inputs came.
    Exchanged,
    /// Its diagnosis was fetched, because it wanted that or somebody here.
    Diagnosis,
    /// It does not answer any more.
    Offline,
}

impl fmt::Display for Life {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Online => "answers",
            Self::Configured => "has taken parameters and configuration",
            Self::ParametersRefused => "refuses the parameters (Prm_Fault)",
            Self::ConfigurationRefused => "refuses the configuration (Cfg_Fault)",
            Self::Exchanged => "exchanges data",
            Self::Diagnosis => "has given its diagnosis",
            Self::Offline => "does not answer any more",
        })
    }
}

/// A master that brings one slave into data exchange, and keeps it there.
pub struct Commissioner<'a, B> {
    bus: B,
    fdl: FdlActiveStation,
    application: Application<'a>,
    slave: PeripheralHandle,
}

impl<B: fmt::Debug> fmt::Debug for Commissioner<'_, B> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Commissioner").field("bus", &self.bus).field("fdl", &self.fdl).finish_non_exhaustive()
    }
}

impl<'a, B: Bus> Commissioner<'a, B> {
    /// A master that begins with its first [`poll`](Self::poll).
    ///
    /// # Errors
    ///
    /// The settings do not fit each other or a telegram.
    pub fn new(bus: B, master: MasterSettings, slave: &'a SlaveSettings) -> Result<Self, SettingsError> {
        check(master, slave)?;
        let mut fdl = ParametersBuilder::new(master.address, rate(master.rate));
        let slot = slot_bits(master);
        if usize::from(slave.max_tsdr) + 15 > usize::from(slot) {
            return Err(SettingsError::SlotTime { max_tsdr: slave.max_tsdr, slot });
        }
        // Nobody but itself and lower addresses is asked whether he wants the token.
        fdl.slot_bits(slot)
            .highest_station_address(master.address + 1)
            // Long enough for whole cycles with a slot time as long as this.
            .token_rotation_bits(u32::from(slot).saturating_mul(20).clamp(32_436, 16_777_960))
            .gap_wait_rotations(100)
            .max_retry_limit(master.retries);
        if slave.parameters.min_tsdr != 0 {
            fdl.min_tsdr(slave.parameters.min_tsdr);
        }
        if let Some(watchdog) = slave.parameters.watchdog {
            let millis = i64::try_from(watchdog.span().as_millis()).unwrap_or(i64::MAX);
            fdl.watchdog_timeout(
                profirust::time::Instant::from_millis(millis) - profirust::time::Instant::ZERO,
            );
        }
        let mut dp = DpMaster::new(Vec::new());
        let inputs = vec![0; usize::from(slave.inputs)];
        let outputs = vec![0; usize::from(slave.outputs)];
        let peripheral = Peripheral::new(slave.address, options(slave), inputs, outputs);
        let handle = dp.add(peripheral.with_diag_buffer(vec![0; MAX_PDU]));
        let mut fdl = FdlActiveStation::new(fdl.build_verified(&dp));
        fdl.set_online();
        dp.enter_operate();
        let application = Application::new(dp, slave.address);
        Ok(Self { bus, fdl, application, slave: handle })
    }

    /// One step: something is sent, or taken, or a little time passes. Says what happened to the slave.
    ///
    /// # Errors
    ///
    /// The bus is broken for good.
    pub fn poll(&mut self) -> Result<Option<Life>, EndError> {
        let now = i64::try_from(self.bus.now().as_nanos() / 1_000).unwrap_or(i64::MAX);
        let sent = self.bus.traffic().telegrams;
        self.application.set_last_request(self.bus.traffic().last_request(self.application.address()));
        self.fdl.poll(profirust::time::Instant::from_micros(now), &mut self.bus, &mut self.application);
        if let Some(error) = self.bus.take_error() {
            return Err(error);
        }
        let event = self.application.dp.take_last_events().peripheral;
        let event = event.map(|(_, event)| match (life(event), &mut self.application.wants_parameters) {
            (Life::Offline, wants_parameters @ true) => {
                *wants_parameters = false;
                Life::ParametersRefused
            }
            (other, wants_parameters) => {
                *wants_parameters = false;
                other
            }
        });
        if event.is_none() && self.bus.traffic().telegrams == sent {
            self.bus.rest()?;
        }
        Ok(event)
    }

    /// Polls until `done` says so, at most for `span` on the bus; whether it did.
    ///
    /// # Errors
    ///
    /// The bus is broken for good.
    pub fn run_until(
        &mut self,
        span: Duration,
        mut done: impl FnMut(&mut Self, Option<Life>) -> bool,
    ) -> Result<bool, EndError> {
        let until = self.bus.now() + span;
        while self.bus.now() < until {
            let event = self.poll()?;
            if done(self, event) {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The next outputs of the slave.
    pub fn outputs_mut(&mut self) -> &mut [u8] {
        self.application.dp.get_mut(self.slave).pi_q_mut()
    }

    /// Its newest inputs.
    pub fn inputs(&mut self) -> &[u8] {
        self.application.dp.get_mut(self.slave).pi_i()
    }

    /// Whether it answers.
    pub fn is_live(&mut self) -> bool {
        self.application.dp.get_mut(self.slave).is_live()
    }

    /// Whether it exchanges data.
    pub fn is_running(&mut self) -> bool {
        self.application.dp.get_mut(self.slave).is_running()
    }

    /// Fetches the diagnosis in place of the next exchange; [`Life::Diagnosis`] tells when it is there.
    pub fn request_diagnosis(&mut self) {
        self.application.dp.get_mut(self.slave).request_diagnostics();
    }

    /// The newest diagnosis, and the device's own part of the newest that was announced as such
    /// (Ext_Diag). [`ask`](Self::ask) for Slave_Diag brings all octets.
    pub fn diagnosis(&mut self) -> Option<(StandardDiagnosis, Vec<u8>)> {
        let found = self.application.dp.get_mut(self.slave).last_diagnostics()?;
        let [one, two] = found.flags.bits().to_le_bytes();
        let [high, low] = found.ident_number.to_be_bytes();
        let octets = [one, two, 0, found.master_address.unwrap_or(0xFF), high, low];
        let extended = found.extended_diagnostics.raw_diag_buffer().unwrap_or_default().to_vec();
        Some((StandardDiagnosis::parse(&octets)?, extended))
    }

    /// Asks the slave, or another, for something between two cycles. One thing at a time.
    ///
    /// [`answer`](Self::answer) has what came of it, some polls later.
    pub fn ask(&mut self, asked: Asked) {
        self.application.ask(asked);
    }

    /// What came of the newest question, once.
    pub fn answer(&mut self) -> Option<Outcome> {
        self.application.take_outcome()
    }

    /// Asks, and polls until there is an answer, at most for `span` on the bus.
    ///
    /// # Errors
    ///
    /// The bus is broken for good.
    pub fn ask_within(&mut self, span: Duration, asked: Asked) -> Result<Option<Outcome>, EndError> {
        self.ask(asked);
        let mut outcome = None;
        self.run_until(span, |master, _| {
            outcome = master.answer();
            outcome.is_some()
        })?;
        Ok(outcome)
    }

    /// The bus.
    pub fn bus(&self) -> &B {
        &self.bus
    }

    /// The bus, to do other things with between two polls.
    pub fn bus_mut(&mut self) -> &mut B {
        &mut self.bus
    }

    /// Ends the master and gives its bus back; the slave stays its own until its watchdog or an unlock
    /// frees it.
    pub fn into_bus(self) -> B {
        self.bus
    }

    /// The time on the bus.
    pub fn now(&self) -> Instant {
        self.bus.now()
    }
}

fn check(master: MasterSettings, slave: &SlaveSettings) -> Result<(), SettingsError> {
    const MOST: usize = MAX_PDU - 2;
    for address in [master.address, slave.address] {
        if address > 125 {
            return Err(SettingsError::Address(address));
        }
    }
    if master.address == slave.address {
        return Err(SettingsError::SameAddress(master.address));
    }
    let lengths = [
        (Service::SetPrm, slave.parameters.user.len(), MOST - 7),
        (Service::ChkCfg, slave.configuration.len(), MOST),
        (Service::DataExchange, slave.inputs.max(slave.outputs).into(), MOST),
    ];
    for (what, octets, most) in lengths {
        if octets > most {
            return Err(SettingsError::TooLong { what, octets, most });
        }
    }
    if !(1..=15).contains(&master.retries) {
        return Err(SettingsError::Retries(master.retries));
    }
    match slave.parameters.min_tsdr {
        1..=10 => Err(SettingsError::MinTsdr(slave.parameters.min_tsdr)),
        _ => match slave.parameters.watchdog {
            // profirust knows no longer one.
            Some(watchdog) if watchdog.span() > Duration::from_secs(650) => Err(WatchdogOutOfRange.into()),
            Some(Watchdog { factor_1: 0, .. } | Watchdog { factor_2: 0, .. }) => {
                Err(WatchdogOutOfRange.into())
            }
            _ => Ok(()),
        },
    }
}

fn options(slave: &SlaveSettings) -> PeripheralOptions<'_> {
    PeripheralOptions {
        ident_number: slave.parameters.ident_number,
        sync_mode: slave.parameters.sync,
        freeze_mode: slave.parameters.freeze,
        groups: slave.parameters.groups,
        max_tsdr: slave.max_tsdr,
        fail_safe: false,
        user_parameters: Some(&slave.parameters.user),
        config: Some(&slave.configuration),
    }
}

/// The slot time in bit times, as profirust can count it.
fn slot_bits(master: MasterSettings) -> u16 {
    let usual = ::bus::virtual_segment::slot_time(master.rate).0;
    let bits =
        master.slot_time.as_nanos().saturating_mul(master.rate.bits_per_second().into()) / 1_000_000_000;
    let bits = bits.max(usual.into());
    u16::try_from(bits).unwrap_or(u16::MAX)
}

const fn rate(rate: Baudrate) -> profirust::Baudrate {
    match rate {
        Baudrate::B9600 => profirust::Baudrate::B9600,
        Baudrate::B19200 => profirust::Baudrate::B19200,
        Baudrate::B45450 => profirust::Baudrate::B45450,
        Baudrate::B93750 => profirust::Baudrate::B93750,
        Baudrate::B187500 => profirust::Baudrate::B187500,
        Baudrate::B500000 => profirust::Baudrate::B500000,
        Baudrate::B1500000 => profirust::Baudrate::B1500000,
        Baudrate::B3000000 => profirust::Baudrate::B3000000,
        Baudrate::B6000000 => profirust::Baudrate::B6000000,
        Baudrate::B12000000 => profirust::Baudrate::B12000000,
    }
}

const fn life(event: PeripheralEvent) -> Life {
    match event {
        PeripheralEvent::Online => Life::Online,
        PeripheralEvent::Configured => Life::Configured,
        PeripheralEvent::ConfigError => Life::ConfigurationRefused,
        PeripheralEvent::ParameterError => Life::ParametersRefused,
        PeripheralEvent::DataExchanged => Life::Exchanged,
        PeripheralEvent::Diagnostics => Life::Diagnosis,
        PeripheralEvent::Offline => Life::Offline,
    }
}
