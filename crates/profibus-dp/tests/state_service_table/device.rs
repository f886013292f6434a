//! A small device without special abilities, and the line it is on.

use profibus_dp::dp::{Application, Configuration, DpSlave, ExtendedDiagnosis, PrmVerdict, Refused};
use profibus_dp::fdl::{BaudSetting, ReceiverMode, Station};
use profibus_dp::time::{Baudrate, Duration, Instant};
use profibus_dp::wire::SetPrm;
use profibus_dp::wire::chk_cfg::Lengths;

use crate::telegrams::{BAD, CFG, ONLOOKER, OUTGROWN, OWNER, SELF, hex, sum, telegram};

/// The device of this test.
#[derive(Debug, Clone)]
pub(crate) struct TestDevice {
    pub(crate) inputs: Vec<u8>,
    pub(crate) outputs: Vec<u8>,
    pub(crate) cfg: Vec<u8>,
    pub(crate) lengths: Lengths,
    pub(crate) fail_safe: bool,
    pub(crate) sync: bool,
    pub(crate) freeze: bool,
    pub(crate) address_changeable: bool,
    pub(crate) warning: bool,
}

impl TestDevice {
    pub(crate) fn of_the_table() -> Self {
        Self {
            inputs: vec![0xAA, 0xBB],
            outputs: vec![0],
            cfg: CFG.to_vec(),
            lengths: Lengths { inputs: 2, outputs: 1 },
            fail_safe: true,
            sync: true,
            freeze: true,
            address_changeable: true,
            warning: false,
        }
    }
}

impl Application for TestDevice {
    fn ident_number(&self) -> u16 {
        0x1234
    }

    fn set_prm(&mut self, _: Instant, prm: &SetPrm<'_>, exchanging: bool) -> PrmVerdict {
        match prm.octets.get(8) {
            Some(&OUTGROWN) if exchanging => PrmVerdict::Outgrown,
            Some(&(BAD | OUTGROWN)) => PrmVerdict::Refused,
            _ => PrmVerdict::Accepted,
        }
    }

    fn chk_cfg(&mut self, _: Instant, configuration: &[u8]) -> Result<Lengths, Refused> {
        if configuration == self.cfg { Ok(self.lengths) } else { Err(Refused) }
    }

    fn configuration(&self, _: bool) -> &[u8] {
        &self.cfg
    }

    fn read_inputs(&self, to: &mut [u8]) -> u8 {
        to.copy_from_slice(&self.inputs);
        sum(&self.inputs)
    }

    fn write_outputs(&mut self, _: Instant, octets: &[u8]) {
        self.outputs.copy_from_slice(octets);
    }

    fn clear_outputs(&mut self, _: Instant) {
        self.outputs.fill(0);
    }

    fn read_outputs(&self, to: &mut [u8]) {
        to.copy_from_slice(&self.outputs);
    }

    fn diagnosis(&self, _: bool, _: &mut [u8]) -> ExtendedDiagnosis {
        ExtendedDiagnosis::default()
    }

    fn external_diagnosis(&self, _: bool) -> bool {
        self.warning
    }

    fn is_fail_safe(&self) -> bool {
        self.fail_safe
    }

    fn supports_sync(&self) -> bool {
        self.sync
    }

    fn supports_freeze(&self) -> bool {
        self.freeze
    }

    fn address_changeable(&self) -> bool {
        self.address_changeable
    }
}

/// The slave on a quiet line at 500 kbit/s: request, answer, a pause.
pub(crate) struct Line {
    pub(crate) slave: DpSlave<TestDevice, 8, 8>,
    now: Instant,
}

impl Line {
    pub(crate) fn new(address: u8, device: TestDevice) -> Self {
        let configuration = Configuration {
            address: Some(address),
            baud: BaudSetting::Fixed(Baudrate::B500000),
            receiver: ReceiverMode::Idle,
        };
        let now = Instant::from_millis(5);
        Self { slave: DpSlave::new(now, configuration, device), now }
    }

    /// When the last answer began.
    pub(crate) const fn now(&self) -> Instant {
        self.now
    }

    /// The answer; no octets for silence.
    pub(crate) fn ask(&mut self, request: &[u8]) -> Vec<u8> {
        self.now += Duration::from_millis(6);
        let answer = match self.slave.receive(self.now, request) {
            Some(window) => {
                self.now = window.not_before;
                let answer = self.slave.transmit(self.now);
                answer.expect("a reply is due in its window").to_vec()
            }
            None => Vec::new(),
        };
        assert_eq!(self.slave.transmit(self.now), None, "nothing more is due");
        answer
    }

    pub(crate) fn ask_ok(&mut self, request: &[u8], answer: &[u8]) {
        assert_eq!(hex(&self.ask(request)), hex(answer), "to {}", hex(request));
    }

    /// The six octets of the diagnosis, read by a master that only looks.
    pub(crate) fn diagnosis(&mut self, address: u8) -> Vec<u8> {
        let answer = self.ask(&telegram(address, ONLOOKER, 0x4D, Some(0x3C), &[]));
        assert_eq!(answer.len(), 17, "a diagnosis of 6 octets at {address}");
        answer[9..15].to_vec()
    }

    pub(crate) fn parameterize(&mut self, prm: &[u8]) {
        self.ask_ok(&telegram(SELF, OWNER, 0x6D, Some(0x3D), prm), &[0xE5]);
    }

    pub(crate) fn start_up(&mut self, prm: &[u8]) {
        self.parameterize(prm);
        let cfg = self.slave.application().cfg.clone();
        self.ask_ok(&telegram(SELF, OWNER, 0x5D, Some(0x3E), &cfg), &[0xE5]);
    }
}
