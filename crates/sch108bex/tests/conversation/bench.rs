//! The device on the bench: the one file of these tests that knows the names of the product.

use std::cell::RefCell;
use std::rc::Rc;

use profibus_dp::fdl::{BaudSetting, ReceiverMode, Station, Window};
use profibus_dp::time::{Baudrate, Instant};
use sch108bex::device::{Device, NonvolatileWrite, PowerOn};
use sch108bex::encoder::Identity;
use sch108bex::end_cap::RotarySwitches;
use sch108bex::event::{Event, Observer, PositionErrorCause};
use sch108bex::health::{Battery, Measurement};
use sch108bex::nonvolatile::{Choice, Record, SLOT_OCTETS, Slot, choose};
use sch108bex::sensor::ShaftReading;
use sch108bex::specification::{SUPPLY_OFF_BELOW_MV, Variant};

use super::script::{self, Setup};

/// What the device reported, as its plain sentences.
#[derive(Debug, Clone, Default)]
pub(crate) struct Reports(Rc<RefCell<Vec<String>>>);

impl Observer for Reports {
    fn observe(&mut self, _: Instant, event: &Event) {
        self.0.borrow_mut().push(event.to_string());
    }
}

/// The device, its switches, the world around it and the memory that outlives its power.
pub(crate) struct Bench {
    device: Option<Device<Reports>>,
    identity: Identity,
    world: Measurement,
    slots: [Vec<u8>; 2],
    writing: Option<NonvolatileWrite>,
    baud: BaudSetting,
    receiver: ReceiverMode,
    reports: Reports,
}

impl Bench {
    pub(crate) fn new(setup: &Setup) -> Result<Self, String> {
        let (n, m) = setup.bits;
        let variant = Variant::new(n, m).map_err(|error| error.to_string())?;
        let serial_number =
            setup.serial.parse().map_err(|_| format!("`{}` is no serial number", setup.serial))?;
        let record = Record {
            stored_address: setup.stored_address,
            operating_time_ms: setup.operating_time * 360_000,
            ..Record::as_delivered(variant)
        };
        Ok(Self {
            device: None,
            identity: Identity {
                variant,
                ident_number: setup.ident,
                serial_number,
                switches: RotarySwitches(setup.switches),
            },
            world: Measurement {
                supply_mv: 24_000,
                temperature_tenths: 200,
                light_ok: true,
                battery: Battery::Ok,
            },
            slots: [record.encode(1).to_vec(), Vec::new()],
            writing: None,
            baud: setup.baud.map_or(BaudSetting::Search(Baudrate::B12000000), BaudSetting::Fixed),
            receiver: if setup.stream { ReceiverMode::Stream } else { ReceiverMode::Idle },
            reports: Reports::default(),
        })
    }

    pub(crate) fn power_on(&mut self, now: Instant) {
        let [a, b] = &self.slots;
        let stored: Choice = choose(Record::decode(a), Record::decode(b));
        let power_on = PowerOn {
            identity: self.identity,
            stored,
            battery: self.world.battery,
            baud: self.baud,
            receiver: self.receiver,
        };
        self.device = Some(Device::new(now, power_on, self.reports.clone()));
        self.measure(now);
    }

    /// Cuts the power: what is being written stays unwritten.
    pub(crate) fn power_off(&mut self) {
        self.device = None;
        self.writing = None;
    }

    pub(crate) const fn is_powered(&self) -> bool {
        self.device.is_some()
    }

    pub(crate) fn switches(&mut self, switches: u8) {
        self.identity.switches = RotarySwitches(switches);
    }

    pub(crate) fn station(&mut self) -> Option<&mut dyn Station> {
        self.device.as_mut().map(|device| device as &mut dyn Station)
    }

    /// Latches what is due up to `now` from `shaft`.
    pub(crate) fn latch(&mut self, now: Instant, shaft: impl Fn(Instant) -> i64) {
        if let Some(device) = &mut self.device {
            while let Some(at) = device.latch_needed(now) {
                device.sample(at, ShaftReading::Full(shaft(at)));
            }
        }
    }

    pub(crate) fn receive(&mut self, now: Instant, octets: &[u8]) -> Option<Window> {
        self.device.as_mut()?.receive(now, octets)
    }

    pub(crate) fn transmit(&mut self, now: Instant) -> Option<Vec<u8>> {
        Some(self.device.as_mut()?.transmit(now)?.to_vec())
    }

    pub(crate) fn measure(&mut self, now: Instant) {
        if let Some(device) = &mut self.device {
            device.measure(now, &self.world);
        }
    }

    /// Changes the world; says whether the supply is enough for the device to run.
    pub(crate) fn supply(&mut self, tenths: i64) -> Result<bool, String> {
        self.world.supply_mv = i32::try_from(tenths * 100).map_err(|error| error.to_string())?;
        Ok(self.world.supply_mv >= SUPPLY_OFF_BELOW_MV)
    }

    pub(crate) fn temperature(&mut self, tenths: i64) -> Result<(), String> {
        self.world.temperature_tenths = i16::try_from(tenths).map_err(|error| error.to_string())?;
        Ok(())
    }

    pub(crate) const fn light(&mut self, ok: bool) {
        self.world.light_ok = ok;
    }

    pub(crate) const fn battery(&mut self, battery: script::Battery) {
        self.world.battery = match battery {
            script::Battery::Ok => Battery::Ok,
            script::Battery::Low => Battery::Low,
            script::Battery::Empty => Battery::Empty,
        };
    }

    pub(crate) fn position_error(&mut self, now: Instant) {
        if let Some(device) = &mut self.device {
            device.position_error(now, PositionErrorCause::Injected);
        }
    }

    /// Takes what the device wants to keep; `true` if a write has begun.
    pub(crate) fn take_nonvolatile(&mut self, now: Instant) -> bool {
        if self.writing.is_none() {
            self.writing = self.device.as_mut().and_then(|device| device.take_nonvolatile(now));
            return self.writing.is_some();
        }
        false
    }

    /// The write has ended well.
    pub(crate) fn confirm_nonvolatile(&mut self) {
        if let (Some(write), Some(device)) = (self.writing.take(), &mut self.device) {
            let octets: [u8; SLOT_OCTETS] = write.octets;
            let [a, b] = &mut self.slots;
            let slot = match write.slot {
                Slot::A => a,
                Slot::B => b,
            };
            *slot = octets.to_vec();
            device.confirm_nonvolatile();
        }
    }

    /// What was reported since the last [`forget_reports`](Self::forget_reports).
    pub(crate) fn reports(&self) -> Vec<String> {
        self.reports.0.borrow().clone()
    }

    pub(crate) fn forget_reports(&self) {
        self.reports.0.borrow_mut().clear();
    }
}
