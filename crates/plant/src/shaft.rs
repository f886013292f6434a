//! What turns an encoder.
//!
//! A shaft is a pure function of time: at any instant it has one position, whoever asked before. A
//! shaft that stands still or turns at constant speed is worked out in whole numbers alone; for the
//! others see [`ShaftFields`], and `moving.rs` for what makes them the same on every computer.

mod build;
mod fields;
mod moving;
mod pieces;
mod playback;
mod walk;

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use profibus_dp::time::Instant;
use sch108bex::specification::Variant;

pub use fields::{Ratio, ShaftFields, ShaftKind};

use crate::control::Which;
use crate::machine::Machine;
use moving::{Moving, Overlay, Path, Plan};

/// Millionths of a revolution per minute: exact for every speed that a user writes.
type MicroRpm = i64;

/// Faster than any shaft, and far from any overflow.
const MAX_RPM: f64 = 1e6;

/// The movement of a shaft, as a function of time.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shaft {
    /// The full physical position in counts at `since`.
    origin: i64,
    since: Instant,
    speed: MicroRpm,
    /// What is no constant speed.
    moving: Option<Box<Moving>>,
}

/// What drives a shaft through a gear.
#[derive(Debug, Clone, PartialEq)]
pub struct Coupling {
    /// The encoder whose shaft drives it.
    pub to: Which,
    /// Where the driven shaft begins, in physical counts; `None`: where it is.
    pub raw: Option<i64>,
    ratio: (i64, i64),
    overlay: Overlay,
    text: String,
}

/// Why text describes no shaft.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ShaftError {
    /// None of the forms.
    #[error(
        "`{0}` is no shaft: write still@RAW or constant:RPM[@RAW], such as still@1000 or constant:-12.5@0, or \
         KIND:NAME=VALUE with ramp, sine, move, hoist, trip, walk, playback or coupled, such as ramp:to_rpm=60:over_s=10"
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
    /// A field is missing, too many or no value.
    #[error("shaft {kind}: {what}; write for example {example}")]
    Field {
        /// The kind of movement.
        kind: String,
        /// What is wrong.
        what: String,
        /// A shaft of this kind.
        example: &'static str,
    },
    /// A file of points is none.
    #[error("shaft playback: {file}: {what}")]
    File {
        /// The file.
        file: String,
        /// What is wrong, with the line.
        what: String,
    },
    /// A coupled shaft where there is no other.
    #[error(
        "a coupled shaft needs an encoder that runs: start with still@RAW, and couple it over the control socket"
    )]
    Coupled,
}

impl Shaft {
    /// A shaft that stands still at a physical position in counts.
    pub const fn still(raw: i64) -> Self {
        Self { origin: raw, since: Instant::ZERO, speed: 0, moving: None }
    }

    /// A shaft that turns at constant speed, positive clockwise, and is at `raw` at `since`.
    ///
    /// Speeds beyond a million revolutions per minute, and what is no number, are 0.
    #[expect(clippy::cast_possible_truncation, reason = "bounded before")]
    pub fn constant(rpm: f64, raw: i64, since: Instant) -> Self {
        let speed = if rpm.abs() <= MAX_RPM { (rpm * 1e6).round() as MicroRpm } else { 0 };
        Self { origin: raw, since, speed, moving: None }
    }

    /// The full physical position in counts at `now`: turns included, no range applied.
    ///
    /// It remembers where it was asked, so that going on from there is quick; it says the same however
    /// it is asked.
    #[inline]
    pub fn at(&mut self, now: Instant, variant: Variant) -> i64 {
        if self.speed == 0 && self.moving.is_none() { self.origin } else { self.turned(now, variant) }
    }

    #[expect(clippy::cast_possible_truncation, reason = "a million RPM for 584 years fit in 64 bits")]
    fn turned(&mut self, now: Instant, variant: Variant) -> i64 {
        /// Nanoseconds in a minute, for millionths.
        const SCALE: i128 = 60_000_000_000 * 1_000_000;
        let nanos = now.since(self.since).as_nanos();
        if let Some(moving) = &mut self.moving {
            return self.origin.wrapping_add(moving.counts(nanos, variant.steps_per_revolution()));
        }
        let steps = i128::from(variant.steps_per_revolution());
        let counts = (i128::from(self.speed) * i128::from(nanos) * steps).div_euclid(SCALE);
        self.origin.wrapping_add(counts as i64)
    }

    /// The speed at `now` in revolutions per minute, positive clockwise.
    #[expect(clippy::cast_precision_loss, reason = "no speed has so many digits")]
    pub fn rpm(&mut self, now: Instant) -> f64 {
        match &mut self.moving {
            Some(moving) => moving.after(now.since(self.since).as_nanos()).1 * 60.0,
            None => self.speed as f64 / 1e6,
        }
    }

    /// Whether the speed can be above so many revolutions per minute at any time.
    #[inline]
    pub(crate) fn may_exceed(&self, rpm: u32) -> bool {
        match &self.moving {
            Some(moving) => moving.most_rpm() > f64::from(rpm),
            None => self.speed.unsigned_abs() > u64::from(rpm) * 1_000_000,
        }
    }

    /// The machine that the shaft's own fields describe.
    pub fn machine(&self) -> Option<&Machine> {
        self.moving.as_ref()?.plan.machine.as_ref()
    }

    /// When the movement began.
    pub(crate) fn since(&self) -> Instant {
        self.since
    }

    /// The same movement, so that it is at `raw` at `now`.
    pub(crate) fn at_once(&mut self, now: Instant, raw: i64, variant: Variant) {
        let turned = self.at(now, variant).wrapping_sub(self.origin);
        self.origin = raw.wrapping_sub(turned);
    }

    /// The same movement, with the clock started at `now`.
    #[must_use]
    pub fn started(self, now: Instant) -> Self {
        Self { since: now, ..self }
    }

    /// The same movement, from another position.
    #[must_use]
    pub fn from(self, raw: i64) -> Self {
        Self { origin: raw, ..self }
    }

    /// What this shaft drives through a gear, which is at `here` at `now`.
    pub(crate) fn geared(&self, coupling: &Coupling, now: Instant, here: i64, variant: Variant) -> Self {
        let (path, machine, (turns, of)) = match &self.moving {
            Some(moving) => (Arc::clone(&moving.plan.path), moving.plan.machine.clone(), moving.plan.gear),
            None => (Arc::new(Path::Turning(self.speed)), None, (1, 1)),
        };
        let gear = reduced(turns, of, coupling.ratio);
        let plan = Plan::new(path, machine, gear, coupling.overlay, coupling.text.clone());
        let moving = Some(Box::new(Moving::new(plan)));
        let mut geared = Self { origin: 0, since: self.since, speed: 0, moving };
        geared.at_once(now, here, variant);
        geared
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

/// A gear behind a gear.
fn reduced(turns: i64, of: i64, ratio: (i64, i64)) -> (i64, i64) {
    let (mut turns, mut of) = (i128::from(turns) * i128::from(ratio.0), i128::from(of) * i128::from(ratio.1));
    let (mut a, mut b) = (turns.abs(), of);
    while b != 0 {
        (a, b) = (b, a % b);
    }
    (turns, of) = (turns / a.max(1), of / a.max(1));
    // Chains of gears that no fraction of 64 bits holds lose their last digits.
    while turns.abs() > i128::from(i64::MAX) || of > i128::from(i64::MAX) {
        (turns, of) = (turns / 2, (of / 2).max(1));
    }
    (i64::try_from(turns).unwrap_or(1), i64::try_from(of).unwrap_or(1))
}

impl FromStr for Shaft {
    type Err = ShaftError;

    /// `KIND[:NAME=VALUE...][@RAW]`; `constant` takes its speed without the name.
    fn from_str(text: &str) -> Result<Self, ShaftError> {
        Self::try_from(&ShaftFields::parse(text)?)
    }
}

impl fmt::Display for Shaft {
    #[expect(clippy::cast_precision_loss, reason = "for reading only")]
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.moving {
            Some(moving) => write!(f, "{}@{}", moving.plan.text, self.origin),
            None if self.speed == 0 => write!(f, "still@{}", self.origin),
            None => write!(f, "constant:{}@{}", self.speed as f64 / 1e6, self.origin),
        }
    }
}

#[cfg(test)]
mod tests;
