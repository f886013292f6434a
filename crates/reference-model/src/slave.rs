//! The slave: octets in, answers out. Every rule is one line where that can be read.

mod services;
mod station;
mod telegram;

use profibus_dp::fdl::{Station, Window};
use profibus_dp::time::{Baudrate, BitTimes, Duration, Instant};
use profibus_dp::wire::{Sap, Telegram};
use reference_model::Device;

use telegram::Request;

/// How a slave is connected.
#[derive(Debug, Clone, Copy)]
pub struct Setting {
    /// Its station address.
    pub address: u8,
    /// The rate, known from the beginning.
    pub rate: Baudrate,
    /// It sees a stream of octets, and no idle times.
    pub stream: bool,
}

/// The states of MS0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum State {
    /// Waits for Set_Prm.
    WaitPrm,
    /// Waits for Chk_Cfg.
    WaitCfg,
    /// Exchanges data.
    DataExch,
}

/// What is due, when, and whether it is the answer of a service, which is stored.
#[derive(Debug, Clone)]
struct Reply {
    octets: Vec<u8>,
    window: Window,
    is_answer: bool,
}

/// The frame count memory: whose request was executed last, and which. The answer is beside it.
#[derive(Debug, Clone)]
struct Memory {
    sa: u8,
    fcb: bool,
    service: (u8, Option<u8>, Option<u8>),
}

/// What follows when the answer to the last service is handed out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum After {
    Nothing,
    Address(u8),
    /// The owner has been sent the diagnosis, asked for with this frame count bit.
    Fetched(bool),
}

/// A DP-V0 slave.
#[derive(Debug, Clone)]
pub struct Slave {
    /// The device behind it.
    pub device: Device,
    setting: Setting,
    address: u8,
    min_tsdr: u32,
    // The receiver.
    octets: Vec<u8>,
    deaf: bool,
    last: Instant,
    // The reply that is due, the frame count memory, and what goes with the answer in it.
    reply: Option<Reply>,
    sent: Vec<u8>,
    memory: Option<Memory>,
    answer: Vec<u8>,
    after: After,
    // The DP state machine.
    state: State,
    owner: Option<u8>,
    group: u8,
    prm_fault: bool,
    cfg_fault: bool,
    not_supported: bool,
    watchdog: Option<Duration>,
    alive: Instant,
    sync: bool,
    kept_aside: Option<Vec<u8>>,
    frozen: Option<Vec<u8>>,
    diag_flag: bool,
    fetched: Option<bool>,
}

impl Slave {
    /// A slave whose power has just come on.
    pub fn new(now: Instant, setting: Setting, device: Device) -> Self {
        Self {
            device,
            setting,
            address: setting.address,
            min_tsdr: 11,
            octets: Vec::new(),
            deaf: false,
            last: now,
            reply: None,
            sent: Vec::new(),
            memory: None,
            answer: Vec::new(),
            after: After::Nothing,
            state: State::WaitPrm,
            owner: None,
            group: 0,
            prm_fault: false,
            cfg_fault: false,
            not_supported: false,
            watchdog: None,
            alive: now,
            sync: false,
            kept_aside: None,
            frozen: None,
            diag_flag: false,
            fetched: None,
        }
    }

    /// Where it stands.
    pub const fn state(&self) -> State {
        self.state
    }

    /// Master_Add.
    pub const fn owner(&self) -> Option<u8> {
        self.owner
    }

    /// A bit of the diagnosis has changed.
    pub fn diagnosis_changed(&mut self) {
        self.diag_flag = self.state == State::DataExch;
        self.fetched = None;
        if matches!(self.after, After::Fetched(_)) {
            self.after = After::Nothing;
        }
    }

    fn bits(&self, bits: u32) -> Duration {
        self.setting.rate.duration(BitTimes(bits))
    }
}

impl Station for Slave {
    fn receive(&mut self, now: Instant, octets: &[u8]) -> Option<Window> {
        for (at, octet) in octets.iter().enumerate() {
            let after = u32::try_from(octets.len() - 1 - at).unwrap_or(0);
            let end = if self.setting.stream { now } else { now - self.bits(11 * after) };
            self.octet(end, *octet);
        }
        self.reply.as_ref().map(|reply| reply.window)
    }

    fn indicate(&mut self, now: Instant, telegram: &Telegram<'_>) -> Option<Window> {
        self.reply = None;
        if let Telegram::Data(data) = telegram {
            let [dsap, ssap] = [data.dsap, data.ssap].map(|sap| (sap != Sap::NIL).then_some(sap.0));
            let (da, sa, fc, data) = (data.da, data.sa, data.fc.0, data.data.to_vec());
            self.hear(now, &Request { da, sa, fc, dsap, ssap, data });
        }
        self.reply.as_ref().map(|reply| reply.window)
    }

    fn line_error(&mut self, now: Instant) {
        self.octets.clear();
        self.deaf = !self.setting.stream;
        self.reply = None;
        self.last = now;
    }

    fn transmit(&mut self, now: Instant) -> Option<&[u8]> {
        let reply =
            self.reply.take_if(|reply| now >= reply.window.not_before && now <= reply.window.not_after)?;
        if reply.is_answer {
            match std::mem::replace(&mut self.after, After::Nothing) {
                After::Address(address) => {
                    self.address = address;
                    self.memory = None;
                }
                After::Fetched(fcb) => self.fetched = Some(fcb),
                After::Nothing => {}
            }
        }
        self.sent = reply.octets;
        Some(&self.sent)
    }

    fn poll(&mut self, now: Instant) {
        self.pass_time(now);
    }

    fn next_deadline(&self) -> Option<Instant> {
        self.watchdog.map(|span| self.alive + span)
    }

    fn listening_rate(&self) -> Baudrate {
        self.setting.rate
    }

    fn address(&self) -> Option<u8> {
        Some(self.address)
    }
}
