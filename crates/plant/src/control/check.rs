//! Values that are none, told before anything is done.

use bus::faults::MOST_WAITING;
use bus::{Noise, NoiseError};
use profibus_dp::time::Duration;
use sch108bex::end_cap::RotarySwitches;

use crate::control::commands::advice;
use crate::control::request::Request;
use crate::encoder::PresetError;
use crate::plant::PlantError;
use crate::shaft::ShaftError;
use crate::store::StoreError;

/// Why a request was not done.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// There is no such encoder or segment.
    #[error("there is no {what} {asked}; there are {there}, numbered from 1")]
    Nobody {
        /// Encoder or segment.
        what: &'static str,
        /// Who was asked for.
        asked: String,
        /// Who is there.
        there: String,
    },
    /// There are several.
    #[error("there are several: add \"{what}\" with one of {there}, a number from 1, or \"all\"")]
    Several {
        /// Encoder or segment.
        what: &'static str,
        /// Who is there.
        there: String,
    },
    /// A value is none.
    #[error("{0}")]
    Value(String),
    /// The shaft is none, or none for this encoder.
    #[error(transparent)]
    Shaft(#[from] ShaftError),
    /// The noise is none.
    #[error(transparent)]
    Noise(#[from] NoiseError),
    /// The memory cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The operating time cannot be set.
    #[error(transparent)]
    Preset(#[from] PresetError),
    /// The plant does not run any more.
    #[error(transparent)]
    Plant(#[from] PlantError),
    /// A connection or a program can do it, a plant cannot.
    #[error("{0} is for the connection or the program, not for the plant")]
    NotOfThePlant(String),
}

impl Request {
    /// Refuses values that are none, as far as that can be told without the plant.
    ///
    /// # Errors
    ///
    /// What is wrong, and what to write instead.
    pub fn check(&self) -> Result<(), ControlError> {
        self.check_values().map_err(|error| match error {
            ControlError::Value(text) => ControlError::Value(advice(&self.name(), &text)),
            other => other,
        })
    }

    fn check_values(&self) -> Result<(), ControlError> {
        match self {
            Self::Shaft { shaft, .. } if shaft.coupling()?.is_some() => Ok(()),
            Self::Shaft { shaft, .. } => Ok(shaft.resolve().map(drop)?),
            Self::Supply { volts, .. } => within("volts", *volts, -100.0..=100.0),
            Self::Temperature { celsius, .. } => within("celsius", *celsius, -300.0..=300.0),
            Self::OperatingTime { hours, .. } => within("hours", *hours, 0.0..=1e7),
            Self::Switches { switches, .. } => parsed_switches(switches).map(drop),
            Self::Line { .. } => Ok(self.noise().check()?),
            Self::LoseRequests { count, .. }
            | Self::LoseReplies { count, .. }
            | Self::DoubleRequests { count, .. }
            | Self::DoubleReplies { count, .. } => counted(*count),
            Self::DelayReplies { count, by_us, .. } => {
                Noise { late_by: Duration::from_micros(*by_us), ..Noise::default() }.check()?;
                counted(*count)
            }
            Self::DamageRequest { octet, mask, .. } | Self::DamageReply { octet, mask, .. } => {
                numbered(*octet)?;
                parsed_mask(mask).map(drop)
            }
            Self::CharacterError { octet, .. } => numbered(*octet).map(drop),
            _ => self.check_surroundings(),
        }
    }

    /// The noise that a `line` asks for.
    pub(super) fn noise(&self) -> Noise {
        match *self {
            Self::Line {
                seed,
                bit_errors,
                character_errors,
                lost_requests,
                lost_replies,
                doubled_requests,
                doubled_replies,
                late_replies,
                late_by_us,
                bursts,
                burst_length,
                burst_bit_errors,
                ..
            } => Noise {
                seed,
                bit_errors,
                character_errors,
                lost_requests,
                lost_replies,
                doubled_requests,
                doubled_replies,
                late_replies,
                late_by: Duration::from_micros(late_by_us),
                bursts,
                // Alone they make no noise.
                burst_length: if bursts > 0.0 { burst_length } else { 0.0 },
                burst_bit_errors: if bursts > 0.0 { burst_bit_errors } else { 0.0 },
            },
            _ => Noise::default(),
        }
    }
}

fn within(name: &str, value: f64, range: std::ops::RangeInclusive<f64>) -> Result<(), ControlError> {
    if range.contains(&value) {
        return Ok(());
    }
    let (least, most) = range.into_inner();
    Err(ControlError::Value(format!("{name} is a number from {least} to {most}")))
}

fn counted(count: usize) -> Result<(), ControlError> {
    if (1..=MOST_WAITING).contains(&count) {
        return Ok(());
    }
    Err(ControlError::Value(format!("count is a number from 1 to {MOST_WAITING}")))
}

/// The octet counted from 0: outside, octets are counted from 1.
pub(super) fn numbered(octet: usize) -> Result<usize, ControlError> {
    octet.checked_sub(1).ok_or_else(|| ControlError::Value("octets are counted from 1".to_owned()))
}

pub(super) fn parsed_switches(text: &str) -> Result<RotarySwitches, ControlError> {
    text.parse().map_err(|error| ControlError::Value(format!("{text:?}: {error}")))
}

pub(super) fn parsed_mask(text: &str) -> Result<u8, ControlError> {
    let digits = text.len() == 2 && text.bytes().all(|digit| digit.is_ascii_hexdigit());
    let mask = u8::from_str_radix(text, 16).ok().filter(|mask| digits && *mask != 0);
    mask.ok_or_else(|| ControlError::Value("mask is two hexadecimal digits from \"01\" to \"FF\"".to_owned()))
}
