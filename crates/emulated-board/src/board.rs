//! The board: an emulator that runs the firmware, its power, its memory and its clock.

use std::path::Path;

use logic::world::{PowerOn, World};
use sch108bex::nonvolatile::{SLOT_OCTETS, Slot};

use crate::emulator::{Emulator, EmulatorError, Setup};
use crate::link::{Done, WorldLink};

/// An emulated board.
///
/// Its memory is here: what the firmware writes is kept, and given back at the next power-on.
#[derive(Debug)]
pub struct Board {
    /// Before the emulator, so that it is dropped first.
    link: WorldLink,
    emulator: Emulator,
    memory: [Option<[u8; SLOT_OCTETS]>; 2],
    powered: bool,
    writes: u64,
    last: Option<Done>,
}

impl Board {
    /// Starts an emulator; the board has no power yet.
    ///
    /// # Errors
    ///
    /// There is no emulator or no image, or the emulator does not come up.
    pub fn start(setup: &Setup) -> Result<Self, EmulatorError> {
        let (emulator, world) = Emulator::start(setup)?;
        let mut link = WorldLink::new(world).map_err(|error| EmulatorError::Socket("world link", error))?;
        link.meet()?;
        Ok(Self { link, emulator, memory: [None; 2], powered: false, writes: 0, last: None })
    }

    /// The socket that a master connects to.
    pub fn bus(&self) -> &Path {
        self.emulator.bus()
    }

    /// What the two slots of the memory hold; `None`: nothing was ever written.
    pub fn memory(&self) -> &[Option<[u8; SLOT_OCTETS]>; 2] {
        &self.memory
    }

    /// The same, to be changed; it counts at the next power-on.
    pub fn memory_mut(&mut self) -> &mut [Option<[u8; SLOT_OCTETS]>; 2] {
        &mut self.memory
    }

    /// How many records were written so far.
    pub fn writes(&self) -> u64 {
        self.writes
    }

    /// Whether it has power.
    pub fn is_powered(&self) -> bool {
        self.powered
    }

    /// What it answered last.
    pub fn last(&self) -> Option<Done> {
        self.last
    }

    /// Power comes, with what the memory holds. The next latch is the first.
    ///
    /// # Errors
    ///
    /// The firmware does not answer.
    pub fn power_on(&mut self, power_on: &PowerOn) -> Result<(), EmulatorError> {
        let as_delivered = self.memory == [None; 2];
        let blank = [0xFF; SLOT_OCTETS];
        if !as_delivered {
            for (slot, octets) in [(Slot::A, self.memory[0]), (Slot::B, self.memory[1])] {
                self.link.memory(slot, &octets.unwrap_or(blank))?;
                self.wait(b'M')?;
            }
        }
        self.link.power_on(&PowerOn { as_delivered, ..*power_on })?;
        self.wait(b'P')?;
        self.powered = true;
        Ok(())
    }

    /// The power is cut without warning.
    ///
    /// # Errors
    ///
    /// The firmware does not answer.
    pub fn cut(&mut self) -> Result<(), EmulatorError> {
        self.link.cut()?;
        self.wait(b'C')?;
        self.powered = false;
        Ok(())
    }

    /// The world at the next latch, or where the board counts time by itself, as of now.
    ///
    /// # Errors
    ///
    /// The firmware does not answer.
    pub fn latch(&mut self, world: &World) -> Result<(), EmulatorError> {
        self.link.latch(world)?;
        self.wait(b'L')
    }

    /// So many latches more, 1 to 255, with the world of the last.
    ///
    /// # Errors
    ///
    /// The firmware does not answer.
    pub fn more(&mut self, latches: u8) -> Result<(), EmulatorError> {
        self.link.more(latches)?;
        self.wait(b'T')
    }

    fn wait(&mut self, kind: u8) -> Result<(), EmulatorError> {
        let Self { link, memory, writes, .. } = self;
        let done = link.done(kind, |slot, octets| {
            memory[usize::from(slot == Slot::B)] = Some(octets);
            *writes += 1;
        })?;
        self.last = Some(done);
        Ok(())
    }
}
