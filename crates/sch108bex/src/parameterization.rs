//! The encoder's part of Set_Prm (manual 4.1), from octet 9 on.
//!
//! | octet | bit | name | range | default | present in |
//! |---|---|---|---|---|---|
//! | 9 | 0 | code sequence: 0 clockwise, 1 counter-clockwise | 0-1 | 0 | all |
//! | | 1 | class 2 functionality | 1 | 1 | class 2, Scancon 2.0 |
//! | | 2 | commissioning diagnostics | 0 | 0 | class 2, Scancon 2.0 |
//! | | 3 | scaling function control | 0-1 | 0 | class 2, Scancon 2.0 |
//! | | 4-7 | not assigned | 0 | 0 | all |
//! | 10-13 | | measuring units per revolution | 1-2^n | 2^n | class 2, Scancon 2.0 |
//! | 14-17 | | total measuring range | 1-2^(n+m) | 2^(n+m) | class 2, Scancon 2.0 |
//! | 18-25 | | reserved for future use | 0 | 0 | class 2, Scancon 2.0 |
//! | 26 | | time base | 0-3 | 1 | Scancon 2.0 |
//!
//! Octets count from 1 over the whole Set_Prm data. Octets 1-7 are the DP standard's, octet 8 is
//! the slave ASIC's: both are checked by the DP layer below.

use core::fmt;

use crate::refusal::PrmRefusal;
use crate::specification::Variant;

/// Octet 9: operating parameters.
pub const OPERATING_PARAMETERS: u8 = 9;
/// Octets 10-13: measuring units per revolution.
pub const MEASURING_UNITS: u8 = 10;
/// Octets 14-17: total measuring range.
pub const MEASURING_RANGE: u8 = 14;
/// Octets 18-25: reserved, the first.
pub const RESERVED_FIRST: u8 = 18;
/// Octets 18-25: reserved, the last.
pub const RESERVED_LAST: u8 = 25;
/// Octet 26: time base.
pub const TIME_BASE: u8 = 26;

const CODE_SEQUENCE_BIT: u8 = 0x01;
const CLASS_2_BIT: u8 = 0x02;
const COMMISSIONING_BIT: u8 = 0x04;
const SCALING_BIT: u8 = 0x08;
const NOT_ASSIGNED_BITS: u8 = 0xF0;

/// In which direction the position grows, seen from the shaft side (manual 4.1.1, bit 0).
#[doc(alias = "CW")]
#[doc(alias = "CCW")]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum CodeSequence {
    /// Increasing clockwise: bit 0 = 0, the default.
    #[default]
    Clockwise,
    /// Increasing counter-clockwise: bit 0 = 1.
    CounterClockwise,
}

/// The unit of velocity and acceleration (manual 4.1.5).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum TimeBase {
    /// 0: steps per 10 ms.
    Per10Ms,
    /// 1: steps per 100 ms, the default.
    #[default]
    Per100Ms,
    /// 2: steps per 1000 ms.
    Per1000Ms,
    /// 3: revolutions per minute.
    Rpm,
}

/// The lengths of Set_Prm that are taken (manual 4.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ParameterLength {
    /// 9 octets: all that class 1 needs.
    Nine,
    /// 25 octets: all that class 2 needs.
    TwentyFive,
    /// 26 octets: all that Scancon 2.0 needs.
    TwentySix,
}

/// The encoder's parameters as the master sent them.
///
/// With `scaling` off the two scaling values are kept as they came and have no effect, whatever
/// they are (manual 4.1.1, bit 3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Parameters {
    /// How many octets of Set_Prm they came in; a shorter telegram leaves the rest at default.
    pub length: ParameterLength,
    /// Octet 9 bit 0.
    pub code_sequence: CodeSequence,
    /// Octet 9 bit 3: whether the two values below are in force.
    pub scaling: bool,
    /// Octets 10-13, in steps: 1 to 2^n while `scaling` is on.
    #[doc(alias = "MUR")]
    pub measuring_units_per_revolution: u32,
    /// Octets 14-17, in steps: 1 to 2^(n+m) while `scaling` is on.
    #[doc(alias = "TMR")]
    pub total_measuring_range: u32,
    /// Octet 26.
    pub time_base: TimeBase,
}

impl CodeSequence {
    /// The code sequence in bit 0 of octet 9, of Set_Prm and of the diagnosis alike.
    pub const fn from_bit(octet: u8) -> Self {
        if octet & CODE_SEQUENCE_BIT == 0 { Self::Clockwise } else { Self::CounterClockwise }
    }

    /// Bit 0 of octet 9: 0 or 1.
    pub const fn bit(self) -> u8 {
        match self {
            Self::Clockwise => 0,
            Self::CounterClockwise => CODE_SEQUENCE_BIT,
        }
    }
}

impl TimeBase {
    /// The time base with this number, 0 to 3; `None` above.
    pub const fn from_octet(octet: u8) -> Option<Self> {
        match octet {
            0 => Some(Self::Per10Ms),
            1 => Some(Self::Per100Ms),
            2 => Some(Self::Per1000Ms),
            3 => Some(Self::Rpm),
            _ => None,
        }
    }

    /// Octet 26: 0 to 3.
    pub const fn octet(self) -> u8 {
        match self {
            Self::Per10Ms => 0,
            Self::Per100Ms => 1,
            Self::Per1000Ms => 2,
            Self::Rpm => 3,
        }
    }
}

impl ParameterLength {
    /// Reading: Set_Prm has exactly 9, 25 or 26 octets; any other number is a parameter fault.
    pub const fn from_octets(octets: usize) -> Option<Self> {
        match octets {
            9 => Some(Self::Nine),
            25 => Some(Self::TwentyFive),
            26 => Some(Self::TwentySix),
            _ => None,
        }
    }

    /// Octets of Set_Prm, octets 1-8 included: 9, 25 or 26.
    pub const fn octets(self) -> u8 {
        match self {
            Self::Nine => 9,
            Self::TwentyFive => 25,
            Self::TwentySix => 26,
        }
    }
}

impl Parameters {
    /// The defaults of the manual for a variant, at full length: clockwise, scaling off, 2^n,
    /// 2^(n+m), steps per 100 ms.
    pub const fn default_for(variant: Variant) -> Self {
        Self {
            length: ParameterLength::TwentySix,
            code_sequence: CodeSequence::Clockwise,
            scaling: false,
            measuring_units_per_revolution: variant.steps_per_revolution(),
            total_measuring_range: variant.total(),
            time_base: TimeBase::Per100Ms,
        }
    }

    /// Reading: parameters that the manual does not allow are refused as a whole, never adapted.
    ///
    /// `set_prm` is the whole data of the telegram, octet 1 first; octets 1-8 are not looked at.
    ///
    /// # Errors
    ///
    /// The first fault in the order of the octets.
    pub fn parse(set_prm: &[u8], variant: &Variant) -> Result<Self, PrmRefusal> {
        let length = ParameterLength::from_octets(set_prm.len())
            .ok_or(PrmRefusal::Length { octets: clamp(set_prm.len()) })?;
        let operating = octet(set_prm, OPERATING_PARAMETERS);
        check_operating_parameters(operating, length)?;
        let defaults =
            Self { length, code_sequence: CodeSequence::from_bit(operating), ..Self::default_for(*variant) };
        if length == ParameterLength::Nine {
            return Ok(defaults);
        }
        let parameters = Self {
            scaling: operating & SCALING_BIT != 0,
            measuring_units_per_revolution: double_word(set_prm, MEASURING_UNITS),
            total_measuring_range: double_word(set_prm, MEASURING_RANGE),
            ..defaults
        };
        parameters.check_scaling(*variant)?;
        check_reserved(set_prm)?;
        if length == ParameterLength::TwentyFive {
            return Ok(parameters);
        }
        let value = octet(set_prm, TIME_BASE);
        let time_base = TimeBase::from_octet(value).ok_or(PrmRefusal::TimeBase { value })?;
        Ok(Self { time_base, ..parameters })
    }

    /// Writes octets 9 and up into the data of a Set_Prm and returns the telegram's length: 9, 25
    /// or 26. Octets 1-8 are left alone.
    pub fn emit(&self, set_prm: &mut [u8; 26]) -> usize {
        let [.., operating, m3, m2, m1, m0, t3, t2, t1, t0, r1, r2, r3, r4, r5, r6, r7, r8, base] = set_prm;
        *operating = self.operating_parameters();
        if self.length > ParameterLength::Nine {
            [*m3, *m2, *m1, *m0] = self.measuring_units_per_revolution.to_be_bytes();
            [*t3, *t2, *t1, *t0] = self.total_measuring_range.to_be_bytes();
            for reserved in [r1, r2, r3, r4, r5, r6, r7, r8] {
                *reserved = 0;
            }
        }
        if self.length == ParameterLength::TwentySix {
            *base = self.time_base.octet();
        }
        usize::from(self.length.octets())
    }

    /// Octet 9 as it is sent.
    fn operating_parameters(&self) -> u8 {
        let class_2 = match self.length {
            ParameterLength::Nine => 0,
            _ if self.scaling => CLASS_2_BIT | SCALING_BIT,
            _ => CLASS_2_BIT,
        };
        self.code_sequence.bit() | class_2
    }

    /// Reading: with scaling off there is no range check of the scaling values.
    fn check_scaling(&self, variant: Variant) -> Result<(), PrmRefusal> {
        if !self.scaling {
            return Ok(());
        }
        let units = self.measuring_units_per_revolution;
        if units == 0 || units > variant.steps_per_revolution() {
            return Err(PrmRefusal::MeasuringUnits { value: units, variant });
        }
        let range = self.total_measuring_range;
        if range == 0 || range > variant.total() {
            return Err(PrmRefusal::MeasuringRange { value: range, variant });
        }
        Ok(())
    }
}

impl fmt::Display for CodeSequence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Clockwise => "clockwise",
            Self::CounterClockwise => "counter-clockwise",
        })
    }
}

impl fmt::Display for TimeBase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Per10Ms => "steps per 10 ms",
            Self::Per100Ms => "steps per 100 ms",
            Self::Per1000Ms => "steps per 1000 ms",
            Self::Rpm => "revolutions per minute",
        })
    }
}

/// Reading: in 9 octets bits 2 and 4-7 of octet 9 must be 0, and bits 1 and 3 are ignored; in 25
/// and 26 octets bit 1 must be 1 as well.
fn check_operating_parameters(value: u8, length: ParameterLength) -> Result<(), PrmRefusal> {
    if length > ParameterLength::Nine && value & CLASS_2_BIT == 0 {
        return Err(PrmRefusal::Class2Missing { value });
    }
    if value & COMMISSIONING_BIT != 0 {
        return Err(PrmRefusal::Commissioning { value });
    }
    if value & NOT_ASSIGNED_BITS != 0 {
        return Err(PrmRefusal::NotAssigned { value });
    }
    Ok(())
}

/// Octets 18-25 must be 0 (manual 4.1.4).
fn check_reserved(set_prm: &[u8]) -> Result<(), PrmRefusal> {
    for number in RESERVED_FIRST..=RESERVED_LAST {
        let value = octet(set_prm, number);
        if value != 0 {
            return Err(PrmRefusal::Reserved { octet: number, value });
        }
    }
    Ok(())
}

/// The octet with the manual's number: the only place that subtracts the 1.
fn octet(set_prm: &[u8], number: u8) -> u8 {
    set_prm.get(usize::from(number).wrapping_sub(1)).copied().unwrap_or(0)
}

/// The four octets from the manual's number on, most significant first.
fn double_word(set_prm: &[u8], number: u8) -> u32 {
    let at = |further| octet(set_prm, number.wrapping_add(further));
    u32::from_be_bytes([at(0), at(1), at(2), at(3)])
}

fn clamp(octets: usize) -> u8 {
    u8::try_from(octets).unwrap_or(u8::MAX)
}

#[cfg(test)]
mod tests;
