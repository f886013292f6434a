//! Slave_Diag (SAP 60): the six standard octets.
//!
//! | octet | bits the slave sets |
//! |-------|---------------------|
//! | 1 | 1 Station_Not_Ready, 2 Cfg_Fault, 3 Ext_Diag, 4 Not_Supported, 6 Prm_Fault |
//! | 2 | 0 Prm_Req, 1 Stat_Diag, 2 always 1, 3 WD_On, 4 Freeze_Mode, 5 Sync_Mode |
//! | 3 | 7 Ext_Diag_Overflow |
//! | 4 | Master_Add, FF = none |
//! | 5, 6 | Ident_Number, high octet first |
//!
//! Bits 0, 5 and 7 of octet 1 and bit 7 of octet 2 are the master's: a slave sends them as 0.

/// Octets 1 to 6 of a diagnosis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StandardDiagnosis {
    /// Octet 1 bit 1: not ready for data exchange.
    #[doc(alias = "Station_Not_Ready")]
    pub station_not_ready: bool,
    /// Octet 1 bit 2: the last Chk_Cfg did not fit.
    #[doc(alias = "Cfg_Fault")]
    pub cfg_fault: bool,
    /// Octet 1 bit 3: the device's own part reports a fault.
    #[doc(alias = "Ext_Diag")]
    pub ext_diag: bool,
    /// Octet 1 bit 4: a function was asked for that there is not.
    #[doc(alias = "Not_Supported")]
    pub not_supported: bool,
    /// Octet 1 bit 6: the last Set_Prm was refused.
    #[doc(alias = "Prm_Fault")]
    pub prm_fault: bool,
    /// Octet 2 bit 0: parameters are needed.
    #[doc(alias = "Prm_Req")]
    pub prm_req: bool,
    /// Octet 2 bit 1: no valid data; the master shall keep fetching the diagnosis.
    #[doc(alias = "Stat_Diag")]
    pub stat_diag: bool,
    /// Octet 2 bit 3: the watchdog runs.
    #[doc(alias = "WD_On")]
    pub watchdog_on: bool,
    /// Octet 2 bit 4.
    #[doc(alias = "Freeze_Mode")]
    pub freeze_mode: bool,
    /// Octet 2 bit 5.
    #[doc(alias = "Sync_Mode")]
    pub sync_mode: bool,
    /// Octet 3 bit 7: more diagnosis than fits.
    #[doc(alias = "Ext_Diag_Overflow")]
    pub ext_diag_overflow: bool,
    /// Octet 4: the owner; `None` (FF) while there is none.
    #[doc(alias = "Master_Add")]
    pub master_add: Option<u8>,
    /// Octets 5 and 6.
    #[doc(alias = "Ident_Number")]
    pub ident_number: u16,
}

/// How many octets the standard part has.
pub const STANDARD_OCTETS: usize = 6;

impl StandardDiagnosis {
    /// The six octets.
    pub fn emit(&self) -> [u8; STANDARD_OCTETS] {
        let bit = |set: bool, number: u8| u8::from(set).wrapping_shl(u32::from(number));
        let [ident_high, ident_low] = self.ident_number.to_be_bytes();
        [
            bit(self.station_not_ready, 1)
                | bit(self.cfg_fault, 2)
                | bit(self.ext_diag, 3)
                | bit(self.not_supported, 4)
                | bit(self.prm_fault, 6),
            bit(self.prm_req, 0)
                | bit(self.stat_diag, 1)
                | bit(true, 2)
                | bit(self.watchdog_on, 3)
                | bit(self.freeze_mode, 4)
                | bit(self.sync_mode, 5),
            bit(self.ext_diag_overflow, 7),
            self.master_add.unwrap_or(0xFF),
            ident_high,
            ident_low,
        ]
    }

    /// Reads the first six octets of a diagnosis; `None` where there are fewer.
    pub fn parse(octets: &[u8]) -> Option<Self> {
        let &[one, two, three, master, ident_high, ident_low] = octets.first_chunk::<STANDARD_OCTETS>()?;
        let bit = |octet: u8, number: u8| octet & 1u8.wrapping_shl(u32::from(number)) != 0;
        Some(Self {
            station_not_ready: bit(one, 1),
            cfg_fault: bit(one, 2),
            ext_diag: bit(one, 3),
            not_supported: bit(one, 4),
            prm_fault: bit(one, 6),
            prm_req: bit(two, 0),
            stat_diag: bit(two, 1),
            watchdog_on: bit(two, 3),
            freeze_mode: bit(two, 4),
            sync_mode: bit(two, 5),
            ext_diag_overflow: bit(three, 7),
            master_add: (master != 0xFF).then_some(master),
            ident_number: u16::from_be_bytes([ident_high, ident_low]),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // DP slave reference, section 4.6: typical values.
    #[test]
    fn typical_values_both_ways() {
        let idle = StandardDiagnosis {
            station_not_ready: true,
            prm_req: true,
            ident_number: 0x4711,
            ..Default::default()
        };
        let running = StandardDiagnosis {
            watchdog_on: true,
            master_add: Some(2),
            ident_number: 0x4711,
            ..Default::default()
        };
        for (value, octets) in [
            (idle, [0x02, 0x05, 0x00, 0xFF, 0x47, 0x11]),
            (StandardDiagnosis { prm_fault: true, ..idle }, [0x42, 0x05, 0x00, 0xFF, 0x47, 0x11]),
            (
                StandardDiagnosis { prm_fault: true, not_supported: true, ..idle },
                [0x52, 0x05, 0x00, 0xFF, 0x47, 0x11],
            ),
            (StandardDiagnosis { cfg_fault: true, ..idle }, [0x06, 0x05, 0x00, 0xFF, 0x47, 0x11]),
            (StandardDiagnosis { station_not_ready: true, ..running }, [0x02, 0x0C, 0x00, 0x02, 0x47, 0x11]),
            (running, [0x00, 0x0C, 0x00, 0x02, 0x47, 0x11]),
            (StandardDiagnosis { ext_diag: true, ..running }, [0x08, 0x0C, 0x00, 0x02, 0x47, 0x11]),
            (
                StandardDiagnosis { ext_diag: true, stat_diag: true, ..running },
                [0x08, 0x0E, 0x00, 0x02, 0x47, 0x11],
            ),
            (
                StandardDiagnosis { freeze_mode: true, sync_mode: true, ext_diag_overflow: true, ..running },
                [0x00, 0x3C, 0x80, 0x02, 0x47, 0x11],
            ),
        ] {
            assert_eq!(value.emit(), octets);
            assert_eq!(StandardDiagnosis::parse(&octets), Some(value));
        }
    }
}
