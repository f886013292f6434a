//! What the end cap's voltages and switches mean.

use sch108bex::end_cap::{Termination, TerminationSwitches};
use sch108bex::health::Measurement;

use crate::turns;

/// A reading of 12 bits at full scale.
const FULL_SCALE: i32 = 4096;
/// The reference, in tenths of a millivolt.
const REFERENCE: i32 = 33_000;
/// 100 kOhm over 10 kOhm: the supply is divided by 11.
const SUPPLY_DIVIDER: i32 = 11;
/// The parts' sensors have 0.76 V at a temperature of their own, and 2.5 mV a degree.
const AT_THAT: i32 = 7_600;

/// What differs from part to part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    /// By so much it divides its battery before it measures it.
    pub battery_divider: i32,
    /// At so many tenths of a degree its sensor has 0.76 V.
    pub degrees: i32,
}

/// The STM32F405.
pub const STM32F405: Part = Part { battery_divider: 2, degrees: 250 };
/// The STM32G474.
pub const STM32G474: Part = Part { battery_divider: 3, degrees: 300 };

/// Three readings of 12 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Readings {
    /// The supply, divided.
    pub supply: u16,
    /// The part's own temperature sensor.
    pub temperature: u16,
    /// The battery, divided by the part.
    pub battery: u16,
    /// Which part it is.
    pub part: Part,
}

/// Tenths of a millivolt at the pin.
fn pin(reading: u16) -> i32 {
    i32::from(reading & 0xFFF).wrapping_mul(REFERENCE) / FULL_SCALE
}

impl Readings {
    /// The battery in millivolts.
    pub fn battery_mv(self) -> i32 {
        pin(self.battery).wrapping_mul(self.part.battery_divider) / 10
    }

    /// What they mean; `light_ok` is what the sensor says of its magnet or light.
    pub fn measurement(self, light_ok: bool) -> Measurement {
        // 25 tenths of a millivolt are a degree, 2.5 a tenth.
        let above = pin(self.temperature).wrapping_sub(AT_THAT).wrapping_mul(2) / 5;
        let tenths = above.wrapping_add(self.part.degrees);
        Measurement {
            supply_mv: pin(self.supply).wrapping_mul(SUPPLY_DIVIDER) / 10,
            temperature_tenths: i16::try_from(tenths).unwrap_or(i16::MAX),
            light_ok,
            battery: turns::battery(self.battery_mv()),
        }
    }
}

/// The switches of the termination resistors: two lines with pull-ups, bits 0 and 1.
pub const fn termination(lines: u8) -> TerminationSwitches {
    TerminationSwitches { first: lines & 1 == 0, second: lines & 2 == 0 }
}

/// Whether the lamp is lit: the supply is out of its range, or one resistor is on and one off,
/// which is wrong everywhere.
pub fn lamp(measurement: &Measurement, termination: TerminationSwitches) -> bool {
    !measurement.supply_in_range() || termination.termination() == Termination::Mismatch
}

/// The rotary switches: eight lines with pull-ups, a closed contact pulls its line low.
pub const fn switches(lines: u8) -> u8 {
    !lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use sch108bex::health::Battery;

    #[test]
    fn voltages_and_temperatures_are_those_of_the_dividers() {
        // 24 V: 2.1818 V at the pin, 2708 of 4096. 25 degrees: 0.76 V, 943. 3 V: 1.5 V, 1862.
        let readings = Readings { supply: 2708, temperature: 943, battery: 1862, part: STM32F405 };
        let measured = readings.measurement(true);
        assert!((23_950..=24_050).contains(&measured.supply_mv), "{measured:?}");
        assert!((245..=255).contains(&measured.temperature_tenths), "{measured:?}");
        assert_eq!(measured.battery, Battery::Ok);
        assert!(measured.light_ok);
        // 65 degrees: 0.86 V, 1067; 9 V: 0.818 V, 1015.
        let hot =
            Readings { supply: 1015, temperature: 1067, battery: 0, part: STM32F405 }.measurement(false);
        assert!((645..=655).contains(&hot.temperature_tenths), "{hot:?}");
        assert!((8_950..=9_050).contains(&hot.supply_mv), "{hot:?}");
        assert_eq!((hot.battery, hot.light_ok), (Battery::Empty, false));
    }

    #[test]
    fn the_other_part_divides_by_three_and_has_its_voltage_at_30_degrees() {
        // 3 V: 1 V, 1241. 30 degrees: 0.76 V, 943.
        let readings = Readings { supply: 0, temperature: 943, battery: 1241, part: STM32G474 };
        assert!((2_990..=3_010).contains(&readings.battery_mv()), "{}", readings.battery_mv());
        assert!((295..=305).contains(&readings.measurement(true).temperature_tenths));
    }

    #[test]
    fn the_lamp_tells_of_a_wrong_supply_or_termination() {
        let low = Measurement { supply_mv: 8_999, ..Measurement::GOOD };
        for (lines, wrong) in [(0b00, false), (0b11, false), (0b01, true), (0b10, true)] {
            assert_eq!(lamp(&Measurement::GOOD, termination(lines)), wrong, "{lines:02b}");
            assert!(lamp(&low, termination(lines)));
        }
        assert_eq!(termination(0b10), TerminationSwitches { first: true, second: false });
    }

    #[test]
    fn a_closed_contact_is_a_one() {
        assert_eq!(switches(0xFF), 0, "all open");
        assert_eq!(switches(!0x2A), 0x2A);
        assert_eq!(switches(0x00), 0xFF, "all closed");
    }
}
