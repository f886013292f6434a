//! The whole device: bus half, sensor half and non-volatile memory, from power-on to power-off.

use profibus_dp::dp::{DpSlave, Slave};
use profibus_dp::fdl::{BaudSetting, ReceiverMode, Station, Window};
use profibus_dp::time::{Baudrate, Instant};
use profibus_dp::wire::Telegram;

use crate::configuration::Configurations;
use crate::diagnostics::Alarms;
use crate::encoder::{Encoder, Identity};
use crate::end_cap::{EffectiveAddress, effective_address};
use crate::event::{Observer, PositionErrorCause};
use crate::halves::{BusHalf, ShaftHalf};
use crate::health::{Battery, Measurement};
use crate::nonvolatile::{Choice, Record, SLOT_OCTETS, Slot, SlotFault};
use crate::sensor::ShaftReading;
use crate::sensor_half::SensorHalf;
use crate::specification::{SUPPLY_MIN_MV, SUPPLY_OFF_BELOW_MV, Variant};
use crate::write_policy::WritePolicy;

/// The most input and output octets of any functionality (manual 4.3).
pub(crate) const INPUTS: usize = 12;
pub(crate) const OUTPUTS: usize = 4;

/// The bus half on whole telegrams.
type BusSlave<O> = Slave<Encoder<O>, INPUTS, OUTPUTS>;

/// What holds at power-on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PowerOn {
    /// Who the device is.
    pub identity: Identity,
    /// What the non-volatile memory holds.
    pub stored: Choice,
    /// The battery that keeps the turn count.
    pub battery: Battery,
    /// Baud rate, or the search for it.
    pub baud: BaudSetting,
    /// What the receiver sees of the line.
    pub receiver: ReceiverMode,
}

/// A record on its way to the non-volatile memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NonvolatileWrite {
    /// The slot it goes to; the other keeps the record before.
    pub slot: Slot,
    /// What the slot holds then.
    pub octets: [u8; SLOT_OCTETS],
}

/// The device under power.
///
/// It is a [`Station`] on the bus side. On its other side it takes the shaft
/// ([`sample`](Self::sample)), the world ([`measure`](Self::measure)) and gives what must be kept
/// ([`take_nonvolatile`](Self::take_nonvolatile)). A driver
///
/// - samples every 500 us from power-on, or (a host) every latch that
///   [`latch_needed`](Self::latch_needed) names, before each `receive`, `indicate` and `poll`;
/// - calls `poll` when [`next_deadline`](Station::next_deadline) has come;
/// - asks for `take_nonvolatile` after every call that may have changed something, and, where it
///   can, before it puts a reply on the line.
///
/// Dropping it is cutting its power.
#[derive(Debug)]
pub struct Device<O = ()> {
    bus: DpSlave<Encoder<O>, INPUTS, OUTPUTS>,
    sensor: SensorHalf,
    memory: Memory,
}

/// The non-volatile memory as seen from the core.
#[derive(Debug)]
pub(crate) struct Memory {
    policy: WritePolicy,
    /// The supply measured last.
    supply_mv: i32,
    sequence: u32,
    slot: Slot,
    /// Nothing was ever confirmed: both slots are to be written, one straight after the other.
    fresh: bool,
}

impl<O: Observer> Device<O> {
    /// Switches the device on.
    pub fn new(now: Instant, power_on: PowerOn, observer: O) -> Self {
        let mut bus = BusHalf::blank(observer);
        let ShaftHalf { sensor, memory } = bus.switch_on(now, power_on);
        Self { bus: bus.bus, sensor, memory }
    }

    /// The two halves by themselves, for firmware that drives them at different priorities.
    pub fn into_halves(self) -> (BusHalf<O>, ShaftHalf) {
        let Self { bus, sensor, memory } = self;
        (BusHalf { bus }, ShaftHalf { sensor, memory })
    }

    /// Offers other configurations than those of the manual's readings, before a master comes.
    #[must_use]
    pub fn offering(mut self, configurations: Configurations) -> Self {
        self.bus.application_mut().configurations = configurations;
        self
    }

    /// The bus half: states, address, parameters.
    pub const fn bus(&self) -> &DpSlave<Encoder<O>, INPUTS, OUTPUTS> {
        &self.bus
    }

    /// The application of the bus half.
    pub const fn encoder(&self) -> &Encoder<O> {
        self.bus.application()
    }

    /// The sensor half: position, motion, health.
    pub const fn sensor(&self) -> &SensorHalf {
        &self.sensor
    }

    /// Whoever is told what happens.
    pub const fn observer_mut(&mut self) -> &mut O {
        &mut self.bus.application_mut().observer
    }

    /// What the switches and the memory make of the address (manual 3.4).
    pub fn effective_address(&self) -> EffectiveAddress {
        let encoder = self.encoder();
        effective_address(encoder.identity().switches, encoder.stored_address())
    }

    /// One octet that ended at `now`, on a line whose idle times are seen: the path of a UART
    /// interrupt. [`Station::receive`] with one octet does the same in more steps.
    #[inline]
    pub fn receive_octet(&mut self, now: Instant, octet: u8) -> Option<Window> {
        if self.bus.collect(now, octet) { self.take_collected(now) } else { None }
    }

    /// An octet has completed a telegram. By itself, so that all other octets are fast.
    #[inline(never)]
    fn take_collected(&mut self, now: Instant) -> Option<Window> {
        let window = self.bus.take_collected(now);
        self.obey_if_asked(now);
        window
    }

    /// Takes the latch that is due at `now`; `false` if none is.
    #[inline]
    pub fn sample(&mut self, now: Instant, reading: ShaftReading) -> bool {
        let encoder = self.bus.application_mut();
        if !self.sensor.sample(now, reading, &mut encoder.observer) {
            return false;
        }
        encoder.image = *self.sensor.inputs();
        if self.sensor.alarms() != encoder.health.alarms {
            self.publish_health();
        }
        true
    }

    /// The earliest latch up to `now` that must be sampled before anything else happens.
    #[inline]
    pub fn latch_needed(&self, now: Instant) -> Option<Instant> {
        self.sensor.latch_needed(now)
    }

    /// Takes what was measured of the world.
    ///
    /// Reading "Operating time": everything is written when the supply falls, below its range and
    /// once more below what the device runs on.
    pub fn measure(&mut self, now: Instant, measurement: &Measurement) {
        self.memory.note_supply(measurement.supply_mv);
        self.sensor.measure(now, measurement, &mut self.bus.application_mut().observer);
        self.publish_health();
    }

    /// Raises the position error alarm (manual 4.2.2).
    pub fn position_error(&mut self, now: Instant, cause: PositionErrorCause) {
        self.sensor.position_error(now, cause, &mut self.bus.application_mut().observer);
        self.publish_health();
    }

    /// The host tells the baud rate: it counts as found.
    pub fn set_baudrate(&mut self, now: Instant, rate: Baudrate) {
        self.bus.set_baudrate(now, rate);
    }

    /// The far side has gone: an unfinished telegram is forgotten.
    pub fn forget_unfinished(&mut self) {
        self.bus.forget_unfinished();
    }

    /// What is to be written now. It must be confirmed within 40 ms, or told to have failed.
    pub fn take_nonvolatile(&mut self, now: Instant) -> Option<NonvolatileWrite> {
        let encoder = self.bus.application_mut();
        let address_changed = encoder.take_address_change();
        self.memory.take(now, &mut self.sensor, encoder.stored_address(), address_changed)
    }

    /// The record taken is in the memory.
    pub fn confirm_nonvolatile(&mut self) {
        self.memory.confirm();
    }

    /// The record taken could not be written; it will be tried again, to the same slot.
    pub fn nonvolatile_failed(&mut self, now: Instant) {
        self.memory.failed(now);
    }

    /// The end is near and known: everything is to be written without delay.
    pub fn shut_down(&mut self) {
        self.memory.force();
    }

    fn obey_if_asked(&mut self, now: Instant) {
        if self.bus.application().is_demanding() {
            obey(self.bus.slave_mut(), &mut self.sensor, &mut self.memory, now);
        }
    }

    fn publish_health(&mut self) {
        publish_health(self.bus.slave_mut(), &mut self.sensor, &mut self.memory);
    }
}

/// Lets the sensor half do what the bus asked for.
#[cold]
#[inline(never)]
fn obey<O: Observer>(slave: &mut BusSlave<O>, sensor: &mut SensorHalf, memory: &mut Memory, now: Instant) {
    let encoder = slave.application_mut();
    while let Some(demand) = encoder.take_demand() {
        sensor.obey(now, demand, &mut encoder.observer);
    }
    encoder.image = *sensor.inputs();
    publish_health(slave, sensor, memory);
}

/// Carries alarms, warnings, operating time and offset over to the bus half.
///
/// Reading "Alarms, warnings": answers are high priority after any change of a bit that is sent,
/// until the owner has fetched it.
#[cold]
#[inline(never)]
fn publish_health<O: Observer>(slave: &mut BusSlave<O>, sensor: &mut SensorHalf, memory: &mut Memory) {
    let health = sensor.health();
    let encoder = slave.application_mut();
    let before = core::mem::replace(&mut encoder.health, health);
    let warnings_changed = encoder.sends_warnings() && before.warnings != health.warnings;
    if before.alarms != health.alarms || warnings_changed {
        slave.diagnosis_changed();
    }
    // Reading "Position error": stored at once.
    if (health.alarms - before.alarms).contains(Alarms::POSITION_ERROR) {
        memory.policy.force();
    }
    memory.note_change(sensor);
}

/// Reading: the very first record goes to both slots. So a slot that holds no record beside one that
/// is blank is a first write that was cut, not a loss: the device is as delivered.
fn never_confirmed(stored: &Choice) -> bool {
    match stored {
        Choice::AsDelivered => true,
        Choice::Lost { a, b } => *a == SlotFault::Absent || *b == SlotFault::Absent,
        Choice::Use { .. } => false,
    }
}

impl Memory {
    /// At power-on, and the record that the device goes on with.
    pub(crate) fn new(now: Instant, variant: Variant, stored: Choice) -> (Self, Record) {
        let fresh = never_confirmed(&stored);
        let (record, sequence, slot) = match stored {
            _ if fresh => (Record::as_delivered(variant), 0, Slot::B),
            Choice::Use { record, sequence, slot, .. } => (record, sequence, slot),
            _ => (Record::after_damage(variant), 0, Slot::B),
        };
        (Self { policy: WritePolicy::new(now), supply_mv: 0, sequence, slot, fresh }, record)
    }

    /// Something that must be kept may have changed.
    pub(crate) fn note_change(&mut self, sensor: &mut SensorHalf) {
        if sensor.take_record_change() {
            self.policy.change();
        }
    }

    /// Everything is to be written without delay.
    pub(crate) fn force(&mut self) {
        self.policy.force();
    }

    /// Reading "Operating time": everything is written when the supply falls.
    pub(crate) fn note_supply(&mut self, supply_mv: i32) {
        let before = core::mem::replace(&mut self.supply_mv, supply_mv);
        let falls_below = |limit| supply_mv < limit && before >= limit;
        if falls_below(SUPPLY_MIN_MV) || falls_below(SUPPLY_OFF_BELOW_MV) {
            self.policy.force();
        }
    }

    /// See [`Device::take_nonvolatile`].
    pub(crate) fn take(
        &mut self,
        now: Instant,
        sensor: &mut SensorHalf,
        stored_address: Option<u8>,
        address_changed: bool,
    ) -> Option<NonvolatileWrite> {
        if address_changed {
            self.policy.force();
        }
        // A latch may have ended what a power-on began: the turn count is known again.
        self.note_change(sensor);
        if !self.policy.take(now) {
            return None;
        }
        self.sequence = self.sequence.wrapping_add(1);
        self.slot = self.slot.other();
        let record = sensor.record(now, stored_address);
        Some(NonvolatileWrite { slot: self.slot, octets: record.encode(self.sequence) })
    }

    /// See [`Device::confirm_nonvolatile`].
    pub(crate) fn confirm(&mut self) {
        self.policy.confirm();
        if core::mem::take(&mut self.fresh) {
            self.policy.force();
        }
    }

    /// See [`Device::nonvolatile_failed`].
    pub(crate) fn failed(&mut self, now: Instant) {
        self.slot = self.slot.other();
        self.policy.failed(now);
    }
}

impl<O: Observer> Station for Device<O> {
    #[inline]
    fn receive(&mut self, now: Instant, octets: &[u8]) -> Option<Window> {
        let Self { bus, sensor, memory } = self;
        // After each telegram: a preset belongs to the scaling before new parameters.
        bus.receive_then(now, octets, |slave, at| {
            if slave.application().is_demanding() {
                obey(slave, sensor, memory, at);
            }
        })
    }

    #[inline]
    fn indicate(&mut self, now: Instant, telegram: &Telegram<'_>) -> Option<Window> {
        let window = self.bus.indicate(now, telegram);
        self.obey_if_asked(now);
        window
    }

    fn line_error(&mut self, now: Instant) {
        self.bus.line_error(now);
    }

    #[inline]
    fn transmit(&mut self, now: Instant) -> Option<&[u8]> {
        self.bus.transmit(now)
    }

    fn poll(&mut self, now: Instant) {
        self.bus.poll(now);
        self.obey_if_asked(now);
        self.sensor.poll(now, &mut self.bus.application_mut().observer);
        self.publish_health();
    }

    fn next_deadline(&self) -> Option<Instant> {
        let deadlines =
            [self.bus.next_deadline(), self.sensor.next_deadline(), self.memory.policy.next_deadline()];
        deadlines.into_iter().flatten().min()
    }

    fn listening_rate(&self) -> Baudrate {
        self.bus.listening_rate()
    }

    fn address(&self) -> Option<u8> {
        self.bus.address()
    }
}
