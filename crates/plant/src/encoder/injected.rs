//! What goes wrong with an encoder by request, and how often what happened to it.

use profibus_dp::time::Instant;
use sch108bex::NonvolatileWrite;
use sch108bex::end_cap::TerminationSwitches;
use sch108bex::event::PositionErrorCause;
use sch108bex::nonvolatile::Record;
use serde::Serialize;

use super::EncoderStation;
use crate::report::What;
use crate::shaft::{Coupling, Shaft};
use crate::store::StoreError;

/// What is wrong with an encoder because somebody asked for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Injected {
    /// Its power is switched off, whatever the supply.
    pub switched_off: bool,
    /// The sensor reports a fault at every latch.
    pub sensor_fault: bool,
    /// The next power-on finds the turn count lost, as with an empty battery.
    pub turns_lost_at_power_on: bool,
    /// Writes to the non-volatile memory fail.
    pub writes_fail: bool,
    /// The next power-on finds both records damaged.
    pub memory_lost_at_power_on: bool,
    /// The power goes during the next write to the memory.
    pub torn_write: bool,
    /// So many writes the memory takes, counted as `memory_writes`; `None`: any number.
    pub endurance: Option<u64>,
    /// The cable is cut between it and the master.
    pub cut_off: bool,
    /// It is off the bus, and hears nothing.
    pub off_the_bus: bool,
}

impl Injected {
    /// It hears nothing, and nobody hears it.
    pub(super) const fn is_off(&self) -> bool {
        self.cut_off || self.off_the_bus
    }
}

/// How often what happened to an encoder since it was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct EncoderCounters {
    /// Telegrams that the segment handed to it.
    pub telegrams: u64,
    /// Replies that it handed out.
    pub replies: u64,
    /// Characters that came wrong.
    pub line_errors: u64,
    /// Times that it got power.
    pub power_ons: u64,
    /// Records written.
    pub memory_writes: u64,
    /// Records that could not be written.
    pub memory_writes_failed: u64,
}

/// Why the operating time cannot be set.
#[derive(Debug, thiserror::Error)]
pub enum PresetError {
    /// The device counts on by itself.
    #[error("the operating time can be set only while the encoder has no power: switch it off first")]
    Powered,
    /// There is no record to go on from.
    #[error("both records of the memory are damaged: switch the encoder on once, it starts as delivered")]
    Damaged,
    /// The memory cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The memory cannot be written.
    #[error("the memory cannot be written: {0}")]
    Write(std::io::Error),
}

impl EncoderStation {
    /// What is wrong by request.
    pub fn injected(&self) -> Injected {
        self.injected
    }

    /// What was counted so far.
    pub fn counters(&self) -> EncoderCounters {
        self.counters
    }

    /// Switches the power on or off, without warning. Off it stays until it is switched on again; on
    /// it runs if the supply suffices.
    ///
    /// # Errors
    ///
    /// Switched on: the store cannot be read.
    pub fn switch_power(&mut self, now: Instant, on: bool) -> Result<(), StoreError> {
        self.breathe(now);
        self.latch(now);
        self.injected.switched_off = !on;
        self.set_power(now)
    }

    /// Takes it off the bus or puts it on it; it keeps its power.
    pub fn plug(&mut self, now: Instant, in_place: bool) {
        if self.injected.off_the_bus == in_place {
            self.injected.off_the_bus = !in_place;
            let what = if in_place { What::Joined(self.reachable_at()) } else { What::Left };
            self.setup.reporter.tell(now, what);
        }
    }

    /// The sensor reports a fault (manual 4.2.2): at the latest latch only, or from now on at every
    /// one, also at power-on. While it does, the position stays where it was.
    pub fn sensor_fault(&mut self, now: Instant, held: bool) {
        self.latch(now);
        self.injected.sensor_fault |= held;
        self.position_error(now, PositionErrorCause::SensorFault);
    }

    /// The sensor reports no fault any more. The alarm stays until the next power-on.
    pub fn end_sensor_fault(&mut self, now: Instant) {
        self.latch(now);
        self.injected.sensor_fault = false;
        self.injected.turns_lost_at_power_on = false;
    }

    /// Raises the position error alarm (manual 4.2.2).
    pub fn position_error(&mut self, now: Instant, cause: PositionErrorCause) {
        self.latch(now);
        if let Some(device) = &mut self.device {
            device.position_error(now, cause);
        }
        self.keep(now);
    }

    /// The next power-on finds the turn count lost, as if the battery had been empty.
    pub fn lose_turns(&mut self) {
        self.injected.turns_lost_at_power_on = true;
    }

    /// Whether writes to the memory fail from now on.
    pub fn fail_writes(&mut self, fail: bool) {
        self.injected.writes_fail = fail;
    }

    /// Whether the next power-on finds both records damaged.
    pub fn lose_memory(&mut self, lose: bool) {
        self.injected.memory_lost_at_power_on = lose;
    }

    /// Damages slot A, slot B or both as they are now. It shows at the next power-on, unless a
    /// record was written over it before.
    ///
    /// # Errors
    ///
    /// The system refuses the file.
    pub fn damage_memory(&mut self, slots: [bool; 2]) -> Result<(), StoreError> {
        self.setup.store.damage(slots)
    }

    /// Sets the operating time that is stored, while there is no power.
    ///
    /// # Errors
    ///
    /// There is power, or the memory cannot be used.
    pub fn set_operating_time(&mut self, millis: u64) -> Result<(), PresetError> {
        if self.device.is_some() {
            return Err(PresetError::Powered);
        }
        let change = |record: &mut Record| record.operating_time_ms = millis;
        self.setup.store.rewrite(self.setup.identity.variant, change)
    }

    /// Another movement of the shaft, which begins at `now` where the shaft is.
    pub fn set_shaft_from_here(&mut self, now: Instant, shaft: Shaft) {
        let here = self.setup.shaft.at(now, self.setup.identity.variant);
        self.set_shaft(now, shaft.from(here).started(now));
    }

    /// What turns it.
    pub fn shaft(&self) -> &Shaft {
        &self.setup.shaft
    }

    /// From now on another shaft drives this one through a gear.
    pub fn couple(&mut self, now: Instant, drive: &Shaft, coupling: &Coupling) {
        let variant = self.setup.identity.variant;
        let here = self.setup.shaft.at(now, variant);
        self.set_shaft(now, drive.geared(coupling, now, here, variant));
    }

    /// The shaft jumps to a physical position, and moves on from there as it does.
    pub fn move_shaft_to(&mut self, now: Instant, raw: i64) {
        self.latch(now);
        self.setup.shaft.at_once(now, raw, self.setup.identity.variant);
    }

    /// Whether the power goes during the next write to the memory, and stays off until it is switched on.
    pub fn tear_next_write(&mut self, tear: bool) {
        self.injected.torn_write = tear;
    }

    /// Half of a record gets into its slot, then the power is gone.
    pub(super) fn tear(&mut self, now: Instant, record: &NonvolatileWrite) {
        self.injected.torn_write = false;
        self.injected.switched_off = true;
        self.counters.memory_writes_failed += 1;
        if let Err(error) = self.setup.store.write_half(record) {
            self.setup.reporter.tell(now, What::NotStored(error.to_string().into()));
        }
        self.power_off(now);
    }

    /// How many writes the memory takes before it is worn out, counted from the start.
    pub fn set_endurance(&mut self, writes: Option<u64>) {
        self.injected.endurance = writes;
    }

    /// Whether the cable is cut between the encoder and the master. It keeps its power.
    pub fn cut_off(&mut self, now: Instant, cut: bool) {
        self.latch(now);
        self.injected.cut_off = cut;
        if let Some(device) = &mut self.device {
            device.forget_unfinished();
        }
    }

    /// Its two termination switches (manual 3.3).
    pub fn termination(&self) -> TerminationSwitches {
        self.setup.termination
    }

    /// Turns its termination switches.
    pub fn set_termination(&mut self, switches: TerminationSwitches) {
        self.setup.termination = switches;
    }
}
