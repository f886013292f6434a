//! Movements beyond constant speed, as functions of time.
//!
//! The same on every computer: whole nanoseconds, whole numbers for chance, and for the rest only
//! `+ - * /` and square roots of 64-bit floating point numbers, which IEEE 754 rounds alike
//! everywhere; no sine or other function of a mathematical library. A position that lies within
//! 1/4096 of a count below a whole count counts as that, so that what is whole on paper is whole here.

#![expect(
    clippy::cast_precision_loss,
    reason = "what needs more than 53 bits is worked out in whole numbers"
)]

use std::sync::Arc;

use super::pieces::{Pieces, SECOND};
use super::walk::{Walk, Walked};
use crate::machine::Machine;

/// Positions so close below a whole count are taken for it.
const ALMOST: f64 = 1.0 / 4096.0;

/// The way of a shaft before gears and play.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Path {
    /// Constant speed in millionths of a revolution per minute.
    Turning(i64),
    /// In pieces.
    Pieces(Pieces),
    /// To and fro, upwards first.
    Sine { amplitude: f64, period: u64 },
    /// By chance.
    Walk(Walk),
}

/// A shaking on top, in turns of the encoder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Vibration {
    pub(super) amplitude: f64,
    pub(super) period: u64,
}

/// What comes on top of a path, in turns of the encoder.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Overlay {
    /// The play between the machine and the encoder: half of it to each side.
    pub(super) half_play: f64,
    pub(super) vibration: Option<Vibration>,
}

/// A movement with all that belongs to it; never changes.
#[derive(Debug)]
pub(super) struct Plan {
    pub(super) path: Arc<Path>,
    /// What the path is in units of; `None`: in turns.
    pub(super) machine: Option<Machine>,
    /// Turns of the encoder for one of the machine's, as a fraction.
    pub(super) gear: (i64, i64),
    /// The same as a number.
    ratio: f64,
    pub(super) overlay: Overlay,
    /// It never turns faster than so many turns a second.
    fastest: f64,
    /// Where the encoder is at the start of each piece, with play: the first time and later ones.
    slack: [Vec<f64>; 2],
    /// As a user writes it.
    pub(super) text: String,
}

/// A plan, and where in it was looked last.
#[derive(Debug, Clone)]
pub(super) struct Moving {
    pub(super) plan: Arc<Plan>,
    cursor: Cursor,
}

#[derive(Debug, Clone, Copy, Default)]
struct Cursor {
    piece: usize,
    walked: Walked,
}

impl PartialEq for Moving {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.plan, &other.plan) || self.plan.text == other.plan.text
    }
}

impl Eq for Moving {}

impl Plan {
    pub(super) fn new(
        path: Arc<Path>,
        machine: Option<Machine>,
        gear: (i64, i64),
        overlay: Overlay,
        text: String,
    ) -> Self {
        let ratio = gear.0 as f64 / gear.1 as f64;
        let slack = [const { Vec::new() }; 2];
        let mut plan = Self { path, machine, gear, ratio, overlay, fastest: 0.0, slack, text };
        plan.fastest = plan.fastest();
        if overlay.half_play > 0.0 {
            plan.slack = plan.slacks();
        }
        plan
    }

    /// Goes through all pieces twice: after that it is the same every time.
    fn slacks(&self) -> [Vec<f64>; 2] {
        let (starts, repeats) = match &*self.path {
            Path::Pieces(pieces) => pieces.turns(),
            Path::Sine { amplitude, .. } => (vec![0.0, *amplitude, -amplitude], true),
            Path::Turning(_) => (vec![0.0], false),
            Path::Walk(_) => return [const { Vec::new() }; 2],
        };
        let starts: Vec<_> = starts.into_iter().map(|units| self.turned::<false>(units, 0.0).0).collect();
        let mut at = starts.first().copied().unwrap_or(0.0);
        let mut once = || -> Vec<f64> {
            let through = starts.iter().map(|&turns| {
                at = self.overlay.follow(at, turns);
                at
            });
            through.collect()
        };
        let first = once();
        let later = if repeats { once() } else { first.clone() };
        [first, later]
    }

    /// Turns of the encoder, and with `SPEED` turns a second, from what the path is in.
    #[inline]
    fn turned<const SPEED: bool>(&self, units: f64, speed: f64) -> (f64, f64) {
        match &self.machine {
            None => (units * self.ratio, speed * self.ratio),
            Some(machine) => {
                let turns = machine.turns(units) * self.ratio;
                if !SPEED {
                    return (turns, 0.0);
                }
                (turns, speed * machine.turns_per_unit(units) * self.ratio)
            }
        }
    }

    /// A bound of the speed, in turns of the encoder a second.
    fn fastest(&self) -> f64 {
        /// What roundings, and the series of the sine, may add.
        const ALLOWANCE: f64 = 1.0 + 1e-9;
        let around = |amplitude: f64, period| circling(amplitude, period).abs();
        let path = match &*self.path {
            Path::Turning(micro) => (*micro as f64 / 60e6).abs(),
            Path::Pieces(pieces) => pieces.fastest(),
            Path::Sine { amplitude, period } => around(*amplitude, *period),
            Path::Walk(walk) => walk.fastest(),
        };
        let machine = self.machine.as_ref().map_or(1.0, Machine::most_turns_per_unit);
        let vibration =
            self.overlay.vibration.map_or(0.0, |shaking| around(shaking.amplitude, shaking.period));
        (path * machine * self.ratio.abs() + vibration) * ALLOWANCE
    }
}

impl Overlay {
    /// Where the far side of the play is when the near side has gone to `to` without turning round.
    fn follow(&self, far: f64, to: f64) -> f64 {
        far.clamp(to - self.half_play, to + self.half_play)
    }
}

impl Moving {
    pub(super) fn new(plan: Plan) -> Self {
        Self { plan: Arc::new(plan), cursor: Cursor::default() }
    }

    /// It never turns faster than so many revolutions per minute.
    #[inline]
    pub(super) fn most_rpm(&self) -> f64 {
        self.plan.fastest * 60.0
    }

    /// Turns from the start, and turns a second, after so many nanoseconds.
    pub(super) fn after(&mut self, nanos: u64) -> (f64, f64) {
        self.look::<true>(nanos)
    }

    /// The same; without `SPEED`, whose speed is then none, in half the time.
    #[inline]
    fn look<const SPEED: bool>(&mut self, nanos: u64) -> (f64, f64) {
        let Self { plan, cursor } = self;
        let overlay = plan.overlay;
        let (near, speed, far) = match &*plan.path {
            Path::Turning(micro) => {
                let turns = (i128::from(*micro) * i128::from(nanos)) as f64 / (60.0 * SECOND * 1e6);
                let (turns, speed) = plan.turned::<SPEED>(turns, *micro as f64 / 60e6);
                (turns, speed, plan.slack[0].first().copied())
            }
            Path::Pieces(pieces) => {
                let (repetition, piece, into) = pieces.find(nanos, cursor.piece);
                cursor.piece = piece;
                let (units, speed) = pieces.look(piece, into);
                let (turns, speed) = plan.turned::<SPEED>(units, speed);
                (turns, speed, plan.slack[usize::from(repetition > 0)].get(piece).copied())
            }
            Path::Sine { amplitude, period } => {
                let phase = (nanos % period) as f64 / *period as f64;
                let speed = if SPEED { circling(*amplitude, *period) * sine(phase + 0.25) } else { 0.0 };
                let (turns, speed) = plan.turned::<SPEED>(amplitude * sine(phase), speed);
                let piece = usize::from(phase >= 0.25) + usize::from(phase >= 0.75);
                (turns, speed, plan.slack[usize::from(nanos >= *period)].get(piece).copied())
            }
            Path::Walk(walk) => {
                let follow = |far, turns| overlay.follow(far, plan.turned::<false>(turns, 0.0).0);
                let (turns, speed) = walk.after(nanos, &mut cursor.walked, follow);
                let (turns, speed) = plan.turned::<SPEED>(turns, speed);
                (turns, speed, Some(cursor.walked.far))
            }
        };
        let (turns, speed) = match far {
            // Within the play the encoder stands still.
            Some(far) if overlay.half_play > 0.0 && (far - near).abs() <= overlay.half_play => (far, 0.0),
            Some(far) if overlay.half_play > 0.0 => (overlay.follow(far, near), speed),
            _ => (near, speed),
        };
        match overlay.vibration {
            None => (turns, speed),
            Some(vibration) => vibration.on_top::<SPEED>(nanos, turns, speed),
        }
    }

    /// Counts from the start.
    #[inline]
    pub(super) fn counts(&mut self, nanos: u64, steps: u32) -> i64 {
        floor(self.look::<false>(nanos).0 * f64::from(steps) + ALMOST)
    }
}

/// The whole number at or below; saturates, and what is no number is 0. A mathematical library is asked for
/// that where the processor's instruction may not be there, which costs more than the rest.
#[inline]
#[expect(clippy::cast_possible_truncation, reason = "saturates")]
fn floor(number: f64) -> i64 {
    let towards_0 = number as i64;
    towards_0.saturating_sub(i64::from(towards_0 as f64 > number))
}

impl Vibration {
    fn on_top<const SPEED: bool>(&self, nanos: u64, turns: f64, speed: f64) -> (f64, f64) {
        let phase = (nanos % self.period) as f64 / self.period as f64;
        let turns = turns + self.amplitude * sine(phase);
        if !SPEED {
            return (turns, 0.0);
        }
        (turns, speed + circling(self.amplitude, self.period) * sine(phase + 0.25))
    }
}

/// The highest speed of a sine, a second, with this period in nanoseconds.
fn circling(amplitude: f64, period: u64) -> f64 {
    2.0 * std::f64::consts::PI * amplitude * SECOND / period as f64
}

/// The sine of a part of a full circle from 0 to 1.25, to within 1e-13.
fn sine(phase: f64) -> f64 {
    /// 1 / (2 3), 1 / (4 5) and so on: each term of the series from the one before.
    const NEXT: [f64; 8] =
        [1.0 / 6.0, 1.0 / 20.0, 1.0 / 42.0, 1.0 / 72.0, 1.0 / 110.0, 1.0 / 156.0, 1.0 / 210.0, 1.0 / 272.0];
    let quarters = if phase >= 1.0 { phase - 1.0 } else { phase } * 4.0;
    // Downhill is uphill from the other side.
    let quarter = match quarters {
        first if first < 1.0 => first,
        downhill if downhill < 3.0 => 2.0 - downhill,
        last => last - 4.0,
    };
    let angle = quarter * std::f64::consts::FRAC_PI_2;
    let square = angle * angle;
    let series = NEXT.iter().rev().fold(1.0, |rest, next| 1.0 - square * next * rest);
    angle * series
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sine_is_a_sine() {
        for step in 0..=1_000 {
            let phase = f64::from(step) / 800.0;
            let due = (phase * 2.0 * std::f64::consts::PI).sin();
            assert!((sine(phase) - due).abs() < 1e-13, "{phase}: {} {due}", sine(phase));
        }
    }

    fn moving(path: Path, play: f64) -> Moving {
        let overlay = Overlay { half_play: play / 2.0, vibration: None };
        Moving::new(Plan::new(Arc::new(path), None, (1, 1), overlay, String::new()))
    }

    // One turn to each side in 4 s, with play of half a turn: a quarter to each side.
    #[test]
    fn play_makes_the_encoder_wait_after_each_turn_round() {
        let mut sine = moving(Path::Sine { amplitude: 1.0, period: 4_000_000_000 }, 0.5);
        let mut at = |millis: u64| sine.after(millis * 1_000_000);
        assert_eq!(at(0), (0.0, 0.0));
        assert_eq!(at(10), (0.0, 0.0), "the play is taken up first");
        assert!((at(1_000).0 - 0.75).abs() < 1e-12);
        assert_eq!(at(1_100), (0.75, 0.0), "and again after the turn round");
        // Half way back the machine is at 0 and pushes with the other side of the play.
        assert!((at(2_000).0 - 0.25).abs() < 1e-12);
        assert!((at(3_000).0 + 0.75).abs() < 1e-12);
        assert!((at(4_000).0 + 0.25).abs() < 1e-12, "the second round begins in the play");
        assert!((at(5_000).0 - 0.75).abs() < 1e-12);
    }

    // All instants or only some: nothing depends on who has asked before.
    #[test]
    fn a_position_does_not_depend_on_what_was_asked_before() {
        let walk = Walk::new(60.0, 10_000_000, 7, Some(3.0));
        let mut often = moving(Path::Walk(walk.clone()), 0.01);
        let mut seldom = moving(Path::Walk(walk), 0.01);
        for step in 0..=20_000_u64 {
            let found = often.after(step * 1_234_567);
            if step % 997 == 0 {
                assert_eq!(seldom.after(step * 1_234_567), found, "{step}");
            }
        }
        let back = seldom.after(5_000_000_000);
        assert_eq!(often.after(5_000_000_000), back);
    }
}
