//! From inputs to turns, speeds and the machine's own units.

use std::time::Duration;

use clap::Args;
use profibus_dp::wire::octet;
use sch108bex::parameterization::TimeBase;

use super::session::{class_2_part, encoder};

/// A velocity that the device does not tell is taken over at least so long.
const WINDOW: Duration = Duration::from_millis(100);

/// What the machine counts in.
#[derive(Debug, Clone, Default, Args)]
pub(super) struct Machine {
    /// So many units of the machine go by in one turn of the shaft, such as 1.2566 for a drum of 0.4 m
    #[arg(long, value_name = "N", value_parser = positive, allow_negative_numbers = true)]
    pub(super) units_per_turn: Option<f64>,
    /// What these units are called
    #[arg(long, value_name = "NAME", default_value = "units", requires = "units_per_turn")]
    pub(super) unit: String,
}

fn positive(text: &str) -> Result<f64, String> {
    let number = crate::arguments::decimal(text)?;
    if number > 0.0 { Ok(number) } else { Err("write a number above 0, like 1.2566".to_owned()) }
}

/// What a telegram has brought.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sample {
    /// In the device's steps.
    pub(super) position: u32,
    /// In the unit of the time base; Scancon 2.0 only.
    pub(super) velocity: Option<i32>,
    /// Likewise.
    pub(super) acceleration: Option<i32>,
}

impl Sample {
    /// Inputs as the manual has them (manual 4.3); `None`: less than a position.
    pub(super) fn of(inputs: &[u8]) -> Option<Self> {
        let at = |from: usize| inputs.get(from..)?.first_chunk::<4>().copied();
        Some(Self {
            position: u32::from_be_bytes(at(0)?),
            velocity: at(4).map(i32::from_be_bytes),
            acceleration: at(8).map(i32::from_be_bytes),
        })
    }
}

/// How the device counts, as far as it is known.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Scale {
    /// Steps of one turn, in force.
    pub(super) steps: Option<u32>,
    /// Steps of the whole range, in force.
    pub(super) range: Option<u32>,
    /// What velocity counts in.
    pub(super) base: Option<TimeBase>,
}

impl Scale {
    /// From a diagnosis in data exchange, and the Set_Prm before it.
    pub(super) fn of(diagnosis: &[u8], set_prm: &[u8]) -> Self {
        let base = if set_prm.len() == 26 { octet(set_prm, 26).and_then(TimeBase::from_octet) } else { None };
        if let Some(part) = class_2_part(diagnosis) {
            let (steps, range) = (part.measuring_units_per_revolution, part.total_measuring_range);
            return Self { steps: Some(steps), range: Some(range), base };
        }
        let Some(encoder) = encoder(diagnosis) else { return Self { base, ..Self::default() } };
        let steps = encoder.singleturn_resolution;
        Self { steps: Some(steps), range: steps.checked_mul(encoder.revolutions.into()), base }
    }

    /// A position in turns.
    pub(super) fn turns(&self, position: u32) -> Option<f64> {
        self.steps.filter(|steps| *steps > 0).map(|steps| f64::from(position) / f64::from(steps))
    }

    /// A velocity of the device in revolutions per minute.
    pub(super) fn rpm(&self, velocity: i32) -> Option<f64> {
        let velocity = f64::from(velocity);
        let base = self.base?;
        if base == TimeBase::Rpm {
            return Some(velocity);
        }
        let steps = f64::from(self.steps.filter(|steps| *steps > 0)?);
        Some(velocity * 60.0 * per_second(base) / steps)
    }

    /// An acceleration of the device in revolutions per minute, per second.
    pub(super) fn rpm_per_second(&self, acceleration: i32) -> Option<f64> {
        let rpm = self.rpm(acceleration)?;
        Some(match self.base? {
            TimeBase::Rpm => rpm,
            base => rpm * per_second(base),
        })
    }

    /// From one position to a later one by the shorter way round.
    pub(super) fn distance(&self, from: u32, to: u32) -> i64 {
        let (from, to) = (i64::from(from), i64::from(to));
        let Some(range) = self.range.map(i64::from).filter(|range| *range > 0) else { return to - from };
        let ahead = (to - from).rem_euclid(range);
        if ahead > range / 2 { ahead - range } else { ahead }
    }
}

/// Sample times in a second.
const fn per_second(base: TimeBase) -> f64 {
    match base {
        TimeBase::Per10Ms => 100.0,
        TimeBase::Per100Ms => 10.0,
        TimeBase::Per1000Ms | TimeBase::Rpm => 1.0,
    }
}

/// A sample with what it means.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reading {
    pub(super) sample: Sample,
    pub(super) turns: Option<f64>,
    pub(super) rpm: Option<f64>,
    pub(super) rpm_per_second: Option<f64>,
}

/// Makes readings of samples: what the device does not tell is taken from its positions.
#[derive(Debug, Default)]
pub(super) struct Reader {
    /// The start of a window: when, and where.
    since: Option<(Duration, u32)>,
    /// The velocity over the last whole window, and the one before.
    rpm: Option<f64>,
    rpm_per_second: Option<f64>,
}

impl Reader {
    pub(super) fn read(&mut self, at: Duration, sample: Sample, scale: &Scale) -> Reading {
        let turns = scale.turns(sample.position);
        if let (Some(velocity), Some(acceleration)) = (sample.velocity, sample.acceleration) {
            let (rpm, rpm_per_second) = (scale.rpm(velocity), scale.rpm_per_second(acceleration));
            return Reading { sample, turns, rpm, rpm_per_second };
        }
        match self.since {
            None => self.since = Some((at, sample.position)),
            Some((since, from)) if at.saturating_sub(since) >= WINDOW => {
                let seconds = at.saturating_sub(since).as_secs_f64();
                #[expect(clippy::cast_precision_loss, reason = "at most 2^31")]
                let steps = scale.distance(from, sample.position) as f64;
                let per_turn = scale.steps.filter(|steps| *steps > 0).map(f64::from);
                let rpm = per_turn.map(|per_turn| steps / per_turn / seconds * 60.0);
                self.rpm_per_second = self.rpm.zip(rpm).map(|(before, now)| (now - before) / seconds);
                (self.rpm, self.since) = (rpm, Some((at, sample.position)));
            }
            Some(_) => {}
        }
        Reading { sample, turns, rpm: self.rpm, rpm_per_second: self.rpm_per_second }
    }
}

/// The least and the most of something.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Extremes(pub(super) Option<(f64, f64)>);

impl Extremes {
    pub(super) fn take(&mut self, value: Option<f64>) {
        let Some(value) = value else { return };
        let (least, most) = self.0.unwrap_or((value, value));
        self.0 = Some((least.min(value), most.max(value)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(value: Option<f64>, due: f64) -> bool {
        value.is_some_and(|value| (value - due).abs() < 1e-9)
    }

    #[test]
    fn inputs_are_read_as_the_manual_has_them() {
        let octets = [0, 0, 0x10, 0, 0xFF, 0xFF, 0xFF, 0xFE, 0, 0, 0, 3];
        let all = Sample { position: 4096, velocity: Some(-2), acceleration: Some(3) };
        assert_eq!(Sample::of(&octets), Some(all));
        assert_eq!(Sample::of(&octets[..4]), Some(Sample { velocity: None, acceleration: None, ..all }));
        assert_eq!(Sample::of(&octets[..3]), None);
    }

    // 60 RPM are 1 turn a second: 4096 steps a second are 409.6 in 100 ms.
    #[test]
    fn velocities_are_told_in_rpm_whatever_the_time_base() {
        let scale = |base| Scale { steps: Some(4_000), range: Some(16_000), base: Some(base) };
        for (base, velocity) in [
            (TimeBase::Per10Ms, 40),
            (TimeBase::Per100Ms, 400),
            (TimeBase::Per1000Ms, 4_000),
            (TimeBase::Rpm, 60),
        ] {
            assert!(near(scale(base).rpm(velocity), 60.0), "{base}");
        }
        // 40 steps more in 100 ms after 100 ms: 6 RPM in a tenth of a second.
        assert!(near(scale(TimeBase::Per100Ms).rpm_per_second(40), 60.0));
        assert!(near(scale(TimeBase::Rpm).rpm_per_second(7), 7.0));
        assert_eq!(Scale::default().rpm(1), None);
        assert_eq!(Scale { steps: Some(0), ..Scale::default() }.turns(1), None);
    }

    #[test]
    fn the_shorter_way_round_is_taken() {
        let scale = Scale { steps: Some(100), range: Some(1_000), base: None };
        assert_eq!(scale.distance(990, 10), 20);
        assert_eq!(scale.distance(10, 990), -20);
        assert_eq!(scale.distance(10, 400), 390);
        assert_eq!(Scale::default().distance(990, 10), -980);
    }

    // A quarter turn in 125 ms: two turns a second, 120 RPM; then 240 RPM, which is 120 more in 125 ms.
    #[test]
    fn what_the_device_does_not_tell_is_taken_from_positions() {
        let scale = Scale { steps: Some(1_000), range: Some(4_000), base: None };
        let mut reader = Reader::default();
        let sample = |position| Sample { position, velocity: None, acceleration: None };
        let at = Duration::from_millis;
        assert_eq!(reader.read(at(0), sample(3_900), &scale).rpm, None);
        assert_eq!(reader.read(at(60), sample(3_950), &scale).rpm, None, "no whole window");
        let first = reader.read(at(125), sample(150), &scale);
        assert!(near(first.rpm, 120.0) && first.rpm_per_second.is_none(), "{first:?}");
        let second = reader.read(at(250), sample(650), &scale);
        assert!(near(second.rpm, 240.0) && near(second.rpm_per_second, 960.0), "{second:?}");
    }

    #[test]
    fn the_scale_is_what_is_in_force() {
        let mut long = vec![0, 0x0C, 0, 2, 0, 0, 51, 0, 0x0A, 2, 0, 0, 0x10, 0, 0x10, 0];
        long.resize(57, 0);
        (long[41], long[42], long[46]) = (0x01, 0x68, 9);
        let mut set_prm = vec![0; 26];
        set_prm[25] = 3;
        let due = Scale { steps: Some(0x168), range: Some(9), base: Some(TimeBase::Rpm) };
        assert_eq!(Scale::of(&long, &set_prm), due);
        let short = [0, 0x0C, 0, 2, 0, 0, 10, 0, 0, 2, 0, 0, 0x10, 0, 0x10, 0];
        let due = Scale { steps: Some(4_096), range: Some(1 << 24), base: None };
        assert_eq!(Scale::of(&short, &set_prm[..9]), due);
    }
}
