//! Service access points of a DP-V0 slave.
//!
//! | SAP | hex | service |
//! |-----|-----|---------|
//! | NIL | -   | Data_Exchange, FDL status, Ident |
//! | 55  | 37  | Set_Slave_Add |
//! | 56  | 38  | RD_Inp |
//! | 57  | 39  | RD_Outp |
//! | 58  | 3A  | Global_Control |
//! | 59  | 3B  | Get_Cfg |
//! | 60  | 3C  | Slave_Diag |
//! | 61  | 3D  | Set_Prm |
//! | 62  | 3E  | Chk_Cfg; as SSAP, the master's |

/// A SAP as its extension octet stands on the wire, or [`Sap::NIL`] where there is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Sap(pub u8);

impl Sap {
    /// No extension octet: the default SAP.
    pub const NIL: Self = Self(0xFF);
    /// 55: Set_Slave_Add
    pub const SET_SLAVE_ADD: Self = Self(55);
    /// 56: RD_Inp
    pub const RD_INP: Self = Self(56);
    /// 57: RD_Outp
    pub const RD_OUTP: Self = Self(57);
    /// 58: Global_Control
    pub const GLOBAL_CONTROL: Self = Self(58);
    /// 59: Get_Cfg
    pub const GET_CFG: Self = Self(59);
    /// 60: Slave_Diag
    pub const SLAVE_DIAG: Self = Self(60);
    /// 61: Set_Prm
    pub const SET_PRM: Self = Self(61);
    /// 62: Chk_Cfg, and the SSAP of a master's MS0 services
    pub const CHK_CFG: Self = Self(62);

    /// Whether there is no extension octet.
    pub const fn is_nil(self) -> bool {
        self.0 == Self::NIL.0
    }

    /// Whether it is NIL or one octet of type SAP (0 to 63). Segment addresses (bit 6) and
    /// chains of extensions (bit 7) are no business of a slave.
    pub const fn is_plain(self) -> bool {
        self.is_nil() || self.0 <= 63
    }
}
