//! A random walk: after equal spans of time another speed, by chance from a seed.

#![expect(
    clippy::cast_precision_loss,
    reason = "what needs more than 53 bits is worked out in whole numbers"
)]

use super::pieces::SECOND;

/// Speeds are whole 2^31st parts of the highest one.
const WHOLE: f64 = 2_147_483_648.0;

/// A walk in turns.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Walk {
    /// Turns in one span at the highest speed.
    step: f64,
    span: u64,
    seed: u64,
    /// A step that would leave this range, in parts of a step, goes the other way.
    within: i64,
}

/// How far a walk has been followed: to the start of the span with this number.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Walked {
    span: u64,
    at: i64,
    /// The far side of the play there.
    pub(super) far: f64,
}

impl Walk {
    /// Speeds up to `rpm` either way, another one after each span of nanoseconds, and at most `within`
    /// turns from the start.
    #[expect(clippy::cast_possible_truncation, reason = "saturates")]
    pub(super) fn new(rpm: f64, span: u64, seed: u64, within: Option<f64>) -> Self {
        let step = rpm / 60.0 * (span as f64 / SECOND);
        let within = within.map_or(i64::MAX / 4, |turns| (turns / step * WHOLE).floor() as i64);
        Self { step, span, seed, within }
    }

    /// The turns in a span at the highest speed.
    pub(super) fn step(&self) -> f64 {
        self.step
    }

    /// The highest speed there is, either way, in turns a second.
    pub(super) fn fastest(&self) -> f64 {
        (self.step * SECOND / self.span as f64).abs()
    }

    /// Position and speed. `follow` says where the far side of the play is after each span.
    pub(super) fn after(
        &self,
        nanos: u64,
        walked: &mut Walked,
        follow: impl Fn(f64, f64) -> f64,
    ) -> (f64, f64) {
        let span = nanos / self.span;
        if walked.span > span {
            *walked = Walked::default();
        }
        while walked.span < span {
            walked.at += self.way(walked);
            walked.span += 1;
            walked.far = follow(walked.far, self.turns(walked.at));
        }
        let way = self.turns(self.way(walked));
        let part = (nanos % self.span) as f64 / self.span as f64;
        (self.turns(walked.at) + way * part, way * SECOND / self.span as f64)
    }

    fn turns(&self, parts: i64) -> f64 {
        parts as f64 / WHOLE * self.step
    }

    /// How far it goes in the span that begins here: SplitMix64, entered at its number.
    fn way(&self, walked: &Walked) -> i64 {
        let number = walked.span.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let mut mixed = self.seed.wrapping_add(number);
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^= mixed >> 31;
        let [a, b, c, d, ..] = mixed.to_le_bytes();
        let way = i64::from(i32::from_le_bytes([a, b, c, d]));
        let leaves = (walked.at + way).abs() > self.within;
        if leaves { -way } else { way }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // SplitMix64 with the seed 1234567 begins with 6457827717110365317 = 0x599ED017FB08FC85, whose low half
    // 0xFB08FC85 is -83297147: -0.03878825... of the highest speed. 60 RPM for 1 s are one turn.
    #[test]
    fn a_walk_is_that_of_its_seed() {
        let walk = Walk::new(60.0, 1_000_000_000, 1_234_567, None);
        let (turns, speed) = walk.after(500_000_000, &mut Walked::default(), |far, _| far);
        let due = -83_297_147.0 / 2_147_483_648.0;
        assert!((speed - due).abs() < 1e-12, "{speed} {due}");
        assert!((turns - due / 2.0).abs() < 1e-12);
    }

    #[test]
    fn a_walk_stays_within_its_range() {
        let walk = Walk::new(600.0, 100_000_000, 3, Some(2.0));
        let mut walked = Walked::default();
        let mut most: f64 = 0.0;
        for step in 0..100_000 {
            let (turns, speed) = walk.after(step * 10_000_000, &mut walked, |far, _| far);
            most = most.max(turns.abs());
            assert!(turns.abs() <= 2.0 && speed.abs() <= 10.0, "{turns} {speed}");
        }
        assert!(most > 1.5, "{most}");
    }
}
