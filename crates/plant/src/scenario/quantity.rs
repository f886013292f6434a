//! Numbers with units: times, lengths and angles.

use std::fmt;
use std::str::FromStr;

use profibus_dp::time::Duration;
use sch108bex::specification::Variant;

use crate::machine::Machine;

/// What a machine moves: metres or degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Travel {
    /// In metres or degrees.
    pub value: f64,
    /// Which.
    pub unit: Unit,
}

/// What a travel is measured in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// Metres.
    Metre,
    /// Degrees.
    Degree,
}

impl Unit {
    /// As units of a machine are called.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Metre => "m",
            Self::Degree => "deg",
        }
    }
}

/// What turns the position that a master reads into units of the machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Scale {
    machine: Machine,
    /// Metres or degrees in one of the machine's units.
    factor: f64,
    unit: Unit,
    /// Where the machine is at 0, in turns of an encoder without offset.
    zero: f64,
}

impl Scale {
    /// One revolution moves so much.
    pub(super) fn of_travel(travel: Travel) -> Self {
        let machine = Machine::linear("", travel.value);
        Self { machine, factor: 1.0, unit: travel.unit, zero: 0.0 }
    }

    /// Of a machine whose unit is one of ours.
    #[expect(clippy::cast_precision_loss, reason = "positions stay far below 2^53")]
    pub(super) fn of_machine(machine: &Machine, variant: Variant) -> Option<Self> {
        let Travel { value: factor, unit } = format!("1 {}", machine.unit).parse().ok()?;
        let zero = machine.zero as f64 / f64::from(variant.steps_per_revolution());
        Some(Self { machine: machine.clone(), factor, unit, zero })
    }

    /// Metres or degrees.
    pub(super) fn unit(&self) -> Unit {
        self.unit
    }

    /// A position in scaled steps as a travel, and that of the step after it. Positions follow each other in a
    /// ring of so many steps: of all that are this one it is the nearest to `due`.
    pub(super) fn travel(&self, steps: f64, per_revolution: f64, range: f64, due: Travel) -> [Travel; 2] {
        let ring = range / per_revolution;
        let turns = steps / per_revolution - self.zero;
        let rounds = ((self.machine.turns(due.value / self.factor) - turns) / ring).round();
        let turns = turns + rounds * ring;
        let travel = |turns| Travel { value: self.machine.units(turns) * self.factor, unit: self.unit };
        [travel(turns), travel(turns + 1.0 / per_revolution)]
    }
}

/// Why a text is no [`Travel`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "a length or an angle is a number and a unit: um, mm, cm, m, km, in, ft, deg or rev, like \"3.20 m\""
)]
pub struct NoTravel;

const LENGTHS: [(&str, f64); 7] =
    [("um", 1e-6), ("mm", 1e-3), ("cm", 1e-2), ("m", 1.0), ("km", 1e3), ("in", 0.0254), ("ft", 0.3048)];
const ANGLES: [(&str, f64); 2] = [("deg", 1.0), ("rev", 360.0)];
/// Nanoseconds.
const TIMES: [(&str, f64); 6] =
    [("us", 1e3), ("ms", 1e6), ("s", 1e9), ("min", 60e9), ("h", 3_600e9), ("d", 86_400e9)];

/// The number and the unit of a text.
fn split(text: &str) -> Option<(f64, &str)> {
    let text = text.trim();
    let end = text.rfind(|character: char| character.is_ascii_digit() || character == '.')? + 1;
    let (number, unit) = text.split_at_checked(end)?;
    let number: f64 = number.trim_start_matches('+').parse().ok()?;
    number.is_finite().then(|| (number, unit.trim()))
}

fn in_unit(unit: &str, units: &[(&str, f64)]) -> Option<f64> {
    units.iter().find(|(name, _)| *name == unit).map(|(_, factor)| *factor)
}

/// A time with its unit; a bare number is seconds.
pub(super) fn time(text: &str) -> Option<Duration> {
    let (number, unit) = split(text)?;
    let factor = if unit.is_empty() { 1e9 } else { in_unit(unit, &TIMES)? };
    nanos(number * factor)
}

/// A time in seconds.
pub(super) fn seconds(seconds: f64) -> Option<Duration> {
    nanos(seconds * 1e9)
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded before")]
fn nanos(nanos: f64) -> Option<Duration> {
    /// About a hundred years.
    const MOST: f64 = 3.2e18;
    (0.0..=MOST).contains(&nanos).then(|| Duration::from_nanos(nanos.round() as u64))
}

/// A time as people write it.
#[expect(clippy::cast_precision_loss, reason = "for reading only")]
pub fn show_time(time: Duration) -> String {
    let nanos = time.as_nanos() as f64;
    let fitting = TIMES.iter().rev().find(|(_, factor)| nanos >= *factor && *factor <= 3_600e9);
    let (unit, factor) = match fitting {
        Some(("h", _)) if nanos % 3_600e9 != 0.0 => ("s", 1e9),
        Some(("min", _)) if nanos % 60e9 != 0.0 => ("s", 1e9),
        Some((unit, factor)) => (*unit, *factor),
        None if nanos == 0.0 => ("s", 1e9),
        None => ("us", 1e3),
    };
    format!("{} {unit}", nanos / factor)
}

impl FromStr for Travel {
    type Err = NoTravel;

    fn from_str(text: &str) -> Result<Self, NoTravel> {
        let (number, unit) = split(text).ok_or(NoTravel)?;
        let length = in_unit(unit, &LENGTHS).map(|factor| Self { value: number * factor, unit: Unit::Metre });
        let angle =
            || in_unit(unit, &ANGLES).map(|factor| Self { value: number * factor, unit: Unit::Degree });
        let found = length.or_else(angle).ok_or(NoTravel)?;
        if found.value.abs() <= 1e12 { Ok(found) } else { Err(NoTravel) }
    }
}

impl fmt::Display for Travel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // To a hundredth of a millimetre or of a degree, without zeros that say nothing.
        let (unit, places) = match self.unit {
            Unit::Metre => ("m", 5),
            Unit::Degree => ("deg", 2),
        };
        let text = format!("{:.places$}", self.value);
        let text = text.trim_end_matches('0').trim_end_matches('.');
        write!(f, "{} {unit}", if text == "-0" { "0" } else { text })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_units_or_are_seconds() {
        for (text, nanos) in [
            ("12 s", 12_000_000_000),
            ("250ms", 250_000_000),
            ("1.5", 1_500_000_000),
            ("10 us", 10_000),
            ("2 min", 120_000_000_000),
            ("1 h", 3_600_000_000_000),
            ("2 d", 172_800_000_000_000),
        ] {
            assert_eq!(time(text), Some(Duration::from_nanos(nanos)), "{text}");
        }
        for text in ["", "s", "1 week", "-1 s", "nan", "1e400 s", "1 s s", "\u{e4}1", "1\u{e4}"] {
            assert_eq!(time(text), None, "{text}");
        }
    }

    #[test]
    fn travels_are_metres_or_degrees() {
        let travel = |text: &str| text.parse::<Travel>();
        assert_eq!(travel("3.20 m"), Ok(Travel { value: 3.2, unit: Unit::Metre }));
        assert_eq!(travel("-2 mm").map(|found| found.value), Ok(-0.002));
        assert_eq!(travel("0.5 rev"), Ok(Travel { value: 180.0, unit: Unit::Degree }));
        for text in ["3.20", "m", "3 parsec", "", "1e300 km"] {
            assert_eq!(travel(text), Err(NoTravel), "{text}");
        }
        assert_eq!(travel("3.20 m").map(|found| found.to_string()), Ok("3.2 m".to_owned()));
        assert_eq!(travel("0 deg").map(|found| found.to_string()), Ok("0 deg".to_owned()));
    }

    #[test]
    fn times_are_shown_as_they_are_written() {
        for (nanos, text) in [
            (0, "0 s"),
            (1_500_000_000, "1.5 s"),
            (3_600_000_000_000, "1 h"),
            (90_000_000_000, "90 s"),
            (20_000, "20 us"),
        ] {
            assert_eq!(show_time(Duration::from_nanos(nanos)), text);
        }
    }
}
