//! What to do about a refusal. What was wrong, the refusals say themselves; a master only hears that they are.

use profibus_dp::dp::{Event as BusEvent, Refusal, Service};
use sch108bex::diagnostics::{Alarms, Warnings};
use sch108bex::event::{Event, PositionErrorCause};
use sch108bex::refusal::{AddressRefusal, CfgRefusal, PresetRefusal, PrmRefusal};

use super::encoder;

/// What to do about parameters that the encoder has refused.
pub const fn of_parameters(refusal: &PrmRefusal) -> &'static str {
    match refusal {
        PrmRefusal::Length { .. } => {
            "take the module's parameters from the encoder's GSD as they are; a master that sends octet 8 twice or not at all is one octet off"
        }
        PrmRefusal::Class2Missing { .. } => "set bit 1 of octet 9, or choose the class 1 module",
        PrmRefusal::Commissioning { .. } => {
            "clear bit 2 of octet 9; in some encoders bits 1 and 2 are exchanged, so the GSD may be another device's"
        }
        PrmRefusal::NotAssigned { .. } => {
            "clear bits 4 to 7 of octet 9; other makers use them, so the GSD may be another device's"
        }
        PrmRefusal::MeasuringUnits { .. } => {
            "write a number of units within that range; if it looks huge or tiny, high and low words are exchanged in the tool"
        }
        PrmRefusal::MeasuringRange { .. } => {
            "write a range within that; if it looks huge or tiny, high and low words are exchanged in the tool"
        }
        PrmRefusal::Reserved { .. } => {
            "write 0 there; values in octets 18 to 25 mean that the parameters are another encoder's"
        }
        PrmRefusal::TimeBase { .. } => {
            "write 0, 1, 2 or 3; beware that other makers count the time bases in the opposite order"
        }
        PrmRefusal::ShorterThanAgreed { .. } => {
            "send all the parameters of the module that is configured, or start up again with the other module"
        }
    }
}

/// What to do about a configuration that the encoder has refused.
pub const fn of_configuration(refusal: &CfgRefusal) -> &'static str {
    match refusal {
        CfgRefusal::NotOffered { .. } => {
            "choose a module of the encoder's own GSD in the master's project; if yours is the maker's GSD with other identifiers, give that file to the virtual encoder"
        }
        CfgRefusal::ParametersTooShort { .. } => {
            "module and parameters do not belong together; choose the module again in the master's project, so that it takes both"
        }
    }
}

/// What to do about a preset that was refused.
pub const fn of_preset(_: &PresetRefusal) -> &'static str {
    "write a value below the total measuring range, with bit 31 on top; then bring bit 31 back to 0 before the next try"
}

/// What to do about a new address that the encoder has refused.
pub const fn of_address(refusal: &AddressRefusal) -> &'static str {
    match refusal {
        AddressRefusal::SwitchesDecide { .. } => {
            "turn the two switches in the end cap to 7 and E and switch the power off and on; or set the address itself there"
        }
        AddressRefusal::OutOfRange { .. } => "give an address from 1 to 125",
        AddressRefusal::Ident { .. } => "read the ident number from the diagnosis and give that one",
        AddressRefusal::TooShort { .. } => "the master's program is wrong: Set_Slave_Add has four octets",
        AddressRefusal::NotInWaitPrm => "take the station out of its master first, or stop that master",
    }
}

/// What to do about what the standard demands to refuse.
pub const fn of_refusal(refusal: &Refusal) -> &'static str {
    match refusal {
        Refusal::PrmTooShort(_) | Refusal::StationStatus(_) | Refusal::AddressTooShort(_) => {
            "the master's program is wrong; compare the telegram with its octets"
        }
        Refusal::PrmIdent { .. } => {
            "the project has another device at this address: take the right GSD, or the right address"
        }
        Refusal::WatchdogFactor(_) => "give both watchdog factors 1 to 255, or switch the watchdog off",
        Refusal::SyncNotSupported => "switch Sync off for this station",
        Refusal::FreezeNotSupported => "switch Freeze off for this station",
        Refusal::AsicOctet(_) => {
            "write 0 to octet 8, the first of User_Prm_Data; the master may take the station for a DP-V1 slave, or miss that octet"
        }
        Refusal::OtherMaster { .. } => {
            "take the station out of one of the two masters, or stop the owner and wait for the watchdog"
        }
        Refusal::NotInThisState(service) => not_in_this_state(*service),
        Refusal::OtherConfiguration { .. } => {
            "start the station up again to change its configuration: Set_Prm first, then Chk_Cfg"
        }
        Refusal::TooManyOctets => "choose another module",
        Refusal::OutputLength { .. } => "send as many outputs as the configured module has",
        Refusal::DataInReadRequest(_) => "the master's program is wrong: a read request carries no data",
        Refusal::GlobalControl(_) => {
            "the master's program is wrong: two octets, and bits 0, 6 and 7 of the first are 0"
        }
        Refusal::AddressIdent { .. } => "read the ident number from the diagnosis and give that one",
        Refusal::AddressRange(_) => "give an address from 1 to 125",
        Refusal::AddressFixed => {
            "turn the two switches in the end cap to 7 and E and switch the power off and on; or set the address itself there"
        }
        Refusal::AtAddress126(_) => "give the station an address from 1 to 125 first",
    }
}

const fn not_in_this_state(service: Service) -> &'static str {
    match service {
        Service::ChkCfg => "send good parameters (Set_Prm) first",
        Service::DataExchange | Service::RdInp | Service::RdOutp => {
            "start the station up first: diagnosis, Set_Prm, Chk_Cfg, diagnosis"
        }
        Service::SetSlaveAdd => "take the station out of its master first, or stop that master",
        _ => "fetch the diagnosis to see what the station waits for",
    }
}

/// What to do about something that the encoder tells of itself; `None` where there is nothing to do.
pub fn of_event(event: &Event) -> Option<&'static str> {
    Some(match event {
        Event::PresetRefused(refusal) => of_preset(refusal),
        Event::PresetBitHeld => "bring output bit 31 to 0 and then to 1 again",
        Event::AlarmRaised(alarms) => first_alarm(*alarms)?,
        Event::WarningRaised(warnings) => first_warning(*warnings)?,
        Event::PositionErrorCause(cause) => match cause {
            PositionErrorCause::TurnCountLost => "have the battery replaced at the factory, and preset again",
            PositionErrorCause::BothRecordsDamaged => "switch off and on, and preset again",
            PositionErrorCause::SensorFault | PositionErrorCause::ImplausibleStep => {
                "switch off and on, preset again; if it comes back, the encoder goes to the factory"
            }
            PositionErrorCause::Injected => "switch off and on when the experiment is over, and preset again",
        },
        Event::PositionErrorCleared | Event::OffsetKeptUnderOtherScaling { .. } => {
            "compare the position with the machine, and preset again"
        }
        Event::PrmRefused(refusal) => of_parameters(refusal),
        Event::CfgRefused(refusal) => of_configuration(refusal),
        Event::AddressRefused(refusal) => of_address(refusal),
        Event::JumpAtOverflow { .. } => {
            "no matter if the machine never comes there; else take a range that divides turns x units"
        }
        Event::Bus(BusEvent::Refused(refusal)) => of_refusal(refusal),
        _ => return None,
    })
}

fn first_alarm(alarms: Alarms) -> Option<&'static str> {
    encoder::alarm_advice(u8::try_from(alarms.bits().trailing_zeros()).ok()?)
}

fn first_warning(warnings: Warnings) -> Option<&'static str> {
    encoder::warning_advice(u8::try_from(warnings.bits().trailing_zeros()).ok()?)
}
