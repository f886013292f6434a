//! A version of the model as a subject of the slave checks.

use conformance::rig::Battery;
use conformance::{Action, Device as Described, EncoderFacts, Features, Hand, Mode, Order, Subject};
use profibus_dp::fdl::{Station, Window};
use profibus_dp::time::{Baudrate, Instant};
use profibus_dp::wire::Telegram;
use reference_model::Device;

use crate::wrong::{AnySlave, PowerOn, Setting};

/// Its address where the switches say it.
const ADDRESS: u8 = 11;

/// Kinds of devices, so that between them every case can be played.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// 4 octets in and out, everything supported.
    Full,
    /// The same, on a stream.
    Stream,
    /// 8 octets in and out, nothing supported.
    Plain,
    /// Inputs only.
    Inputs,
    /// Outputs only.
    Outputs,
    /// As the full one, for the cases of the encoder that ask nothing special of it.
    Encoder,
}

impl Kind {
    pub(crate) const ALL: [Self; 6] =
        [Self::Full, Self::Stream, Self::Plain, Self::Inputs, Self::Outputs, Self::Encoder];

    /// Whether it sees a stream of octets.
    pub(crate) fn is_stream(self) -> bool {
        self == Self::Stream
    }

    pub(crate) fn device(self) -> Device {
        let device = Device::new();
        match self {
            Self::Full | Self::Stream | Self::Encoder => device,
            Self::Plain => Device { fail_safe: false, sync: false, freeze: false, ..device }.with_lengths(
                &[0x17, 0x27],
                8,
                8,
            ),
            Self::Inputs => device.with_lengths(&[0xD1], 4, 0),
            Self::Outputs => device.with_lengths(&[0x21], 0, 2),
        }
    }

    pub(crate) fn described(self) -> Described {
        let device = self.device();
        let (inputs, outputs) = (device.inputs.len(), device.outputs.len());
        let mode =
            Mode { name: "the".to_owned(), user_prm: vec![0, 0], cfg: device.cfg.clone(), inputs, outputs };
        let features = Features {
            freeze: device.freeze,
            sync: device.sync,
            fail_safe: device.fail_safe,
            set_slave_add: true,
            asic_octet_8: true,
        };
        let mut described = Described::slave(ADDRESS, mode, features);
        described.ident = Some(device.ident);
        if self == Self::Encoder {
            described.encoder = Some(EncoderFacts { singleturn_bits: 16, multiturn_bits: 15, serial: None });
        }
        described
    }
}

/// One version of the model, its switches, and the address that it keeps.
#[derive(Debug)]
pub(crate) struct Version {
    kind: Kind,
    power_on: PowerOn,
    switches: u8,
    kept: u8,
}

impl Version {
    pub(crate) const fn new(kind: Kind, power_on: PowerOn) -> Self {
        Self { kind, power_on, switches: ADDRESS, kept: 126 }
    }

    fn station(&self, now: Instant, order: Order) -> Boxed {
        let mut device = self.kind.device();
        device.address_changeable = self.switches == 126;
        let address = if self.switches == 126 { self.kept } else { self.switches };
        let setting = Setting {
            // An address that is none keeps it off the bus: no telegram has it.
            address: if (1..=126).contains(&address) { address } else { 0xFF },
            rate: order.rate,
            stream: self.kind.is_stream(),
        };
        Boxed((self.power_on)(now, setting, device))
    }
}

impl Subject for Version {
    type Station = Boxed;

    fn power_on(&mut self, now: Instant, order: &Order) -> Boxed {
        (self.switches, self.kept) = (order.address.unwrap_or(126), 126);
        self.station(now, *order)
    }

    fn has(&self, hand: Hand) -> bool {
        match hand {
            Hand::Power | Hand::Delivery | Hand::Switches | Hand::World => true,
            // The encoder's cases mean a shaft that its scaling counts.
            Hand::Shaft => self.kind != Kind::Encoder,
            _ => false,
        }
    }

    fn act(&mut self, station: &mut Option<Boxed>, now: Instant, action: &Action, order: &Order) {
        if *action == Action::PowerOn {
            *station = Some(self.station(now, *order));
        }
        if let Action::Switches(switches) = *action {
            self.switches = switches;
        }
        let Some(Boxed(slave)) = station else { return };
        let device = slave.device();
        match *action {
            Action::Shaft(raw) => {
                let octets = raw.to_be_bytes();
                let count = device.inputs.len();
                return device.inputs.copy_from_slice(&octets[octets.len() - count..]);
            }
            Action::PowerOff => {
                if let (126, Some(address)) = (self.switches, slave.address()) {
                    self.kept = address;
                }
                *station = None;
                return;
            }
            Action::Battery(cell) => device.ext_diag = cell != Battery::Ok,
            Action::Supply(tenths) => {
                device.stat_diag = !(90..=300).contains(&tenths);
                device.ext_diag = device.stat_diag;
            }
            Action::Temperature(tenths) => device.ext_diag = tenths > 650,
            Action::Light(ok) => device.ext_diag = !ok,
            _ => return,
        }
        slave.diagnosis_changed();
    }
}

/// Any version behind one type.
pub(crate) struct Boxed(Box<dyn AnySlave>);

impl Station for Boxed {
    fn receive(&mut self, now: Instant, octets: &[u8]) -> Option<Window> {
        self.0.receive(now, octets)
    }
    fn indicate(&mut self, now: Instant, telegram: &Telegram<'_>) -> Option<Window> {
        self.0.indicate(now, telegram)
    }
    fn line_error(&mut self, now: Instant) {
        self.0.line_error(now);
    }
    fn transmit(&mut self, now: Instant) -> Option<&[u8]> {
        self.0.transmit(now)
    }
    fn poll(&mut self, now: Instant) {
        self.0.poll(now);
    }
    fn next_deadline(&self) -> Option<Instant> {
        self.0.next_deadline()
    }
    fn listening_rate(&self) -> Baudrate {
        self.0.listening_rate()
    }
    fn address(&self) -> Option<u8> {
        self.0.address()
    }
}
