//! The device as two halves that run at different priorities: for firmware.
//!
//! [`Device`](crate::Device) is both in one and carries over what they exchange at once. Firmware
//! keeps the [`BusHalf`] for its bus interrupt and the [`ShaftHalf`] for its latch, and carries
//! over itself, each piece in a critical section of a few instructions:
//!
//! | what | from | to | when |
//! |---|---|---|---|
//! | input image | [`ShaftHalf::inputs`] | [`BusHalf::show`] | after each latch, after each demand |
//! | health | [`ShaftHalf::health`] | [`BusHalf::publish`] | after whatever returns that it changed |
//! | demands | [`BusHalf::take_demand`] | [`ShaftHalf::obey`] | after each telegram |
//! | stored address | [`BusHalf::take_address_change`] | [`ShaftHalf::take_nonvolatile`] | before each question |

// What stands in an interrupt has to lie there.
#![allow(clippy::inline_always)]

use profibus_dp::dp::{Configuration, DpSlave};
use profibus_dp::fdl::{BaudSetting, Gathered, ReceiverMode, Station, Window};
use profibus_dp::time::{Duration, Instant};

use crate::device::{INPUTS, Memory, NonvolatileWrite, OUTPUTS, PowerOn};
use crate::diagnostics::Alarms;
use crate::encoder::Encoder;
use crate::end_cap::effective_address;
use crate::event::{Observer, PositionErrorCause};
use crate::health::{Health, Measurement};
use crate::sensor::ShaftReading;
use crate::sensor_half::{Demand, InputImage, SensorHalf};

/// Receiver, station, slave and the encoder's part of them.
#[derive(Debug)]
pub struct BusHalf<O = ()> {
    pub(crate) bus: DpSlave<Encoder<O>, INPUTS, OUTPUTS>,
}

/// Latch, scaling, motion and health, and the policy of the non-volatile memory.
#[derive(Debug)]
pub struct ShaftHalf {
    pub(crate) sensor: SensorHalf,
    pub(crate) memory: Memory,
}

impl<O: Observer> BusHalf<O> {
    /// Without power: off the bus until [`switch_on`](Self::switch_on). For a static, where the
    /// half lies from the beginning and is never moved.
    pub const fn blank(observer: O) -> Self {
        Self { bus: DpSlave::blank(Encoder::blank(observer)) }
    }

    /// Switches the device on, whatever it was before; the other half begins.
    pub fn switch_on(&mut self, now: Instant, power_on: PowerOn) -> ShaftHalf {
        let PowerOn { identity, stored, battery, baud, receiver } = power_on;
        let (memory, record) = Memory::new(now, identity.variant, stored);
        let encoder = self.bus.application_mut();
        let sensor = SensorHalf::new(now, identity.variant, &record, battery, &mut encoder.observer);
        encoder.restart(identity, record.stored_address, sensor.health());
        let address = effective_address(identity.switches, record.stored_address).octet();
        self.bus.restart(now, Configuration { address, baud, receiver });
        let mut shaft = ShaftHalf { sensor, memory };
        shaft.memory.note_change(&mut shaft.sensor);
        shaft
    }

    /// The power is gone: off the bus until [`switch_on`](Self::switch_on).
    pub fn switch_off(&mut self) {
        let baud = BaudSetting::Fixed(self.bus.slave().baudrate());
        self.bus.restart(Instant::ZERO, Configuration { address: None, baud, receiver: ReceiverMode::Idle });
    }

    /// States, rate, address.
    pub const fn bus(&self) -> &DpSlave<Encoder<O>, INPUTS, OUTPUTS> {
        &self.bus
    }

    /// The line was idle for [`idle_gap`](Self::idle_gap) or longer, before the next octet.
    #[inline]
    pub fn line_was_idle(&mut self) {
        self.bus.forget_unfinished();
    }

    /// Takes one octet. The rest is [`look`](Self::look) or
    /// [`hear_foreign`](Self::hear_foreign), where it says so.
    #[inline(always)]
    pub fn gather(&mut self, octet: u8) -> Gathered {
        self.bus.gather(octet)
    }

    /// Whether the same octet completes a telegram: then
    /// [`take_collected`](Self::take_collected) must follow.
    #[inline(always)]
    pub fn look(&mut self, octet: u8) -> bool {
        self.bus.look(octet)
    }

    /// A telegram for another station has come; it ended at `now`.
    #[inline]
    pub fn hear_foreign(&mut self, now: Instant) {
        self.bus.hear_foreign(now);
    }

    /// From the end of one octet to the end of the next: as long as this, and the line was idle.
    /// It changes with the rate.
    pub const fn idle_gap(&self) -> Duration {
        self.bus.idle_gap()
    }

    /// Whether the telegram just completed is sure to be answered with data: an SD2 that may be
    /// begun before [`take_collected`](Self::take_collected).
    #[inline]
    pub fn answers_data(&self, now: Instant) -> bool {
        self.bus.answers_data(now)
    }

    /// From the end of a request to the earliest start of its reply.
    #[inline]
    pub const fn reply_delay(&self) -> Duration {
        self.bus.slave().station().reply_delay()
    }

    /// Obeys the telegram just completed; the window of the reply, where there is one.
    #[inline]
    pub fn take_collected(&mut self, now: Instant) -> Option<Window> {
        self.bus.take_collected(now)
    }

    /// The reply, if `now` lies in its window. Octets handed out count as sent.
    #[inline]
    pub fn transmit(&mut self, now: Instant) -> Option<&[u8]> {
        self.bus.transmit(now)
    }

    /// A character with a parity, framing or overrun error.
    pub fn line_error(&mut self, now: Instant) {
        self.bus.line_error(now);
    }

    /// Lets time pass: watchdog, baud search.
    pub fn poll(&mut self, now: Instant) {
        self.bus.poll(now);
    }

    /// Whether [`take_demand`](Self::take_demand) has something.
    #[inline]
    pub const fn is_demanding(&self) -> bool {
        self.bus.application().is_demanding()
    }

    /// What the other half has to do next.
    pub fn take_demand(&mut self) -> Option<Demand> {
        self.bus.application_mut().take_demand()
    }

    /// Shows the inputs of the latest latch from now on.
    #[inline]
    pub fn show(&mut self, inputs: &InputImage) {
        self.bus.application_mut().image = *inputs;
    }

    /// Shows alarms, warnings, operating time and offset; answers are high priority after a change
    /// of a bit that is sent.
    pub fn publish(&mut self, health: Health) {
        let encoder = self.bus.application_mut();
        let before = core::mem::replace(&mut encoder.health, health);
        let warnings_changed = encoder.sends_warnings() && before.warnings != health.warnings;
        if before.alarms != health.alarms || warnings_changed {
            self.bus.diagnosis_changed();
        }
    }

    /// Whether the station address was set over the bus since the last call.
    pub fn take_address_change(&mut self) -> bool {
        self.bus.application_mut().take_address_change()
    }

    /// The station address set over the bus, if ever.
    pub const fn stored_address(&self) -> Option<u8> {
        self.bus.application().stored_address()
    }
}

impl ShaftHalf {
    /// Position, motion, health.
    pub const fn sensor(&self) -> &SensorHalf {
        &self.sensor
    }

    /// The input octets for the next answer.
    #[inline]
    pub const fn inputs(&self) -> &InputImage {
        self.sensor.inputs()
    }

    /// What the diagnosis tells.
    pub const fn health(&self) -> Health {
        self.sensor.health()
    }

    /// Takes the latch that is due at `now`; whether the health changed with it.
    #[inline]
    pub fn sample(&mut self, now: Instant, reading: ShaftReading, observer: &mut impl Observer) -> bool {
        let before = self.sensor.alarms();
        if !self.sensor.sample(now, reading, observer) || self.sensor.alarms() == before {
            return false;
        }
        self.changed_from(before);
        true
    }

    /// Does what the bus asks. The image and the health have to be carried over then.
    pub fn obey(&mut self, now: Instant, demand: Demand, observer: &mut impl Observer) {
        self.sensor.obey(now, demand, observer);
        self.memory.note_change(&mut self.sensor);
    }

    /// Takes what was measured of the world. The health has to be carried over then.
    pub fn measure(&mut self, now: Instant, measurement: &Measurement, observer: &mut impl Observer) {
        self.memory.note_supply(measurement.supply_mv);
        self.sensor.measure(now, measurement, observer);
        self.memory.note_change(&mut self.sensor);
    }

    /// Raises the position error alarm. The health has to be carried over then.
    pub fn position_error(&mut self, now: Instant, cause: PositionErrorCause, observer: &mut impl Observer) {
        let before = self.sensor.alarms();
        self.sensor.position_error(now, cause, observer);
        self.changed_from(before);
    }

    /// Lets time pass for alarms, warnings and operating time, if it brings something; whether it
    /// did, and the health has to be carried over.
    pub fn poll(&mut self, now: Instant, observer: &mut impl Observer) -> bool {
        let due = self.sensor.next_deadline().is_some_and(|deadline| now >= deadline);
        if due {
            self.sensor.poll(now, observer);
            self.memory.note_change(&mut self.sensor);
        }
        due
    }

    /// What is to be written now, with the station address as the bus half has it.
    pub fn take_nonvolatile(
        &mut self,
        now: Instant,
        stored_address: Option<u8>,
        address_changed: bool,
    ) -> Option<NonvolatileWrite> {
        self.memory.take(now, &mut self.sensor, stored_address, address_changed)
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

    /// Reading "Position error": stored at once.
    #[cold]
    #[inline(never)]
    fn changed_from(&mut self, before: Alarms) {
        if (self.sensor.alarms() - before).contains(Alarms::POSITION_ERROR) {
            self.memory.force();
        }
        self.memory.note_change(&mut self.sensor);
    }
}
