//! Slaves that are no encoders: without inputs, without outputs, with 8 outputs, and without the
//! things that the encoder can do.

use conformance::rig::Battery;
use conformance::{Action, Device, Features, Hand, Mode, Order, Subject};
use profibus_dp::dp::{Application, Configuration, DpSlave, ExtendedDiagnosis, PrmVerdict, Refused};
use profibus_dp::fdl::{BaudSetting, ReceiverMode};
use profibus_dp::time::Instant;
use profibus_dp::wire::SetPrm;
use profibus_dp::wire::chk_cfg::Lengths;
use profibus_dp::wire::telegram::sum;

const ADDRESS: u8 = 11;
const IDENT: u16 = 0x1234;

/// A slave with a class of its own by what it has not.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RemoteIo {
    inputs: u8,
    outputs: u8,
    /// Sync, Freeze and Fail_Safe.
    able: bool,
}

impl RemoteIo {
    pub(crate) const NO_OUTPUTS: Self = Self { inputs: 4, outputs: 0, able: true };
    pub(crate) const NO_INPUTS: Self = Self { inputs: 0, outputs: 4, able: true };
    pub(crate) const PLAIN: Self = Self { inputs: 2, outputs: 8, able: false };

    /// Octets, consistent over one.
    fn cfg(self) -> Vec<u8> {
        let input = (self.inputs > 0).then(|| 0x10 | (self.inputs - 1));
        let output = (self.outputs > 0).then(|| 0x20 | (self.outputs - 1));
        input.into_iter().chain(output).collect()
    }

    pub(crate) fn device(self) -> Device {
        let mode = Mode {
            name: "the only one".to_owned(),
            user_prm: vec![0x00],
            cfg: self.cfg(),
            inputs: usize::from(self.inputs),
            outputs: usize::from(self.outputs),
        };
        let features = Features {
            freeze: self.able,
            sync: self.able,
            fail_safe: self.able,
            set_slave_add: false,
            asic_octet_8: true,
        };
        Device::slave(ADDRESS, mode, features)
    }
}

/// The device behind it.
pub(crate) struct Io {
    kind: RemoteIo,
    cfg: Vec<u8>,
    outputs: [u8; 8],
    overload: bool,
    /// Its supply is too high or too low: the inputs are not valid.
    dead: bool,
}

impl Application for Io {
    fn ident_number(&self) -> u16 {
        IDENT
    }

    fn set_prm(&mut self, _: Instant, prm: &SetPrm<'_>, _: bool) -> PrmVerdict {
        if prm.octets.len() == 8 { PrmVerdict::Accepted } else { PrmVerdict::Refused }
    }

    fn chk_cfg(&mut self, _: Instant, octets: &[u8]) -> Result<Lengths, Refused> {
        let RemoteIo { inputs, outputs, .. } = self.kind;
        if octets == self.cfg { Ok(Lengths { inputs, outputs }) } else { Err(Refused) }
    }

    fn configuration(&self, _: bool) -> &[u8] {
        &self.cfg
    }

    fn read_inputs(&self, to: &mut [u8]) -> u8 {
        to.fill(0x5A);
        sum(to)
    }

    fn write_outputs(&mut self, _: Instant, octets: &[u8]) {
        self.outputs[..octets.len()].copy_from_slice(octets);
    }

    fn clear_outputs(&mut self, _: Instant) {
        self.outputs = [0; 8];
    }

    fn read_outputs(&self, to: &mut [u8]) {
        to.copy_from_slice(&self.outputs[..to.len()]);
    }

    fn diagnosis(&self, _: bool, to: &mut [u8]) -> ExtendedDiagnosis {
        to[..2].copy_from_slice(&[0x02, u8::from(self.overload) | u8::from(self.dead) << 1]);
        ExtendedDiagnosis { length: 2, overflow: false }
    }

    fn external_diagnosis(&self, _: bool) -> bool {
        self.overload || self.dead
    }

    fn static_diagnosis(&self) -> bool {
        self.dead
    }

    fn is_fail_safe(&self) -> bool {
        self.kind.able
    }

    fn supports_sync(&self) -> bool {
        self.kind.able
    }

    fn supports_freeze(&self) -> bool {
        self.kind.able
    }
}

impl Subject for RemoteIo {
    type Station = DpSlave<Io, 4, 8>;

    fn power_on(&mut self, now: Instant, order: &Order) -> Self::Station {
        let baud = if order.search {
            BaudSetting::Search(profibus_dp::time::Baudrate::B12000000)
        } else {
            BaudSetting::Fixed(order.rate)
        };
        let configuration = Configuration { address: Some(ADDRESS), baud, receiver: ReceiverMode::Stream };
        let io = Io { kind: *self, cfg: self.cfg(), outputs: [0; 8], overload: false, dead: false };
        DpSlave::new(now, configuration, io)
    }

    fn has(&self, hand: Hand) -> bool {
        matches!(hand, Hand::Power | Hand::Delivery | Hand::World)
    }

    /// A low battery stands for whatever a device may have to report.
    fn act(&mut self, station: &mut Option<Self::Station>, now: Instant, action: &Action, order: &Order) {
        match action {
            Action::PowerOff => *station = None,
            Action::PowerOn => *station = Some(self.power_on(now, order)),
            Action::Battery(battery) => {
                if let Some(slave) = station {
                    slave.application_mut().overload = *battery != Battery::Ok;
                    slave.diagnosis_changed();
                }
            }
            Action::Supply(tenths) => {
                if let Some(slave) = station {
                    slave.application_mut().dead = !(90..=300).contains(tenths);
                    slave.diagnosis_changed();
                }
            }
            _ => {}
        }
    }
}
