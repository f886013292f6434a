//! The same device once more, that takes every latch: 2000 a second.

use plant::{Shaft, World};
use profibus_dp::fdl::{BaudSetting, ReceiverMode, Station, Window};
use profibus_dp::time::{Baudrate, Instant};
use profibus_dp::wire::Telegram;
use sch108bex::end_cap::RotarySwitches;
use sch108bex::nonvolatile::{Record, SLOT_OCTETS, Slot, choose};
use sch108bex::sensor::ShaftReading;
use sch108bex::specification::LATCH_PERIOD;
use sch108bex::{Device, Identity, PowerOn};

/// A device beside the one on the bus.
#[derive(Debug)]
pub(crate) struct Shadow {
    device: Option<Device>,
    identity: Identity,
    rate: Baudrate,
    shaft: Shaft,
    world: World,
    memory: [Option<[u8; SLOT_OCTETS]>; 2],
    next: Instant,
    pub(crate) latches: u64,
    pub(crate) replies: u64,
}

impl Shadow {
    pub(crate) fn new(now: Instant, identity: Identity, rate: Baudrate, shaft: Shaft, world: World) -> Self {
        let mut shadow = Self {
            device: None,
            identity,
            rate,
            shaft,
            world,
            memory: [None; 2],
            next: now,
            latches: 0,
            replies: 0,
        };
        shadow.set_power(now);
        shadow
    }

    fn set_power(&mut self, now: Instant) {
        match (self.world.is_powered(), self.device.is_some()) {
            (true, false) => self.power_on(now),
            (false, true) => self.device = None,
            _ => {}
        }
    }

    fn power_on(&mut self, now: Instant) {
        let slot = |octets: &Option<[u8; SLOT_OCTETS]>| {
            Record::decode(octets.as_ref().map_or(&[], <[u8; SLOT_OCTETS]>::as_slice))
        };
        let power_on = PowerOn {
            identity: self.identity,
            stored: choose(slot(&self.memory[0]), slot(&self.memory[1])),
            battery: self.world.0.battery,
            baud: BaudSetting::Search(self.rate),
            receiver: ReceiverMode::Idle,
        };
        let mut device = Device::new(now, power_on, ());
        device.measure(now, &self.world.0);
        self.device = Some(device);
        self.next = now;
        self.latch(now);
        self.keep(now);
    }

    fn latch(&mut self, now: Instant) {
        let Some(device) = &mut self.device else { return };
        while self.next <= now {
            let counts = self.shaft.at(self.next, self.identity.variant);
            device.sample(self.next, ShaftReading::Full(counts));
            self.next += LATCH_PERIOD;
            self.latches += 1;
        }
    }

    fn keep(&mut self, now: Instant) {
        let Some(device) = &mut self.device else { return };
        if let Some(write) = device.take_nonvolatile(now) {
            self.memory[usize::from(write.slot == Slot::B)] = Some(write.octets);
            device.confirm_nonvolatile();
        }
    }

    pub(crate) fn set_shaft(&mut self, now: Instant, shaft: Shaft) {
        self.latch(now);
        self.shaft = shaft;
    }

    pub(crate) fn set_world(&mut self, now: Instant, world: World) {
        self.world = world;
        if let Some(device) = &mut self.device {
            device.measure(now, &world.0);
            self.keep(now);
        }
        self.set_power(now);
    }

    pub(crate) fn set_switches(&mut self, switches: RotarySwitches) {
        self.identity.switches = switches;
    }

    pub(crate) fn power_cycle(&mut self, now: Instant) {
        self.device = None;
        self.set_power(now);
    }

    /// What is different from the device on the bus, if anything is.
    pub(crate) fn indicate(
        &mut self,
        now: Instant,
        telegram: &Telegram<'_>,
        window: Option<Window>,
    ) -> Option<String> {
        self.latch(now);
        let own = self.device.as_mut()?.indicate(now, telegram);
        (own != window).then(|| format!("with every latch it answers {own:?}, not {window:?}"))
    }

    pub(crate) fn line_error(&mut self, now: Instant) {
        self.latch(now);
        if let Some(device) = &mut self.device {
            device.line_error(now);
        }
    }

    /// What is different from the reply of the device on the bus, if anything is.
    pub(crate) fn transmit(&mut self, now: Instant, reply: Option<&[u8]>) -> Option<String> {
        let own = self.device.as_mut()?.transmit(now);
        let difference =
            (own != reply).then(|| format!("with every latch it sends {own:02X?}, not {reply:02X?}"));
        self.replies += 1;
        self.keep(now);
        difference
    }

    pub(crate) fn poll(&mut self, now: Instant) {
        self.latch(now);
        if let Some(device) = &mut self.device {
            device.poll(now);
        }
        self.keep(now);
    }
}
