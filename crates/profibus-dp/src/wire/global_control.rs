//! Global_Control (SAP 58): a command to groups of slaves, never answered.
//!
//! | octet | content |
//! |-------|---------|
//! | 1 | bit 1 Clear_Data, 2 Unfreeze, 3 Freeze, 4 Unsync, 5 Sync; 0, 6, 7 reserved |
//! | 2 | Group_Select; 0 = all, else bit n: group n + 1 |

/// A Global_Control without a fault: two octets, reserved bits 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GlobalControl {
    /// Octet 1 bit 1: outputs to 0.
    #[doc(alias = "Clear_Data")]
    pub clear_data: bool,
    /// Octet 1 bits 2, 3.
    pub freeze: ModeCommand,
    /// Octet 1 bits 4, 5.
    pub sync: ModeCommand,
    /// Octet 2.
    #[doc(alias = "Group_Select")]
    pub group_select: u8,
}

/// What Global_Control wants of Sync or Freeze.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModeCommand {
    /// Neither bit: leave it.
    Leave,
    /// Sync or Freeze alone: begin, or pass on once more.
    Activate,
    /// Unsync or Unfreeze, whatever the other bit says.
    Deactivate,
}

impl ModeCommand {
    const fn of(activate: bool, deactivate: bool) -> Self {
        match (deactivate, activate) {
            (true, _) => Self::Deactivate,
            (false, true) => Self::Activate,
            (false, false) => Self::Leave,
        }
    }
}

impl GlobalControl {
    const RESERVED: u8 = 0b1100_0001;

    /// Reads the data unit; `None` where it has not two octets or a reserved bit is set.
    pub fn parse(octets: &[u8]) -> Option<Self> {
        let &[command, group_select] = octets else {
            return None;
        };
        (command & Self::RESERVED == 0).then_some(Self {
            clear_data: command & 0x02 != 0,
            freeze: ModeCommand::of(command & 0x08 != 0, command & 0x04 != 0),
            sync: ModeCommand::of(command & 0x20 != 0, command & 0x10 != 0),
            group_select,
        })
    }

    /// Whether a slave with this Group_Ident is meant.
    pub const fn addresses(&self, group_ident: u8) -> bool {
        self.group_select == 0 || self.group_select & group_ident != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // DP slave reference, section 4.10.
    #[test]
    fn the_combinations_of_the_reference() {
        let command = |octet| GlobalControl::parse(&[octet, 0]).expect("no reserved bit");
        assert_eq!(command(0x00).sync, ModeCommand::Leave);
        assert_eq!(command(0x20).sync, ModeCommand::Activate);
        assert_eq!(command(0x10).sync, ModeCommand::Deactivate);
        assert_eq!(command(0x30).sync, ModeCommand::Deactivate);
        assert_eq!(command(0x08).freeze, ModeCommand::Activate);
        assert_eq!(command(0x04).freeze, ModeCommand::Deactivate);
        assert_eq!(command(0x0C).freeze, ModeCommand::Deactivate);
        assert!(command(0x02).clear_data && !command(0x20).clear_data);
    }

    #[test]
    fn reserved_bits_and_other_lengths_are_refused() {
        for octets in [&[0x01, 0][..], &[0x40, 0], &[0x80, 0], &[0x02], &[0x02, 0, 0], &[]] {
            assert_eq!(GlobalControl::parse(octets), None, "{octets:?}");
        }
    }

    #[test]
    fn groups_are_bits_and_not_numbers() {
        let select = |group_select| GlobalControl {
            clear_data: true,
            freeze: ModeCommand::Leave,
            sync: ModeCommand::Leave,
            group_select,
        };
        assert!(select(0).addresses(0));
        assert!(!select(1).addresses(0));
        assert!(select(0b0110).addresses(0b0100));
        assert!(!select(3).addresses(0b0100));
    }
}
