//! Set_Slave_Add (SAP 55): a new station address over the bus.
//!
//! | octet | name |
//! |-------|------|
//! | 1 | New_Slave_Add |
//! | 2, 3 | Ident_Number, high octet first |
//! | 4 | No_Add_Chg: other than 0, the master wants no change to be possible after this |
//! | 5.. | Rem_Slave_Data, for the device to keep |

/// A Set_Slave_Add of at least four octets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SetSlaveAdd<'a> {
    /// Octet 1.
    #[doc(alias = "New_Slave_Add")]
    pub new_address: u8,
    /// Octets 2 and 3.
    #[doc(alias = "Ident_Number")]
    pub ident_number: u16,
    /// Octet 4: whether the master wants a later change to be impossible.
    ///
    /// Reading "No_Add_Chg": accepted and without effect, or a slip would lock the device for ever.
    #[doc(alias = "No_Add_Chg")]
    pub no_further_change: bool,
    /// Octets 5 on, 0 to 240.
    #[doc(alias = "Rem_Slave_Data")]
    pub remanent_data: &'a [u8],
}

impl<'a> SetSlaveAdd<'a> {
    /// The least a Set_Slave_Add must hold.
    pub const LEAST_OCTETS: usize = 4;

    /// Reads the data unit; `None` where it has fewer than four octets.
    pub fn parse(octets: &'a [u8]) -> Option<Self> {
        let (&[new_address, ident_high, ident_low, no_change], remanent_data) = octets.split_first_chunk()?;
        Some(Self {
            new_address,
            ident_number: u16::from_be_bytes([ident_high, ident_low]),
            no_further_change: no_change != 0,
            remanent_data,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // DP slave reference, section 3.5: 126 becomes 11; manual 3.4 for the last field.
    #[test]
    fn the_example_of_the_reference_reads_as_told() {
        let read = SetSlaveAdd::parse(&[0x0B, 0x47, 0x11, 0x00]).expect("long enough");
        assert_eq!((read.new_address, read.ident_number, read.no_further_change), (11, 0x4711, false));
        assert!(read.remanent_data.is_empty());
        let locked = SetSlaveAdd::parse(&[0x2A, 0x10, 0x8B, 0xFF, 1, 2]).expect("long enough");
        assert!(locked.no_further_change);
        assert_eq!(locked.remanent_data, [1, 2]);
        assert_eq!(SetSlaveAdd::parse(&[0x0B, 0x47, 0x11]), None);
    }
}
