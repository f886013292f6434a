//! What happened, as values: the core reports through these and writes no log itself.

use core::fmt;

use profibus_dp::dp::{Event as BusEvent, Refusal};
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
    Bus(BusEvent),
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
            Self::Bus(event) => {
                event.fmt(f)?;
                match event {
                    BusEvent::Refused(refusal) => {
                        section_of(*refusal).map_or(Ok(()), |section| write!(f, " (manual {section})"))
                    }
                    _ => Ok(()),
                }
            }
        }
    }
}

/// The section of the manual with the rule; `None`: it is the standard's alone.
const fn section_of(refusal: Refusal) -> Option<&'static str> {
    match refusal {
        Refusal::PrmTooShort(_)
        | Refusal::StationStatus(_)
        | Refusal::WatchdogFactor(_)
        | Refusal::AsicOctet(_) => Some("4.1"),
        Refusal::OtherConfiguration { .. } | Refusal::TooManyOctets | Refusal::OutputLength { .. } => {
            Some("4.3")
        }
        Refusal::AddressRange(_) | Refusal::AddressFixed | Refusal::AtAddress126(_) => Some("3.4"),
        _ => None,
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

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use profibus_dp::dp::Service;

    use super::*;

    fn sentence(refusal: Refusal) -> std::string::String {
        Event::Bus(BusEvent::Refused(refusal)).to_string()
    }

    #[test]
    fn a_refusal_of_the_bus_half_names_the_section_where_the_manual_has_the_rule() {
        for (refusal, section) in [
            (Refusal::PrmTooShort(6), "(manual 4.1)"),
            (Refusal::OutputLength { received: 3, due: 4 }, "(manual 4.3)"),
            (Refusal::AtAddress126(Service::SetPrm), "(manual 3.4)"),
            (Refusal::AddressFixed, "(manual 3.4)"),
        ] {
            assert!(sentence(refusal).ends_with(section), "{}", sentence(refusal));
        }
        assert!(!sentence(Refusal::DataInReadRequest(Service::GetCfg)).contains("manual"));
    }

    #[test]
    fn another_configuration_is_told_with_both_octets() {
        let of = |octet, received, agreed| sentence(Refusal::OtherConfiguration { octet, received, agreed });
        assert!(of(1, Some(0xD1), Some(0xF1)).contains("Chk_Cfg octet 1 is D1, but F1 was agreed on"));
        assert!(of(2, None, Some(0xD1)).contains("Chk_Cfg octet 2 is missing, but D1 was agreed on"));
        assert!(of(2, Some(0x00), None).contains("Chk_Cfg octet 2 is 00, but no such octet was agreed on"));
    }
}
