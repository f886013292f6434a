//! Where the bus is, and how it is asked: the options that all commands with a master have.

use std::time::Duration as Time;

use ::master::{LightMaster, Settings, Wire};
use bus::{PortAddress, open_for_master};
use clap::Args;
use profibus_dp::time::{Baudrate, BitTimes, Duration};

use super::Light;
use crate::arguments::{Baud, whole};
use crate::{Failure, output};

/// A port, and a master of its own on it.
#[derive(Debug, Clone, Args)]
pub(crate) struct Place {
    /// Where the slaves are: /dev/ttyUSB0, /dev/pts/4, tcp:ADDRESS:PORT, tcp-listen:ADDRESS:PORT, unix:PATH
    #[arg(long, value_name = "PORT", env = "SCH108BEX_PORT")]
    pub(crate) port: PortAddress,
    /// The rate in bits per second; sockets have none
    #[arg(long, value_name = "RATE", default_value = "500000", value_parser = rate)]
    pub(crate) baud: Baudrate,
    /// This master's own address
    #[arg(long = "master-address", value_name = "N", default_value_t = 2, value_parser = whole::<u8>(0..=125), allow_negative_numbers = true)]
    pub(crate) own_address: u8,
    /// How long to wait for a reply, in milliseconds
    #[arg(long, value_name = "MS", env = "SCH108BEX_REPLY_WITHIN", default_value_t = 20, value_parser = whole::<u16>(1..=10_000), allow_negative_numbers = true)]
    pub(crate) reply_within: u16,
    /// How often a request is repeated that is not answered
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = whole::<u8>(1..=15), allow_negative_numbers = true)]
    pub(crate) retries: u8,
    /// How long to wait for somebody at the far side of the port, in seconds
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = whole::<u16>(0..=3_600), allow_negative_numbers = true)]
    pub(crate) wait: u16,
}

fn rate(text: &str) -> Result<Baudrate, String> {
    match text.parse::<Baud>() {
        Ok(Baud::Fixed(rate)) => Ok(rate),
        Ok(Baud::Auto) => Err("a master has to know its rate; write one like 500000".to_owned()),
        Err(why) => Err(why.replace("; or write auto", "")),
    }
}

impl Place {
    /// A master on the port.
    pub(crate) fn open(&self) -> Result<Light, Failure> {
        let patience = Duration::from_secs(self.wait.into());
        let end = open_end(&self.port, self.baud, patience)?;
        let mut wire = Wire::new(end)
            .with_slot_time(self.slot())
            .with_octet_time(self.baud.duration(BitTimes::CHARACTER));
        if !wire.await_peer(patience).map_err(|error| Failure::Failed(error.to_string()))? {
            return Err(Failure::Failed(format!(
                "nobody has connected to {} within {} s; start the slave's side, or give it longer with --wait",
                self.port, self.wait
            )));
        }
        let settings = Settings { address: self.own_address, retries: self.retries, ..Settings::default() };
        Ok(LightMaster::new(wire, settings))
    }

    /// How long a reply may take.
    pub(crate) fn slot(&self) -> Duration {
        Duration::from_millis(self.reply_within.into())
    }

    /// A master cannot ask itself.
    pub(crate) fn check(&self, station: Option<u8>) -> Result<(), Failure> {
        if station == Some(self.own_address) {
            return Err(Failure::Usage(format!(
                "master and station are both at address {}; --master-address takes another",
                self.own_address
            )));
        }
        Ok(())
    }

    /// Asks with `work`; where the far side has gone meanwhile, says so.
    pub(crate) fn with<T>(&self, work: impl FnOnce(&mut Light) -> Result<T, Failure>) -> Result<T, Failure> {
        let mut light = self.open()?;
        let done = work(&mut light);
        if done.is_err() && light.line().is_gone() {
            return Err(Failure::Failed(format!(
                "the far side of {} has closed the line; is its program still running?",
                self.port
            )));
        }
        done
    }
}

/// The end of a port for a master. A port that listens is told on standard error, since port 0 is any that is free.
pub(crate) fn open_end(
    port: &PortAddress,
    rate: Baudrate,
    patience: Duration,
) -> Result<Box<dyn bus::End>, Failure> {
    let end = open_for_master(port, rate, patience).map_err(|error| match port {
        PortAddress::Pty => Failure::Usage(error.to_string()),
        _ => Failure::Failed(error.to_string()),
    })?;
    if matches!(port, PortAddress::TcpListen(_)) {
        output::aside(&format!("waiting for the slave's side at {}", end.name()));
    }
    Ok(end)
}

/// A pause between two requests.
pub(crate) fn core_span(span: Time) -> Duration {
    Duration::from_nanos(u64::try_from(span.as_nanos()).unwrap_or(u64::MAX))
}
