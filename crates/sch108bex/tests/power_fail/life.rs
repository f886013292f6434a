//! One life of a device: power-on, a deed, and all that it wrote meanwhile.

use profibus_dp::fdl::{BaudSetting, ReceiverMode, Station};
use profibus_dp::time::{Baudrate, Duration, Instant};
use sch108bex::end_cap::RotarySwitches;
use sch108bex::event::PositionErrorCause;
use sch108bex::health::{Battery, Measurement};
use sch108bex::sensor::ShaftReading;
use sch108bex::specification::{PLACEHOLDER_IDENT, SerialNumber, Variant};
use sch108bex::{Device, Identity, NonvolatileWrite, PowerOn};

use super::e2prom::E2prom;

/// Where the shaft stands: in its sixth turn.
pub(crate) const RAW: i64 = 5 * 65_536 + 100;

/// What must be there after a cut: what was confirmed last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Kept {
    pub(crate) address: Option<u8>,
    pub(crate) offset: i32,
    pub(crate) alarm: bool,
    /// Turns that count as turn 0.
    pub(crate) turn_base: i64,
    /// Time under power so far, in milliseconds.
    pub(crate) powered_ms: u64,
}

impl Kept {
    pub(crate) const AS_DELIVERED: Self =
        Self { address: None, offset: 0, alarm: false, turn_base: 0, powered_ms: 0 };

    /// The next power-on after a position error clears alarm, turn count and offset (manual 4.2.2).
    pub(crate) fn after_power_on(self) -> Self {
        if self.alarm { Self { alarm: false, offset: 0, turn_base: RAW >> 16, ..self } } else { self }
    }
}

/// What a life is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Deed {
    /// A master gives it this address.
    Address(u8),
    /// A master presets it to this position, in class 2 with scaling off.
    Preset(u32),
    /// The sensor raises the position error alarm.
    Alarm,
    /// It runs for so many minutes.
    Run(u64),
    /// The supply falls after a minute.
    SupplyFalls,
    /// It is told that the end has come, after 5 minutes.
    OrderlyEnd,
}

/// A write, and what is to be there once it is confirmed.
pub(crate) type Written = (NonvolatileWrite, Kept);

/// A device under power, with its writes done and noted.
pub(crate) struct Life {
    pub(crate) device: Device,
    pub(crate) kept: Kept,
    pub(crate) writes: Vec<Written>,
    begun_ms: u64,
    now: Instant,
}

const POWER_ON: Instant = Instant::from_millis(1_000);

impl Life {
    /// Switches a device on whose memory is this, with what it is expected to hold.
    pub(crate) fn begin(memory: &E2prom, kept: Kept) -> Self {
        let identity = Identity {
            variant: Variant::FULL,
            ident_number: PLACEHOLDER_IDENT,
            serial_number: SerialNumber::DEFAULT,
            switches: RotarySwitches(0x7E),
        };
        let power_on = PowerOn {
            identity,
            stored: memory.choice(),
            battery: Battery::Ok,
            baud: BaudSetting::Fixed(Baudrate::B500000),
            receiver: ReceiverMode::Idle,
        };
        let device = Device::new(POWER_ON, power_on, ());
        let begun_ms = kept.powered_ms;
        let kept = kept.after_power_on();
        let mut life = Self { device, kept, writes: Vec::new(), begun_ms, now: POWER_ON };
        life.device.measure(POWER_ON, &Measurement::GOOD);
        life.pass(Duration::ZERO);
        life
    }

    pub(crate) fn position(&self) -> i64 {
        self.device.sensor().physical_position() + i64::from(self.device.sensor().offset())
    }

    /// Does it, and gives all writes of this life.
    pub(crate) fn doing(mut self, deed: Deed) -> Vec<Written> {
        match deed {
            Deed::Address(address) => self.take_address(address),
            Deed::Preset(position) => self.preset(position),
            Deed::Alarm => {
                self.kept.alarm = true;
                self.device.position_error(self.now, PositionErrorCause::Injected);
                self.pass(Duration::ZERO);
            }
            Deed::Run(minutes) => (0..minutes * 60).for_each(|_| self.pass(Duration::from_secs(1))),
            Deed::SupplyFalls => {
                self.pass(Duration::from_secs(60));
                self.device.measure(self.now, &Measurement { supply_mv: 8_000, ..Measurement::GOOD });
                self.pass(Duration::ZERO);
            }
            Deed::OrderlyEnd => {
                self.pass(Duration::from_secs(300));
                self.device.shut_down();
                self.pass(Duration::ZERO);
            }
        }
        // Whatever waits for its second.
        self.pass(Duration::from_secs(2));
        self.writes
    }

    /// Time goes by, then latches are taken, deadlines kept, and what is to be written is written.
    fn pass(&mut self, span: Duration) {
        self.now += span;
        self.kept.powered_ms = self.begun_ms + self.now.since(POWER_ON).as_millis();
        while let Some(latch) = self.device.latch_needed(self.now) {
            self.device.sample(latch, ShaftReading::Full(RAW));
        }
        self.device.poll(self.now);
        while let Some(write) = self.device.take_nonvolatile(self.now) {
            self.writes.push((write, self.kept));
            self.device.confirm_nonvolatile();
        }
    }

    fn take_address(&mut self, address: u8) {
        let [high, low] = PLACEHOLDER_IDENT.to_be_bytes();
        // SAP 55: address, ident, no "no further change".
        let reply = self.ask(&[&[55, 62], &[address, high, low, 0][..]].concat(), true);
        assert_eq!(reply, [0xE5]);
        self.kept.address = Some(address);
        self.pass(Duration::ZERO);
    }

    fn preset(&mut self, position: u32) {
        if self.device.address() == Some(126) {
            // There is no data exchange at 126.
            self.take_address(4);
        }
        let [high, low] = PLACEHOLDER_IDENT.to_be_bytes();
        // Lock_Req, no watchdog, the ident, no group; then ASIC octet, class 2 without scaling.
        let mut parameters = vec![61, 62, 0x80, 1, 1, 11, high, low, 0, 0x00, 0x02];
        parameters.resize(2 + 25, 0);
        assert_eq!(self.ask(&parameters, true), [0xE5]);
        assert_eq!(self.ask(&[62, 62, 0xF1], true), [0xE5]);
        self.ask(&[60, 62], true);
        self.ask(&[0, 0, 0, 0], false);
        self.pass(Duration::from_millis(1));
        self.ask(&(0x8000_0000 | position).to_be_bytes(), false);
        let turn = i64::from(u16::try_from(RAW & 0xFFFF).unwrap());
        let physical = turn + (((RAW >> 16) - self.kept.turn_base) << 16);
        self.kept.offset = i32::try_from(i64::from(position) - physical).unwrap();
        self.pass(Duration::ZERO);
    }

    /// One SRD high from master 2, each the first of its kind (FCB 1, FCV 0); what comes back.
    fn ask(&mut self, data: &[u8], saps: bool) -> Vec<u8> {
        self.now += Duration::from_millis(2);
        let mark = if saps { 0x80 } else { 0 };
        let address = self.device.address().expect("on the bus");
        let body = [&[address | mark, 2 | mark, 0x6D], data].concat();
        let length = u8::try_from(body.len()).unwrap();
        let sum = body.iter().fold(0_u8, |sum, octet| sum.wrapping_add(*octet));
        let telegram = [&[0x68, length, length, 0x68], &body[..], &[sum, 0x16]].concat();
        let window = self.device.receive(self.now, &telegram).expect("a reply");
        self.device.transmit(window.not_before).expect("the reply").to_vec()
    }
}
