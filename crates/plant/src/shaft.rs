//! What turns an encoder.
//!
//! A shaft is a pure function of time: at any instant it has one position, whoever asked before. A
//! shaft that stands still or turns at constant speed is worked out in whole numbers alone; for the
//! others see [`ShaftFields`], and `moving.rs` for what makes them the same on every computer.

mod build;
mod fields;
mod moving;
mod pieces;
mod playback;
mod walk;

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use profibus_dp::time::Instant;
use sch108bex::specification::Variant;

pub use fields::{Ratio, ShaftFields, ShaftKind};

use crate::control::Which;
use crate::machine::Machine;
use moving::{Moving, Overlay, Path, Plan};

/// Millionths of a revolution per minute: exact for every speed that a user writes.
type MicroRpm = i64;

/// Faster than any shaft, and far from any overflow.
const MAX_RPM: f64 = 1e6;

/// The movement of a shaft, as a function of time.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shaft {
    /// The full physical position in counts at `since`.
    origin: i64,
    since: Instant,
    speed: MicroRpm,
    /// What is no constant speed.
    moving: Option<Box<Moving>>,
}

/// What drives a shaft through a gear.
#[derive(Debug, Clone, PartialEq)]
pub struct Coupling {
    /// The encoder whose shaft drives it.
    pub to: Which,
    /// Where the driven shaft begins, in physical counts; `None`: where it is.
    pub raw: Option<i64>,
    ratio: (i64, i64),
    overlay: Overlay,
    text: String,
}

/// Why text describes no shaft.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ShaftError {
    /// None of the forms.
    #[error(
        "`{0}` is no shaft: write still@RAW or constant:RPM[@RAW], such as still@1000 or constant:-12.5@0, or \
         KIND:NAME=VALUE with ramp, sine, move, hoist, trip, walk, playback or coupled, such as ramp:to_rpm=60:over_s=10"
    )]
    Form(String),
    /// RAW is no number of counts.
    #[error("`{0}` is no physical position: write a whole number of counts, such as 65536")]
    Raw(String),
    /// RAW is outside the physical range.
    #[error("{raw} is outside the physical range of this encoder: 0 to {max} counts with {variant} bits")]
    OutOfRange {
        /// What was asked for.
        raw: i64,
        /// The highest position there is.
        max: u32,
        /// The encoder's bits.
        variant: Variant,
    },
    /// RPM is no speed.
    #[error(
        "`{0}` is no speed: write revolutions per minute between -1000000 and 1000000, positive clockwise"
    )]
    Speed(String),
    /// A field is missing, too many or no value.
    #[error("shaft {kind}: {what}; write for example {example}")]
    Field {
        /// The kind of movement.
        kind: String,
        /// What is wrong.
        what: String,
        /// A shaft of this kind.
        example: &'static str,
    },
    /// A file of points is none.
    #[error("shaft playback: {file}: {what}")]
    File {
        /// The file.
        file: String,
        /// What is wrong, with the line.
        what: String,
    },
    /// A coupled shaft where there is no other.
    #[error(
        "a coupled shaft needs an encoder that runs: start with still@RAW, and couple it over the control socket"
    )]
    Coupled,
}

impl Shaft {
    /// A shaft that stands still at a physical position in counts.
    pub const fn still(raw: i64) -> Self {
        Self { origin: raw, since: Instant::ZERO, speed: 0, moving: None }
    }

    /// A shaft that turns at constant speed, positive clockwise, and is at `raw` at `since`.
    ///
    /// Speeds beyond a million revolutions per minute, and what is no number, are 0.
    #[expect(clippy::cast_possible_truncation, reason = "bounded before")]
    pub fn constant(rpm: f64, raw: i64, since: Instant) -> Self {
        let speed = if rpm.abs() <= MAX_RPM { (rpm * 1e6).round() as MicroRpm } else { 0 };
        Self { origin: raw, since, speed, moving: None }
    }

    /// The full physical position in counts at `now`: turns included, no range applied.
    ///
    /// It remembers where it was asked, so that going on from there is quick; it says the same however
    /// it is asked.
    #[inline]
    pub fn at(&mut self, now: Instant, variant: Variant) -> i64 {
        if self.speed == 0 && self.moving.is_none() { self.origin } else { self.turned(now, variant) }
    }

    #[expect(clippy::cast_possible_truncation, reason = "a million RPM for 584 years fit in 64 bits")]
    fn turned(&mut self, now: Instant, variant: Variant) -> i64 {
        /// Nanoseconds in a minute, for millionths.
        const SCALE: i128 = 60_000_000_000 * 1_000_000;
        let nanos = now.since(self.since).as_nanos();
        if let Some(moving) = &mut self.moving {
            return self.origin.wrapping_add(moving.counts(nanos, variant.steps_per_revolution()));
        }
        let steps = i128::from(variant.steps_per_revolution());
        let counts = (i128::from(self.speed) * i128::from(nanos) * steps).div_euclid(SCALE);
        self.origin.wrapping_add(counts as i64)
    }

    /// The speed at `now` in revolutions per minute, positive clockwise.
    #[expect(clippy::cast_precision_loss, reason = "no speed has so many digits")]
    pub fn rpm(&mut self, now: Instant) -> f64 {
        match &mut self.moving {
            Some(moving) => moving.after(now.since(self.since).as_nanos()).1 * 60.0,
            None => self.speed as f64 / 1e6,
        }
    }

    /// Whether the speed can be above so many revolutions per minute, without a closer look.
    #[inline]
    pub(crate) fn may_exceed(&self, rpm: i64) -> bool {
        self.moving.is_some() || self.speed.unsigned_abs() > rpm.unsigned_abs() * 1_000_000
    }

    /// The machine that the shaft's own fields describe.
    pub fn machine(&self) -> Option<&Machine> {
        self.moving.as_ref()?.plan.machine.as_ref()
    }

    /// When the movement began.
    pub(crate) fn since(&self) -> Instant {
        self.since
    }

    /// The same movement, so that it is at `raw` at `now`.
    pub(crate) fn at_once(&mut self, now: Instant, raw: i64, variant: Variant) {
        let turned = self.at(now, variant).wrapping_sub(self.origin);
        self.origin = raw.wrapping_sub(turned);
    }

    /// The same movement, with the clock started at `now`.
    #[must_use]
    pub fn started(self, now: Instant) -> Self {
        Self { since: now, ..self }
    }

    /// The same movement, from another position.
    #[must_use]
    pub fn from(self, raw: i64) -> Self {
        Self { origin: raw, ..self }
    }

    /// What this shaft drives through a gear, which is at `here` at `now`.
    pub(crate) fn geared(&self, coupling: &Coupling, now: Instant, here: i64, variant: Variant) -> Self {
        let (path, machine, (turns, of)) = match &self.moving {
            Some(moving) => (Arc::clone(&moving.plan.path), moving.plan.machine.clone(), moving.plan.gear),
            None => (Arc::new(Path::Turning(self.speed)), None, (1, 1)),
        };
        let gear = reduced(turns, of, coupling.ratio);
        let plan = Plan::new(path, machine, gear, coupling.overlay, coupling.text.clone());
        let moving = Some(Box::new(Moving::new(plan)));
        let mut geared = Self { origin: 0, since: self.since, speed: 0, moving };
        geared.at_once(now, here, variant);
        geared
    }

    /// Refuses a position that the encoder has not.
    ///
    /// # Errors
    ///
    /// [`ShaftError::OutOfRange`].
    pub fn check(&self, variant: Variant) -> Result<(), ShaftError> {
        let max = variant.total() - 1;
        if (0..=i64::from(max)).contains(&self.origin) {
            Ok(())
        } else {
            Err(ShaftError::OutOfRange { raw: self.origin, max, variant })
        }
    }
}

/// A gear behind a gear.
fn reduced(turns: i64, of: i64, ratio: (i64, i64)) -> (i64, i64) {
    let (mut turns, mut of) = (i128::from(turns) * i128::from(ratio.0), i128::from(of) * i128::from(ratio.1));
    let (mut a, mut b) = (turns.abs(), of);
    while b != 0 {
        (a, b) = (b, a % b);
    }
    (turns, of) = (turns / a.max(1), of / a.max(1));
    // Chains of gears that no fraction of 64 bits holds lose their last digits.
    while turns.abs() > i128::from(i64::MAX) || of > i128::from(i64::MAX) {
        (turns, of) = (turns / 2, (of / 2).max(1));
    }
    (i64::try_from(turns).unwrap_or(1), i64::try_from(of).unwrap_or(1))
}

impl FromStr for Shaft {
    type Err = ShaftError;

    /// `KIND[:NAME=VALUE...][@RAW]`; `constant` takes its speed without the name.
    fn from_str(text: &str) -> Result<Self, ShaftError> {
        Self::try_from(&ShaftFields::parse(text)?)
    }
}

impl fmt::Display for Shaft {
    #[expect(clippy::cast_precision_loss, reason = "for reading only")]
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.moving {
            Some(moving) => write!(f, "{}@{}", moving.plan.text, self.origin),
            None if self.speed == 0 => write!(f, "still@{}", self.origin),
            None => write!(f, "constant:{}@{}", self.speed as f64 / 1e6, self.origin),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shaft(text: &str) -> Result<Shaft, ShaftError> {
        text.parse()
    }

    #[test]
    fn a_still_shaft_stays_where_it_is() {
        let mut still = shaft("still@491520").expect("a shaft");
        assert_eq!(still.at(Instant::from_millis(0), Variant::FULL), 491_520);
        assert_eq!(still.at(Instant::from_millis(99_999), Variant::FULL), 491_520);
        assert_eq!(shaft("still").expect("a shaft").at(Instant::ZERO, Variant::FULL), 0);
    }

    // 3000 RPM are 50 turns a second: 3 276 800 counts with 16 bits.
    #[test]
    fn a_turning_shaft_turns_exactly() {
        let mut turning = shaft("constant:3000@100").expect("a shaft").started(Instant::from_millis(5));
        assert_eq!(turning.at(Instant::from_millis(5), Variant::FULL), 100);
        assert_eq!(turning.at(Instant::from_millis(1_005), Variant::FULL), 3_276_900);
        assert_eq!(turning.at(Instant::from_millis(15), Variant::FULL), 100 + 32_768);
        let mut back = shaft("constant:-60@0").expect("a shaft");
        assert_eq!(back.at(Instant::from_nanos(1), Variant::FULL), -1, "floor, not truncation");
        assert_eq!(back.at(Instant::from_millis(1_000), Variant::FULL), -65_536);
    }

    #[test]
    fn what_is_no_shaft_is_told() {
        assert!(matches!(shaft("moving"), Err(ShaftError::Form(_))));
        assert!(matches!(shaft("still@1x"), Err(ShaftError::Raw(_))));
        assert!(matches!(shaft("constant:fast"), Err(ShaftError::Speed(_))));
        assert!(matches!(shaft("constant:nan"), Err(ShaftError::Speed(_))));
        assert!(matches!(shaft("constant:1e300"), Err(ShaftError::Speed(_))));
        assert!(shaft("still@-1").expect("text is fine").check(Variant::FULL).is_err());
        assert!(Shaft::still(i64::from(u32::MAX >> 1)).check(Variant::FULL).is_ok());
        assert!(Shaft::still(1 << 31).check(Variant::FULL).is_err());
    }

    const SECOND: u64 = 1_000_000_000;

    fn positions(text: &str, millis: &[u64]) -> Vec<i64> {
        let mut shaft = shaft(text).unwrap_or_else(|error| panic!("{error}"));
        millis.iter().map(|&millis| shaft.at(Instant::from_millis(millis), Variant::FULL)).collect()
    }

    // From 0 to 60 RPM in 10 s are 5 turns: 327 680 counts; then a turn a second.
    #[test]
    fn a_ramp_goes_on_at_its_last_speed() {
        assert_eq!(
            positions("ramp:to_rpm=60:over_s=10@100", &[0, 5_000, 10_000, 11_000]),
            [100, 100 + 81_920, 100 + 327_680, 100 + 393_216]
        );
        let mut ramp = shaft("ramp:to_rpm=60:over_s=10").unwrap();
        assert!((ramp.rpm(Instant::from_millis(5_000)) - 30.0).abs() < 1e-9);
    }

    // Two turns to each side in 30 s; a twelfth of it is half the amplitude.
    #[test]
    fn a_sine_swings_to_both_sides() {
        assert_eq!(
            positions("sine:amplitude=2:period_s=30@0", &[0, 2_500, 7_500, 15_000, 22_500]),
            [0, 65_536, 131_072, 0, -131_072]
        );
        let days = 86_400_000 * 365;
        assert_eq!(positions("sine:amplitude=2:period_s=30", &[days + 2_500]), [65_536]);
    }

    // Half a metre for a turn: 3.2 m are 6.4 turns, 419 430.4 counts. 4 s at 0.8 m/s and 2 s more for
    // coming up to speed (without a limit of the jerk); then 2 s at the top, and down.
    #[test]
    fn a_hoist_goes_up_and_down_for_ever() {
        let hoist = "hoist:by=3.2:speed=0.8:acceleration=0.4:pause_s=2:unit=m:per_turn=0.5@1000";
        let once = positions(hoist, &[0, 3_000, 6_000, 8_000, 11_000, 14_000, 16_000]);
        assert_eq!(once, [1_000, 1_000 + 209_715, 420_430, 420_430, 210_715, 1_000, 1_000]);
        let later = positions(hoist, &[16_000_000 + 3_000, 16_000_000 + 6_000]);
        assert_eq!(later, [210_715, 420_430]);
    }

    // A drum whose rope lies at 1 m in the first layer of ten turns and at 1.06 m in the second: 15 turns
    // are (10 + 5.3) pi of rope, a quarter of that at the hook of four lines.
    #[test]
    fn a_trip_winds_its_rope_in_layers() {
        let by = (10.0 + 5.3) * std::f64::consts::PI / 4.0;
        let trip = format!(
            "trip:by={by}:speed=10:acceleration=1000:pause_s=5:drum_diameter=0.97:rope_diameter=0.03:\
             turns_per_layer=10:lines=4"
        );
        let found = positions(&trip, &[4_000, 3_000_000])[0];
        assert!((found - 15 * 65_536).abs() <= 1, "{found}");
    }

    #[test]
    fn texts_and_fields_are_the_same_shafts_and_print_as_texts() {
        for text in [
            "still@5",
            "constant:-12.5@7",
            "ramp:from_rpm=-10.0:over_s=2.5:to_rpm=20.0@5",
            "constant:backlash_deg=1.5:rpm=60.0@0",
            "walk:every_s=0.5:rpm=30.0:seed=7:within=10.0@9",
        ] {
            let parsed = shaft(text).unwrap_or_else(|error| panic!("{text}: {error}"));
            assert_eq!(parsed.to_string(), text);
            let fields = ShaftFields::parse(text).unwrap();
            let json = serde_json::to_string(&fields).unwrap();
            let read: ShaftFields = serde_json::from_str(&json).unwrap();
            assert_eq!(Shaft::try_from(&read).unwrap(), parsed);
        }
    }

    #[test]
    fn every_example_is_a_shaft_and_what_a_kind_does_not_take_is_told() {
        for kind in ["still", "constant", "ramp", "sine", "move", "hoist", "trip", "walk"] {
            let kind: ShaftKind = serde_json::from_value(kind.into()).unwrap();
            shaft(kind.form().example).unwrap_or_else(|error| panic!("{error}"));
        }
        for (text, word) in [
            ("still:rpm=5", "rpm"),
            ("ramp:over_s=5", "to_rpm"),
            ("ramp:to_rpm=5:over_s=0", "over_s"),
            ("sine:amplitude=2", "period_s"),
            ("move:by=1:speed=0:acceleration=1", "speed"),
            ("trip:by=1:speed=1:acceleration=1", "drum"),
            ("walk:rpm=60:every_s=1:within=0.5", "within"),
            ("hoist:by=1:speed=1:acceleration=1:unit=m", "per_turn"),
            ("constant:60:vibration_hz=5", "vibration_deg"),
            ("ramp:to_rpm=5:over_s=1:over_s=2", "twice"),
            ("ramp:to_rpm=5:overs=1", "overs"),
            ("playback:file=/does/not/exist", "/does/not/exist"),
            ("coupled:to=1", "control socket"),
            ("coupled:to=1:ratio=1/0", "3/2"),
        ] {
            let error = shaft(text).expect_err(text).to_string();
            assert!(error.contains(word), "{text}: {error}");
        }
    }

    // Three turns for two, the other way round, from where both are.
    #[test]
    fn a_coupled_shaft_turns_with_the_other() {
        let coupling = ShaftFields::parse("coupled:to=1:ratio=-3/2").unwrap().coupling().unwrap().unwrap();
        let drive = shaft("constant:60@1000").unwrap();
        let now = Instant::from_millis(2_000);
        let mut driven = drive.geared(&coupling, now, 500, Variant::FULL);
        assert_eq!(driven.at(now, Variant::FULL), 500);
        assert_eq!(driven.at(Instant::from_millis(4_000), Variant::FULL), 500 - 3 * 65_536);
        // One behind it with a third of its turns: half of the first, and no drift after a day.
        let third = ShaftFields::parse("coupled:to=2:ratio=-1/3").unwrap().coupling().unwrap().unwrap();
        let mut last = driven.geared(&third, now, 0, Variant::FULL);
        assert_eq!(last.at(Instant::from_nanos(86_402 * SECOND), Variant::FULL), 43_200 * 65_536);
    }

    #[test]
    fn vibration_comes_on_top_and_play_takes_off() {
        // A degree is 182.04 counts; the quarter of a period of 10 Hz is 25 ms.
        assert_eq!(
            positions("still:vibration_deg=1:vibration_hz=10@1000", &[0, 25, 50, 75]),
            [1_000, 1_182, 1_000, 817]
        );
        // Play of 90 degrees takes 45 off.
        assert_eq!(positions("constant:60:backlash_deg=90", &[100, 1_000]), [0, 65_536 - 8_192]);
    }

    #[test]
    fn a_file_is_played_back() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a:b@c.csv");
        std::fs::write(&file, "time,position\n0,1\n2,3\n").unwrap();
        let text = format!("playback:per_turn=0.5:file={}", file.display());
        assert_eq!(positions(&text, &[0, 1_000, 5_000]), [131_072, 262_144, 393_216]);
        let text = format!("playback:per_turn=0.5:repeat=true:file={}", file.display());
        assert_eq!(positions(&text, &[1_000, 5_000]), [262_144, 262_144]);
    }
}
