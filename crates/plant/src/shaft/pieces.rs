//! Movements in pieces: in each the position is a cubic of time and goes one way only.

#![expect(
    clippy::cast_precision_loss,
    reason = "what needs more than 53 bits is worked out in whole numbers"
)]

/// Nanoseconds in a second.
pub(super) const SECOND: f64 = 1e9;

/// The limits of a point-to-point move, in the unit of the distance and seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Limits {
    pub(super) speed: f64,
    pub(super) acceleration: f64,
    /// Infinite: the acceleration may jump.
    pub(super) jerk: f64,
}

/// From `start` on: position, speed, half the acceleration and a sixth of the jerk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Piece {
    pub(super) start: u64,
    at: f64,
    speed: f64,
    half: f64,
    sixth: f64,
}

/// Pieces without a gap. The last goes on for ever, or the whole begins anew after a period.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Pieces {
    list: Vec<Piece>,
    period: Option<u64>,
}

impl Piece {
    fn after(&self, nanos: u64) -> (f64, f64) {
        let t = nanos as f64 / SECOND;
        let position = self.at + t * (self.speed + t * (self.half + t * self.sixth));
        let speed = self.speed + t * (2.0 * self.half + t * 3.0 * self.sixth);
        (position, speed)
    }
}

impl Piece {
    /// The highest speed within so many nanoseconds, or ever.
    fn fastest(&self, length: Option<u64>) -> f64 {
        let steady = self.half == 0.0 && self.sixth == 0.0;
        let length = match length {
            Some(length) => length as f64 / SECOND,
            None if steady => 0.0,
            None => return f64::INFINITY,
        };
        let speed = |t: f64| (self.speed + t * (2.0 * self.half + t * 3.0 * self.sixth)).abs();
        // The acceleration does not change its sign within a piece, so the highest is at an end.
        speed(0.0).max(speed(length))
    }
}

impl Pieces {
    /// Standing still at 0 from the start.
    pub(super) fn new() -> Self {
        let rest = Piece { start: 0, at: 0.0, speed: 0.0, half: 0.0, sixth: 0.0 };
        Self { list: vec![rest], period: None }
    }

    fn open(&mut self) -> &mut Piece {
        // There is one from the start.
        let last = self.list.len() - 1;
        &mut self.list[last]
    }

    /// The piece that is open goes on for so long; then the next begins at the position and the speed
    /// reached, or at `exactly`.
    fn close(&mut self, nanos: u64, exactly: Option<(f64, f64)>) {
        let open = *self.open();
        let (at, speed) = exactly.unwrap_or_else(|| open.after(nanos));
        let next = Piece { start: open.start.saturating_add(nanos), at, speed, half: 0.0, sixth: 0.0 };
        if nanos == 0 { *self.open() = next } else { self.list.push(next) }
    }

    /// Goes on with this acceleration and jerk for so long.
    fn go(&mut self, nanos: u64, acceleration: f64, jerk: f64) {
        if nanos > 0 {
            let open = self.open();
            (open.half, open.sixth) = (acceleration / 2.0, jerk / 6.0);
            self.close(nanos, None);
        }
    }

    /// Stands still for so long.
    pub(super) fn pause(&mut self, nanos: u64) {
        self.close(nanos, None);
    }

    /// From one speed to another at constant acceleration, and on at that.
    pub(super) fn ramp(from: f64, to: f64, nanos: u64) -> Self {
        let mut pieces = Self::new();
        pieces.open().speed = from;
        let acceleration = (to - from) / (nanos as f64 / SECOND);
        if from * to < 0.0 {
            // It turns round on its way: one piece for each direction.
            let first = rounded_up(-from / acceleration).min(nanos);
            pieces.go(first, acceleration, 0.0);
            pieces.go(nanos - first, acceleration, 0.0);
        } else {
            pieces.go(nanos, acceleration, 0.0);
        }
        pieces.open().speed = to;
        pieces
    }

    /// Moves by a distance, from rest to rest, as fast as the limits allow; times are rounded up to
    /// whole nanoseconds, so that none is exceeded.
    pub(super) fn move_by(&mut self, distance: f64, limits: Limits) {
        let from = self.open().at;
        let (jerking, steady, cruising) = times(distance.abs(), limits);
        let [j, s, c] = [jerking, steady, cruising].map(|nanos| nanos as f64 / SECOND);
        // With times as they are now it ends exactly at the distance.
        let acceleration = distance / ((j + s) * (2.0 * j + s + c));
        let jerk = if jerking == 0 { 0.0 } else { acceleration / j };
        self.go(jerking, 0.0, jerk);
        self.go(steady, acceleration, 0.0);
        self.go(jerking, acceleration, -jerk);
        self.go(cruising, 0.0, 0.0);
        self.go(jerking, 0.0, -jerk);
        self.go(steady, -acceleration, 0.0);
        self.go(jerking, -acceleration, jerk);
        let end = self.open();
        (end.at, end.speed) = (from + distance, 0.0);
    }

    /// The whole begins anew when what has been said so far is over.
    pub(super) fn repeated(mut self) -> Self {
        let end = self.open().start;
        if end > 0 {
            self.list.pop();
            self.period = Some(end);
        }
        self
    }

    /// Straight lines through points of time and position, the first at 0; still after the last.
    pub(super) fn through(points: &[(u64, f64)], repeat: bool) -> Self {
        let mut pieces = Self::new();
        pieces.open().at = points.first().map_or(0.0, |(_, position)| *position);
        for pair in points.windows(2) {
            let [(start, from), (end, to)] = [pair[0], pair[1]];
            let nanos = end - start;
            pieces.open().speed = (to - from) / (nanos as f64 / SECOND);
            pieces.close(nanos, Some((to, 0.0)));
        }
        if repeat { pieces.repeated() } else { pieces }
    }

    /// Which repetition and which piece this is, how far into it. `hint`: where the last was found.
    pub(super) fn find(&self, nanos: u64, hint: usize) -> (u64, usize, u64) {
        let (repetition, within) = match self.period {
            Some(period) => (nanos / period, nanos % period),
            None => (0, nanos),
        };
        let holds = |at: usize| {
            self.list.get(at).is_some_and(|piece| piece.start <= within)
                && self.list.get(at + 1).is_none_or(|next| within < next.start)
        };
        let at = if holds(hint) {
            hint
        } else {
            self.list.partition_point(|piece| piece.start <= within).saturating_sub(1)
        };
        (repetition, at, within - self.list[at].start)
    }

    /// Position and speed in a piece.
    #[inline]
    pub(super) fn look(&self, at: usize, into: u64) -> (f64, f64) {
        self.list[at].after(into)
    }

    /// The highest speed there is, either way.
    pub(super) fn fastest(&self) -> f64 {
        let ends = self.list.iter().skip(1).map(|next| Some(next.start)).chain([self.period]);
        let pieces = self.list.iter().zip(ends);
        pieces.map(|(piece, end)| piece.fastest(end.map(|end| end - piece.start))).fold(0.0, f64::max)
    }

    /// Where each piece begins, and whether they repeat.
    pub(super) fn turns(&self) -> (Vec<f64>, bool) {
        (self.list.iter().map(|piece| piece.at).collect(), self.period.is_some())
    }
}

/// How long the jerk, the constant acceleration and the constant speed last, in nanoseconds.
fn times(distance: f64, limits: Limits) -> (u64, u64, u64) {
    let Limits { speed, acceleration, jerk } = limits;
    // The acceleration is built up within this time, at most.
    let build_up = acceleration / jerk;
    let reaches_acceleration = speed * jerk >= acceleration * acceleration || jerk.is_infinite();
    let (jerking, steady) = if reaches_acceleration {
        (build_up, speed / acceleration - build_up)
    } else {
        ((speed / jerk).sqrt(), 0.0)
    };
    let cruising = distance / speed - (2.0 * jerking + steady);
    if cruising >= 0.0 {
        return (rounded_up(jerking), rounded_up(steady), rounded_up(cruising));
    }
    // Too short for the speed: d = a (j + s)(2 j + s) with j = a / jerk, or d = 2 jerk j^3.
    let root = (build_up * build_up + 4.0 * distance / acceleration).sqrt();
    let steady = (root - 3.0 * build_up) / 2.0;
    if steady >= 0.0 {
        (rounded_up(build_up), rounded_up(steady), 0)
    } else {
        (rounded_up(cube_root(distance / (2.0 * jerk))), 0, 0)
    }
}

/// By Newton's method, as that of a mathematical library may differ from machine to machine.
fn cube_root(of: f64) -> f64 {
    let mut root = of.max(1.0);
    for _ in 0..200 {
        let next = (2.0 * root + of / (root * root)) / 3.0;
        if next >= root {
            break;
        }
        root = next;
    }
    root
}

/// Seconds as nanoseconds, not less than they are.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "times are not negative")]
pub(super) fn rounded_up(seconds: f64) -> u64 {
    // A rounding error below a thousandth of a nanosecond makes no whole one.
    (seconds * SECOND - 1e-3).ceil().max(0.0) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(pieces: &Pieces, millis: u64) -> (f64, f64) {
        let (_, piece, into) = pieces.find(millis * 1_000_000, 0);
        pieces.look(piece, into)
    }

    fn near(found: (f64, f64), position: f64, speed: f64) {
        assert!((found.0 - position).abs() < 1e-9 && (found.1 - speed).abs() < 1e-6, "{found:?}");
    }

    // 10 at 2 a second, 1 a second squared, 1 a second cubed: 1 s of jerk, 1 s of acceleration 1, 1 s
    // of jerk make 2 a second over 3 in 3 s; 4 remain at that speed, for 2 s; and down again: 8 s.
    #[test]
    fn a_move_keeps_its_limits_and_ends_where_it_has_to() {
        let mut pieces = Pieces::new();
        pieces.move_by(10.0, Limits { speed: 2.0, acceleration: 1.0, jerk: 1.0 });
        near(at(&pieces, 0), 0.0, 0.0);
        near(at(&pieces, 1_000), 1.0 / 6.0, 0.5);
        near(at(&pieces, 2_000), 1.0 / 6.0 + 0.5 + 0.5, 1.5);
        near(at(&pieces, 3_000), 3.0, 2.0);
        near(at(&pieces, 4_000), 5.0, 2.0);
        near(at(&pieces, 5_000), 7.0, 2.0);
        near(at(&pieces, 7_000), 10.0 - 1.0 / 6.0, 0.5);
        assert_eq!(at(&pieces, 8_000), (10.0, 0.0), "exactly");
        assert_eq!(at(&pieces, 1_000_000_000), (10.0, 0.0), "and stays there");
    }

    // Without a limit of the jerk: a triangle of 2 s up and 2 s down for 4 at 1 a second squared.
    #[test]
    fn a_move_too_short_for_its_speed_turns_round_in_the_middle() {
        let mut pieces = Pieces::new();
        pieces.move_by(-4.0, Limits { speed: 100.0, acceleration: 1.0, jerk: f64::INFINITY });
        near(at(&pieces, 2_000), -2.0, -2.0);
        assert_eq!(at(&pieces, 4_000), (-4.0, 0.0));
        // d = 2 jerk j^3: 16 with a jerk of 1 is 2 s for each of the four.
        let mut pieces = Pieces::new();
        pieces.move_by(16.0, Limits { speed: 100.0, acceleration: 100.0, jerk: 1.0 });
        near(at(&pieces, 2_000), 8.0 / 6.0, 2.0);
        near(at(&pieces, 4_000), 8.0, 4.0);
        assert_eq!(at(&pieces, 8_000), (16.0, 0.0));
        // 6 at most 1 a second squared with a jerk of 1: 1 s of jerk, 1 s steady: 1 * 2 * 3.
        let mut pieces = Pieces::new();
        pieces.move_by(6.0, Limits { speed: 100.0, acceleration: 1.0, jerk: 1.0 });
        near(at(&pieces, 3_000), 3.0, 2.0);
        assert_eq!(at(&pieces, 6_000), (6.0, 0.0));
        // A speed of 1 below what a jerk of 4 needs for 100: half a second of jerk each.
        let mut pieces = Pieces::new();
        pieces.move_by(3.0, Limits { speed: 1.0, acceleration: 100.0, jerk: 4.0 });
        near(at(&pieces, 1_000), 0.5, 1.0);
        assert_eq!(at(&pieces, 4_000), (3.0, 0.0));
    }

    #[test]
    fn a_ramp_through_rest_has_a_piece_for_each_direction() {
        let pieces = Pieces::ramp(-1.0, 1.0, 2_000_000_000);
        near(at(&pieces, 1_000), -0.5, 0.0);
        near(at(&pieces, 2_000), 0.0, 1.0);
        near(at(&pieces, 12_000), 10.0, 1.0);
        assert_eq!(pieces.turns().0.len(), 3);
    }

    #[test]
    fn what_is_repeated_does_not_drift_in_a_year() {
        let mut pieces = Pieces::new();
        pieces.move_by(0.3, Limits { speed: 0.7, acceleration: 0.9, jerk: 3.0 });
        pieces.pause(123_456_789);
        pieces.move_by(-0.3, Limits { speed: 0.7, acceleration: 0.9, jerk: 3.0 });
        let pieces = pieces.repeated();
        let period = pieces.period.unwrap();
        let (_, piece, into) = pieces.find(period / 3, 0);
        let once = pieces.look(piece, into);
        let (repetition, piece, into) = pieces.find(period * 20_000_000 + period / 3, 0);
        assert_eq!((repetition, pieces.look(piece, into)), (20_000_000, once));
    }

    #[test]
    fn a_cube_root_is_one() {
        for root in [1e-6, 0.5, 1.0, 2.0, 1e6] {
            let found = cube_root(root * root * root);
            assert!((found / root - 1.0).abs() < 1e-12, "{root}: {found}");
        }
    }
}
