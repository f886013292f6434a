//! The memory that a device writes into, octet by octet, and what a cut leaves of it.

use sch108bex::NonvolatileWrite;
use sch108bex::nonvolatile::{Choice, Record, SLOT_OCTETS, Slot, choose};

/// Both slots as they lie there. Blank octets are FFh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct E2prom(pub(crate) [u8; 2 * SLOT_OCTETS]);

/// What the octet that was being written when the power went is like.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Torn {
    /// Not begun.
    Untouched,
    /// Erased, not programmed.
    Erased,
    /// Some bits are the new ones, some the old ones.
    Mixed,
    /// Neither.
    Garbage,
}

impl Torn {
    pub(crate) const ALL: [Self; 4] = [Self::Untouched, Self::Erased, Self::Mixed, Self::Garbage];
}

impl E2prom {
    pub(crate) const BLANK: Self = Self([0xFF; 2 * SLOT_OCTETS]);

    pub(crate) fn choice(&self) -> Choice {
        let (a, b) = self.0.split_at(SLOT_OCTETS);
        choose(Record::decode(a), Record::decode(b))
    }

    fn start(slot: Slot) -> usize {
        if slot == Slot::A { 0 } else { SLOT_OCTETS }
    }

    pub(crate) fn slot_mut(&mut self, slot: Slot) -> &mut [u8] {
        let start = Self::start(slot);
        &mut self.0[start..start + SLOT_OCTETS]
    }

    pub(crate) fn written(mut self, write: &NonvolatileWrite) -> Self {
        self.slot_mut(write.slot).copy_from_slice(&write.octets);
        self
    }

    /// The power goes when so many octets of the write are done.
    pub(crate) fn cut(mut self, write: &NonvolatileWrite, done: usize, torn: Torn) -> Self {
        let slot = self.slot_mut(write.slot);
        slot[..done].copy_from_slice(&write.octets[..done]);
        if let (Some(old), Some(new)) = (slot.get_mut(done), write.octets.get(done)) {
            *old = match torn {
                Torn::Untouched => *old,
                Torn::Erased => 0xFF,
                Torn::Mixed => (*old & 0x0F) | (*new & 0xF0),
                Torn::Garbage => !*new,
            };
        }
        self
    }
}
