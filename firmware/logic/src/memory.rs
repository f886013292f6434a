//! Records in a 24-series EEPROM or FRAM on I2C: page by page, so that each piece is short.
//!
//! Slot A is at 0000h, slot B at 0040h: each begins a page of 64 octets, and two of 32.

use sch108bex::nonvolatile::{SLOT_OCTETS, Slot};

/// Octets of a page: the smallest of the parts with 16-bit addresses (24x32 and larger).
pub const PAGE: usize = 32;
/// From slot to slot.
const SLOT_DISTANCE: u16 = 64;

/// Where a slot begins.
pub const fn address(slot: Slot) -> u16 {
    match slot {
        Slot::A => 0,
        Slot::B => SLOT_DISTANCE,
    }
}

/// A record on its way into the memory.
#[derive(Debug, Clone)]
pub struct Writing {
    slot: Slot,
    octets: [u8; SLOT_OCTETS],
    done: usize,
}

/// A piece: what goes over I2C in one transfer, address first, and never over the end of a page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Piece<'a> {
    /// The address in the memory, high octet first on the wire.
    pub address: u16,
    /// What is written there.
    pub octets: &'a [u8],
}

impl Writing {
    /// Nothing is written yet.
    pub const fn new(slot: Slot, octets: [u8; SLOT_OCTETS]) -> Self {
        Self { slot, octets, done: 0 }
    }

    /// The piece that is due; `None`: the record is written.
    pub fn piece(&self) -> Option<Piece<'_>> {
        let rest = self.octets.get(self.done..).filter(|rest| !rest.is_empty())?;
        let octets = rest.get(..PAGE.min(rest.len()))?;
        let done = u16::try_from(self.done).ok()?;
        Some(Piece { address: address(self.slot).wrapping_add(done), octets })
    }

    /// The memory has taken the piece.
    pub fn taken(&mut self) {
        self.done = self.done.saturating_add(PAGE);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    #[test]
    fn a_record_is_written_whole_and_no_piece_crosses_a_page() {
        let mut octets = [0; SLOT_OCTETS];
        for (number, octet) in (1..).zip(&mut octets) {
            *octet = number;
        }
        for (slot, start) in [(Slot::A, 0_usize), (Slot::B, 64)] {
            let mut memory = [0xFF_u8; 128];
            let mut pieces = Vec::new();
            let mut writing = Writing::new(slot, octets);
            while let Some(piece) = writing.piece() {
                let at = usize::from(piece.address);
                let last = at + piece.octets.len() - 1;
                assert_eq!(at / 32, last / 32, "inside one page");
                memory[at..=last].copy_from_slice(piece.octets);
                pieces.push(piece.octets.len());
                writing.taken();
            }
            assert_eq!(pieces, [32, 8]);
            assert_eq!(memory[start..start + 40], octets);
            assert!(memory[..start].iter().chain(&memory[start + 40..]).all(|octet| *octet == 0xFF));
        }
    }
}
