//! Making a shaft from its fields.

use std::sync::Arc;

use profibus_dp::time::Instant;

use super::fields::{Ratio, ShaftFields, ShaftKind};
use super::moving::{Moving, Overlay, Path, Plan, Vibration};
use super::pieces::{Limits, Pieces, rounded_up};
use super::walk::Walk;
use super::{Coupling, MAX_RPM, Shaft, ShaftError, playback};
use crate::machine::{Drum, Machine};

/// Longer than any test, and far from any overflow.
const MOST_SECONDS: f64 = 1e9;

/// Turns and units beyond this are a mistake.
const FAR: f64 = 1e9;

impl TryFrom<&ShaftFields> for Shaft {
    type Error = ShaftError;

    /// A shaft that begins at `raw`, or at 0.
    fn try_from(fields: &ShaftFields) -> Result<Self, ShaftError> {
        fields.check_names()?;
        let overlay = fields.overlay()?;
        let raw = fields.raw.unwrap_or(0);
        let is_plain = overlay == Overlay::default();
        match fields.kind {
            ShaftKind::Still if is_plain => return Ok(Self::still(raw)),
            ShaftKind::Constant if is_plain => {
                return Ok(Self::constant(fields.speed_of("rpm", fields.rpm)?, raw, Instant::ZERO));
            }
            ShaftKind::Coupled => {
                fields.coupling()?;
                return Err(ShaftError::Coupled);
            }
            _ => {}
        }
        let machine = fields.machine()?;
        let path = Arc::new(fields.path()?);
        let plan = Plan::new(path, machine, (1, 1), overlay, fields.text());
        Ok(Self { origin: raw, since: Instant::ZERO, speed: 0, moving: Some(Box::new(Moving::new(plan))) })
    }
}

impl ShaftFields {
    /// What drives a coupled shaft; `None` for another kind.
    ///
    /// # Errors
    ///
    /// What cannot be read.
    pub fn coupling(&self) -> Result<Option<Coupling>, ShaftError> {
        if self.kind != ShaftKind::Coupled {
            return Ok(None);
        }
        self.check_names()?;
        let to = self.to.clone().ok_or_else(|| self.kind.wrong("it needs to, the encoder that drives it"))?;
        if to.is_all() {
            return Err(self.kind.wrong("one encoder drives it, not all"));
        }
        let ratio = self.ratio()?;
        Ok(Some(Coupling { to, raw: self.raw, ratio, overlay: self.overlay()?, text: self.text() }))
    }

    fn ratio(&self) -> Result<(i64, i64), ShaftError> {
        /// Enough for any gear box, and far from any overflow.
        const MOST: i64 = 1_000_000_000;
        #[expect(clippy::cast_possible_truncation, reason = "saturates, and is refused then")]
        let ratio = match &self.ratio {
            None => Some((1, 1)),
            Some(Ratio::Number(number)) => Some(((number * 1e6).round() as i64, 1_000_000)),
            Some(Ratio::Fraction(text)) => text
                .split_once('/')
                .and_then(|(turns, of)| Some((turns.trim().parse().ok()?, of.trim().parse().ok()?))),
        };
        let fits = |(turns, of): &(i64, i64)| {
            *turns != 0 && turns.unsigned_abs() <= MOST.unsigned_abs() && (1..=MOST).contains(of)
        };
        ratio.filter(fits).ok_or_else(|| self.kind.wrong("ratio is a number like 2.5 or a fraction like 3/2"))
    }

    fn path(&self) -> Result<Path, ShaftError> {
        let at = Instant::ZERO;
        Ok(match self.kind {
            ShaftKind::Still | ShaftKind::Coupled => Path::Turning(0),
            ShaftKind::Constant => Path::Turning(Self::constant_speed(self.speed_of("rpm", self.rpm)?, at)),
            ShaftKind::Ramp => {
                let from = self.speed_of("from_rpm", self.from_rpm.or(Some(0.0)))? / 60.0;
                let to = self.speed_of("to_rpm", self.to_rpm)? / 60.0;
                Path::Pieces(Pieces::ramp(from, to, self.nanos("over_s", self.over_s)?))
            }
            ShaftKind::Sine => Path::Sine {
                amplitude: self.distance("amplitude", self.amplitude)?,
                period: self.nanos("period_s", self.period_s)?,
            },
            ShaftKind::Move => {
                let mut pieces = Pieces::new();
                pieces.pause(self.pause()?);
                pieces.move_by(self.distance("by", self.by)?, self.limits(self.speed)?);
                Path::Pieces(pieces)
            }
            ShaftKind::Hoist | ShaftKind::Trip => {
                let by = self.distance("by", self.by)?;
                let mut pieces = Pieces::new();
                pieces.move_by(by, self.limits(self.speed)?);
                pieces.pause(self.pause()?);
                pieces.move_by(-by, self.limits(self.back_speed.or(self.speed))?);
                pieces.pause(self.pause()?);
                Path::Pieces(pieces.repeated())
            }
            ShaftKind::Walk => Path::Walk(self.walk()?),
            ShaftKind::Playback => {
                let file = self.file.as_ref().ok_or_else(|| self.kind.wrong("it needs file"))?;
                let points = playback::read(file.as_ref())?;
                Path::Pieces(Pieces::through(&points, self.repeat.unwrap_or(false)))
            }
        })
    }

    fn constant_speed(rpm: f64, at: Instant) -> i64 {
        Shaft::constant(rpm, 0, at).speed
    }

    fn walk(&self) -> Result<Walk, ShaftError> {
        let rpm = self.positive("rpm", self.speed_of("rpm", self.rpm)?)?;
        let span = self.nanos("every_s", self.every_s)?;
        let walk = Walk::new(rpm, span, self.seed.unwrap_or(0), self.within);
        match self.within {
            Some(within) if !(within.is_finite() && within >= walk.step()) => {
                let step = walk.step();
                Err(self.kind.wrong(&format!("within is at least {step} turns, what rpm and every_s make")))
            }
            _ => Ok(walk),
        }
    }

    fn limits(&self, speed: Option<f64>) -> Result<Limits, ShaftError> {
        let jerk = match self.jerk {
            Some(jerk) => self.positive("jerk", jerk)?,
            None => f64::INFINITY,
        };
        Ok(Limits {
            speed: self.positive("speed", self.number("speed", speed)?)?,
            acceleration: self.positive("acceleration", self.number("acceleration", self.acceleration)?)?,
            jerk,
        })
    }

    fn pause(&self) -> Result<u64, ShaftError> {
        match self.pause_s {
            None | Some(0.0) => Ok(0),
            pause => self.nanos("pause_s", pause),
        }
    }

    /// The machine that the fields describe; `None`: units are turns.
    pub(super) fn machine(&self) -> Result<Option<Machine>, ShaftError> {
        let wrong = |what: String| self.kind.wrong(&what);
        let drum = match (self.drum_diameter, self.rope_diameter, self.turns_per_layer) {
            (Some(drum_diameter), Some(rope_diameter), Some(turns_per_layer)) => {
                let wound_turns = self.wound_turns.unwrap_or(0.0);
                let lines = self.lines.unwrap_or(1.0);
                Some(Drum { drum_diameter, rope_diameter, turns_per_layer, wound_turns, lines })
            }
            (None, None, None) if self.wound_turns.or(self.lines).is_none() => None,
            _ => {
                let what = "a drum has drum_diameter, rope_diameter and turns_per_layer";
                return Err(wrong(what.to_owned()));
            }
        };
        if self.kind == ShaftKind::Trip && drum.is_none() {
            return Err(wrong("it needs a drum".to_owned()));
        }
        if drum.is_none() && self.per_turn.is_none() {
            return match self.unit {
                Some(_) => Err(wrong("unit needs per_turn, the units for one turn, or a drum".to_owned())),
                None => Ok(None),
            };
        }
        let unit = self.unit.clone().unwrap_or_else(|| "m".to_owned());
        let machine = Machine { unit, zero: self.raw.unwrap_or(0), per_turn: self.per_turn, drum };
        machine.check().map_err(wrong)?;
        Ok(Some(machine))
    }

    fn overlay(&self) -> Result<Overlay, ShaftError> {
        let half_play = match self.backlash_deg {
            Some(degrees) => self.positive("backlash_deg", degrees)? / 720.0,
            None => 0.0,
        };
        let vibration = match (self.vibration_deg, self.vibration_hz) {
            (None, None) => None,
            (Some(degrees), Some(hertz)) => {
                let amplitude = self.positive("vibration_deg", degrees)? / 360.0;
                let hertz = self.positive("vibration_hz", hertz)?;
                if hertz > 1e5 {
                    return Err(self.kind.wrong("vibration_hz is at most 100000"));
                }
                Some(Vibration { amplitude, period: rounded_up(1.0 / hertz).max(1) })
            }
            _ => return Err(self.kind.wrong("vibration_deg and vibration_hz go together")),
        };
        Ok(Overlay { half_play, vibration })
    }

    fn number(&self, name: &str, value: Option<f64>) -> Result<f64, ShaftError> {
        let value = value.ok_or_else(|| self.kind.wrong(&format!("it needs {name}")))?;
        let fits = value.is_finite() && value.abs() <= FAR;
        fits.then_some(value).ok_or_else(|| self.kind.wrong(&format!("{name} is a number up to {FAR:e}")))
    }

    fn distance(&self, name: &str, value: Option<f64>) -> Result<f64, ShaftError> {
        let value = self.number(name, value)?;
        if value == 0.0 { Err(self.kind.wrong(&format!("{name} is not 0"))) } else { Ok(value) }
    }

    fn positive(&self, name: &str, value: f64) -> Result<f64, ShaftError> {
        let fits = (1e-9..=FAR).contains(&value);
        fits.then_some(value).ok_or_else(|| self.kind.wrong(&format!("{name} is a number above 0")))
    }

    fn speed_of(&self, name: &str, value: Option<f64>) -> Result<f64, ShaftError> {
        let rpm = value.ok_or_else(|| self.kind.wrong(&format!("it needs {name}")))?;
        if rpm.abs() <= MAX_RPM { Ok(rpm) } else { Err(ShaftError::Speed(rpm.to_string())) }
    }

    /// Seconds as nanoseconds, at least a microsecond.
    fn nanos(&self, name: &str, value: Option<f64>) -> Result<u64, ShaftError> {
        let seconds = self.number(name, value)?;
        if (1e-6..=MOST_SECONDS).contains(&seconds) {
            Ok(rounded_up(seconds))
        } else {
            Err(self.kind.wrong(&format!("{name} is a number of seconds from 0.000001 to {MOST_SECONDS:e}")))
        }
    }

    /// The text form, without the position.
    fn text(&self) -> String {
        let fields = serde_json::to_value(Self { raw: None, ..self.clone() }).unwrap_or_default();
        let mut text = self.kind.name();
        for (name, value) in fields.as_object().into_iter().flatten() {
            // A file's name goes to the end.
            if name != "kind" && name != "file" {
                let value = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
                text.extend([":", name, "=", &value]);
            }
        }
        if let Some(file) = &self.file {
            text.extend([":file=", file]);
        }
        text
    }
}
