//! Set_Prm (SAP 61): parameters from the master that wants to own the slave.
//!
//! | octet | name | content |
//! |-------|------|---------|
//! | 1 | Station_Status | bit 7 Lock_Req, 6 Unlock_Req, 5 Sync_Req, 4 Freeze_Req, 3 WD_On, 2..0 reserved |
//! | 2, 3 | WD_Fact_1, WD_Fact_2 | 1 to 255 each |
//! | 4 | min T_SDR | bit times, 0 = keep |
//! | 5, 6 | Ident_Number | high octet first |
//! | 7 | Group_Ident | bit n: member of group n + 1 |
//! | 8 | the slave ASIC's octet, the first of User_Prm_Data | bit 7 DPV1_Enable, 6 Fail_Safe, 2 WD_Base, 1 Dis_Stop_Control, 0 Dis_Start_Control |
//! | 9.. | User_Prm_Data | the device's own |

use super::octet;
use crate::time::Duration;

/// The least a Set_Prm must hold.
pub const STANDARD_OCTETS: usize = 7;

/// Octet 1 of Set_Prm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StationStatus(pub u8);

impl StationStatus {
    /// Bit 7: the slave shall be locked for other masters.
    #[doc(alias = "Lock_Req")]
    pub const fn lock_req(self) -> bool {
        self.0 & 0x80 != 0
    }
    /// Bit 6: the slave shall be free for other masters.
    #[doc(alias = "Unlock_Req")]
    pub const fn unlock_req(self) -> bool {
        self.0 & 0x40 != 0
    }
    /// Bit 5: the master will use Sync.
    #[doc(alias = "Sync_Req")]
    pub const fn sync_req(self) -> bool {
        self.0 & 0x20 != 0
    }
    /// Bit 4: the master will use Freeze.
    #[doc(alias = "Freeze_Req")]
    pub const fn freeze_req(self) -> bool {
        self.0 & 0x10 != 0
    }
    /// Bit 3: the watchdog shall run.
    #[doc(alias = "WD_On")]
    pub const fn watchdog_on(self) -> bool {
        self.0 & 0x08 != 0
    }
    /// Bits 2 to 0, reserved.
    pub const fn reserved(self) -> u8 {
        self.0 & 0x07
    }
}

/// Octet 8 of Set_Prm, DPV1_Status_1 to later standards.
#[doc(alias = "DPV1_Status_1")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AsicOctet(pub u8);

impl AsicOctet {
    /// Reading "Octet 8 of Set_Prm": bits 7, 5, 4 and 3 are a parameter fault in a DP-V0 slave;
    /// bits 6, 1 and 0 are accepted without effect.
    pub const fn refused_bits(self) -> u8 {
        self.0 & 0b1011_1000
    }
    /// Bit 2: the watchdog counts in steps of 1 ms, not of 10 ms.
    #[doc(alias = "WD_Base")]
    pub const fn watchdog_base_1_ms(self) -> bool {
        self.0 & 0x04 != 0
    }
}

/// A Set_Prm of at least seven octets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SetPrm<'a> {
    /// Octet 1.
    pub status: StationStatus,
    /// Octets 2 and 3: the watchdog factors.
    #[doc(alias = "WD_Fact_1")]
    #[doc(alias = "WD_Fact_2")]
    pub watchdog_factors: [u8; 2],
    /// Octet 4: min T_SDR in bit times, 0 = keep.
    #[doc(alias = "min_Tsdr")]
    pub min_tsdr: u8,
    /// Octets 5 and 6.
    #[doc(alias = "Ident_Number")]
    pub ident_number: u16,
    /// Octet 7.
    #[doc(alias = "Group_Ident")]
    pub group_ident: u8,
    /// All octets from 1 on, for the device's own part.
    pub octets: &'a [u8],
}

impl<'a> SetPrm<'a> {
    /// Reads the data unit; `None` where it has fewer than seven octets.
    pub fn parse(octets: &'a [u8]) -> Option<Self> {
        let &[status, factor_1, factor_2, min_tsdr, ident_high, ident_low, group_ident] =
            octets.first_chunk::<STANDARD_OCTETS>()?;
        Some(Self {
            status: StationStatus(status),
            watchdog_factors: [factor_1, factor_2],
            min_tsdr,
            ident_number: u16::from_be_bytes([ident_high, ident_low]),
            group_ident,
            octets,
        })
    }

    /// Octet 8; 0 where the telegram ends before it.
    pub fn asic_octet(&self) -> AsicOctet {
        AsicOctet(octet(self.octets, 8).unwrap_or(0))
    }

    /// Twd = 10 ms (or 1 ms) x WD_Fact_1 x WD_Fact_2; `None` with WD_On = 0 or a factor of 0.
    #[doc(alias = "Twd")]
    pub fn watchdog(&self) -> Option<Duration> {
        let [factor_1, factor_2] = self.watchdog_factors.map(u64::from);
        let base = Duration::from_millis(if self.asic_octet().watchdog_base_1_ms() { 1 } else { 10 });
        let span = base.times(factor_1.saturating_mul(factor_2));
        (self.status.watchdog_on() && span > Duration::ZERO).then_some(span)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // DP slave reference, sections 3.5 and 5.2.
    #[test]
    fn the_examples_of_the_reference_read_as_told() {
        let octets = [0x88, 0x01, 0x14, 0x0B, 0x47, 0x11, 0x00, 0x00, 0x00];
        let prm = SetPrm::parse(&octets).expect("long enough");
        assert!(prm.status.lock_req() && prm.status.watchdog_on() && !prm.status.unlock_req());
        assert_eq!((prm.min_tsdr, prm.ident_number, prm.group_ident), (11, 0x4711, 0));
        assert_eq!(prm.watchdog(), Some(Duration::from_millis(200)));

        let trace = SetPrm::parse(&[0xB8, 0x0D, 0x0F, 0, 0, 0, 0]).expect("long enough");
        assert_eq!(trace.watchdog(), Some(Duration::from_millis(1950)));
        assert!(trace.status.sync_req() && trace.status.freeze_req());
        let fast = SetPrm::parse(&[0x88, 0x01, 0xC8, 0, 0, 0, 0, 0x04]).expect("long enough");
        assert_eq!(fast.watchdog(), Some(Duration::from_millis(200)));
        let off = SetPrm::parse(&[0x80, 0x01, 0xC8, 0, 0, 0, 0]).expect("long enough");
        assert_eq!(off.watchdog(), None);
        assert_eq!(SetPrm::parse(&octets[..6]), None);
    }

    #[test]
    fn the_asic_octet_refuses_what_dp_v0_has_not() {
        for bit in 0..8u8 {
            let refused = AsicOctet(1 << bit).refused_bits() != 0;
            assert_eq!(refused, [7, 5, 4, 3].contains(&bit), "bit {bit}");
        }
    }
}
