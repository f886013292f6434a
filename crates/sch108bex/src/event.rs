//! What happened, as values: the core reports through these and writes no log itself.

use core::fmt;

use profibus_dp::time::Instant;

use crate::diagnostics::{Alarms, Warnings};
use crate::functionality::Functionality;
use crate::refusal::{AddressRefusal, CfgRefusal, PresetRefusal, PrmRefusal};

/// Something that a tool or a log wants to know. Displays as one plain sentence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Event {
    /// The encoder preset itself (manual 4.3.2).
    PresetTaken {
        /// The position of the latest latch before, in scaled steps.
        from: u32,
        /// The position of the same latch now.
        to: u32,
        /// The new offset value (manual 4.2.14).
        offset: i32,
    },
    /// A preset was refused; nothing changed.
    PresetRefused(PresetRefusal),
    /// Output bit 31 was set already when the exchange of data began: nothing was preset.
    PresetBitHeld,
    /// These alarms appeared (manual 4.2.2).
    AlarmRaised(Alarms),
    /// These alarms went (manual 4.2.2).
    AlarmCleared(Alarms),
    /// These warnings appeared (manual 4.2.9).
    WarningRaised(Warnings),
    /// These warnings went (manual 4.2.9).
    WarningCleared(Warnings),
    /// Why the position error alarm appears.
    PositionErrorCause(PositionErrorCause),
    /// This power-on ended a position error: turn count and offset start at 0 (manual 4.2.2).
    PositionErrorCleared,
    /// Parameters were refused.
    PrmRefused(PrmRefusal),
    /// A configuration was refused.
    CfgRefused(CfgRefusal),
    /// A change of the station address was refused.
    AddressRefused(AddressRefusal),
    /// The offset was made under another scaling or direction and is kept, modulo the new range.
    OffsetKeptUnderOtherScaling {
        /// The offset value that is kept.
        offset: i32,
    },
    /// Under the scaling in force the position jumps where the physical range ends, by so many
    /// steps: the total measuring range does not divide it.
    JumpAtOverflow {
        /// Steps, 1 and more.
        residual: u32,
    },
    /// The configuration chose what the device is from now on.
    FunctionalityChosen(Functionality),
    /// What the slave has to tell: states, baud rate, refusals that the standard demands.
    Bus(profibus_dp::dp::Event),
}

/// What makes the position doubtful (manual 4.2.2, bit 0).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PositionErrorCause {
    /// The battery was empty while the power was off.
    TurnCountLost,
    /// Both non-volatile records are damaged: offset and turn count are those at delivery.
    BothRecordsDamaged,
    /// The sensor reported a fault.
    SensorFault,
    /// More than a quarter turn between two samples at most 1 ms apart.
    ImplausibleStep,
    /// Somebody asked for it, to try what happens then.
    Injected,
}

/// Whoever wants to know what happens. `()` does not.
pub trait Observer {
    /// `event` happened at `now`. Called from within the core: do not take long.
    fn observe(&mut self, now: Instant, event: &Event);
}

impl Observer for () {
    #[inline]
    fn observe(&mut self, _: Instant, _: &Event) {}
}

impl<O: Observer + ?Sized> Observer for &mut O {
    #[inline]
    fn observe(&mut self, now: Instant, event: &Event) {
        (**self).observe(now, event);
    }
}

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::PresetTaken { from, to, offset } => {
                write!(f, "preset: position {from} is now {to}, offset value {offset}")
            }
            Self::PresetRefused(refusal) => write!(f, "preset refused: {refusal}"),
            Self::PresetBitHeld => f.write_str(
                "output bit 31 was set already when the exchange of data began: nothing was preset, it must go to 0 first",
            ),
            Self::AlarmRaised(alarms) => write!(f, "alarm: {alarms}"),
            Self::AlarmCleared(alarms) => write!(f, "alarm gone: {alarms}"),
            Self::WarningRaised(warnings) => write!(f, "warning: {warnings}"),
            Self::WarningCleared(warnings) => write!(f, "warning gone: {warnings}"),
            Self::PositionErrorCause(cause) => write!(f, "position error: {cause}"),
            Self::PositionErrorCleared => f.write_str(
                "this power-on cleared the position error: turn count and offset start at 0",
            ),
            Self::PrmRefused(refusal) => write!(f, "parameters refused: {refusal}"),
            Self::CfgRefused(refusal) => write!(f, "configuration refused: {refusal}"),
            Self::AddressRefused(refusal) => write!(f, "address change refused: {refusal}"),
            Self::OffsetKeptUnderOtherScaling { offset } => write!(
                f,
                "the offset value {offset} was made under another scaling or direction: check the position, preset again if it is wrong"
            ),
            Self::JumpAtOverflow { residual } => write!(
                f,
                "where the physical range ends, the position will jump by {residual} steps: the total measuring range does not divide it"
            ),
            Self::FunctionalityChosen(functionality) => {
                write!(f, "the configuration chose {functionality}")
            }
            Self::Bus(event) => event.fmt(f),
        }
    }
}

impl fmt::Display for PositionErrorCause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::TurnCountLost => {
                "the battery was empty at power-on, so the turn count is lost and starts at 0"
            }
            Self::BothRecordsDamaged => "both non-volatile records are damaged",
            Self::SensorFault => "the sensor reports a fault",
            Self::ImplausibleStep => "the shaft seems to have turned by more than a quarter turn within 1 ms",
            Self::Injected => "injected by request",
        })
    }
}
