//! Velocity and acceleration (manual 4.1.5, 4.3.3), measured over windows of the time base.
//!
//! | time base | window | velocity | acceleration |
//! |---|---|---|---|
//! | 0 | 10 ms | steps per 10 ms | velocity per 10 ms |
//! | 1 | 100 ms | steps per 100 ms | velocity per 100 ms |
//! | 2 | 1000 ms | steps per 1000 ms | velocity per 1000 ms |
//! | 3 | 100 ms | RPM | RPM per second |
//!
//! A value holds until the next window ends. One that does not fit stays at the end of its range.

use core::hint::cold_path;

use profibus_dp::time::{Duration, Instant};

use crate::parameterization::TimeBase;
use crate::scaling::Scaling;

/// How many window boundaries decide velocity and acceleration: the acceleration is the
/// difference of two velocities, so three positions.
const BOUNDARIES_THAT_MATTER: u64 = 3;

/// The measurement of velocity and acceleration.
#[derive(Debug, Clone, Copy)]
pub struct Motion {
    next: Instant,
    time_base: TimeBase,
    history: History,
    velocity: i32,
    acceleration: i32,
}

/// What the windows so far have left.
#[derive(Debug, Clone, Copy)]
enum History {
    /// No sample yet.
    Empty,
    /// One sample: the position at the start of the first window.
    Started { position: i64 },
    /// At least one full window: the latest position, and the latest difference.
    Moving { position: i64, difference: i64 },
}

impl TimeBase {
    /// Reading: a sample of the position follows every 20, 200 or 2000 latches; in RPM mode every
    /// 200, the 100 ms that the manual recommends.
    pub const fn window(self) -> Duration {
        Duration::from_millis(match self {
            Self::Per10Ms => 10,
            Self::Per100Ms | Self::Rpm => 100,
            Self::Per1000Ms => 1000,
        })
    }
}

impl Motion {
    /// No measurement: both values stay 0.
    pub const STOPPED: Self = Self {
        next: Instant::MAX,
        time_base: TimeBase::Per100Ms,
        history: History::Empty,
        velocity: 0,
        acceleration: 0,
    };

    /// Reading: the first sample is the first latch in data exchange, or the first after new
    /// parameters in it; both values are 0 until there are windows for them.
    pub const fn starting(first: Instant, time_base: TimeBase) -> Self {
        Self { next: first, time_base, ..Self::STOPPED }
    }

    /// Ends the measurement; the values stay.
    pub fn stop(&mut self) {
        self.next = Instant::MAX;
    }

    /// The instant of the next sample; [`Instant::MAX`] while stopped.
    #[inline]
    pub const fn next(&self) -> Instant {
        self.next
    }

    /// The unit in force.
    pub const fn time_base(&self) -> TimeBase {
        self.time_base
    }

    /// Positive while the position grows; in steps per time base or RPM (input octets 5-8).
    pub const fn velocity(&self) -> i32 {
        self.velocity
    }

    /// Positive while the velocity grows (input octets 9-12).
    pub const fn acceleration(&self) -> i32 {
        self.acceleration
    }

    /// Takes the latch at `latch`, not before [`Motion::next`], for a sample.
    ///
    /// The first full window gives a velocity, the second an acceleration. A latch that comes late
    /// stands for the boundary that it missed. One that comes later than the boundary after starts
    /// the measurement anew.
    pub fn sample(&mut self, latch: Instant, scaling: &Scaling, physical: i64) {
        let window = self.time_base.window();
        if latch >= self.next + window {
            self.history = History::Empty;
            self.next += window.times(latch.since(self.next).whole(window));
        }
        self.next += window;
        let position = self.position_of(scaling, physical);
        let steps = scaling.variant().singleturn_bits();
        self.history = match self.history {
            History::Empty => {
                (self.velocity, self.acceleration) = (0, 0);
                History::Started { position }
            }
            History::Started { position: before } => {
                let difference = difference(position, before);
                self.velocity = self.velocity_of(difference, steps);
                History::Moving { position, difference }
            }
            History::Moving { position: before, difference: earlier } => {
                let latest = difference(position, before);
                let change = difference(latest, earlier);
                self.velocity = self.velocity_of(latest, steps);
                self.acceleration = self.acceleration_of(change, steps);
                History::Moving { position, difference: latest }
            }
        };
    }

    /// Reading: the velocity is measured on the unwrapped scaled position, so that it never jumps
    /// at a preset, a wrap or the overflow; in RPM mode on the physical one, whatever the scaling.
    fn position_of(&self, scaling: &Scaling, physical: i64) -> i64 {
        match self.time_base {
            TimeBase::Rpm => scaling.directed(physical),
            _ => scaling.unwrapped(physical),
        }
    }

    /// Reading: the velocity is the difference of two samples; in RPM mode it is
    /// `round(d * 600 / 2^n)`.
    fn velocity_of(&self, difference: i64, singleturn_bits: u8) -> i32 {
        match self.time_base {
            TimeBase::Rpm => per_revolution(difference, 600, singleturn_bits),
            _ => saturated(difference),
        }
    }

    /// Reading: the acceleration is the difference of two velocities; in RPM mode it is in RPM per
    /// second, `round((d2 - d1) * 6000 / 2^n)` of the physical differences, not the difference of
    /// the rounded velocities.
    fn acceleration_of(&self, change: i64, singleturn_bits: u8) -> i32 {
        match self.time_base {
            TimeBase::Rpm => per_revolution(change, 6000, singleturn_bits),
            _ => saturated(change),
        }
    }

    /// The earliest boundary, up to the latch at `latest`, that is still to be sampled so that
    /// the values are those of having sampled all of them; `None` if none is due.
    pub fn needed(&self, latest: Instant) -> Option<Instant> {
        if self.next > latest {
            return None;
        }
        let window = self.time_base.window();
        let due = latest.since(self.next).whole(window).saturating_add(1);
        Some(self.next + window.times(due.saturating_sub(BOUNDARIES_THAT_MATTER)))
    }
}

/// Reading: `counts * factor / 2^n` is rounded half away from zero.
fn per_revolution(counts: i64, factor: i32, singleturn_bits: u8) -> i32 {
    // Up to 16; written so that it is seen to be below 32, which makes the shift of 64 bits short.
    let n = u32::from(singleturn_bits & 0x1F);
    // The shift floors. A half more rounds, a half of a negative number towards zero: just below
    // the half it goes the other way.
    let half = 1_i32.wrapping_shl(n.wrapping_sub(1));
    let more = i64::from(half.wrapping_sub(i32::from(counts < 0)));
    let scaled = if let Ok(counts) = i32::try_from(counts) {
        i64::from(counts).wrapping_mul(i64::from(factor)).wrapping_add(more)
    } else {
        cold_path();
        counts.saturating_mul(i64::from(factor)).saturating_add(more)
    };
    saturated(scaled.wrapping_shr(n))
}

/// Reading: values that do not fit into 32 bits stay at the end of the range.
fn saturated(value: i64) -> i32 {
    i32::try_from(value).unwrap_or_else(|_| {
        cold_path();
        if value < 0 { i32::MIN } else { i32::MAX }
    })
}

/// `later - earlier`; stays at the end of the range.
fn difference(later: i64, earlier: i64) -> i64 {
    later.checked_sub(earlier).unwrap_or_else(|| {
        // Not `saturating_sub`, which takes a Cortex-M4 both ways.
        cold_path();
        if later < earlier { i64::MIN } else { i64::MAX }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rounded_half_away_from_zero_and_kept_in_range(
            counts in prop_oneof![any::<i64>(), -0x4_0000_0000_i64..0x4_0000_0000, -70_000_i64..70_000],
            factor in prop_oneof![Just(600), Just(6000)],
            n in 2_u8..=16,
        ) {
            let (size, half) = (i128::from(counts).abs() * i128::from(factor), 1_i128 << (n - 1));
            let rounded = ((size + half) >> n) * i128::from(counts.signum());
            let due = rounded.clamp(i32::MIN.into(), i32::MAX.into());
            prop_assert_eq!(i128::from(per_revolution(counts, factor, n)), due);
        }

        #[test]
        fn a_difference_stays_at_the_end_of_the_range(later in any::<i64>(), earlier in any::<i64>()) {
            prop_assert_eq!(difference(later, earlier), later.saturating_sub(earlier));
        }
    }
}
