//! The field's names of formats, functions and services.

use profibus_dp::wire::function_code::{Function, FunctionCode};
use profibus_dp::wire::sap::Sap;
use serde::Serialize;

/// The format of a telegram.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum Format {
    /// Without data.
    SD1,
    /// With a length.
    SD2,
    /// With eight octets of data.
    SD3,
    /// The token.
    SD4,
    /// The short acknowledgement.
    SC,
}

/// Who speaks to whom.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// Bit 6 of FC is 1.
    Request,
    /// Bit 6 of FC is 0, or a short acknowledgement.
    Response,
    /// The right to send goes on.
    Token,
}

/// What a telegram is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[allow(missing_docs, reason = "the names are the standard's")]
pub enum Service {
    #[serde(rename = "Data_Exchange")]
    DataExchange,
    #[serde(rename = "Set_Slave_Add")]
    SetSlaveAdd,
    #[serde(rename = "RD_Inp")]
    RdInp,
    #[serde(rename = "RD_Outp")]
    RdOutp,
    #[serde(rename = "Global_Control")]
    GlobalControl,
    #[serde(rename = "Get_Cfg")]
    GetCfg,
    #[serde(rename = "Slave_Diag")]
    SlaveDiag,
    #[serde(rename = "Set_Prm")]
    SetPrm,
    #[serde(rename = "Chk_Cfg")]
    ChkCfg,
    #[serde(rename = "FDL_Status")]
    FdlStatus,
    #[serde(rename = "Ident")]
    Ident,
    #[serde(rename = "LSAP_Status")]
    LsapStatus,
    /// A SAP that DP-V0 slaves do not have.
    #[serde(rename = "other")]
    Other,
}

impl Service {
    /// The name, as in JSON.
    pub const fn name(self) -> &'static str {
        match self {
            Self::DataExchange => "Data_Exchange",
            Self::SetSlaveAdd => "Set_Slave_Add",
            Self::RdInp => "RD_Inp",
            Self::RdOutp => "RD_Outp",
            Self::GlobalControl => "Global_Control",
            Self::GetCfg => "Get_Cfg",
            Self::SlaveDiag => "Slave_Diag",
            Self::SetPrm => "Set_Prm",
            Self::ChkCfg => "Chk_Cfg",
            Self::FdlStatus => "FDL_Status",
            Self::Ident => "Ident",
            Self::LsapStatus => "LSAP_Status",
            Self::Other => "unknown service",
        }
    }

    /// The service of a slave's SAP.
    pub(crate) fn of_sap(sap: Sap) -> Self {
        match sap {
            Sap::NIL => Self::DataExchange,
            Sap::SET_SLAVE_ADD => Self::SetSlaveAdd,
            Sap::RD_INP => Self::RdInp,
            Sap::RD_OUTP => Self::RdOutp,
            Sap::GLOBAL_CONTROL => Self::GlobalControl,
            Sap::GET_CFG => Self::GetCfg,
            Sap::SLAVE_DIAG => Self::SlaveDiag,
            Sap::SET_PRM => Self::SetPrm,
            Sap::CHK_CFG => Self::ChkCfg,
            _ => Self::Other,
        }
    }

    /// The service of a request.
    pub(crate) fn of_request(fc: FunctionCode, dsap: Sap) -> Self {
        match fc.function() {
            Function::FdlStatus => Self::FdlStatus,
            Function::Ident => Self::Ident,
            Function::LsapStatus => Self::LsapStatus,
            Function::SendAndRequestData => Self::of_sap(dsap),
            Function::SendDataNoAcknowledge if dsap == Sap::GLOBAL_CONTROL => Self::GlobalControl,
            _ => Self::Other,
        }
    }
}

/// The words for the function of a request.
pub(crate) fn function(fc: FunctionCode) -> &'static str {
    if fc.0 & 0x80 != 0 {
        return if fc.0.trailing_zeros() >= 4 { "clock value" } else { "reserved" };
    }
    match fc.0 & 0x0F {
        0x0 => "time event",
        0x3 => "SDA low: send data with acknowledge",
        0x4 => "SDN low: send data, no acknowledge",
        0x5 => "SDA high: send data with acknowledge",
        0x6 => "SDN high: send data, no acknowledge",
        0x7 => "MSRD: send and request data, multicast reply",
        0x9 => "request FDL status",
        0xC => "SRD low: send and request data",
        0xD => "SRD high: send and request data",
        0xE => "request Ident",
        0xF => "request LSAP status",
        _ => "reserved",
    }
}

/// The words for the code of a response.
pub(crate) fn response(fc: FunctionCode) -> &'static str {
    match fc.0 & 0x0F {
        0x0 => "OK",
        0x1 => "UE: user error",
        0x2 => "RR: no resource for the data",
        0x3 => "RS: no service activated here",
        0x8 => "DL: data, low priority",
        0x9 => "NR: no data",
        0xA => "DH: data, high priority: a diagnosis waits",
        0xC => "RDL: low data, but no resource for the request's",
        0xD => "RDH: high data, but no resource for the request's",
        _ => "reserved",
    }
}

/// The words for the station type in a response.
pub(crate) fn station_type(fc: FunctionCode) -> &'static str {
    ["slave", "master, not ready", "master, ready for the ring", "master in the ring"]
        [usize::from(fc.0 >> 4 & 3)]
}

/// The words for a SAP.
pub(crate) fn sap(sap: u8) -> &'static str {
    match sap {
        48..=49 | 51 => "DP-V1",
        50 => "DP-V1 alarms",
        53 => "Set_Ext_Prm",
        54 => "master to master",
        63 => "all SAPs",
        64.. => "no SAP: a segment or a chain of extensions",
        _ => match Service::of_sap(Sap(sap)) {
            Service::Other => "",
            Service::ChkCfg => "Chk_Cfg, or the master's own",
            service => service.name(),
        },
    }
}
