//! The figures that the device works with (manual 6), and which variant of it was ordered.
//!
//! The figures that are only read, never used, are in [`crate::data_sheet`].

use core::fmt;
use core::str::FromStr;

use profibus_dp::time::Duration;

/// Octets 24-25 of the diagnosis: Profile for Encoders 1.1, major then minor (manual 4.2.11).
pub const PROFILE_VERSION: [u8; 2] = [1, 1];

/// Reading: the software version is 1.1 (octets 26-27 of the diagnosis, manual 4.2.12).
pub const SOFTWARE_VERSION: [u8; 2] = [1, 1];

/// Octet 10 of the diagnosis: singleturn absolute rotary encoder with electronic turn count
/// (manual 4.2.4).
pub const ENCODER_TYPE: u8 = 2;

/// Reading: the maker's Ident_Number is not public; this one is a placeholder that belongs to
/// nobody here and is to be replaced by the number of the user's own GSD.
#[doc(alias = "Ident_Number")]
pub const PLACEHOLDER_IDENT: u16 = 0x108B;

/// Lowest supply voltage within range, in millivolts; below it the alarm is raised (manual 4.2.2).
pub const SUPPLY_MIN_MV: i32 = 9_000;

/// Highest supply voltage within range, in millivolts; above it the alarm is raised (manual 4.2.2).
pub const SUPPLY_MAX_MV: i32 = 30_000;

/// Reading: below so many millivolts, and with reversed poles, the device is simply off. The
/// figure is our own, simulated: the manual (3.2, 6) names none.
pub const SUPPLY_OFF_BELOW_MV: i32 = 6_000;

/// Reading: the temperature warning is set strictly above so many tenths of a degree Celsius, at
/// 65.0 it is not (manual 4.2.9).
pub const TEMPERATURE_LIMIT_TENTHS: i16 = 650;

/// Above so many tenths of an hour the operating time warning is set: 87600 h (manual 4.2.9).
pub const OPERATING_TIME_LIMIT_TENTHS: u32 = 876_000;

/// Reading: latches of the position are at power-on + i * 500 us; the manual has 2000 updates a
/// second (manual 6).
pub const LATCH_PERIOD: Duration = Duration::from_micros(500);

/// Highest continuous shaft speed in revolutions per minute (manual 6).
pub const SHAFT_SPEED_MAX_RPM: u32 = 3_000;

/// Which resolution was ordered: `n` singleturn and `m` multiturn bits (manual 4.1.2, 4.1.3, 6).
///
/// Written as `16x15`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Variant {
    singleturn_bits: u8,
    multiturn_bits: u8,
}

/// Why a resolution is none that this device exists in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VariantError {
    /// Not 2 to 16 singleturn bits.
    SingleturnBits(u8),
    /// Not 0 to 15 multiturn bits.
    MultiturnBits(u8),
    /// Not two numbers with an `x` between.
    Syntax,
}

impl Variant {
    /// All bits there are: 65536 steps per revolution, 32768 revolutions.
    pub const FULL: Self = Self { singleturn_bits: 16, multiturn_bits: 15 };

    /// Reading: singleturn bits that can be had. With fewer than 2 the direction cannot be told.
    pub const SINGLETURN_BITS: core::ops::RangeInclusive<u8> = 2..=16;

    /// Reading: multiturn bits that can be had. 15 are the manual's most (manual 6).
    pub const MULTITURN_BITS: core::ops::RangeInclusive<u8> = 0..=15;

    /// The variant with `n` singleturn bits (2 to 16) and `m` multiturn bits (0 to 15).
    ///
    /// # Errors
    ///
    /// Which of the two numbers is out of range.
    pub const fn new(n: u8, m: u8) -> Result<Self, VariantError> {
        if n < *Self::SINGLETURN_BITS.start() || n > *Self::SINGLETURN_BITS.end() {
            return Err(VariantError::SingleturnBits(n));
        }
        if m > *Self::MULTITURN_BITS.end() {
            return Err(VariantError::MultiturnBits(m));
        }
        Ok(Self { singleturn_bits: n, multiturn_bits: m })
    }

    /// `n`: bits of one revolution, 2 to 16.
    pub const fn singleturn_bits(self) -> u8 {
        self.singleturn_bits
    }

    /// `m`: bits of the turn count, 0 to 15.
    pub const fn multiturn_bits(self) -> u8 {
        self.multiturn_bits
    }

    /// 2^n: physical steps of one revolution, 4 to 65536 (octets 11-14 of the diagnosis).
    pub const fn steps_per_revolution(self) -> u32 {
        1_u32.wrapping_shl(self.singleturn_bits as u32)
    }

    /// 2^m: revolutions that can be told apart, 1 to 32768 (octets 15-16 of the diagnosis).
    pub const fn revolutions(self) -> u32 {
        1_u32.wrapping_shl(self.multiturn_bits as u32)
    }

    /// 2^(n+m): physical steps of the whole range, 4 to 2^31.
    pub const fn total(self) -> u32 {
        self.steps_per_revolution().wrapping_shl(self.multiturn_bits as u32)
    }
}

impl Default for Variant {
    fn default() -> Self {
        Self::FULL
    }
}

impl fmt::Display for Variant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.singleturn_bits, self.multiturn_bits)
    }
}

impl FromStr for Variant {
    type Err = VariantError;

    fn from_str(text: &str) -> Result<Self, VariantError> {
        let (n, m) = text.split_once(['x', 'X']).ok_or(VariantError::Syntax)?;
        let bits = |digits: &str| match digits.as_bytes() {
            [b'0'..=b'9', ..] => digits.parse::<u8>().map_err(|_| VariantError::Syntax),
            _ => Err(VariantError::Syntax),
        };
        Self::new(bits(n)?, bits(m)?)
    }
}

impl fmt::Display for VariantError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SingleturnBits(n) => {
                write!(f, "{n} singleturn bits, but there are variants with 2 to 16 only")
            }
            Self::MultiturnBits(m) => {
                write!(f, "{m} multiturn bits, but there are variants with 0 to 15 only")
            }
            Self::Syntax => f.write_str("the bits are written as two numbers, like 16x15"),
        }
    }
}

impl core::error::Error for VariantError {}

/// The serial number, octets 48-57 of the diagnosis: 6 or 7 digits, then spaces (manual 4.2.18).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct SerialNumber([u8; 10]);

/// A serial number is 6 or 7 decimal digits and nothing else.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SerialNumberError;

impl SerialNumber {
    /// The number of a virtual encoder that was given none: 1234567.
    pub const DEFAULT: Self = Self(*b"1234567   ");

    /// The ten octets as they are sent.
    pub const fn octets(&self) -> &[u8; 10] {
        &self.0
    }

    /// The number in ten octets as they were sent; `None` if they hold no such number.
    pub fn from_octets(octets: [u8; 10]) -> Option<Self> {
        let (digits, padding) = match octets.get(6) {
            Some(b' ') => octets.split_at_checked(6)?,
            _ => octets.split_at_checked(7)?,
        };
        let good = digits.iter().all(u8::is_ascii_digit) && padding.iter().all(|&o| o == b' ');
        good.then_some(Self(octets))
    }

    fn digits(&self) -> impl Iterator<Item = char> {
        self.0.iter().filter(|octet| octet.is_ascii_digit()).map(|&octet| char::from(octet))
    }
}

impl Default for SerialNumber {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl FromStr for SerialNumber {
    type Err = SerialNumberError;

    fn from_str(text: &str) -> Result<Self, SerialNumberError> {
        let digits = text.as_bytes();
        if !matches!(digits.len(), 6 | 7) || !digits.iter().all(u8::is_ascii_digit) {
            return Err(SerialNumberError);
        }
        let mut octets = [b' '; 10];
        for (octet, &digit) in octets.iter_mut().zip(digits) {
            *octet = digit;
        }
        Ok(Self(octets))
    }
}

impl fmt::Display for SerialNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.digits().try_for_each(|digit| fmt::Write::write_char(f, digit))
    }
}

impl fmt::Display for SerialNumberError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a serial number is 6 or 7 decimal digits (manual 4.2.18)")
    }
}

impl core::error::Error for SerialNumberError {}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;

    #[test]
    fn the_full_variant_is_the_one_of_the_manual() {
        let full: Variant = "16x15".parse().unwrap();
        assert_eq!(full, Variant::FULL);
        assert_eq!(full.steps_per_revolution(), 65_536);
        assert_eq!(full.revolutions(), 32_768);
        assert_eq!(full.total(), 0x8000_0000);
        assert_eq!(full.to_string(), "16x15");
    }

    #[test]
    fn variants_end_where_the_bits_end() {
        assert_eq!(Variant::new(2, 0).unwrap().total(), 4);
        assert_eq!(Variant::new(1, 0), Err(VariantError::SingleturnBits(1)));
        assert_eq!(Variant::new(17, 0), Err(VariantError::SingleturnBits(17)));
        assert_eq!(Variant::new(16, 16), Err(VariantError::MultiturnBits(16)));
        for text in ["", "16", "x", "16x", "x15", "+16x15", "16x-1", "16 x 15", "300x1", "16x15x"] {
            assert_eq!(text.parse::<Variant>(), Err(VariantError::Syntax), "{text}");
        }
    }

    #[test]
    fn a_serial_number_is_left_justified() {
        let seven: SerialNumber = "1234567".parse().unwrap();
        assert_eq!(seven.octets(), b"1234567   ");
        let six: SerialNumber = "123456".parse().unwrap();
        assert_eq!(six.octets(), b"123456    ");
        assert_eq!(six.to_string(), "123456");
        for number in [six, seven] {
            assert_eq!(SerialNumber::from_octets(*number.octets()), Some(number));
        }
    }

    #[test]
    fn other_serial_numbers_are_refused() {
        for text in ["", "12345", "12345678", "12345a", "１２"] {
            assert_eq!(text.parse::<SerialNumber>(), Err(SerialNumberError), "{text}");
        }
        for octets in [b"**********", b"12345     ", b"12345678  ", b"1234567  x"] {
            assert_eq!(SerialNumber::from_octets(*octets), None);
        }
    }
}
