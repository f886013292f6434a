//! The encoder's part of Slave_Diag (manual 4.2), from octet 7 on.
//!
//! | octet | name | value | present in |
//! |---|---|---|---|
//! | 7 | header: length of the block, itself included | 10 or 51 | all |
//! | 8 | alarms | bits 0, 1 | all |
//! | 9 | operating status | bits 0, 1, 3 | all |
//! | 10 | encoder type | 2 | all |
//! | 11-14 | singleturn resolution | 2^n | all |
//! | 15-16 | number of revolutions | 2^m | all |
//! | 17 | additional alarms | 0 | class 2, Scancon 2.0 |
//! | 18-19 | supported alarms | 0003h | class 2, Scancon 2.0 |
//! | 20-21 | warnings | bits 1, 2, 4, 5 | class 2, Scancon 2.0 |
//! | 22-23 | supported warnings | 0036h | class 2, Scancon 2.0 |
//! | 24-25 | profile version | 1.1 | class 2, Scancon 2.0 |
//! | 26-27 | software version | 1.1 | class 2, Scancon 2.0 |
//! | 28-31 | operating time | 0.1 h | class 2, Scancon 2.0 |
//! | 32-35 | offset value | signed | class 2, Scancon 2.0 |
//! | 36-39 | manufacturer offset value | 0 | class 2, Scancon 2.0 |
//! | 40-43 | measuring units per revolution | in force | class 2, Scancon 2.0 |
//! | 44-47 | total measuring range | in force | class 2, Scancon 2.0 |
//! | 48-57 | serial number | ASCII | class 2, Scancon 2.0 |
//!
//! Octets count from 1 over the whole diagnosis. Octets 1-6 are the DP standard's.

use core::fmt;

use bitflags::bitflags;

use crate::functionality::Functionality;
use crate::health::{Health, OperatingTime};
use crate::parameterization::CodeSequence;
use crate::scaling::Scaling;
use crate::specification::{ENCODER_TYPE, PROFILE_VERSION, SOFTWARE_VERSION, SerialNumber, Variant};

/// Octet 7: the header, first of the block.
pub const HEADER: u8 = 7;
/// Octets of the block in class 1, and the value of its header (manual 4.2.1).
pub const SHORT_BLOCK: u8 = 10;
/// Octets of the block in class 2 and Scancon 2.0, and the value of its header (manual 4.2.1).
pub const LONG_BLOCK: u8 = 51;

const CLASS_2_BIT: u8 = 0x02;
const SCALING_BIT: u8 = 0x08;

bitflags! {
    /// Octet 8: alarms (manual 4.2.2). An alarm tells that the position may be wrong.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
    pub struct Alarms: u8 {
        /// Bit 0: there is, or may be, a wrong position.
        const POSITION_ERROR = 0x01;
        /// Bit 1: the supply voltage is outside 9 to 30 V.
        const SUPPLY_VOLTAGE = 0x02;
        /// Bit 2: current too high; other encoders', always 0 here.
        const CURRENT_TOO_HIGH = 0x04;
        /// Bit 3: commissioning diagnostics; other encoders', always 0 here.
        const COMMISSIONING = 0x08;
        /// Bit 4: memory error; other encoders', always 0 here.
        const MEMORY_ERROR = 0x10;
    }
}

bitflags! {
    /// Octets 20-21: warnings (manual 4.2.9). With a warning the device goes on working.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
    pub struct Warnings: u16 {
        /// Bit 0: frequency exceeded; other encoders', always 0 here.
        const FREQUENCY_EXCEEDED = 0x0001;
        /// Bit 1: more than 65 degrees Celsius inside.
        const TEMPERATURE_EXCEEDED = 0x0002;
        /// Bit 2: the reserve of light is used up.
        const LIGHT_CONTROL_RESERVE = 0x0004;
        /// Bit 3: CPU watchdog; other encoders', always 0 here.
        const CPU_WATCHDOG = 0x0008;
        /// Bit 4: more than 87600 hours in operation.
        const OPERATING_TIME_LIMIT = 0x0010;
        /// Bit 5: the battery is below its limit.
        const BATTERY_CHARGE = 0x0020;
        /// Bit 6: reference point; other encoders', always 0 here.
        const REFERENCE_POINT = 0x0040;
    }
}

/// The encoder's part of the diagnosis as values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Diagnostics {
    /// Octet 8.
    pub alarms: Alarms,
    /// Octet 9 bit 0: the code sequence in force.
    pub code_sequence: CodeSequence,
    /// Octet 9 bit 1: class 2 functionality.
    pub class_2: bool,
    /// Octet 9 bit 3: scaling in force.
    pub scaling: bool,
    /// Octet 10.
    pub encoder_type: u8,
    /// Octets 11-14: physical steps of one revolution.
    pub singleturn_resolution: u32,
    /// Octets 15-16: revolutions that can be told apart.
    pub revolutions: u16,
    /// Octets 17-57; `None` in the short form, the one of class 1.
    pub class_2_part: Option<Class2Part>,
}

/// Octets 17-57 of the diagnosis: what only class 2 and Scancon 2.0 send.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Class2Part {
    /// Octet 17: 0, none are defined.
    pub additional_alarms: u8,
    /// Octets 18-19: a bit for each alarm that can appear.
    pub supported_alarms: u16,
    /// Octets 20-21.
    pub warnings: Warnings,
    /// Octets 22-23: a bit for each warning that can appear.
    pub supported_warnings: Warnings,
    /// Octets 24-25: major, minor.
    pub profile_version: [u8; 2],
    /// Octets 26-27: major, minor.
    pub software_version: [u8; 2],
    /// Octets 28-31.
    pub operating_time: OperatingTime,
    /// Octets 32-35: in scaled steps.
    pub offset: i32,
    /// Octets 36-39: 0, there is none.
    pub manufacturer_offset: i32,
    /// Octets 40-43: in force.
    pub measuring_units_per_revolution: u32,
    /// Octets 44-47: in force.
    pub total_measuring_range: u32,
    /// Octets 48-57.
    pub serial_number: [u8; 10],
}

impl Alarms {
    /// The alarms that this device can raise, octets 18-19 (manual 4.2.8).
    pub const SUPPORTED: Self = Self::POSITION_ERROR.union(Self::SUPPLY_VOLTAGE);
}

impl Warnings {
    /// The warnings that this device can raise, octets 22-23 (manual 4.2.10).
    pub const SUPPORTED: Self = Self::TEMPERATURE_EXCEEDED
        .union(Self::LIGHT_CONTROL_RESERVE)
        .union(Self::OPERATING_TIME_LIMIT)
        .union(Self::BATTERY_CHARGE);
}

/// Reading: Ext_Diag is set while an alarm bit is set, or, where warnings are sent, a warning bit.
pub const fn ext_diag(alarms: Alarms, warnings: Warnings, long_form: bool) -> bool {
    !alarms.is_empty() || (long_form && !warnings.is_empty())
}

/// Reading: Stat_Diag is set while an alarm bit is set. Warnings never set it.
pub const fn stat_diag(alarms: Alarms) -> bool {
    !alarms.is_empty()
}

/// Reading: bit 1 of octet 9 is 0 in class 1: it tells what the device was made, not what it could
/// be.
const fn class_2_bit(functionality: Functionality) -> bool {
    !matches!(functionality, Functionality::Class1)
}

impl Diagnostics {
    /// Reading: outside data exchange the diagnosis has the short form with octet 9 = 0, whatever
    /// was parameterized.
    pub fn outside_data_exchange(variant: Variant, health: &Health) -> Self {
        Self {
            alarms: health.alarms,
            code_sequence: CodeSequence::Clockwise,
            class_2: false,
            scaling: false,
            encoder_type: ENCODER_TYPE,
            singleturn_resolution: variant.steps_per_revolution(),
            revolutions: u16::try_from(variant.revolutions()).unwrap_or(0),
            class_2_part: None,
        }
    }

    /// The diagnosis in data exchange: the short form in class 1, else the long one.
    pub fn in_data_exchange(
        functionality: Functionality,
        scaling: &Scaling,
        health: &Health,
        serial_number: &SerialNumber,
    ) -> Self {
        let class_2 = class_2_bit(functionality);
        Self {
            code_sequence: scaling.code_sequence(),
            class_2,
            scaling: scaling.is_on(),
            class_2_part: class_2.then(|| Class2Part {
                additional_alarms: 0,
                supported_alarms: u16::from(Alarms::SUPPORTED.bits()),
                warnings: health.warnings,
                supported_warnings: Warnings::SUPPORTED,
                profile_version: PROFILE_VERSION,
                software_version: SOFTWARE_VERSION,
                operating_time: health.operating_time,
                offset: health.offset,
                manufacturer_offset: 0,
                measuring_units_per_revolution: scaling.measuring_units_per_revolution(),
                total_measuring_range: scaling.total_measuring_range(),
                serial_number: *serial_number.octets(),
            }),
            ..Self::outside_data_exchange(scaling.variant(), health)
        }
    }

    /// Octet 9 as it is sent.
    pub fn operating_status(&self) -> u8 {
        self.code_sequence.bit()
            | if self.class_2 { CLASS_2_BIT } else { 0 }
            | if self.scaling { SCALING_BIT } else { 0 }
    }

    /// Writes octets 7-16, the short form.
    pub fn emit_short(&self, block: &mut [u8; SHORT_BLOCK as usize]) {
        self.emit_common(SHORT_BLOCK, block);
    }

    /// Writes octets 7-57, the long form; without a class 2 part octets 17-57 are 0.
    pub fn emit_long(&self, block: &mut [u8; LONG_BLOCK as usize]) {
        *block = [0; LONG_BLOCK as usize];
        self.emit_common(LONG_BLOCK, block);
        if let Some(part) = &self.class_2_part {
            part.emit(block);
        }
    }

    fn emit_common(&self, header: u8, block: &mut [u8]) {
        put(block, HEADER, [header]);
        put(block, 8, [self.alarms.bits()]);
        put(block, 9, [self.operating_status()]);
        put(block, 10, [self.encoder_type]);
        put(block, 11, self.singleturn_resolution.to_be_bytes());
        put(block, 15, self.revolutions.to_be_bytes());
    }

    /// The values in the extended block of a diagnosis, octet 7 first; `None` if it is neither of
    /// the two forms: its header is not 10 or 51, or it has fewer octets than that. Octets after
    /// the block are not looked at.
    pub fn parse(block: &[u8]) -> Option<Self> {
        let [header] = get(block, HEADER);
        let class_2_part = match header {
            SHORT_BLOCK => None,
            LONG_BLOCK => Some(Class2Part::parse(block)),
            _ => return None,
        };
        if block.len() < usize::from(header) {
            return None;
        }
        let [alarms, status, encoder_type] = get(block, 8);
        Some(Self {
            alarms: Alarms::from_bits_retain(alarms),
            code_sequence: CodeSequence::from_bit(status),
            class_2: status & CLASS_2_BIT != 0,
            scaling: status & SCALING_BIT != 0,
            encoder_type,
            singleturn_resolution: u32::from_be_bytes(get(block, 11)),
            revolutions: u16::from_be_bytes(get(block, 15)),
            class_2_part,
        })
    }
}

impl Class2Part {
    /// Writes octets 17-57 into a block that starts with octet 7.
    fn emit(&self, block: &mut [u8]) {
        put(block, 17, [self.additional_alarms]);
        put(block, 18, self.supported_alarms.to_be_bytes());
        put(block, 20, self.warnings.bits().to_be_bytes());
        put(block, 22, self.supported_warnings.bits().to_be_bytes());
        put(block, 24, self.profile_version);
        put(block, 26, self.software_version);
        put(block, 28, self.operating_time.0.to_be_bytes());
        put(block, 32, self.offset.to_be_bytes());
        put(block, 36, self.manufacturer_offset.to_be_bytes());
        put(block, 40, self.measuring_units_per_revolution.to_be_bytes());
        put(block, 44, self.total_measuring_range.to_be_bytes());
        put(block, 48, self.serial_number);
    }

    /// Octets 17-57 of a block that starts with octet 7.
    fn parse(block: &[u8]) -> Self {
        Self {
            additional_alarms: u8::from_be_bytes(get(block, 17)),
            supported_alarms: u16::from_be_bytes(get(block, 18)),
            warnings: Warnings::from_bits_retain(u16::from_be_bytes(get(block, 20))),
            supported_warnings: Warnings::from_bits_retain(u16::from_be_bytes(get(block, 22))),
            profile_version: get(block, 24),
            software_version: get(block, 26),
            operating_time: OperatingTime(u32::from_be_bytes(get(block, 28))),
            offset: i32::from_be_bytes(get(block, 32)),
            manufacturer_offset: i32::from_be_bytes(get(block, 36)),
            measuring_units_per_revolution: u32::from_be_bytes(get(block, 40)),
            total_measuring_range: u32::from_be_bytes(get(block, 44)),
            serial_number: get(block, 48),
        }
    }
}

/// Where the octet with the manual's number stands in the block: the only subtraction.
const fn index(number: u8) -> usize {
    number.saturating_sub(HEADER) as usize
}

/// Writes octets from the manual's number on.
fn put<const N: usize>(block: &mut [u8], number: u8, octets: [u8; N]) {
    for (place, octet) in block.iter_mut().skip(index(number)).zip(octets) {
        *place = octet;
    }
}

/// Octets from the manual's number on; what is missing is 0.
fn get<const N: usize>(block: &[u8], number: u8) -> [u8; N] {
    let mut octets = [0; N];
    for (octet, &sent) in octets.iter_mut().zip(block.iter().skip(index(number))) {
        *octet = sent;
    }
    octets
}

impl fmt::Display for Alarms {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        list(
            f,
            self.iter().map(|alarm| match alarm {
                Self::POSITION_ERROR => "position error",
                Self::SUPPLY_VOLTAGE => "supply voltage outside 9 to 30 V",
                Self::CURRENT_TOO_HIGH => "current too high",
                Self::COMMISSIONING => "commissioning diagnostics",
                _ => "memory error",
            }),
        )
    }
}

impl fmt::Display for Warnings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        list(
            f,
            self.iter().map(|warning| match warning {
                Self::FREQUENCY_EXCEEDED => "frequency exceeded",
                Self::TEMPERATURE_EXCEEDED => "temperature above 65 degrees C",
                Self::LIGHT_CONTROL_RESERVE => "light reserve used up",
                Self::CPU_WATCHDOG => "CPU watchdog",
                Self::OPERATING_TIME_LIMIT => "operating time above 87600 h",
                Self::BATTERY_CHARGE => "battery below its limit",
                _ => "reference point",
            }),
        )
    }
}

/// The names with commas between, "none" if there is none.
fn list(f: &mut fmt::Formatter<'_>, mut names: impl Iterator<Item = &'static str>) -> fmt::Result {
    f.write_str(names.next().unwrap_or("none"))?;
    names.try_for_each(|name| write!(f, ", {name}"))
}

#[cfg(test)]
mod tests;
