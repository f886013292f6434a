//! A board whose clock is in our hand: shaft and world at each latch, power, switches, faults.

use logic::world::{PowerOn, World};
use plant::Shaft;
use profibus_dp::time::{Duration, Instant};
use sch108bex::end_cap::TerminationSwitches;
use sch108bex::health::{Battery, Measurement};
use sch108bex::nonvolatile::{Choice, Record, SLOT_OCTETS, Slot, choose};
use sch108bex::sensor::ShaftReading;
use sch108bex::specification::{LATCH_PERIOD, Variant};

use crate::board::Board;
use crate::emulator::EmulatorError;

/// A board that gets one latch after the other.
#[derive(Debug)]
pub struct Stepped {
    board: Board,
    /// Singleturn and multiturn bits.
    pub variant: Variant,
    /// What turns the shaft, on the clock of [`now`](Self::now).
    pub shaft: Shaft,
    /// What is around it.
    pub measurement: Measurement,
    /// The rotary switches; they count at the next power-on.
    pub switches: u8,
    /// Which of the ten rates, slowest first. It says how long a pause is an idle line: at 9 (12 Mbit/s) a latch,
    /// at 1 (19.2 kbit/s) four of them.
    pub rate: u8,
    /// Latches at which nothing is new go in one message. Not for a board that gets octets meanwhile: it would
    /// get too many latches between two of them.
    pub brief: bool,
    /// The sensor reports a fault at each latch.
    pub sensor_fault: bool,
    /// The next power-on finds the turn count lost.
    pub turns_lost: bool,
    powered_at: Instant,
    /// Latches since then.
    latches: u64,
    now: Instant,
    /// The world of the latest latch.
    told: Option<World>,
}

impl Stepped {
    /// A board without power, at time 0.
    pub fn new(board: Board, variant: Variant, measurement: Measurement) -> Self {
        Self {
            board,
            variant,
            shaft: Shaft::still(0),
            measurement,
            switches: 0x7E,
            rate: 9,
            brief: true,
            sensor_fault: false,
            turns_lost: false,
            powered_at: Instant::ZERO,
            latches: 0,
            now: Instant::ZERO,
            told: None,
        }
    }

    /// The board.
    pub fn board(&self) -> &Board {
        &self.board
    }

    /// The board, to be changed.
    pub fn board_mut(&mut self) -> &mut Board {
        &mut self.board
    }

    /// How far it was brought.
    pub fn now(&self) -> Instant {
        self.now
    }

    /// Latches since power-on.
    pub fn latches(&self) -> u64 {
        self.latches
    }

    /// The instant of the next latch.
    pub fn next_latch(&self) -> Instant {
        self.powered_at + LATCH_PERIOD.times(self.latches)
    }

    /// Power comes now, with the first latch.
    ///
    /// # Errors
    ///
    /// The firmware does not answer.
    pub fn power_on(&mut self) -> Result<(), EmulatorError> {
        let turns_lost = std::mem::take(&mut self.turns_lost);
        self.board.power_on(&PowerOn {
            lock_step: true,
            as_delivered: false,
            paced: false,
            switches: self.switches,
            rate: self.rate,
            search: false,
            battery: if turns_lost { Battery::Empty } else { self.measurement.battery },
            variant: self.variant,
        })?;
        (self.powered_at, self.latches, self.told) = (self.now, 0, None);
        self.advance_to(self.now)
    }

    /// The power is cut now.
    ///
    /// # Errors
    ///
    /// The firmware does not answer.
    pub fn cut(&mut self) -> Result<(), EmulatorError> {
        self.board.cut()
    }

    /// The memory is that of a device as delivered.
    pub fn deliver(&mut self) {
        *self.board.memory_mut() = [None; 2];
    }

    /// All latches up to `until`.
    ///
    /// # Errors
    ///
    /// The firmware does not answer.
    pub fn advance_to(&mut self, until: Instant) -> Result<(), EmulatorError> {
        let mut alike = 0;
        while self.board.is_powered() && self.next_latch() <= until {
            let world = self.world_at(self.next_latch());
            let known = self.brief && self.told == Some(world);
            if !known || alike == u8::MAX {
                self.tell_more(std::mem::take(&mut alike))?;
            }
            if known {
                alike += 1;
            } else {
                self.board.latch(&world)?;
                self.told = Some(world);
            }
            self.latches += 1;
        }
        self.tell_more(alike)?;
        self.now = self.now.max(until);
        Ok(())
    }

    fn tell_more(&mut self, latches: u8) -> Result<(), EmulatorError> {
        if latches == 0 { Ok(()) } else { self.board.more(latches) }
    }

    fn world_at(&mut self, latch: Instant) -> World {
        let counts = self.shaft.at(latch, self.variant);
        let shaft = if self.sensor_fault { ShaftReading::Fault } else { ShaftReading::Full(counts) };
        World { shaft, measurement: self.measurement, termination: TerminationSwitches::ON }
    }

    /// One latch, or without power the time of one.
    ///
    /// # Errors
    ///
    /// The firmware does not answer.
    pub fn step(&mut self) -> Result<(), EmulatorError> {
        let until = if self.board.is_powered() { self.next_latch() } else { self.now + LATCH_PERIOD };
        self.advance_to(until)
    }

    /// Time passes.
    ///
    /// # Errors
    ///
    /// The firmware does not answer.
    pub fn wait(&mut self, span: Duration) -> Result<(), EmulatorError> {
        self.advance_to(self.now + span)
    }

    /// The operating time in the newest record, in milliseconds.
    ///
    /// # Errors
    ///
    /// Both records are damaged.
    pub fn set_operating_time(&mut self, millis: u64) -> Result<(), EmulatorError> {
        let [a, b] = *self.board.memory();
        let content = |slot: Option<[u8; SLOT_OCTETS]>| {
            Record::decode(slot.as_ref().map_or(&[], |octets| octets.as_slice()))
        };
        let (mut record, sequence, slot) = match choose(content(a), content(b)) {
            Choice::Use { record, sequence, slot, .. } => (record, sequence, slot),
            Choice::AsDelivered => (Record::as_delivered(self.variant), 0, Slot::A),
            Choice::Lost { .. } => {
                return Err(EmulatorError::World(
                    "both records of the memory are damaged: switch the board on once".to_owned(),
                ));
            }
        };
        record.operating_time_ms = millis;
        self.board.memory_mut()[usize::from(slot == Slot::B)] = Some(record.encode(sequence));
        Ok(())
    }
}
