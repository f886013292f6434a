//! What the slave tells its application.

use core::fmt;

use super::refusal::Refusal;
use crate::time::{Baudrate, BitTimes};

/// Something worth telling. Ordinary Data_Exchange is not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// A master has parameterized the slave and owns it: Wait_Cfg.
    Parameterized {
        /// The owner.
        master: u8,
    },
    /// The owner sent good parameters in data exchange; they are in force.
    ParametersChanged,
    /// Data exchange begins.
    DataExchangeEntered {
        /// The owner.
        master: u8,
    },
    /// Back in Wait_Prm, outputs cleared, no owner.
    MasterLeft(Cause),
    /// A request was refused.
    Refused(Refusal),
    /// min T_SDR from the next answer on; `above_max`: it is above max T_SDR of the rate, so a
    /// master may give up before the answer starts.
    MinTsdr {
        /// What is in force now.
        value: BitTimes,
        /// Whether masters may take the answers for late.
        above_max: bool,
    },
    /// The slave answers to a new address.
    AddressTaken(u8),
    /// Global_Control has cleared the outputs.
    Cleared,
    /// Sync mode is on (or has passed outputs on once more), or off.
    Sync(bool),
    /// Freeze mode is on (or has taken inputs once more), or off.
    Freeze(bool),
    /// The search listens at this rate.
    Listening(Baudrate),
    /// The baud rate is found.
    BaudrateFound(Baudrate),
}

/// Why a slave left its master.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// The master unlocked it.
    Unlocked,
    /// A Set_Prm was refused.
    PrmFault,
    /// A Chk_Cfg was refused.
    CfgFault,
    /// New parameters are too short for the configuration agreed on.
    ParametersTooShort,
    /// Data_Exchange came with a wrong number of outputs.
    OutputLength,
    /// The master was silent longer than the watchdog allows.
    WatchdogExpired,
    /// The device itself cannot exchange data any longer.
    Application,
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Unlocked => "the master has unlocked the slave",
            Self::PrmFault => "its parameters were refused",
            Self::CfgFault => "its configuration was refused",
            Self::ParametersTooShort => "its new parameters are too short for the configuration agreed on",
            Self::OutputLength => "it sent a wrong number of output octets",
            Self::WatchdogExpired => "the watchdog has expired",
            Self::Application => "the device cannot exchange data",
        })
    }
}

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Parameterized { master } => write!(f, "parameterized by master {master}"),
            Self::ParametersChanged => f.write_str("new parameters taken during data exchange"),
            Self::DataExchangeEntered { master } => write!(f, "data exchange with master {master} begins"),
            Self::MasterLeft(cause) => write!(f, "waiting for parameters: {cause}"),
            Self::Refused(refusal) => refusal.fmt(f),
            Self::MinTsdr { value, above_max } => {
                write!(f, "answers start {} bit times after a request at the earliest", value.0)?;
                if above_max {
                    f.write_str(": above max T_SDR of this rate, masters may not wait so long")?;
                }
                Ok(())
            }
            Self::AddressTaken(address) => write!(f, "new station address {address}"),
            Self::Cleared => f.write_str("outputs cleared by Global_Control"),
            Self::Sync(true) => f.write_str("Sync: outputs held until the next Sync or Unsync"),
            Self::Sync(false) => f.write_str("Unsync: outputs follow again"),
            Self::Freeze(true) => f.write_str("Freeze: inputs held until the next Freeze or Unfreeze"),
            Self::Freeze(false) => f.write_str("Unfreeze: inputs follow again"),
            Self::Listening(rate) => write!(f, "searching the baud rate: listening at {rate}"),
            Self::BaudrateFound(rate) => write!(f, "baud rate {rate} found"),
        }
    }
}
