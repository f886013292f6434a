//! What turns an encoder.

use std::fmt;
use std::str::FromStr;

use profibus_dp::time::Instant;
use sch108bex::specification::Variant;

/// Millionths of a revolution per minute: exact for every speed that a user writes.
type MicroRpm = i64;

/// Faster than any shaft, and far from any overflow.
const MAX_RPM: f64 = 1e6;

/// The movement of a shaft, as a function of time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shaft {
    /// The full physical position in counts at `since`.
    origin: i64,
    since: Instant,
    speed: MicroRpm,
}

/// Why text describes no shaft.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ShaftError {
    /// Neither of the two forms.
    #[error(
        "`{0}` is no shaft: write still@RAW or constant:RPM[@RAW], such as still@1000 or constant:-12.5@0"
    )]
    Form(String),
    /// RAW is no number of counts.
    #[error("`{0}` is no physical position: write a whole number of counts, such as 65536")]
    Raw(String),
    /// RAW is outside the physical range.
    #[error("{raw} is outside the physical range of this encoder: 0 to {max} counts with {variant} bits")]
    OutOfRange {
        /// What was asked for.
        raw: i64,
        /// The highest position there is.
        max: u32,
        /// The encoder's bits.
        variant: Variant,
    },
    /// RPM is no speed.
    #[error(
        "`{0}` is no speed: write revolutions per minute between -1000000 and 1000000, positive clockwise"
    )]
    Speed(String),
}

impl Shaft {
    /// A shaft that stands still at a physical position in counts.
    pub const fn still(raw: i64) -> Self {
        Self { origin: raw, since: Instant::ZERO, speed: 0 }
    }

    /// A shaft that turns at constant speed, positive clockwise, and is at `raw` at `since`.
    ///
    /// Speeds beyond a million revolutions per minute, and what is no number, are 0.
    #[expect(clippy::cast_possible_truncation, reason = "bounded before")]
    pub fn constant(rpm: f64, raw: i64, since: Instant) -> Self {
        let speed = if rpm.abs() <= MAX_RPM { (rpm * 1e6).round() as MicroRpm } else { 0 };
        Self { origin: raw, since, speed }
    }

    /// The full physical position in counts at `now`: turns included, no range applied.
    #[inline]
    pub fn at(&self, now: Instant, variant: Variant) -> i64 {
        if self.speed == 0 { self.origin } else { self.turned(now, variant) }
    }

    #[expect(clippy::cast_possible_truncation, reason = "a million RPM for 584 years fit in 64 bits")]
    fn turned(&self, now: Instant, variant: Variant) -> i64 {
        /// Nanoseconds in a minute, for millionths.
        const SCALE: i128 = 60_000_000_000 * 1_000_000;
        let nanos = i128::from(now.since(self.since).as_nanos());
        let steps = i128::from(variant.steps_per_revolution());
        let counts = (i128::from(self.speed) * nanos * steps).div_euclid(SCALE);
        self.origin.wrapping_add(counts as i64)
    }

    /// The same movement, with the clock started at `now`.
    #[must_use]
    pub const fn started(self, now: Instant) -> Self {
        Self { since: now, ..self }
    }

    /// The same movement, from another position.
    #[must_use]
    pub const fn from(self, raw: i64) -> Self {
        Self { origin: raw, ..self }
    }

    /// Refuses a position that the encoder has not.
    ///
    /// # Errors
    ///
    /// [`ShaftError::OutOfRange`].
    pub fn check(&self, variant: Variant) -> Result<(), ShaftError> {
        let max = variant.total() - 1;
        if (0..=i64::from(max)).contains(&self.origin) {
            Ok(())
        } else {
            Err(ShaftError::OutOfRange { raw: self.origin, max, variant })
        }
    }
}

impl FromStr for Shaft {
    type Err = ShaftError;

    /// `still@RAW` or `constant:RPM[@RAW]`.
    fn from_str(text: &str) -> Result<Self, ShaftError> {
        let (kind, raw) = text.split_once('@').map_or((text, None), |(kind, raw)| (kind, Some(raw)));
        let raw = match raw {
            Some(raw) => raw.parse::<i64>().map_err(|_| ShaftError::Raw(raw.to_owned()))?,
            None => 0,
        };
        if kind == "still" {
            return Ok(Self::still(raw));
        }
        let rpm = kind.strip_prefix("constant:").ok_or_else(|| ShaftError::Form(text.to_owned()))?;
        match rpm.parse::<f64>() {
            Ok(speed) if speed.abs() <= MAX_RPM => Ok(Self::constant(speed, raw, Instant::ZERO)),
            _ => Err(ShaftError::Speed(rpm.to_owned())),
        }
    }
}

impl fmt::Display for Shaft {
    #[expect(clippy::cast_precision_loss, reason = "for reading only")]
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.speed == 0 {
            write!(f, "still@{}", self.origin)
        } else {
            write!(f, "constant:{}@{}", self.speed as f64 / 1e6, self.origin)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shaft(text: &str) -> Result<Shaft, ShaftError> {
        text.parse()
    }

    #[test]
    fn a_still_shaft_stays_where_it_is() {
        let still = shaft("still@491520").expect("a shaft");
        assert_eq!(still.at(Instant::from_millis(0), Variant::FULL), 491_520);
        assert_eq!(still.at(Instant::from_millis(99_999), Variant::FULL), 491_520);
        assert_eq!(shaft("still").expect("a shaft").at(Instant::ZERO, Variant::FULL), 0);
    }

    // 3000 RPM are 50 turns a second: 3 276 800 counts with 16 bits.
    #[test]
    fn a_turning_shaft_turns_exactly() {
        let turning = shaft("constant:3000@100").expect("a shaft").started(Instant::from_millis(5));
        assert_eq!(turning.at(Instant::from_millis(5), Variant::FULL), 100);
        assert_eq!(turning.at(Instant::from_millis(1_005), Variant::FULL), 3_276_900);
        assert_eq!(turning.at(Instant::from_millis(15), Variant::FULL), 100 + 32_768);
        let back = shaft("constant:-60@0").expect("a shaft");
        assert_eq!(back.at(Instant::from_nanos(1), Variant::FULL), -1, "floor, not truncation");
        assert_eq!(back.at(Instant::from_millis(1_000), Variant::FULL), -65_536);
    }

    #[test]
    fn what_is_no_shaft_is_told() {
        assert!(matches!(shaft("moving"), Err(ShaftError::Form(_))));
        assert!(matches!(shaft("still@1x"), Err(ShaftError::Raw(_))));
        assert!(matches!(shaft("constant:fast"), Err(ShaftError::Speed(_))));
        assert!(matches!(shaft("constant:nan"), Err(ShaftError::Speed(_))));
        assert!(matches!(shaft("constant:1e300"), Err(ShaftError::Speed(_))));
        assert!(shaft("still@-1").expect("text is fine").check(Variant::FULL).is_err());
        assert!(Shaft::still(i64::from(u32::MAX >> 1)).check(Variant::FULL).is_ok());
        assert!(Shaft::still(1 << 31).check(Variant::FULL).is_err());
    }
}
