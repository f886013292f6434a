//! Requests of a master, and the services by their names.

use std::fmt;

use profibus_dp::wire::Sap;
use profibus_dp::wire::function_code::FunctionCode;

/// With which priority SRD requests are sent. Slaves make no difference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Priority {
    /// Function C.
    Low,
    /// Function D, as most masters do.
    #[default]
    High,
}

/// A Send and Request Data request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Request<'a> {
    /// The slave's address, 0 to 126.
    pub slave: u8,
    /// Destination SAP.
    pub dsap: Sap,
    /// Source SAP.
    pub ssap: Sap,
    /// The PDU without its SAP octets, 0 to 244 octets, without SAPs 246.
    pub data: &'a [u8],
}

impl<'a> Request<'a> {
    /// A service of DP, from the SAP that masters use for it.
    pub const fn service(slave: u8, service: Service, data: &'a [u8]) -> Self {
        let (dsap, ssap) = match service {
            Service::DataExchange | Service::FdlStatus => (Sap::NIL, Sap::NIL),
            Service::Other(dsap) => (dsap, Sap::CHK_CFG),
            Service::SetSlaveAdd => (Sap::SET_SLAVE_ADD, Sap::CHK_CFG),
            Service::RdInp => (Sap::RD_INP, Sap::CHK_CFG),
            Service::RdOutp => (Sap::RD_OUTP, Sap::CHK_CFG),
            Service::GlobalControl => (Sap::GLOBAL_CONTROL, Sap::CHK_CFG),
            Service::GetCfg => (Sap::GET_CFG, Sap::CHK_CFG),
            Service::SlaveDiag => (Sap::SLAVE_DIAG, Sap::CHK_CFG),
            Service::SetPrm => (Sap::SET_PRM, Sap::CHK_CFG),
            Service::ChkCfg => (Sap::CHK_CFG, Sap::CHK_CFG),
        };
        Self { slave, dsap, ssap, data }
    }

    /// Which service it is.
    pub const fn named(&self) -> Service {
        match self.dsap {
            Sap::NIL => Service::DataExchange,
            Sap::SET_SLAVE_ADD => Service::SetSlaveAdd,
            Sap::RD_INP => Service::RdInp,
            Sap::RD_OUTP => Service::RdOutp,
            Sap::GLOBAL_CONTROL => Service::GlobalControl,
            Sap::GET_CFG => Service::GetCfg,
            Sap::SLAVE_DIAG => Service::SlaveDiag,
            Sap::SET_PRM => Service::SetPrm,
            Sap::CHK_CFG => Service::ChkCfg,
            other => Service::Other(other),
        }
    }
}

/// What a master asks of a slave.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Service {
    /// Request FDL status.
    FdlStatus,
    /// Outputs for inputs.
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
    Other(Sap),
}

impl fmt::Display for Service {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::FdlStatus => "FDL status",
            Self::DataExchange => "Data_Exchange",
            Self::SetSlaveAdd => "Set_Slave_Add",
            Self::RdInp => "RD_Inp",
            Self::RdOutp => "RD_Outp",
            Self::GlobalControl => "Global_Control",
            Self::GetCfg => "Get_Cfg",
            Self::SlaveDiag => "Slave_Diag",
            Self::SetPrm => "Set_Prm",
            Self::ChkCfg => "Chk_Cfg",
            Self::Other(sap) => return write!(f, "SAP {}", sap.0),
        })
    }
}

/// Request FDL status.
pub(crate) const FDL_STATUS: FunctionCode = FunctionCode(0x49);
/// SDN high: what Global_Control is sent with.
pub(crate) const SDN_HIGH: FunctionCode = FunctionCode(0x46);

/// What the next request to a slave has in FCB and FCV.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum FrameCount {
    /// A sequence begins: FCV = 0, FCB = 1.
    #[default]
    First,
    /// FCV = 1, FCB = 0.
    Zero,
    /// FCV = 1, FCB = 1.
    One,
}

impl FrameCount {
    /// The FC octet of an SRD.
    pub(crate) const fn srd(self, priority: Priority) -> FunctionCode {
        let function = match priority {
            Priority::Low => 0x4C,
            Priority::High => 0x4D,
        };
        FunctionCode(
            function
                | match self {
                    Self::First => 0x20,
                    Self::Zero => 0x10,
                    Self::One => 0x30,
                },
        )
    }

    /// After a request that was answered.
    pub(crate) const fn next(self) -> Self {
        match self {
            Self::First | Self::One => Self::Zero,
            Self::Zero => Self::One,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // DP slave reference, section 3.6: 6D, 5D, 7D, 5D and so on.
    #[test]
    fn a_sequence_begins_with_fcv_0_and_then_the_bit_toggles() {
        let mut count = FrameCount::default();
        let octets: Vec<u8> = (0..5)
            .map(|_| {
                let octet = count.srd(Priority::High).0;
                count = count.next();
                octet
            })
            .collect();
        assert_eq!(octets, [0x6D, 0x5D, 0x7D, 0x5D, 0x7D]);
        assert_eq!(FrameCount::First.srd(Priority::Low).0, 0x6C);
    }
}
