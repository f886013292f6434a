//! What changes around an encoder by itself, and why an encoder is as it is.

use profibus_dp::time::{Duration, Instant};
use sch108bex::health::Battery;
use sch108bex::specification::TEMPERATURE_LIMIT_TENTHS;
use sch108bex::specification::{SHAFT_SPEED_MAX_RPM, SUPPLY_MAX_MV, SUPPLY_MIN_MV, SUPPLY_OFF_BELOW_MV};
use serde::Serialize;

use super::EncoderStation;
use crate::machine::Machine;
use crate::report::What;
use crate::world::World;
use crate::world::model::{Cell, Led, SupplyProfile, Thermal, WorldModel};

/// A shaft that was too fast is not any more below this.
const SLOW_AGAIN: f64 = 0.99 * SHAFT_SPEED_MAX_RPM as f64;

/// Why something is not as it should be.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Reason {
    /// In one word.
    pub kind: &'static str,
    /// In a sentence.
    pub text: String,
}

impl EncoderStation {
    /// The machine that the encoder is on, for its units; `None`: that of the shaft, if it has one.
    pub fn set_machine(&mut self, machine: Option<Machine>) {
        self.machine = machine;
    }

    /// The machine whose units the snapshot has.
    pub fn machine(&self) -> Option<&Machine> {
        self.machine.as_ref().or_else(|| self.setup.shaft.machine())
    }

    /// From now on the supply follows points of nanoseconds and millivolts.
    pub(crate) fn follow_supply(&mut self, now: Instant, points: Vec<(u64, i32)>, repeat: bool) {
        self.change_model(now, |model, _, _| model.supply = Some(SupplyProfile::new(now, points, repeat)));
    }

    /// From now on the temperature runs after that around it and its own heat, from where it is.
    pub(crate) fn follow_temperature(&mut self, now: Instant, ambient: f64, own: f64, constant: Duration) {
        self.change_model(now, |model, world, _| {
            let celsius = f64::from(world.0.temperature_tenths) / 10.0;
            model.thermal = Some(Thermal::new(now, celsius, ambient, own, constant));
        });
    }

    /// From now on the LED ages; it has so much time under power left.
    pub(crate) fn age_led(&mut self, now: Instant, left: Duration) {
        self.change_model(now, |model, _, powered| model.led = Some(Led::new(now, left, powered)));
    }

    /// From now on the battery gives its charge away: a full one lasts so long without and with power.
    pub(crate) fn discharge(&mut self, now: Instant, charge: f64, low: f64, lasts: [Option<Duration>; 2]) {
        self.change_model(now, |model, _, powered| {
            model.battery = Some(Cell::new(now, charge, low, lasts, powered));
        });
    }

    /// A part of the world stays as it is from now on.
    pub(crate) fn stop_following(&mut self, now: Instant, part: impl FnOnce(&mut WorldModel)) {
        if self.model.is_some() {
            self.change_model(now, |model, _, _| part(model));
        }
    }

    fn change_model(&mut self, now: Instant, change: impl FnOnce(&mut WorldModel, World, bool)) {
        self.breathe(now);
        let powered = self.device.is_some();
        let mut model = self.model.take().unwrap_or_default();
        change(&mut model, self.setup.world, powered);
        self.model = (!model.is_empty()).then_some(model);
        self.breathe(now);
    }

    /// The world goes on to `now`.
    #[inline]
    pub(super) fn breathe(&mut self, now: Instant) {
        if self.model.is_some() {
            self.live_on(now);
        }
        self.take_samples(now);
    }

    #[cold]
    fn live_on(&mut self, now: Instant) {
        while let Some(due) = self.model.as_ref().and_then(|model| model.due()).filter(|due| *due <= now) {
            self.take_samples(due);
            self.go_to(due);
        }
        self.take_samples(now);
        self.go_to(now);
    }

    fn go_to(&mut self, now: Instant) {
        let Some(mut model) = self.model.take() else {
            return;
        };
        let mut world = self.setup.world;
        model.advance(now, self.device.is_some(), &mut world.0);
        self.model = Some(model);
        let before = self.setup.world;
        if world == before {
            return;
        }
        if self.device.is_none() && world.0.battery == Battery::Empty && before.0.battery != Battery::Empty {
            // Another battery does not bring the turn count back.
            self.injected.turns_lost_at_power_on = true;
        }
        if let Err(error) = self.apply_world(now, world) {
            self.setup.reporter.tell(now, What::NotStored(error.to_string().into()));
        }
    }

    /// Tells when the shaft gets too fast for the encoder, and when it is not any more.
    #[cold]
    pub(super) fn watch_speed(&mut self, now: Instant) {
        let rpm = self.setup.shaft.rpm(now).abs();
        if !self.too_fast && rpm > f64::from(SHAFT_SPEED_MAX_RPM) {
            self.too_fast = true;
            self.setup.reporter.tell(now, What::TooFast(rpm));
        } else if self.too_fast && rpm < SLOW_AGAIN {
            self.too_fast = false;
            self.setup.reporter.tell(now, What::SlowAgain);
        }
    }

    /// Whether the speed has to be watched.
    #[inline]
    pub(super) fn may_be_too_fast(&self) -> bool {
        self.too_fast || self.setup.shaft.may_exceed(SHAFT_SPEED_MAX_RPM)
    }

    /// Why it is not as it should be: everything around it that is out of the ordinary.
    pub fn reasons(&self) -> Vec<Reason> {
        let mut reasons = Vec::new();
        let mut add = |kind, holds: bool, text: &dyn Fn() -> String| {
            if holds {
                reasons.push(Reason { kind, text: text() });
            }
        };
        let World(world) = self.setup.world;
        let volts = f64::from(world.supply_mv) / 1e3;
        let off = world.supply_mv < SUPPLY_OFF_BELOW_MV;
        add("switched_off", self.injected.switched_off, &|| "the power is switched off".to_owned());
        add("reversed_poles", world.supply_mv < 0, &|| {
            format!("the supply has its poles reversed ({volts} V): the encoder is off")
        });
        add("no_supply", off && world.supply_mv >= 0, &|| {
            format!("the supply is {volts} V, and below 6 V the encoder is off")
        });
        add("supply_low", !off && world.supply_mv < SUPPLY_MIN_MV, &|| {
            format!("the supply is {volts} V, below 9 V: alarm (manual 4.2.2)")
        });
        add("supply_high", world.supply_mv > SUPPLY_MAX_MV, &|| {
            format!("the supply is {volts} V, above 30 V: alarm (manual 4.2.2)")
        });
        add("hot", world.temperature_tenths > TEMPERATURE_LIMIT_TENTHS, &|| {
            let celsius = f64::from(world.temperature_tenths) / 10.0;
            format!("it is {celsius} degrees inside, above 65: warning (manual 4.2.9)")
        });
        add("light_low", !world.light_ok, &|| {
            "the reserve of the LED's light is used up: warning (manual 4.2.9)".to_owned()
        });
        add("battery_low", world.battery == Battery::Low, &|| {
            "the battery is low: warning (manual 4.2.9)".to_owned()
        });
        add("battery_empty", world.battery == Battery::Empty, &|| {
            "the battery is empty: warning (manual 4.2.9), and the turn count goes with the power".to_owned()
        });
        add("sensor_fault", self.injected.sensor_fault, &|| {
            "the sensor reports a fault: position error (manual 4.2.2)".to_owned()
        });
        add("turns_lost", self.injected.turns_lost_at_power_on, &|| {
            "the turn count is lost: the next power-on restarts it with a position error".to_owned()
        });
        add("too_fast", self.too_fast, &|| {
            format!("the shaft turns faster than {SHAFT_SPEED_MAX_RPM} RPM (manual 6)")
        });
        add("writes_fail", self.injected.writes_fail, &|| "writes to the memory fail".to_owned());
        add("memory_worn_out", self.is_worn_out(), &|| {
            let writes = self.counters.memory_writes;
            format!("the memory is worn out after {writes} writes: further ones fail")
        });
        add("torn_write", self.injected.torn_write, &|| {
            "the power will go during the next write to the memory".to_owned()
        });
        add("memory_lost", self.injected.memory_lost_at_power_on, &|| {
            "the next power-on finds both records damaged".to_owned()
        });
        let switches = self.setup.identity.switches;
        let read = self.device().map(|device| device.encoder().identity().switches);
        add("switches_turned", read.is_some_and(|read| read != switches), &|| {
            format!("the switches were turned to {switches}, which counts at the next power-on (manual 3.4)")
        });
        add("cut_off", self.injected.cut_off, &|| "the cable is cut between it and the master".to_owned());
        reasons
    }

    /// Whether the memory takes no writes any more.
    pub(super) fn is_worn_out(&self) -> bool {
        self.injected.endurance.is_some_and(|endurance| self.counters.memory_writes >= endurance)
    }
}
