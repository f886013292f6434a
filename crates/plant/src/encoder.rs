//! One encoder in its world, as a station for any segment.

mod injected;
mod surroundings;

use bus::RateListener;
use profibus_dp::fdl::{BaudSetting, ReceiverMode, Station, Window};
use profibus_dp::time::{Baudrate, Instant};
use profibus_dp::wire::Telegram;
use profibus_dp::wire::telegram::MAX_OCTETS;
use sch108bex::configuration::Configurations;
use sch108bex::end_cap::{RotarySwitches, TerminationSwitches};
use sch108bex::health::Battery;
use sch108bex::nonvolatile::Choice;
use sch108bex::sensor::ShaftReading;
use sch108bex::{Device, Identity, PowerOn};

pub use injected::{EncoderCounters, Injected, PresetError};
pub use surroundings::Reason;

use crate::machine::Machine;
use crate::report::{Reporter, What};
use crate::sample::{DeviceSample, Sample, Samplings};
use crate::shaft::Shaft;
use crate::snapshot::{DeviceSnapshot, MachineSnapshot, Snapshot};
use crate::store::{Store, StoreError};
use crate::world::World;
use crate::world::model::WorldModel;

/// The timing that counts where the end of a segment has no rate of its own.
const RATE_WITHOUT_A_RATE: Baudrate = bus::segment::DEFAULT_RATE;

/// Everything that makes an encoder before it gets power.
#[derive(Debug)]
pub struct EncoderSetup {
    /// Who it is.
    pub identity: Identity,
    /// The configurations that it offers.
    pub configurations: Configurations,
    /// How it comes to its baud rate.
    pub rate: Rate,
    /// Its two termination switches (manual 3.3).
    pub termination: TerminationSwitches,
    /// What turns it.
    pub shaft: Shaft,
    /// What is around it.
    pub world: World,
    /// What keeps its memory.
    pub store: Store,
    /// Whom it tells what happens.
    pub reporter: Reporter,
}

/// How an encoder comes to its baud rate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rate {
    /// It listens at this rate only.
    Fixed(Baudrate),
    /// It searches, beginning with this one: on a bus whose octets have a rate, such as a virtual
    /// segment.
    Search(Baudrate),
    /// The master's, where the end of the segment knows it, counts as found at once; 500 kbit/s
    /// until then, and where the end has none.
    OfTheEnd,
}

/// An encoder, its shaft, its world and its memory.
///
/// Implements [`Station`]: before every call the latches that matter are taken from the shaft, and
/// before a reply leaves what must be kept is in the store.
#[derive(Debug)]
pub struct EncoderStation {
    setup: EncoderSetup,
    /// Boxed, so that a segment finds its stations close together.
    device: Option<Box<Device<Reporter>>>,
    /// The rate that the segment's end has told.
    told_rate: Option<Baudrate>,
    injected: Injected,
    counters: EncoderCounters,
    /// What changes around it by itself.
    model: Option<Box<WorldModel>>,
    /// For the units of the machine.
    machine: Option<Machine>,
    too_fast: bool,
    samplings: Samplings,
    reply: [u8; MAX_OCTETS],
}

impl EncoderStation {
    /// Puts an encoder into its world; it has power from `now` on if the supply suffices.
    ///
    /// # Errors
    ///
    /// The store cannot be read.
    pub fn new(now: Instant, setup: EncoderSetup) -> Result<Self, StoreError> {
        let mut station = Self {
            setup,
            device: None,
            told_rate: None,
            injected: Injected::default(),
            counters: EncoderCounters::default(),
            model: None,
            machine: None,
            too_fast: false,
            samplings: Samplings::default(),
            reply: [0; MAX_OCTETS],
        };
        if station.setup.world.is_powered() {
            // Damage that a user does not know of yet is told before anything is written over it.
            let stored = station.setup.store.load()?;
            station.power_on(now, stored);
        }
        Ok(station)
    }

    /// Its name.
    pub fn name(&self) -> &str {
        self.setup.reporter.who()
    }

    /// The device, while it has power.
    pub fn device(&self) -> Option<&Device<Reporter>> {
        self.device.as_deref()
    }

    /// What is around it.
    pub fn world(&self) -> World {
        self.setup.world
    }

    /// Another movement of the shaft, from `now` on.
    pub fn set_shaft(&mut self, now: Instant, shaft: Shaft) {
        self.latch(now);
        self.setup.shaft = shaft;
    }

    /// The shaft begins its movement at `now`.
    pub fn start_shaft(&mut self, now: Instant) {
        self.set_shaft(now, self.setup.shaft.clone().started(now));
    }

    /// Another world, from `now` on. Too little supply takes the power away, enough gives it back.
    ///
    /// # Errors
    ///
    /// With power coming back: the store cannot be read.
    pub fn set_world(&mut self, now: Instant, world: World) -> Result<(), StoreError> {
        self.breathe(now);
        self.apply_world(now, world)
    }

    fn apply_world(&mut self, now: Instant, world: World) -> Result<(), StoreError> {
        self.setup.world = world;
        // What is written because of it has the position of this instant.
        self.latch(now);
        if let Some(device) = &mut self.device {
            device.measure(now, &world.0);
            self.keep(now);
        }
        self.set_power(now)
    }

    /// The switches are turned; the device looks at them at its next power-on (manual 3.4).
    pub fn set_switches(&mut self, switches: RotarySwitches) {
        self.setup.identity.switches = switches;
    }

    /// Cuts the power without warning, and gives it back if the supply suffices.
    ///
    /// # Errors
    ///
    /// The store cannot be read.
    pub fn power_cycle(&mut self, now: Instant) -> Result<(), StoreError> {
        self.breathe(now);
        self.power_off(now);
        self.set_power(now)
    }

    /// An orderly end: what must be kept is written and on the disk.
    pub fn shut_down(&mut self, now: Instant) {
        self.latch(now);
        if let Some(device) = &mut self.device {
            device.shut_down();
        }
        self.keep(now);
        if let Err(error) = self.setup.store.sync() {
            self.setup.reporter.tell(now, What::NotStored(error.to_string().into()));
        }
    }

    /// What it is like at `now`.
    pub fn snapshot(&mut self, now: Instant) -> Snapshot {
        self.breathe(now);
        self.latch(now);
        let identity = self.setup.identity;
        let shaft_position = self.setup.shaft.at(now, identity.variant);
        let rpm = self.setup.shaft.rpm(now);
        let machine = self.machine().map(|machine| MachineSnapshot {
            unit: machine.unit.clone(),
            position: machine.position(shaft_position, identity.variant),
            rope_layer: machine.rope_layer(shaft_position, identity.variant),
            per_turn: machine.per_turn,
            speed: rpm / 60.0 / machine.turns_per_unit(machine.position(shaft_position, identity.variant)),
        });
        Snapshot {
            name: self.name().to_owned(),
            at: now,
            identity,
            switches: identity.switches,
            termination: self.setup.termination,
            world: self.setup.world,
            shaft: self.setup.shaft.clone(),
            shaft_position,
            rpm,
            machine,
            reasons: self.reasons(),
            injected: self.injected,
            counters: self.counters,
            device: self.device().map(DeviceSnapshot::of),
        }
    }

    /// What it is like at `at`, which is not before any earlier latch.
    pub(crate) fn sample(&mut self, at: Instant) -> Sample<'_> {
        self.latch(at);
        let variant = self.setup.identity.variant;
        let shaft_position = self.setup.shaft.at(at, variant);
        let rpm = self.setup.shaft.rpm(at);
        let World(measured) = self.setup.world;
        let machine = self.machine();
        Sample {
            at,
            shaft_position,
            rpm,
            machine: machine.map(|machine| (machine.position(shaft_position, variant), &*machine.unit)),
            supply_mv: measured.supply_mv,
            temperature_tenths: measured.temperature_tenths,
            device: self.device().map(DeviceSample::of),
        }
    }

    #[inline]
    pub(crate) fn samplings_mut(&mut self) -> &mut Samplings {
        &mut self.samplings
    }

    fn set_power(&mut self, now: Instant) -> Result<(), StoreError> {
        let powered = self.setup.world.is_powered() && !self.injected.switched_off;
        match (powered, self.device.is_some()) {
            (true, false) => {
                let stored = self.load()?;
                self.power_on(now, stored);
                Ok(())
            }
            (false, true) => {
                self.power_off(now);
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// The rate at which it listens first once it has power. Without power it hears nothing, and a segment
    /// need not take it for one that hears faults.
    fn first_rate(&self) -> Baudrate {
        match self.setup.rate {
            Rate::Fixed(rate) | Rate::Search(rate) => rate,
            Rate::OfTheEnd => self.told_rate.unwrap_or(RATE_WITHOUT_A_RATE),
        }
    }

    /// What the memory holds at a later power-on: there the damage is the encoder's to deal with.
    fn load(&mut self) -> Result<Choice, StoreError> {
        if std::mem::take(&mut self.injected.memory_lost_at_power_on) {
            self.setup.store.damage([true; 2])?;
        }
        match self.setup.store.load() {
            Err(StoreError::Damaged { a, b, .. }) => Ok(Choice::Lost { a, b }),
            other => other,
        }
    }

    fn power_on(&mut self, now: Instant, stored: Choice) {
        let turns_lost = std::mem::take(&mut self.injected.turns_lost_at_power_on);
        let EncoderSetup { identity, configurations, rate, world, reporter, .. } = &self.setup;
        let baud = match *rate {
            Rate::Fixed(rate) => BaudSetting::Fixed(rate),
            Rate::Search(first) => BaudSetting::Search(first),
            Rate::OfTheEnd => BaudSetting::Fixed(self.told_rate.unwrap_or(RATE_WITHOUT_A_RATE)),
        };
        let power_on = PowerOn {
            identity: *identity,
            stored,
            battery: if turns_lost { Battery::Empty } else { world.0.battery },
            baud,
            receiver: ReceiverMode::Idle,
        };
        let device = Device::new(now, power_on, reporter.clone()).offering(*configurations);
        let mut device = Box::new(device);
        reporter.tell(now, What::PowerOn(device.address()));
        device.measure(now, &world.0);
        self.device = Some(device);
        self.counters.power_ons += 1;
        if let Some(model) = &mut self.model {
            model.note_power(now, true);
        }
        self.latch(now);
        self.keep(now);
    }

    fn power_off(&mut self, now: Instant) {
        if self.device.take().is_some() {
            self.too_fast = false;
            if let Some(model) = &mut self.model {
                model.note_power(now, false);
            }
            self.setup.reporter.tell(now, What::PowerOff);
        }
    }

    /// The address that it answers to while it is on the bus.
    fn reachable_at(&self) -> Option<u8> {
        self.device.as_ref()?.address()
    }

    /// Takes the latches up to `now` that matter.
    #[inline]
    fn latch(&mut self, now: Instant) {
        self.take_samples(now);
        let Some(device) = &mut self.device else {
            return;
        };
        let mut newest = None;
        while let Some(latch) = device.latch_needed(now) {
            newest = Some(latch);
            let reading = if self.injected.sensor_fault {
                ShaftReading::Fault
            } else {
                ShaftReading::Full(self.setup.shaft.at(latch, self.setup.identity.variant))
            };
            device.sample(latch, reading);
        }
        if let Some(latch) = newest
            && self.may_be_too_fast()
        {
            self.watch_speed(latch);
        }
    }

    /// Writes what must be kept by now.
    #[inline]
    fn keep(&mut self, now: Instant) {
        let worn_out = self.is_worn_out();
        let Some(device) = &mut self.device else {
            return;
        };
        if let Some(record) = device.take_nonvolatile(now) {
            if self.injected.torn_write {
                self.tear(now, &record);
                return;
            }
            let written = if worn_out {
                Err(std::io::Error::other("it is worn out"))
            } else if self.injected.writes_fail {
                Err(std::io::Error::other(
                    "the memory refuses to be written, as asked over the control socket",
                ))
            } else {
                self.setup.store.write(&record)
            };
            match written {
                Ok(()) => {
                    self.counters.memory_writes += 1;
                    device.confirm_nonvolatile();
                }
                Err(error) => {
                    self.counters.memory_writes_failed += 1;
                    device.nonvolatile_failed(now);
                    self.setup.reporter.tell(now, What::NotStored(error.to_string().into()));
                }
            }
        }
    }
}

impl Station for EncoderStation {
    fn receive(&mut self, now: Instant, octets: &[u8]) -> Option<Window> {
        if self.injected.is_off() {
            return None;
        }
        self.latch(now);
        self.device.as_mut()?.receive(now, octets)
    }

    #[inline]
    fn indicate(&mut self, now: Instant, telegram: &Telegram<'_>) -> Option<Window> {
        if self.injected.is_off() {
            return None;
        }
        self.counters.telegrams += 1;
        self.latch(now);
        self.device.as_mut()?.indicate(now, telegram)
    }

    fn line_error(&mut self, now: Instant) {
        if self.injected.is_off() {
            return;
        }
        self.counters.line_errors += 1;
        self.latch(now);
        if let Some(device) = &mut self.device {
            device.line_error(now);
        }
    }

    #[inline]
    fn transmit(&mut self, now: Instant) -> Option<&[u8]> {
        if self.injected.off_the_bus {
            return None;
        }
        let reply = self.device.as_mut()?.transmit(now)?;
        self.counters.replies += 1;
        let length = reply.len();
        self.reply.get_mut(..length)?.copy_from_slice(reply);
        // A new address, and an offset unless another was stored within the last second, is in the
        // store before the master can know of it.
        self.keep(now);
        // The power may have gone with the write.
        self.device.as_ref()?;
        self.reply.get(..length)
    }

    fn poll(&mut self, now: Instant) {
        self.breathe(now);
        self.latch(now);
        if let Some(device) = &mut self.device {
            device.poll(now);
        }
        self.keep(now);
    }

    fn next_deadline(&self) -> Option<Instant> {
        let device = self.device.as_ref().and_then(|device| device.next_deadline());
        match self.model.as_ref().and_then(|model| model.due()) {
            None => device,
            Some(due) => Some(device.map_or(due, |device| device.min(due))),
        }
    }

    fn listening_rate(&self) -> Baudrate {
        self.device.as_ref().map_or_else(|| self.first_rate(), |device| device.listening_rate())
    }

    fn address(&self) -> Option<u8> {
        if self.injected.is_off() { None } else { self.reachable_at() }
    }
}

impl RateListener for EncoderStation {
    fn rate_found(&mut self, now: Instant, rate: Option<Baudrate>) {
        let rate = rate.unwrap_or(RATE_WITHOUT_A_RATE);
        self.told_rate = Some(rate);
        if let (Rate::OfTheEnd, Some(device)) = (self.setup.rate, &mut self.device) {
            device.set_baudrate(now, rate);
        }
    }
}
