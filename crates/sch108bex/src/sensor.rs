//! The shaft as the disc reads it (manual 4.2.4 to 4.2.6), latch by latch.

use profibus_dp::time::{Duration, Instant};

use crate::event::PositionErrorCause;
use crate::specification::{LATCH_PERIOD, Variant};

/// Reading: a step of more than a quarter turn is a position error between singleturn samples at
/// most so far apart.
const STEP_JUDGED_WITHIN: Duration = Duration::from_millis(1);

/// What the sensor delivers at a latch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ShaftReading {
    /// The whole position in physical counts, turns included, no range applied: a virtual shaft.
    /// Clockwise is positive.
    Full(i64),
    /// The angle within a turn, 0 to 2^n - 1: a real disc. The core counts the turns.
    Singleturn(u16),
    /// The sensor says that it cannot read. The position stays where it was.
    Fault,
}

/// Where the shaft is, and when it was last looked at.
#[derive(Debug, Clone, Copy)]
pub struct Sensor {
    next: Instant,
    physical: i64,
    /// Subtracted from a full reading, whole turns.
    base: i64,
    turn_base: i32,
    start: Start,
    variant: Variant,
}

/// What the first reading after power-on is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Start {
    /// It goes on with the turn count from before.
    Continue,
    /// There is no turn count from before: the device is as delivered, in turn 0.
    AsDelivered,
    /// The turn count is lost: it restarts at 0.
    RestartTurns,
    /// There was one.
    Done,
}

/// A latch that is due.
#[derive(Debug, Clone, Copy)]
pub struct Latch {
    /// Its instant: the latest of the grid.
    pub at: Instant,
    /// Whether the sample before was close enough to judge the step between.
    judged: bool,
}

/// What became of a reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Taken {
    /// The position is the new one.
    Position,
    /// It is, and the turn count was restarted by it.
    TurnsRestarted,
    /// There is or may be a wrong position.
    Doubtful(PositionErrorCause),
}

impl Sensor {
    /// The sensor at power-on. `turn_base` and `raw` are those of the non-volatile record.
    pub fn new(
        power_on: Instant,
        variant: Variant,
        turn_base: i32,
        raw: Option<u32>,
        turns_lost: bool,
    ) -> Self {
        let start = match raw {
            _ if turns_lost => Start::RestartTurns,
            Some(_) => Start::Continue,
            None => Start::AsDelivered,
        };
        let (physical, base) = (i64::from(raw.unwrap_or(0)), turns(turn_base, variant));
        Self { next: power_on, physical, base, turn_base, start, variant }
    }

    /// The instant of the next latch.
    pub const fn next(&self) -> Instant {
        self.next
    }

    /// The position of the latest latch in physical counts, no range applied.
    #[inline]
    pub const fn physical(&self) -> i64 {
        self.physical
    }

    /// The position of the latest latch in physical counts; only the lower `n + m` bits count.
    #[inline]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "lower bits")]
    pub const fn raw(&self) -> u32 {
        self.physical as u32
    }

    /// Turns of the shaft that count as turn 0.
    pub const fn turn_base(&self) -> i32 {
        self.turn_base
    }

    /// The position of the latest latch, 0 to 2^(n+m) - 1, before the first the one that was
    /// kept; `None` if none is known.
    pub fn known_raw(&self) -> Option<u32> {
        let known = matches!(self.start, Start::Done | Start::Continue);
        known.then(|| self.raw() & self.variant.total().wrapping_sub(1))
    }

    /// Whether the turn count is lost and not yet restarted: no latch has been since power-on.
    pub fn turns_lost(&self) -> bool {
        self.start == Start::RestartTurns
    }

    /// Whether there was a good reading since power-on.
    pub fn is_started(&self) -> bool {
        self.start == Start::Done
    }

    /// Takes the reading of the next latch if there is nothing special about it; says no, and does
    /// nothing, for a fault or a doubtful step. Not for the first one, nor after skipped ones.
    #[inline]
    pub fn take_ordinary(&mut self, reading: ShaftReading) -> bool {
        self.physical = match reading {
            ShaftReading::Full(counts) => counts.wrapping_sub(self.base),
            ShaftReading::Singleturn(angle) => {
                let step = self.step_to(angle);
                if step.unsigned_abs() > self.quarter_turn() {
                    return false;
                }
                self.physical.wrapping_add(i64::from(step))
            }
            ShaftReading::Fault => return false,
        };
        self.next += LATCH_PERIOD;
        true
    }

    /// The latest latch at or before `now`, where one is due. Latches before it are skipped.
    pub fn due(&mut self, now: Instant) -> Latch {
        let expected = self.next;
        self.next = expected + LATCH_PERIOD;
        if now < self.next {
            return Latch { at: expected, judged: LATCH_PERIOD <= STEP_JUDGED_WITHIN };
        }
        let at = latest_latch(expected, now);
        self.next = at + LATCH_PERIOD;
        Latch { at, judged: at.since(expected) + LATCH_PERIOD <= STEP_JUDGED_WITHIN }
    }

    /// Takes the reading of any latch.
    pub fn take(&mut self, latch: Latch, reading: ShaftReading) -> Taken {
        if !self.is_started() {
            return self.take_first(reading);
        }
        match reading {
            ShaftReading::Full(counts) => self.physical = counts.wrapping_sub(self.base),
            ShaftReading::Singleturn(angle) => {
                let step = self.step_to(angle);
                self.physical = self.physical.wrapping_add(i64::from(step));
                if latch.judged && step.unsigned_abs() > self.quarter_turn() {
                    return Taken::Doubtful(PositionErrorCause::ImplausibleStep);
                }
            }
            ShaftReading::Fault => return Taken::Doubtful(PositionErrorCause::SensorFault),
        }
        Taken::Position
    }

    /// Physical counts of a quarter turn.
    #[inline]
    fn quarter_turn(&self) -> u32 {
        self.variant.steps_per_revolution() >> 2
    }

    /// The shorter way from the latest position to `angle`, at most half a turn.
    #[inline]
    fn step_to(&self, angle: u16) -> i32 {
        // At the top of 32 bits the difference has the sign of the shorter way.
        let shift = 32_u32.wrapping_sub(u32::from(self.variant.singleturn_bits()));
        let difference = u32::from(angle).wrapping_sub(self.raw()).wrapping_shl(shift);
        difference.cast_signed().wrapping_shr(shift)
    }

    /// The first reading after power-on.
    #[cold]
    fn take_first(&mut self, reading: ShaftReading) -> Taken {
        let restart = self.turns_lost();
        match reading {
            ShaftReading::Full(counts) => {
                if restart {
                    let n = u32::from(self.variant.singleturn_bits());
                    self.turn_base = lower_32(counts.wrapping_shr(n));
                    self.base = turns(self.turn_base, self.variant);
                }
                self.physical = counts.wrapping_sub(self.base);
            }
            ShaftReading::Singleturn(angle) if self.start != Start::Continue => {
                self.physical = self.within(angle);
            }
            ShaftReading::Singleturn(angle) => {
                let step = i64::from(self.step_to(angle));
                self.physical = self.physical.wrapping_add(step);
            }
            ShaftReading::Fault => return Taken::Doubtful(PositionErrorCause::SensorFault),
        }
        self.start = Start::Done;
        if restart { Taken::TurnsRestarted } else { Taken::Position }
    }

    /// An angle within turn 0.
    fn within(&self, angle: u16) -> i64 {
        i64::from(u32::from(angle) & self.variant.steps_per_revolution().wrapping_sub(1))
    }
}

/// The latest latch of the grid at or before `now`, which is not before the latch `known`.
pub(crate) fn latest_latch(known: Instant, now: Instant) -> Instant {
    if now < known + LATCH_PERIOD {
        return known;
    }
    known + LATCH_PERIOD.times(now.since(known).whole(LATCH_PERIOD))
}

/// Whole turns in physical counts.
fn turns(turns: i32, variant: Variant) -> i64 {
    i64::from(turns).wrapping_shl(u32::from(variant.singleturn_bits()))
}

#[expect(clippy::cast_possible_truncation, reason = "a turn count matters in its lower bits only")]
const fn lower_32(value: i64) -> i32 {
    value as i32
}
