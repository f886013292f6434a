//! The model and the product side by side, each behind the same device and on the same line.

use profibus_dp::dp::{self, Application, Configuration, DpSlave, ExtendedDiagnosis, PrmVerdict, Refused};
use profibus_dp::fdl::{BaudSetting, ReceiverMode, Station, Window};
use profibus_dp::time::{BitTimes, Duration, Instant};
use profibus_dp::wire::SetPrm;
use profibus_dp::wire::chk_cfg::Lengths;
use reference_model::{Device, Setting, Slave, State};

/// The model's device behind the product's slave.
#[derive(Debug)]
pub(crate) struct Behind(Device);

fn octets(count: usize) -> u8 {
    u8::try_from(count).expect("small devices")
}

impl Application for Behind {
    fn ident_number(&self) -> u16 {
        self.0.ident
    }

    fn set_prm(&mut self, _: Instant, prm: &SetPrm<'_>, _: bool) -> PrmVerdict {
        let good = prm.octets.len() == self.0.prm_octets
            && prm.octets.get(8).is_none_or(|octet| *octet == self.0.prm_octet_9);
        if good { PrmVerdict::Accepted } else { PrmVerdict::Refused }
    }

    fn chk_cfg(&mut self, _: Instant, configuration: &[u8]) -> Result<Lengths, Refused> {
        let lengths = Lengths { inputs: octets(self.0.inputs.len()), outputs: octets(self.0.outputs.len()) };
        if configuration == self.0.cfg { Ok(lengths) } else { Err(Refused) }
    }

    fn configuration(&self, _: bool) -> &[u8] {
        &self.0.cfg
    }

    fn read_inputs(&self, to: &mut [u8]) -> u8 {
        to.copy_from_slice(&self.0.inputs);
        to.iter().fold(0, |sum, octet| sum.wrapping_add(*octet))
    }

    fn write_outputs(&mut self, _: Instant, octets: &[u8]) {
        self.0.outputs = octets.to_vec();
        self.0.taken += 1;
    }

    fn clear_outputs(&mut self, _: Instant) {
        self.0.outputs.fill(0);
    }

    fn read_outputs(&self, to: &mut [u8]) {
        to.copy_from_slice(&self.0.outputs);
    }

    fn diagnosis(&self, _: bool, to: &mut [u8]) -> ExtendedDiagnosis {
        let length = self.0.user_diagnosis.len();
        to[..length].copy_from_slice(&self.0.user_diagnosis);
        ExtendedDiagnosis { length, overflow: false }
    }

    fn external_diagnosis(&self, _: bool) -> bool {
        self.0.ext_diag
    }

    fn static_diagnosis(&self) -> bool {
        self.0.stat_diag
    }

    fn is_fail_safe(&self) -> bool {
        self.0.fail_safe
    }

    fn supports_sync(&self) -> bool {
        self.0.sync
    }

    fn supports_freeze(&self) -> bool {
        self.0.freeze
    }

    fn address_changeable(&self) -> bool {
        self.0.address_changeable
    }
}

/// What becomes of a reply.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fate {
    /// Asked for so many bit times after its window opens; it may be closed again by then.
    After(u32),
    /// Nobody asks.
    Lost,
}

/// Both slaves.
#[derive(Debug)]
pub(crate) struct Twin {
    pub(crate) model: Slave,
    product: DpSlave<Behind, 16, 16>,
    setting: Setting,
    now: Instant,
}

/// The first thing in which they differ, in words.
pub(crate) type Same<T = ()> = Result<T, String>;

fn same<T: PartialEq + std::fmt::Debug>(what: &str, model: &T, product: &T) -> Same {
    if model == product { Ok(()) } else { Err(format!("{what}: model {model:02X?}, product {product:02X?}")) }
}

impl Twin {
    pub(crate) fn new(setting: Setting, device: &Device) -> Self {
        let now = Instant::from_millis(1_000);
        let configuration = Configuration {
            address: Some(setting.address),
            baud: BaudSetting::Fixed(setting.rate),
            receiver: if setting.stream { ReceiverMode::Stream } else { ReceiverMode::Idle },
        };
        Self {
            model: Slave::new(now, setting, device.clone()),
            product: DpSlave::new(now, configuration, Behind(device.clone())),
            setting,
            now,
        }
    }

    pub(crate) fn address(&self) -> u8 {
        self.model.address().expect("on the bus")
    }

    pub(crate) fn pass(&mut self, span: Duration) -> Same {
        self.now += span;
        self.model.poll(self.now);
        self.product.poll(self.now);
        self.compare()
    }

    pub(crate) fn idle(&mut self, bits: u32) {
        self.now += self.setting.rate.duration(BitTimes(bits));
    }

    /// Reads of octets without a pause between them, and what becomes of the reply.
    pub(crate) fn send(&mut self, reads: &[&[u8]], fate: Fate) -> Same<Option<Vec<u8>>> {
        let mut windows = (None, None);
        for octets in reads.iter().filter(|octets| !octets.is_empty()) {
            self.idle(11 * u32::try_from(octets.len()).expect("short"));
            windows = (self.model.receive(self.now, octets), self.product.receive(self.now, octets));
        }
        same("window", &windows.0, &windows.1)?;
        self.compare()?;
        let answer = self.fetch(windows.0, fate)?;
        self.compare()?;
        Ok(answer)
    }

    fn fetch(&mut self, window: Option<Window>, fate: Fate) -> Same<Option<Vec<u8>>> {
        let Fate::After(bits) = fate else { return Ok(None) };
        let Some(window) = window else {
            same("reply without a window", &self.model.transmit(self.now), &self.product.transmit(self.now))?;
            return Ok(None);
        };
        let early = window.not_before - Duration::from_nanos(1);
        same("reply before its window", &self.model.transmit(early), &self.product.transmit(early))?;
        self.now = window.not_before + self.setting.rate.duration(BitTimes(bits));
        let model = self.model.transmit(self.now).map(<[u8]>::to_vec);
        same("reply", &model.as_deref(), &self.product.transmit(self.now))?;
        same("reply twice", &self.model.transmit(self.now), &self.product.transmit(self.now))?;
        Ok(model)
    }

    pub(crate) fn line_error(&mut self) -> Same {
        self.idle(11);
        self.model.line_error(self.now);
        self.product.line_error(self.now);
        self.compare()
    }

    /// Changes something in both devices.
    pub(crate) fn change(&mut self, change: impl Fn(&mut Device), of_the_diagnosis: bool) {
        change(&mut self.model.device);
        change(&mut self.product.application_mut().0);
        if of_the_diagnosis {
            self.model.diagnosis_changed();
            self.product.diagnosis_changed();
        }
    }

    fn compare(&self) -> Same {
        let slave = self.product.slave();
        let state = match slave.state() {
            dp::State::WaitPrm => State::WaitPrm,
            dp::State::WaitCfg(_) => State::WaitCfg,
            dp::State::DataExchange(..) => State::DataExch,
        };
        same("state", &self.model.state(), &state)?;
        same("owner", &self.model.owner(), &slave.state().owner())?;
        same("device", &self.model.device, &self.product.application().0)?;
        same("address", &self.model.address(), &self.product.address())
    }
}
