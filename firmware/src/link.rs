//! The world link's end: its USART, and the memory that it fills.

use core::mem::MaybeUninit;

use logic::world::{Message, Reader};
use sch108bex::nonvolatile::{SLOT_OCTETS, Slot};

use crate::cell::Latched;

/// The USART of the world link.
pub trait Wire {
    /// The octet that came.
    fn take(&self) -> Option<u8>;
    /// Sends an octet, and waits for room before.
    fn send(&self, octet: u8);
}

/// What came, and the memory.
#[derive(Debug)]
pub struct Link {
    reader: Reader,
    /// Not dealt with yet.
    pub message: Option<Message>,
    /// Both slots.
    pub slots: [[u8; SLOT_OCTETS]; 2],
}

/// The one world link.
pub static LINK: Latched<Link> = Latched::new();

impl Link {
    /// Nothing came, and the memory is empty.
    #[inline(never)]
    pub fn make(place: &mut MaybeUninit<Self>) {
        place.write(Self { reader: Reader::new(), message: None, slots: [[0xFF; SLOT_OCTETS]; 2] });
    }

    /// What a slot holds.
    pub fn slot(&mut self, slot: Slot) -> &mut [u8; SLOT_OCTETS] {
        let [a, b] = &mut self.slots;
        match slot {
            Slot::A => a,
            Slot::B => b,
        }
    }
}

/// The interrupt of its USART.
///
/// # Safety
///
/// Only from interrupts of the latch's priority.
pub unsafe fn interrupt(wire: &impl Wire) {
    // SAFETY: an owner, by the caller.
    let link = unsafe { LINK.own() };
    if let Some(octet) = wire.take()
        && let Some(message) = link.reader.take(octet)
    {
        link.message = Some(message);
    }
}
