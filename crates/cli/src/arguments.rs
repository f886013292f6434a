//! Values on the command line, each with an error that says what to write instead.

use std::fmt;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::str::FromStr;

use clap::ValueEnum;
use clap::builder::{OsStringValueParser, TypedValueParser};
use plant::control::ControlAddress;
use profibus_dp::time::Baudrate;
use sch108bex::end_cap::TerminationSwitches;
use sch108bex::health::Battery;

/// `auto` or one of the ten rates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Baud {
    /// The master's.
    Auto,
    /// This one only.
    Fixed(Baudrate),
}

impl FromStr for Baud {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        let rate = text.parse().ok().and_then(Baudrate::from_bits_per_second);
        rate.map(Self::Fixed).ok_or_else(|| {
            let rates: Vec<_> = Baudrate::ALL.iter().map(|rate| rate.bits_per_second().to_string()).collect();
            format!("PROFIBUS has these rates: {}; or write auto", rates.join(", "))
        })
    }
}

/// A whole number in decimal digits within `range`, as a parser for `clap`.
pub(crate) fn whole<T: TryFrom<u64>>(
    range: RangeInclusive<u64>,
) -> impl Fn(&str) -> Result<T, String> + Clone {
    move |text| {
        let number = text.parse().ok().filter(|number| range.contains(number));
        number
            .and_then(|number| T::try_from(number).ok())
            .ok_or_else(|| format!("write a whole number from {} to {}", range.start(), range.end()))
    }
}

/// Where requests are taken: a path, or a TCP port of this computer.
pub(crate) fn control_address() -> impl TypedValueParser<Value = ControlAddress> {
    OsStringValueParser::new().try_map(ControlAddress::try_from)
}

/// Any number, in decimal digits.
pub(crate) fn decimal(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|number: &f64| number.is_finite())
        .ok_or_else(|| "write a number like 8.5".to_owned())
}

/// An ident number as 0xHHHH.
pub(crate) fn ident_number(text: &str) -> Result<u16, String> {
    let digits = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"));
    digits
        .filter(|digits| {
            (1..=4).contains(&digits.len()) && digits.bytes().all(|digit| digit.is_ascii_hexdigit())
        })
        .and_then(|digits| u16::from_str_radix(digits, 16).ok())
        .ok_or_else(|| {
            "an ident number is written with up to four hexadecimal digits, like 0x108B".to_owned()
        })
}

/// Volts, kept in millivolts.
pub(crate) fn supply_mv(text: &str) -> Result<i32, String> {
    scaled(text, 1_000.0, 100.0).ok_or_else(|| "write volts between -100 and 100, like 24 or 8.9".to_owned())
}

/// Degrees Celsius, kept in tenths.
pub(crate) fn temperature_tenths(text: &str) -> Result<i16, String> {
    scaled(text, 10.0, 300.0)
        .and_then(|tenths| i16::try_from(tenths).ok())
        .ok_or_else(|| "write degrees Celsius between -300 and 300, like 20 or 65.1".to_owned())
}

#[expect(clippy::cast_possible_truncation, reason = "bounded before")]
fn scaled(text: &str, by: f64, limit: f64) -> Option<i32> {
    let value: f64 = text.parse().ok()?;
    (value.abs() <= limit).then(|| (value * by).round() as i32)
}

/// The light of the LED.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Light {
    /// Within its limits
    Ok,
    /// Its reserve is used up: a warning
    Low,
}

/// The battery that keeps the turn count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum BatteryState {
    /// Above its limit
    Ok,
    /// Below its limit: a warning
    Low,
    /// Keeps nothing: the turn count is lost with the power
    Empty,
}

impl From<BatteryState> for Battery {
    fn from(state: BatteryState) -> Self {
        match state {
            BatteryState::Ok => Self::Ok,
            BatteryState::Low => Self::Low,
            BatteryState::Empty => Self::Empty,
        }
    }
}

/// The two termination switches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum TerminationState {
    /// As it has to be: on at the last encoder, off at the others
    Auto,
    /// Both on
    On,
    /// Both off
    Off,
    /// One on, one off: always wrong
    One,
}

impl TerminationState {
    /// The switches of an encoder; `last`: it is the far end of the cable.
    pub(crate) fn switches(self, last: bool) -> TerminationSwitches {
        let (first, second) = match self {
            Self::Auto => (last, last),
            Self::On => (true, true),
            Self::Off => (false, false),
            Self::One => (true, false),
        };
        TerminationSwitches { first, second }
    }
}

impl FromStr for TerminationState {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        ValueEnum::from_str(text, false).map_err(|_| "write auto, on, off or one".to_owned())
    }
}

/// What distinguishes a further encoder: KEY=VALUE pairs with commas between.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Further {
    pub(crate) pairs: Vec<(Key, String)>,
}

/// What a further encoder may have of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Key {
    Switches,
    Bits,
    Serial,
    State,
    Shaft,
    Termination,
}

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Switches => "switches",
            Self::Bits => "bits",
            Self::Serial => "serial",
            Self::State => "state",
            Self::Shaft => "shaft",
            Self::Termination => "termination",
        })
    }
}

impl FromStr for Further {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let pairs = text.split(',').map(|pair| {
            let (key, value) = pair.split_once('=')?;
            Some((<Key as ValueEnum>::from_str(key, false).ok()?, value.to_owned()))
        });
        let pairs = pairs.collect::<Option<Vec<_>>>().ok_or_else(|| {
            "write KEY=VALUE pairs with commas between; keys are switches, bits, serial, state, shaft, termination, \
             like switches=2B,shaft=still@1000"
                .to_owned()
        })?;
        let twice =
            |(at, (key, _)): &(usize, &(Key, _))| pairs.iter().take(*at).any(|(other, _)| other == key);
        match pairs.iter().enumerate().find(twice) {
            Some((_, (key, _))) => {
                Err(format!("{key} is there twice; write it once, and --encoder again for one more encoder"))
            }
            None => Ok(Self { pairs }),
        }
    }
}

impl Further {
    /// The value of a key.
    pub(crate) fn get(&self, key: Key) -> Option<&str> {
        self.pairs.iter().find(|(other, _)| *other == key).map(|(_, value)| value.as_str())
    }

    /// The value of `key` as a type with an error that explains itself.
    pub(crate) fn parsed<T: FromStr<Err: fmt::Display>>(&self, key: Key) -> Result<Option<T>, String> {
        self.get(key)
            .map(|value| value.parse().map_err(|error| format!("--encoder: {key}={value}: {error}")))
            .transpose()
    }

    /// A path.
    pub(crate) fn path(&self, key: Key) -> Option<PathBuf> {
        self.get(key).map(PathBuf::from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ident_numbers_are_hexadecimal_with_0x() {
        assert_eq!(ident_number("0x108B"), Ok(0x108B));
        assert_eq!(ident_number("0xf"), Ok(15));
        for text in ["108B", "0x", "0x10000", "0xZZ", "", "-1", "0x+1"] {
            assert!(ident_number(text).is_err(), "{text}");
        }
    }

    #[test]
    fn whole_numbers_have_both_their_bounds() {
        let address = whole::<u8>(1..=126);
        assert_eq!((address("1"), address("126")), (Ok(1), Ok(126)));
        for text in ["0", "127", "300", "-1", "1.5", "0x10", "", " 1", "99999999999999999999999"] {
            assert_eq!(address(text), Err("write a whole number from 1 to 126".to_owned()), "{text}");
        }
        for text in ["nan", "inf", "", "abc", "1e999"] {
            assert!(decimal(text).is_err(), "{text}");
        }
    }

    #[test]
    fn volts_and_degrees_are_kept_exactly() {
        assert_eq!(supply_mv("24"), Ok(24_000));
        assert_eq!(supply_mv("8.999"), Ok(8_999));
        assert_eq!(supply_mv("-24"), Ok(-24_000));
        assert_eq!(temperature_tenths("65.1"), Ok(651));
        for text in ["x", "nan", "inf", "1e9", ""] {
            assert!(supply_mv(text).is_err() && temperature_tenths(text).is_err(), "{text}");
        }
    }

    #[test]
    fn further_encoders_are_pairs() {
        let further: Further = "switches=2B,shaft=still@1000".parse().expect("pairs");
        assert_eq!(further.get(Key::Switches), Some("2B"));
        assert_eq!(further.get(Key::Bits), None);
        assert!("switches".parse::<Further>().is_err());
        assert!("colour=red".parse::<Further>().is_err());
        let twice = "switches=06,bits=12x12,switches=07".parse::<Further>().expect_err("which of the two?");
        assert!(twice.starts_with("switches is there twice"), "{twice}");
        let bad: Further = "bits=99x1".parse().expect("pairs");
        let error = bad.parsed::<sch108bex::specification::Variant>(Key::Bits).expect_err("too many bits");
        assert!(error.contains("bits=99x1"), "{error}");
    }

    #[test]
    fn baud_is_auto_or_one_of_the_ten() {
        assert_eq!("auto".parse(), Ok(Baud::Auto));
        assert_eq!("93750".parse(), Ok(Baud::Fixed(Baudrate::B93750)));
        assert!("115200".parse::<Baud>().expect_err("no PROFIBUS rate").contains("93750"));
    }
}
