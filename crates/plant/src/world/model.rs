//! A world that changes by itself: supply, temperature, light and battery over time.
//!
//! The same on every computer: plain arithmetic, at instants that only time decides.

use profibus_dp::time::{Duration, Instant};
use sch108bex::health::{Battery, Measurement};

/// How often a voltage that is on its way is looked at.
const SLOPE: Duration = Duration::from_millis(1);

/// How often the temperature is.
const THERMAL_STEP: Duration = Duration::from_secs(1);

const SECOND: f64 = 1e9;
const HOUR: f64 = 3600.0 * SECOND;

/// What changes by itself.
#[derive(Debug, Clone, Default)]
pub(crate) struct WorldModel {
    pub(crate) supply: Option<SupplyProfile>,
    pub(crate) thermal: Option<Thermal>,
    pub(crate) led: Option<Led>,
    pub(crate) battery: Option<Cell>,
}

/// The supply voltage in straight lines through points.
#[derive(Debug, Clone)]
pub(crate) struct SupplyProfile {
    since: Instant,
    /// Nanoseconds and millivolts; two at one time are a jump.
    points: Vec<(u64, i32)>,
    repeat: bool,
    due: Option<Instant>,
}

/// The temperature inside, of first order: it runs after that around and what the device itself makes.
#[derive(Debug, Clone)]
pub(crate) struct Thermal {
    celsius: f64,
    pub(crate) ambient: f64,
    /// By how much it is warmer inside, under power.
    pub(crate) own: f64,
    pub(crate) time_constant: Duration,
    due: Instant,
}

/// The LED, which has so much left under power.
#[derive(Debug, Clone)]
pub(crate) struct Led {
    pub(crate) left: Duration,
    last: Instant,
    powered: bool,
}

/// The battery, which gives its charge away.
#[derive(Debug, Clone)]
pub(crate) struct Cell {
    /// From 0 to 1.
    pub(crate) charge: f64,
    pub(crate) low_below: f64,
    /// How long a full one lasts without power and with it; `None`: for ever.
    pub(crate) lasts: [Option<Duration>; 2],
    last: Instant,
    powered: bool,
}

impl WorldModel {
    /// When it has to be looked at next.
    pub(crate) fn due(&self) -> Option<Instant> {
        let supply = self.supply.as_ref().and_then(|supply| supply.due);
        let thermal = self.thermal.as_ref().map(|thermal| thermal.due);
        let led = self.led.as_ref().and_then(Led::due);
        let battery = self.battery.as_ref().and_then(Cell::due);
        [supply, thermal, led, battery].into_iter().flatten().min()
    }

    /// The power came or went.
    pub(crate) fn note_power(&mut self, now: Instant, powered: bool) {
        if let Some(led) = &mut self.led {
            led.advance(now, powered);
        }
        if let Some(battery) = &mut self.battery {
            battery.advance(now, powered);
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.supply.is_none() && self.thermal.is_none() && self.led.is_none() && self.battery.is_none()
    }

    /// Goes on to `now`; since the last time there was power, or there was none.
    pub(crate) fn advance(&mut self, now: Instant, powered: bool, world: &mut Measurement) {
        if let Some(supply) = &mut self.supply {
            world.supply_mv = supply.look(now);
        }
        if let Some(thermal) = &mut self.thermal {
            world.temperature_tenths = thermal.advance(now, powered);
        }
        if let Some(led) = &mut self.led {
            world.light_ok = led.advance(now, powered);
        }
        if let Some(battery) = &mut self.battery {
            world.battery = battery.advance(now, powered);
        }
    }
}

impl SupplyProfile {
    /// Points of nanoseconds and millivolts, in order of time; there is one at least.
    pub(crate) fn new(since: Instant, points: Vec<(u64, i32)>, repeat: bool) -> Self {
        Self { since, points, repeat, due: Some(since) }
    }

    fn look(&mut self, now: Instant) -> i32 {
        let end = self.points.last().map_or(0, |(at, _)| *at);
        let mut nanos = now.since(self.since).as_nanos();
        if self.repeat && end > 0 {
            nanos %= end;
        }
        // Of two at one time the later counts.
        let next = self.points.partition_point(|(at, _)| *at <= nanos);
        let before = next.checked_sub(1).and_then(|at| self.points.get(at));
        let (from, millivolts) = before.or(self.points.first()).copied().unwrap_or_default();
        let Some(&(to, target)) = self.points.get(next) else {
            self.due = None;
            return millivolts;
        };
        let left = Duration::from_nanos(to - nanos);
        let flat = target == millivolts || before.is_none();
        self.due = Some(now + if flat { left } else { SLOPE.min(left) });
        if flat {
            return millivolts;
        }
        let change = i128::from(target - millivolts) * i128::from(nanos - from) / i128::from(to - from);
        millivolts.saturating_add(i32::try_from(change).unwrap_or(0))
    }
}

impl Thermal {
    pub(crate) fn new(now: Instant, celsius: f64, ambient: f64, own: f64, time_constant: Duration) -> Self {
        Self { celsius, ambient, own, time_constant, due: now + THERMAL_STEP }
    }

    /// In steps of a second, each with the share of the new value that makes it stable for any constant.
    #[expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "within 300 degrees")]
    fn advance(&mut self, now: Instant, powered: bool) -> i16 {
        let share = THERMAL_STEP.as_nanos() as f64 / self.time_constant.as_nanos() as f64;
        let target = self.ambient + if powered { self.own } else { 0.0 };
        while self.due <= now {
            self.celsius = (self.celsius + share * target) / (1.0 + share);
            self.due += THERMAL_STEP;
        }
        (self.celsius * 10.0 + 0.5).floor().clamp(-3_000.0, 3_000.0) as i16
    }
}

impl Led {
    pub(crate) fn new(now: Instant, left: Duration, powered: bool) -> Self {
        Self { left, last: now, powered }
    }

    fn due(&self) -> Option<Instant> {
        (self.powered && self.left > Duration::ZERO).then(|| self.last + self.left)
    }

    fn advance(&mut self, now: Instant, powered: bool) -> bool {
        if self.powered {
            let left = self.left.as_nanos().saturating_sub(now.since(self.last).as_nanos());
            self.left = Duration::from_nanos(left);
        }
        (self.last, self.powered) = (now, powered);
        self.left > Duration::ZERO
    }
}

impl Cell {
    pub(crate) fn new(
        now: Instant,
        charge: f64,
        low_below: f64,
        lasts: [Option<Duration>; 2],
        powered: bool,
    ) -> Self {
        Self { charge, low_below, lasts, last: now, powered }
    }

    /// When it next falls below a limit.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "above 0"
    )]
    fn due(&self) -> Option<Instant> {
        let lasts = self.lasts[usize::from(self.powered)]?.as_nanos() as f64;
        let limit = if self.charge >= self.low_below { self.low_below } else { 0.0 };
        // A microsecond later it is below, however it was rounded.
        let nanos = ((self.charge - limit) * lasts).max(0.0) + 1_000.0;
        (self.charge > 0.0).then(|| self.last + Duration::from_nanos(nanos as u64))
    }

    #[expect(clippy::cast_precision_loss, reason = "nanoseconds of a battery's life")]
    fn advance(&mut self, now: Instant, powered: bool) -> Battery {
        if let Some(lasts) = self.lasts[usize::from(self.powered)] {
            let gone = now.since(self.last).as_nanos() as f64 / lasts.as_nanos() as f64;
            self.charge = (self.charge - gone).max(0.0);
        }
        (self.last, self.powered) = (now, powered);
        if self.charge <= 0.0 {
            Battery::Empty
        } else if self.charge < self.low_below {
            Battery::Low
        } else {
            Battery::Ok
        }
    }
}

/// Hours as a time.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked before")]
pub(crate) fn hours(hours: f64) -> Duration {
    Duration::from_nanos((hours * HOUR).max(1.0) as u64)
}

/// Seconds as nanoseconds.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked before")]
pub(crate) fn nanos(seconds: f64) -> u64 {
    (seconds * SECOND).round().max(0.0) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: u64) -> Instant {
        Instant::from_millis(millis)
    }

    fn run(model: &mut WorldModel, until: Instant, powered: bool) -> Measurement {
        let mut world = Measurement::GOOD;
        while let Some(due) = model.due().filter(|due| *due <= until) {
            model.advance(due, powered, &mut world);
        }
        model.advance(until, powered, &mut world);
        world
    }

    // 24 V for a second, down to 8 V within another, there for a second, and back at once.
    #[test]
    fn a_voltage_goes_in_straight_lines_and_jumps() {
        const S: u64 = 1_000_000_000;
        let points =
            vec![(0, 24_000), (S, 24_000), (2 * S, 8_000), (3 * S, 8_000), (3 * S, 24_000), (4 * S, 24_000)];
        let mut supply = SupplyProfile::new(at(100), points, true);
        for (millis, millivolts) in [
            (0, 24_000),
            (999, 24_000),
            (1_500, 16_000),
            (2_000, 8_000),
            (2_999, 8_000),
            (3_000, 24_000),
            (5_250, 20_000),
        ] {
            assert_eq!(supply.look(at(100 + millis)), millivolts, "{millis} ms");
        }
        supply.look(at(100));
        assert_eq!(supply.due, Some(at(1_100)));
        supply.look(at(1_600));
        assert_eq!(supply.due, Some(at(1_601)));
    }

    // After one time constant 63.2 % of the way from 20 to 20 + 50 degrees, after five 99.3 %.
    #[test]
    fn a_temperature_runs_after_its_causes() {
        let thermal = Thermal::new(at(0), 20.0, 20.0, 50.0, Duration::from_secs(600));
        let mut model = WorldModel { thermal: Some(thermal), ..WorldModel::default() };
        assert_eq!(run(&mut model, at(600_000), true).temperature_tenths, 516);
        assert_eq!(run(&mut model, at(3_000_000), true).temperature_tenths, 697);
        // Without power it cools again: 36.8 % of what it was above.
        assert_eq!(run(&mut model, at(3_600_000), false).temperature_tenths, 383);
    }

    #[test]
    fn an_led_ages_under_power_only() {
        let led = Led::new(at(0), Duration::from_secs(10), true);
        let mut model = WorldModel { led: Some(led), ..WorldModel::default() };
        assert!(run(&mut model, at(6_000), false).light_ok);
        assert!(run(&mut model, at(60_000), true).light_ok);
        assert!(run(&mut model, at(63_999), true).light_ok);
        assert!(!run(&mut model, at(64_000), true).light_ok);
    }

    // A full one lasts 100 s without power, and for ever with it.
    #[test]
    fn a_battery_is_low_before_it_is_empty() {
        let battery = Cell::new(at(0), 1.0, 0.2, [Some(Duration::from_secs(100)), None], false);
        let mut model = WorldModel { battery: Some(battery), ..WorldModel::default() };
        assert_eq!(run(&mut model, at(50_000), true).battery, Battery::Ok);
        assert_eq!(run(&mut model, at(950_000), false).battery, Battery::Ok);
        assert_eq!(run(&mut model, at(979_000), false).battery, Battery::Ok);
        assert_eq!(run(&mut model, at(981_000), false).battery, Battery::Low);
        assert_eq!(run(&mut model, at(999_000), false).battery, Battery::Low);
        assert_eq!(run(&mut model, at(1_001_000), false).battery, Battery::Empty);
        assert_eq!(model.due(), None);
    }
}
