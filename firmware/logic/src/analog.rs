//! What the end cap's voltages and switches mean.

use sch108bex::health::Measurement;

use crate::turns;

/// A reading of 12 bits at full scale.
const FULL_SCALE: i32 = 4096;
/// The reference, in tenths of a millivolt.
const REFERENCE: i32 = 33_000;
/// 100 kOhm over 10 kOhm: the supply is divided by 11.
const SUPPLY_DIVIDER: i32 = 11;
/// The part halves its battery before it measures it.
const BATTERY_DIVIDER: i32 = 2;
/// The part's sensor: 0.76 V at 25.0 degrees, 2.5 mV a degree.
const AT_25_DEGREES: i32 = 7_600;

/// Three readings of 12 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Readings {
    /// The supply, divided.
    pub supply: u16,
    /// The part's own temperature sensor.
    pub temperature: u16,
    /// The battery, halved.
    pub battery: u16,
}

/// Tenths of a millivolt at the pin.
fn pin(reading: u16) -> i32 {
    i32::from(reading & 0xFFF).wrapping_mul(REFERENCE) / FULL_SCALE
}

impl Readings {
    /// The battery in millivolts.
    pub fn battery_mv(self) -> i32 {
        pin(self.battery).wrapping_mul(BATTERY_DIVIDER) / 10
    }

    /// What they mean; `light_ok` is what the sensor says of its magnet or light.
    pub fn measurement(self, light_ok: bool) -> Measurement {
        // 25 tenths of a millivolt are a degree, 2.5 a tenth.
        let tenths =
            (pin(self.temperature).wrapping_sub(AT_25_DEGREES).wrapping_mul(2) / 5).wrapping_add(250);
        Measurement {
            supply_mv: pin(self.supply).wrapping_mul(SUPPLY_DIVIDER) / 10,
            temperature_tenths: i16::try_from(tenths).unwrap_or(i16::MAX),
            light_ok,
            battery: turns::battery(self.battery_mv()),
        }
    }
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
        let readings = Readings { supply: 2708, temperature: 943, battery: 1862 };
        let measured = readings.measurement(true);
        assert!((23_950..=24_050).contains(&measured.supply_mv), "{measured:?}");
        assert!((245..=255).contains(&measured.temperature_tenths), "{measured:?}");
        assert_eq!(measured.battery, Battery::Ok);
        assert!(measured.light_ok);
        // 65 degrees: 0.86 V, 1067; 9 V: 0.818 V, 1015.
        let hot = Readings { supply: 1015, temperature: 1067, battery: 0 }.measurement(false);
        assert!((645..=655).contains(&hot.temperature_tenths), "{hot:?}");
        assert!((8_950..=9_050).contains(&hot.supply_mv), "{hot:?}");
        assert_eq!((hot.battery, hot.light_ok), (Battery::Empty, false));
    }

    #[test]
    fn a_closed_contact_is_a_one() {
        assert_eq!(switches(0xFF), 0, "all open");
        assert_eq!(switches(!0x2A), 0x2A);
        assert_eq!(switches(0x00), 0xFF, "all closed");
    }
}
