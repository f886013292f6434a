//! Why the device refused something: octet, value, rule and section of the manual.
//!
//! The bus only tells that a parameter or a configuration was refused, never why. These reasons
//! go to tools: each displays as one plain sentence.

use core::fmt;

use crate::functionality::Functionality;
use crate::specification::Variant;

/// Why the encoder's part of a Set_Prm was refused (manual 4.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PrmRefusal {
    /// Neither 9 nor 25 nor 26 octets.
    Length {
        /// The octets that came, 255 for more.
        octets: u8,
    },
    /// Octet 9, bit 1 is 0 in 25 or 26 octets.
    Class2Missing {
        /// The whole octet.
        value: u8,
    },
    /// Octet 9, bit 2 is 1.
    Commissioning {
        /// The whole octet.
        value: u8,
    },
    /// Octet 9, one of bits 4-7 is 1.
    NotAssigned {
        /// The whole octet.
        value: u8,
    },
    /// Octets 10-13 are 0 or above 2^n while scaling is on.
    MeasuringUnits {
        /// The steps per revolution asked for.
        value: u32,
        /// The variant that sets the limit.
        variant: Variant,
    },
    /// Octets 14-17 are 0 or above 2^(n+m) while scaling is on.
    MeasuringRange {
        /// The steps of the whole range asked for.
        value: u32,
        /// The variant that sets the limit.
        variant: Variant,
    },
    /// One of octets 18-25 is not 0.
    Reserved {
        /// Which: 18 to 25.
        octet: u8,
        /// What it holds.
        value: u8,
    },
    /// Octet 26 is above 3.
    TimeBase {
        /// What it holds.
        value: u8,
    },
    /// New parameters in data exchange are shorter than the agreed functionality needs.
    ShorterThanAgreed {
        /// The octets that came.
        octets: u8,
        /// What was agreed.
        functionality: Functionality,
    },
}

/// Why a Chk_Cfg was refused (manual 4, 4.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum CfgRefusal {
    /// These octets choose none of the three functionalities.
    NotOffered {
        /// How many octets came, 255 for more.
        length: u8,
        /// The first eight of them; the rest is 0.
        first: [u8; 8],
    },
    /// The functionality needs longer parameters than the last Set_Prm had.
    ParametersTooShort {
        /// What the configuration chose.
        functionality: Functionality,
        /// Octets that Set_Prm had.
        have: u8,
    },
}

/// Why a preset was refused: the value is above the total measuring range minus 1 (manual 4.3.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct PresetRefusal {
    /// Bits 0-30 of the outputs.
    pub value: u32,
    /// The highest value allowed.
    pub limit: u32,
}

/// Why a Set_Slave_Add was refused (manual 3.4).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum AddressRefusal {
    /// The rotary switches are not at 126: they decide.
    SwitchesDecide {
        /// Where they are.
        switches: u8,
    },
    /// The new address is not 1 to 125.
    OutOfRange {
        /// The address asked for.
        address: u8,
    },
    /// The ident number is another device's.
    Ident {
        /// The number that came.
        received: u16,
        /// The device's own.
        own: u16,
    },
    /// Fewer than 4 octets.
    TooShort {
        /// The octets that came.
        octets: u8,
    },
    /// The device waits for no parameters: it is being parameterized or exchanges data.
    NotInWaitPrm,
}

impl PrmRefusal {
    /// The first octet of Set_Prm at fault; `None` if it is the length.
    pub const fn octet(&self) -> Option<u8> {
        match *self {
            Self::Length { .. } | Self::ShorterThanAgreed { .. } => None,
            Self::Class2Missing { .. } | Self::Commissioning { .. } | Self::NotAssigned { .. } => {
                Some(crate::parameterization::OPERATING_PARAMETERS)
            }
            Self::MeasuringUnits { .. } => Some(crate::parameterization::MEASURING_UNITS),
            Self::MeasuringRange { .. } => Some(crate::parameterization::MEASURING_RANGE),
            Self::Reserved { octet, .. } => Some(octet),
            Self::TimeBase { .. } => Some(crate::parameterization::TIME_BASE),
        }
    }

    /// The value at fault; the number of octets if it is the length.
    pub const fn value(&self) -> u32 {
        match *self {
            Self::MeasuringUnits { value, .. } | Self::MeasuringRange { value, .. } => value,
            Self::Class2Missing { value }
            | Self::Commissioning { value }
            | Self::NotAssigned { value }
            | Self::Reserved { value, .. }
            | Self::TimeBase { value } => value as u32,
            Self::Length { octets } | Self::ShorterThanAgreed { octets, .. } => octets as u32,
        }
    }

    /// The section of the manual with the rule.
    pub const fn section(&self) -> &'static str {
        match self {
            Self::Length { .. } | Self::ShorterThanAgreed { .. } => "4.1",
            Self::Class2Missing { .. } | Self::Commissioning { .. } | Self::NotAssigned { .. } => "4.1.1",
            Self::MeasuringUnits { .. } => "4.1.2",
            Self::MeasuringRange { .. } => "4.1.3",
            Self::Reserved { .. } => "4.1.4",
            Self::TimeBase { .. } => "4.1.5",
        }
    }
}

impl fmt::Display for PrmRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Length { octets } => write!(
                f,
                "Set_Prm: {octets} octets, but it must be 9 (class 1), 25 (class 2) or 26 (Scancon 2.0)"
            )?,
            Self::Class2Missing { value } => write!(
                f,
                "Set_Prm octet 9: {value:02X}h has bit 1 (class 2 functionality) off, but in 25 and 26 octets it must be on"
            )?,
            Self::Commissioning { value } => write!(
                f,
                "Set_Prm octet 9: {value:02X}h has bit 2 (commissioning diagnostics) on, but that is not supported and must be off"
            )?,
            Self::NotAssigned { value } => write!(
                f,
                "Set_Prm octet 9: {value:02X}h has one of bits 4-7 on, but they are not assigned and must be off"
            )?,
            Self::MeasuringUnits { value, variant } => write!(
                f,
                "Set_Prm octets 10-13: {value} measuring units per revolution, but {} with {} singleturn bits",
                Allowed { value, limit: variant.steps_per_revolution() },
                variant.singleturn_bits(),
            )?,
            Self::MeasuringRange { value, variant } => write!(
                f,
                "Set_Prm octets 14-17: {value} steps of total measuring range, but {} with {} singleturn and {} multiturn bits",
                Allowed { value, limit: variant.total() },
                variant.singleturn_bits(),
                variant.multiturn_bits(),
            )?,
            Self::Reserved { octet, value } => {
                write!(
                    f,
                    "Set_Prm octet {octet}: {value:02X}h, but octets 18-25 are reserved and must be 0"
                )?;
            }
            Self::TimeBase { value } => write!(
                f,
                "Set_Prm octet 26: time base {value}, but it must be 0 (10 ms), 1 (100 ms), 2 (1000 ms) or 3 (RPM)"
            )?,
            Self::ShorterThanAgreed { octets, functionality } => write!(
                f,
                "Set_Prm: {octets} octets of new parameters in data exchange, but the agreed {functionality} needs {}",
                functionality.parameter_octets(),
            )?,
        }
        write!(f, " (manual {})", self.section())
    }
}

/// "at least 1 is needed" or "at most so many are possible".
struct Allowed {
    value: u32,
    limit: u32,
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.value == 0 {
            write!(f, "1 to {} are possible", self.limit)
        } else {
            write!(f, "at most {} are possible", self.limit)
        }
    }
}

impl CfgRefusal {
    /// The refusal of these Chk_Cfg octets because they choose nothing.
    pub fn not_offered(octets: &[u8]) -> Self {
        let mut first = [0; 8];
        for (kept, &octet) in first.iter_mut().zip(octets) {
            *kept = octet;
        }
        Self::NotOffered { length: u8::try_from(octets.len()).unwrap_or(u8::MAX), first }
    }

    /// The first octet of Chk_Cfg at fault; `None` if it is the length of the parameters, or if
    /// no octets came.
    pub const fn octet(&self) -> Option<u8> {
        match *self {
            Self::NotOffered { length: 1.., .. } => Some(1),
            Self::NotOffered { .. } | Self::ParametersTooShort { .. } => None,
        }
    }

    /// The first four configuration octets, most significant first; or the octets that Set_Prm
    /// had.
    pub const fn value(&self) -> u32 {
        match *self {
            Self::NotOffered { first: [a, b, c, d, ..], .. } => u32::from_be_bytes([a, b, c, d]),
            Self::ParametersTooShort { have, .. } => have as u32,
        }
    }

    /// The section of the manual with the rule.
    pub const fn section(&self) -> &'static str {
        match self {
            Self::NotOffered { .. } => "4.3",
            Self::ParametersTooShort { .. } => "4.1",
        }
    }
}

impl fmt::Display for CfgRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NotOffered { length: 0, .. } => f.write_str("Chk_Cfg: no octets")?,
            Self::NotOffered { length, first } => {
                f.write_str("Chk_Cfg:")?;
                for octet in first.iter().take(usize::from(length)) {
                    write!(f, " {octet:02X}")?;
                }
                if length > 8 {
                    write!(f, " and {} octets more", length.saturating_sub(8))?;
                }
            }
            Self::ParametersTooShort { functionality, have } => write!(
                f,
                "Chk_Cfg: {functionality} needs a Set_Prm of {} octets, but the last one had {have}",
                functionality.parameter_octets(),
            )?,
        }
        if let Self::NotOffered { .. } = self {
            f.write_str(
                ", but the device offers D1 (class 1), F1 (class 2), F1 D1 D1 or F1 D3 (Scancon 2.0)",
            )?;
        }
        write!(f, " (manual {})", self.section())
    }
}

impl PresetRefusal {
    /// The first octet of the outputs that hold the value.
    pub const fn octet(&self) -> Option<u8> {
        Some(1)
    }

    /// The preset value asked for.
    pub const fn value(&self) -> u32 {
        self.value
    }

    /// The section of the manual with the rule.
    pub const fn section(&self) -> &'static str {
        "4.3.2"
    }
}

impl fmt::Display for PresetRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "output octets 1-4: preset to {}, but at most {} is possible, the total measuring range minus 1 (manual {})",
            self.value,
            self.limit,
            self.section(),
        )
    }
}

impl AddressRefusal {
    /// The first octet of Set_Slave_Add at fault; `None` if no octet is.
    pub const fn octet(&self) -> Option<u8> {
        match self {
            Self::OutOfRange { .. } => Some(1),
            Self::Ident { .. } => Some(2),
            Self::SwitchesDecide { .. } | Self::TooShort { .. } | Self::NotInWaitPrm => None,
        }
    }

    /// The value at fault: address, ident number, number of octets or the value of the switches;
    /// 0 where it is the state of the device.
    pub const fn value(&self) -> u32 {
        match *self {
            Self::SwitchesDecide { switches: octet }
            | Self::OutOfRange { address: octet }
            | Self::TooShort { octets: octet } => octet as u32,
            Self::Ident { received, .. } => received as u32,
            Self::NotInWaitPrm => 0,
        }
    }

    /// The section of the manual with the rule.
    pub const fn section(&self) -> &'static str {
        "3.4"
    }
}

impl fmt::Display for AddressRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::SwitchesDecide { switches } => write!(
                f,
                "Set_Slave_Add: the rotary switches are at {switches:02X}h ({switches}) and decide the address, but a change over the bus needs them at 7Eh (126)"
            )?,
            Self::OutOfRange { address } => {
                write!(f, "Set_Slave_Add octet 1: address {address}, but it must be 1 to 125")?;
            }
            Self::Ident { received, own } => write!(
                f,
                "Set_Slave_Add octets 2-3: ident number {received:04X}h, but this device has {own:04X}h"
            )?,
            Self::TooShort { octets } => {
                write!(f, "Set_Slave_Add: {octets} octets, but at least 4 are needed")?;
            }
            Self::NotInWaitPrm => f.write_str(
                "Set_Slave_Add: the device is parameterized, but the address can only be changed while no master has it",
            )?,
        }
        write!(f, " (manual {})", self.section())
    }
}

impl core::error::Error for PrmRefusal {}
impl core::error::Error for CfgRefusal {}
impl core::error::Error for PresetRefusal {}
impl core::error::Error for AddressRefusal {}

#[cfg(test)]
mod tests;
