//! Alarms (manual 4.2.2), warnings (manual 4.2.9) and operating time (manual 4.2.13).
//!
//! | octet | bit | set | gone |
//! |---|---|---|---|
//! | 8 | 0 position error | see [`crate::event::PositionErrorCause`] | at the next power-on |
//! | 8 | 1 supply voltage | outside 9.0 to 30.0 V, at once | 100 ms after it is back inside |
//! | 20-21 | 1 temperature | above 65.0 degrees C | not above |
//! | 20-21 | 2 light reserve | the sensor says so | the sensor says so |
//! | 20-21 | 4 operating time | above 876000 tenths of an hour | never |
//! | 20-21 | 5 battery | low or empty | not so |

use core::fmt;

use profibus_dp::time::{Duration, Instant};

use crate::diagnostics::{Alarms, Warnings};
use crate::event::{Event, Observer};
use crate::specification::{
    OPERATING_TIME_LIMIT_TENTHS, SUPPLY_MAX_MV, SUPPLY_MIN_MV, TEMPERATURE_LIMIT_TENTHS,
};

/// Reading: the supply voltage alarm goes after so long inside the range.
pub const SUPPLY_SETTLED_AFTER: Duration = Duration::from_millis(100);

/// Milliseconds in 0.1 h.
const TENTH_OF_AN_HOUR_MS: u64 = 360_000;

/// The state of the battery that keeps the turn count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Battery {
    /// Above its limit.
    #[default]
    Ok,
    /// Below its limit: a warning (manual 4.2.9, bit 5).
    Low,
    /// It keeps nothing any more: the same warning, and the turn count is lost with the power.
    Empty,
}

/// What the device measures of the world around it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Measurement {
    /// Supply voltage in millivolts, negative with reversed poles.
    pub supply_mv: i32,
    /// Temperature inside in tenths of a degree Celsius.
    pub temperature_tenths: i16,
    /// Whether the light of the LED is within its limits.
    pub light_ok: bool,
    /// The battery.
    pub battery: Battery,
}

/// Time under external power in tenths of an hour, as octets 28-31 of the diagnosis have it
/// (manual 4.2.13). Stays at its end after 49000 years.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct OperatingTime(pub u32);

/// What the diagnosis tells about the state of the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Health {
    /// Octet 8.
    pub alarms: Alarms,
    /// Octets 20-21.
    pub warnings: Warnings,
    /// Octets 28-31.
    pub operating_time: OperatingTime,
    /// Octets 32-35: the offset value in scaled steps (manual 4.2.14).
    pub offset: i32,
}

/// Watches over alarms, warnings and the operating time.
#[derive(Debug, Clone, Copy)]
pub struct Supervision {
    alarms: Alarms,
    warnings: Warnings,
    supply: Supply,
    clock: OperatingClock,
}

/// The supply voltage and its alarm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Supply {
    /// Inside the range, no alarm.
    Good,
    /// Outside: alarm.
    Outside,
    /// Inside again, the alarm goes then.
    Settling { until: Instant },
}

/// Counts the time under external power, on from the non-volatile record.
#[derive(Debug, Clone, Copy)]
struct OperatingClock {
    power_on: Instant,
    before_ms: u64,
    shown: OperatingTime,
    next_tenth: Instant,
}

impl Measurement {
    /// 24 V, 20 degrees, light and battery good.
    pub const GOOD: Self =
        Self { supply_mv: 24_000, temperature_tenths: 200, light_ok: true, battery: Battery::Ok };

    /// Whether the supply voltage is within 9.0 to 30.0 V (manual 4.2.2).
    pub const fn supply_in_range(&self) -> bool {
        self.supply_mv >= SUPPLY_MIN_MV && self.supply_mv <= SUPPLY_MAX_MV
    }

    /// The warnings that it gives reason for.
    fn warnings(self) -> Warnings {
        let mut warnings = Warnings::empty();
        let hot = self.temperature_tenths > TEMPERATURE_LIMIT_TENTHS;
        warnings.set(Warnings::TEMPERATURE_EXCEEDED, hot);
        warnings.set(Warnings::LIGHT_CONTROL_RESERVE, !self.light_ok);
        warnings.set(Warnings::BATTERY_CHARGE, self.battery != Battery::Ok);
        warnings
    }
}

impl OperatingTime {
    /// The tenths of an hour that are full after so many milliseconds.
    pub fn from_millis(millis: u64) -> Self {
        let tenths = millis.checked_div(TENTH_OF_AN_HOUR_MS).unwrap_or(0);
        Self(u32::try_from(tenths).unwrap_or(u32::MAX))
    }

    /// Tenths of an hour.
    pub const fn tenths(self) -> u32 {
        self.0
    }

    /// Whole hours.
    pub const fn hours(self) -> u32 {
        self.0 / 10
    }

    /// Minutes past the hour, in steps of 6.
    pub const fn minutes(self) -> u32 {
        (self.0 % 10).wrapping_mul(6)
    }

    /// Whether it is above 87600 h, strictly (manual 4.2.9, bit 4).
    pub const fn above_limit(self) -> bool {
        self.0 > OPERATING_TIME_LIMIT_TENTHS
    }
}

impl fmt::Display for OperatingTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} h {} min", self.hours(), self.minutes())
    }
}

impl Supervision {
    /// From power-on: `operating_time_ms` as the non-volatile record has it, supply, temperature
    /// and light taken for good until measured.
    pub fn new(
        power_on: Instant,
        operating_time_ms: u64,
        battery: Battery,
        observer: &mut impl Observer,
    ) -> Self {
        let mut supervision = Self {
            alarms: Alarms::empty(),
            warnings: Warnings::empty(),
            supply: Supply::Good,
            clock: OperatingClock::new(power_on, operating_time_ms),
        };
        let measurement = Measurement { battery, ..Measurement::GOOD };
        supervision.measure(power_on, &measurement, observer);
        supervision
    }

    /// The alarms now.
    #[inline]
    pub const fn alarms(&self) -> Alarms {
        self.alarms
    }

    /// The warnings now.
    #[inline]
    pub const fn warnings(&self) -> Warnings {
        self.warnings
    }

    /// The operating time as of the last call of `measure` or `poll`.
    pub const fn operating_time(&self) -> OperatingTime {
        self.clock.shown
    }

    /// The operating time at `now` in milliseconds, for the non-volatile record.
    pub fn operating_time_ms(&self, now: Instant) -> u64 {
        self.clock.millis(now)
    }

    /// Raises the position error alarm; only a power-on clears it. Says whether it is new.
    pub fn raise_position_error(&mut self, now: Instant, observer: &mut impl Observer) -> bool {
        let new = !self.alarms.contains(Alarms::POSITION_ERROR);
        self.set_alarms(now, self.alarms | Alarms::POSITION_ERROR, observer);
        new
    }

    /// Takes what was measured.
    pub fn measure(&mut self, now: Instant, measurement: &Measurement, observer: &mut impl Observer) {
        self.supply = match (self.supply, measurement.supply_in_range()) {
            (_, false) => Supply::Outside,
            (Supply::Outside, true) => Supply::Settling { until: now + SUPPLY_SETTLED_AFTER },
            (unchanged, true) => unchanged,
        };
        let kept = self.warnings & Warnings::OPERATING_TIME_LIMIT;
        self.set_warnings(now, measurement.warnings() | kept, observer);
        self.poll(now, observer);
    }

    /// Lets time pass: settles the supply voltage, counts the operating time.
    pub fn poll(&mut self, now: Instant, observer: &mut impl Observer) {
        if let Supply::Settling { until } = self.supply
            && now >= until
        {
            self.supply = Supply::Good;
        }
        let mut alarms = self.alarms;
        alarms.set(Alarms::SUPPLY_VOLTAGE, self.supply != Supply::Good);
        self.set_alarms(now, alarms, observer);
        if now >= self.clock.next_tenth {
            self.clock.show(now);
        }
        let mut warnings = self.warnings;
        warnings.set(Warnings::OPERATING_TIME_LIMIT, self.clock.shown.above_limit());
        self.set_warnings(now, warnings, observer);
    }

    /// When [`Supervision::poll`] has something to do next.
    pub fn next_deadline(&self) -> Instant {
        match self.supply {
            Supply::Settling { until } => until.min(self.clock.next_tenth),
            _ => self.clock.next_tenth,
        }
    }

    fn set_alarms(&mut self, now: Instant, alarms: Alarms, observer: &mut impl Observer) {
        let raised = alarms.difference(self.alarms);
        let cleared = self.alarms.difference(alarms);
        self.alarms = alarms;
        if !raised.is_empty() {
            observer.observe(now, &Event::AlarmRaised(raised));
        }
        if !cleared.is_empty() {
            observer.observe(now, &Event::AlarmCleared(cleared));
        }
    }

    fn set_warnings(&mut self, now: Instant, warnings: Warnings, observer: &mut impl Observer) {
        let raised = warnings.difference(self.warnings);
        let cleared = self.warnings.difference(warnings);
        self.warnings = warnings;
        if !raised.is_empty() {
            observer.observe(now, &Event::WarningRaised(raised));
        }
        if !cleared.is_empty() {
            observer.observe(now, &Event::WarningCleared(cleared));
        }
    }
}

impl OperatingClock {
    fn new(power_on: Instant, before_ms: u64) -> Self {
        let shown = OperatingTime::from_millis(before_ms);
        let mut clock = Self { power_on, before_ms, shown, next_tenth: power_on };
        clock.show(power_on);
        clock
    }

    /// Reading: the operating time is counted in milliseconds while there is power.
    fn millis(&self, now: Instant) -> u64 {
        self.before_ms.saturating_add(now.since(self.power_on).as_millis())
    }

    fn show(&mut self, now: Instant) {
        let millis = self.millis(now);
        self.shown = OperatingTime::from_millis(millis);
        let full = u64::from(self.shown.0).saturating_add(1).saturating_mul(TENTH_OF_AN_HOUR_MS);
        let since_power_on = full.saturating_sub(self.before_ms);
        self.next_tenth = self.power_on + Duration::from_millis(since_power_on);
        if self.next_tenth <= now {
            // The count is at its end.
            self.next_tenth = Instant::MAX;
        }
    }
}

#[cfg(test)]
mod tests;
