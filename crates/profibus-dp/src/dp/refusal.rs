//! Why the slave refused something: octet, value, rule.

use core::fmt;

/// The services of MS0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Service {
    /// NIL
    DataExchange,
    /// SAP 55
    SetSlaveAdd,
    /// SAP 56
    RdInp,
    /// SAP 57
    RdOutp,
    /// SAP 58
    GlobalControl,
    /// SAP 59
    GetCfg,
    /// SAP 60
    SlaveDiag,
    /// SAP 61
    SetPrm,
    /// SAP 62
    ChkCfg,
    /// Any other SAP.
    Sap(u8),
}

/// What was refused, with the octet and the value that were wrong.
///
/// Octets count from 1 in the data unit of the service.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// Set_Prm with fewer than seven octets.
    PrmTooShort(u8),
    /// Set_Prm: octet 1 has a reserved bit (2 to 0) set.
    StationStatus(u8),
    /// Set_Prm for another kind of device.
    PrmIdent {
        /// What octets 5 and 6 hold.
        received: u16,
        /// The device's own.
        own: u16,
    },
    /// Set_Prm: WD_On with a factor of 0; the octet is 2 or 3.
    WatchdogFactor(u8),
    /// Set_Prm: Sync_Req, but the device has no Sync.
    SyncNotSupported,
    /// Set_Prm: Freeze_Req, but the device has no Freeze.
    FreezeNotSupported,
    /// Set_Prm: octet 8 asks for DP-V1 or has a reserved bit set.
    AsicOctet(u8),
    /// Another master owns the slave.
    OtherMaster {
        /// What was asked.
        service: Service,
        /// Who owns the slave.
        owner: u8,
        /// Who asked.
        requester: u8,
    },
    /// The service is not active in this state.
    NotInThisState(Service),
    /// Chk_Cfg in data exchange with other identifiers than agreed on.
    OtherConfiguration {
        /// The first octet that differs, counted from 1.
        octet: u8,
        /// What it holds; `None`: the telegram ends before it.
        received: Option<u8>,
        /// What was agreed on; `None`: nothing more.
        agreed: Option<u8>,
    },
    /// Chk_Cfg: the application offers more octets than the slave was built for.
    TooManyOctets,
    /// Data_Exchange with another number of outputs than agreed on.
    OutputLength {
        /// Octets in the telegram.
        received: u8,
        /// Octets agreed on.
        due: u8,
    },
    /// A read service (Slave_Diag, Get_Cfg, RD_Inp, RD_Outp) with data in the request.
    DataInReadRequest(Service),
    /// Global_Control with a reserved bit or not of two octets; octet 1.
    GlobalControl(u8),
    /// Set_Slave_Add with fewer than four octets.
    AddressTooShort(u8),
    /// Set_Slave_Add for another kind of device.
    AddressIdent {
        /// What octets 2 and 3 hold.
        received: u16,
        /// The device's own.
        own: u16,
    },
    /// Set_Slave_Add to an address that the device cannot take.
    AddressRange(u8),
    /// Set_Slave_Add, but the device's address is set otherwise.
    AddressFixed,
    /// Set_Prm or Chk_Cfg at address 126.
    AtAddress126(Service),
}

impl Refusal {
    /// The service that was refused.
    pub const fn service(&self) -> Service {
        match *self {
            Self::PrmTooShort(_)
            | Self::StationStatus(_)
            | Self::PrmIdent { .. }
            | Self::WatchdogFactor(_)
            | Self::SyncNotSupported
            | Self::FreezeNotSupported
            | Self::AsicOctet(_) => Service::SetPrm,
            Self::OtherMaster { service, .. }
            | Self::NotInThisState(service)
            | Self::DataInReadRequest(service)
            | Self::AtAddress126(service) => service,
            Self::OtherConfiguration { .. } | Self::TooManyOctets => Service::ChkCfg,
            Self::OutputLength { .. } => Service::DataExchange,
            Self::GlobalControl(_) => Service::GlobalControl,
            Self::AddressTooShort(_)
            | Self::AddressIdent { .. }
            | Self::AddressRange(_)
            | Self::AddressFixed => Service::SetSlaveAdd,
        }
    }

    /// The octet that was wrong, counted from 1; `None` where it is the whole that does not fit.
    pub const fn octet(&self) -> Option<u8> {
        match *self {
            Self::StationStatus(_)
            | Self::SyncNotSupported
            | Self::FreezeNotSupported
            | Self::GlobalControl(_)
            | Self::AddressRange(_) => Some(1),
            Self::AddressIdent { .. } => Some(2),
            Self::PrmIdent { .. } => Some(5),
            Self::AsicOctet(_) => Some(8),
            Self::WatchdogFactor(octet) | Self::OtherConfiguration { octet, .. } => Some(octet),
            _ => None,
        }
    }

    /// The value that was wrong: an octet, a number or a length; 0 where there is none.
    pub const fn value(&self) -> u32 {
        match *self {
            Self::PrmTooShort(value)
            | Self::StationStatus(value)
            | Self::AsicOctet(value)
            | Self::GlobalControl(value)
            | Self::AddressTooShort(value)
            | Self::AddressRange(value)
            | Self::OutputLength { received: value, .. }
            | Self::OtherConfiguration { received: Some(value), .. }
            | Self::OtherMaster { requester: value, .. } => value as u32,
            Self::PrmIdent { received, .. } | Self::AddressIdent { received, .. } => received as u32,
            _ => 0,
        }
    }
}

impl fmt::Display for Service {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::DataExchange => "Data_Exchange",
            Self::SetSlaveAdd => "Set_Slave_Add",
            Self::RdInp => "RD_Inp",
            Self::RdOutp => "RD_Outp",
            Self::GlobalControl => "Global_Control",
            Self::GetCfg => "Get_Cfg",
            Self::SlaveDiag => "Slave_Diag",
            Self::SetPrm => "Set_Prm",
            Self::ChkCfg => "Chk_Cfg",
            Self::Sap(sap) => return write!(f, "a service at SAP {sap}"),
        })
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::PrmTooShort(length) => {
                write!(f, "Set_Prm has {length} octets, but the standard part alone has 7")
            }
            Self::StationStatus(octet) => write!(
                f,
                "Set_Prm octet 1 (Station_Status) is {octet:02X}, but its bits 0 to 2 are reserved and must be 0"
            ),
            Self::PrmIdent { received, own } => write!(
                f,
                "Set_Prm octets 5-6 name the ident number {received:04X}, but this device has {own:04X}"
            ),
            Self::WatchdogFactor(octet) => write!(
                f,
                "Set_Prm octet {octet} (watchdog factor) is 0, but with WD_On both factors must be 1 to 255"
            ),
            Self::SyncNotSupported => f.write_str("Set_Prm octet 1 asks for Sync, which this device has not"),
            Self::FreezeNotSupported => {
                f.write_str("Set_Prm octet 1 asks for Freeze, which this device has not")
            }
            Self::AsicOctet(octet) => write!(
                f,
                "Set_Prm octet 8 is {octet:02X}, but a DP-V0 slave knows only its bits 0, 1, 2 and 6"
            ),
            Self::OtherMaster { service, owner, requester } => {
                write!(f, "{service} from master {requester} is refused: master {owner} owns this slave")
            }
            Self::NotInThisState(service) => write!(f, "{service} is not active in this state"),
            Self::OtherConfiguration { octet, received, agreed } => {
                write!(f, "Chk_Cfg octet {octet} is ")?;
                identifier(f, received, "missing")?;
                f.write_str(", but ")?;
                identifier(f, agreed, "no such octet")?;
                f.write_str(" was agreed on, and in data exchange it cannot change")
            }
            Self::TooManyOctets => f.write_str("Chk_Cfg asks for more octets than this slave was built for"),
            Self::OutputLength { received, due } => {
                write!(f, "Data_Exchange carries {received} output octets, but {due} were agreed on")
            }
            Self::DataInReadRequest(service) => write!(f, "{service} is a read service and takes no data"),
            Self::GlobalControl(octet) => write!(
                f,
                "Global_Control octet 1 is {octet:02X}: bits 0, 6 and 7 are reserved, and there must be 2 octets"
            ),
            Self::AddressTooShort(length) => {
                write!(f, "Set_Slave_Add has {length} octets, but needs 4 at least")
            }
            Self::AddressIdent { received, own } => write!(
                f,
                "Set_Slave_Add octets 2-3 name the ident number {received:04X}, but this device has {own:04X}"
            ),
            Self::AddressRange(address) => {
                write!(f, "Set_Slave_Add octet 1 is {address}, but only 1 to 125 can be set")
            }
            Self::AddressFixed => {
                f.write_str("Set_Slave_Add is refused: the address is not set over the bus")
            }
            Self::AtAddress126(service) => write!(
                f,
                "{service} is refused: at address 126 a slave can only be found, diagnosed and given an address"
            ),
        }
    }
}

/// An identifier octet, or what stands for none.
fn identifier(f: &mut fmt::Formatter<'_>, octet: Option<u8>, none: &str) -> fmt::Result {
    match octet {
        Some(octet) => write!(f, "{octet:02X}"),
        None => f.write_str(none),
    }
}
