//! The product, twice: a plain device that notes every output it takes, and the encoder.

use std::cell::RefCell;
use std::rc::Rc;

use profibus_dp::dp::{Application, Configuration, DpSlave, ExtendedDiagnosis, PrmVerdict, Refused};
use profibus_dp::fdl::{BaudSetting, ReceiverMode, Station};
use profibus_dp::time::{Baudrate, Instant};
use profibus_dp::wire::SetPrm;
use profibus_dp::wire::chk_cfg::Lengths;
use sch108bex::end_cap::RotarySwitches;
use sch108bex::event::{Event, Observer};
use sch108bex::health::Battery;
use sch108bex::nonvolatile::{Record, choose};
use sch108bex::sensor::ShaftReading;
use sch108bex::specification::{SerialNumber, Variant};
use sch108bex::{Device, Identity, PowerOn};

use crate::master::{Facts, SLAVE};

/// The rate of the exploration.
pub(crate) const RATE: Baudrate = Baudrate::B500000;

/// A slave, and what it has done because its master said so.
pub(crate) trait Subject: Station {
    /// Numbers of outputs taken, or of presets executed, in their order.
    fn done(&self) -> Vec<u16>;
    /// Brings it up to this time.
    fn keep_up(&mut self, now: Instant);
    /// What its master has to know; the watchdog is 20 ms if it runs.
    fn facts(watchdog: bool) -> Facts;
    /// Which numbers it has to have done, of those that were answered well.
    fn due(answered: &[u16]) -> Vec<u16>;
}

/// Notes every output.
#[derive(Debug, Default)]
pub(crate) struct Noting(Vec<u16>);

impl Application for Noting {
    fn ident_number(&self) -> u16 {
        0x1234
    }
    fn set_prm(&mut self, _: Instant, _: &SetPrm<'_>, _: bool) -> PrmVerdict {
        PrmVerdict::Accepted
    }
    fn chk_cfg(&mut self, _: Instant, _: &[u8]) -> Result<Lengths, Refused> {
        Ok(Lengths { inputs: 1, outputs: 4 })
    }
    fn configuration(&self, _: bool) -> &[u8] {
        &[0x10, 0x23]
    }
    fn read_inputs(&self, to: &mut [u8]) -> u8 {
        to.fill(7);
        7
    }
    fn write_outputs(&mut self, _: Instant, octets: &[u8]) {
        self.0.push(u16::from_be_bytes([octets[2], octets[3]]));
    }
    fn clear_outputs(&mut self, _: Instant) {}
    fn read_outputs(&self, _: &mut [u8]) {}
    fn diagnosis(&self, _: bool, _: &mut [u8]) -> ExtendedDiagnosis {
        ExtendedDiagnosis::default()
    }
}

pub(crate) fn noting(now: Instant) -> DpSlave<Noting, 1, 4> {
    let (address, baud) = (Some(SLAVE), BaudSetting::Fixed(RATE));
    DpSlave::new(now, Configuration { address, baud, receiver: ReceiverMode::Idle }, Noting::default())
}

impl Subject for DpSlave<Noting, 1, 4> {
    fn done(&self) -> Vec<u16> {
        self.application().0.clone()
    }
    fn keep_up(&mut self, now: Instant) {
        self.poll(now);
    }
    fn facts(watchdog: bool) -> Facts {
        let prm = vec![if watchdog { 0x88 } else { 0x80 }, 1, 2, 0, 0x12, 0x34, 0];
        Facts { prm, cfg: vec![0x10, 0x23], inputs: 1 }
    }
    fn due(answered: &[u16]) -> Vec<u16> {
        answered.to_vec()
    }
}

/// Notes every preset.
#[derive(Debug, Default, Clone)]
pub(crate) struct Presets(Rc<RefCell<Vec<u16>>>);

impl Observer for Presets {
    fn observe(&mut self, _: Instant, event: &Event) {
        if let Event::PresetTaken { to, .. } = event {
            self.0.borrow_mut().push(u16::try_from(*to).expect("small presets"));
        }
    }
}

/// The encoder with its notes.
pub(crate) struct Encoder {
    device: Device<Presets>,
    presets: Presets,
}

pub(crate) fn encoder(now: Instant) -> Encoder {
    let variant = Variant::new(16, 15).expect("a variant");
    let identity = Identity {
        variant,
        ident_number: 0x108B,
        serial_number: SerialNumber::DEFAULT,
        switches: RotarySwitches(SLAVE),
    };
    let presets = Presets::default();
    let record = Record::as_delivered(variant).encode(1);
    let stored = choose(Record::decode(&record), Record::decode(&[]));
    let (baud, receiver) = (BaudSetting::Fixed(RATE), ReceiverMode::Idle);
    let power_on = PowerOn { identity, stored, battery: Battery::Ok, baud, receiver };
    let mut encoder = Encoder { device: Device::new(now, power_on, presets.clone()), presets };
    encoder.keep_up(now);
    encoder
}

impl Subject for Encoder {
    fn done(&self) -> Vec<u16> {
        self.presets.0.borrow().clone()
    }
    fn keep_up(&mut self, now: Instant) {
        while let Some(at) = self.device.latch_needed(now) {
            self.device.sample(at, ShaftReading::Full(100_000));
        }
        self.device.poll(now);
    }
    fn facts(watchdog: bool) -> Facts {
        let head = [if watchdog { 0x88 } else { 0x80 }, 1, 2, 0, 0x10, 0x8B, 0, 0, 0x02];
        let prm = [&head[..], &[0; 16]].concat();
        Facts { prm, cfg: vec![0xF1], inputs: 4 }
    }
    fn due(answered: &[u16]) -> Vec<u16> {
        let edges = answered.windows(2).filter(|pair| pair[0] + 1 == pair[1]);
        edges.map(|pair| pair[1]).filter(|serial| serial % 2 == 1).collect()
    }
}

impl Station for Encoder {
    fn receive(&mut self, now: Instant, octets: &[u8]) -> Option<profibus_dp::Window> {
        self.device.receive(now, octets)
    }
    fn indicate(
        &mut self,
        now: Instant,
        telegram: &profibus_dp::wire::Telegram<'_>,
    ) -> Option<profibus_dp::Window> {
        self.device.indicate(now, telegram)
    }
    fn line_error(&mut self, now: Instant) {
        self.device.line_error(now);
    }
    fn transmit(&mut self, now: Instant) -> Option<&[u8]> {
        self.device.transmit(now)
    }
    fn poll(&mut self, now: Instant) {
        self.device.poll(now);
    }
    fn next_deadline(&self) -> Option<Instant> {
        self.device.next_deadline()
    }
    fn listening_rate(&self) -> Baudrate {
        self.device.listening_rate()
    }
    fn address(&self) -> Option<u8> {
        self.device.address()
    }
}
