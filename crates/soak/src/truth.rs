//! What an encoder must show, from what was done to it, in plain arithmetic.

use plant::{Shaft, World};
use profibus_dp::time::{Duration, Instant};
use sch108bex::health::Battery;
use sch108bex::specification::Variant;

/// Manual 1: 2000 updates a second.
const LATCH_NS: u64 = 500_000;
/// Reading "Supply": the alarm goes so long after the supply is back; and so late it may be seen.
const SETTLED_AFTER: Duration = Duration::from_millis(100);
const SEEN_AFTER: Duration = Duration::from_micros(100_100);

/// The scaling that the master has given.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scale {
    pub(crate) counter_clockwise: bool,
    pub(crate) units: u32,
    pub(crate) range: u32,
}

/// The offsets that are possible: one, unless a preset was not confirmed or was asked for twice.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Offsets {
    values: [i64; 8],
    count: usize,
}

/// What happened to an encoder, as far as it shows.
#[derive(Debug, Clone)]
pub(crate) struct Truth {
    pub(crate) variant: Variant,
    pub(crate) scale: Scale,
    pub(crate) power_on: Instant,
    shaft: Shaft,
    /// The shaft before, and until when that was it.
    before: (Shaft, Instant),
    pub(crate) offsets: Offsets,
    pub(crate) world: World,
    /// The supply has been back inside its range since then.
    supply_back: Option<Instant>,
}

impl Offsets {
    pub(crate) const NONE: Self = Self { values: [0; 8], count: 1 };

    pub(crate) fn values(&self) -> &[i64] {
        &self.values[..self.count]
    }

    pub(crate) fn from(values: impl Iterator<Item = i64>) -> Self {
        let mut offsets = Self { values: [0; 8], count: 0 };
        for value in values.take(8) {
            if !offsets.values().contains(&value) {
                offsets.values[offsets.count] = value;
                offsets.count += 1;
            }
        }
        offsets
    }
}

impl Truth {
    pub(crate) fn new(variant: Variant, scale: Scale, power_on: Instant, shaft: Shaft, world: World) -> Self {
        let before = (shaft.clone(), power_on);
        Self { variant, scale, power_on, shaft, before, offsets: Offsets::NONE, world, supply_back: None }
    }

    /// The newest latch at or before `now`.
    pub(crate) fn latch(&self, now: Instant) -> Instant {
        let nanos = now.since(self.power_on).as_nanos();
        self.power_on + Duration::from_nanos(nanos / LATCH_NS * LATCH_NS)
    }

    pub(crate) fn shaft(&self) -> Shaft {
        self.shaft.clone()
    }

    pub(crate) fn set_shaft(&mut self, now: Instant, shaft: Shaft) {
        self.before = (std::mem::replace(&mut self.shaft, shaft), now);
    }

    /// The scaled position of the newest latch, without offset.
    pub(crate) fn scaled(&self, now: Instant) -> i64 {
        let latch = self.latch(now);
        // What was latched at the very instant of the change was the shaft before.
        let shaft = if latch <= self.before.1 { &self.before.0 } else { &self.shaft };
        let total = u64::from(self.variant.total());
        let counts = shaft.clone().at(latch, self.variant).cast_unsigned() & (total - 1);
        let directed = if self.scale.counter_clockwise { (total - counts) & (total - 1) } else { counts };
        let scaled = (directed * u64::from(self.scale.units)) >> self.variant.singleturn_bits();
        scaled.cast_signed()
    }

    /// Whether this position is that of one of the latches, with one of the offsets; keeps those offsets
    /// that it can be.
    pub(crate) fn takes_position(&mut self, position: u32, asked: &[Instant]) -> bool {
        let range = i64::from(self.scale.range);
        let fits = |offset: i64| {
            asked.iter().any(|&at| (self.scaled(at) + offset).rem_euclid(range) == i64::from(position))
        };
        if let [offset] = *self.offsets.values() {
            return fits(offset);
        }
        let left = Offsets::from(self.offsets.values().iter().copied().filter(|&offset| fits(offset)));
        let found = left.count > 0;
        if found {
            self.offsets = left;
        }
        found
    }

    /// A preset was asked for at these instants; not confirmed, it may also not have been heard.
    pub(crate) fn preset(&mut self, value: u32, asked: &[Instant], confirmed: bool) {
        let range = i64::from(self.scale.range);
        let new = asked.iter().map(|&at| i64::from(value) - self.scaled(at).rem_euclid(range));
        let old = self.offsets.values().iter().copied().filter(|_| !confirmed);
        self.offsets = Offsets::from(new.chain(old));
    }

    pub(crate) fn set_world(&mut self, now: Instant, world: World) {
        let before = self.world.0.supply_in_range();
        self.world = world;
        match (before, world.0.supply_in_range()) {
            (false, true) => self.supply_back = Some(now),
            (_, false) => self.supply_back = None,
            (true, true) => {}
        }
    }

    pub(crate) fn set_power_on(&mut self, now: Instant) {
        self.power_on = now;
        self.before = (self.shaft.clone(), now);
        self.supply_back = None;
    }

    /// Octet 8 of the diagnosis; `None` while the supply settles.
    pub(crate) fn alarms(&self, now: Instant) -> Option<u8> {
        if !self.world.0.supply_in_range() {
            return Some(0x02);
        }
        match self.supply_back {
            Some(back) if now < back + SETTLED_AFTER => Some(0x02),
            Some(back) if now < back + SEEN_AFTER => None,
            _ => Some(0),
        }
    }

    /// Octets 20-21 of the diagnosis.
    pub(crate) fn warnings(&self) -> u16 {
        let world = self.world.0;
        u16::from(world.temperature_tenths > 650) << 1
            | u16::from(!world.light_ok) << 2
            | u16::from(world.battery != Battery::Ok) << 5
    }
}
