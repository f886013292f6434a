//! The terminal side of the bus, and a master that speaks to one slave.

use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{ControlModes, OptionalActions, tcgetattr, tcsetattr};

/// The master's address.
pub(crate) const MASTER: u8 = 2;

/// The ident number that an encoder has which was given none.
pub(crate) const IDENT: [u8; 2] = [0x10, 0x8B];

/// Set_Prm from octet 8 on: octet 8 is the ASIC's, octet 9 has the operating parameters (manual 4.1).
pub(crate) const CLASS_1: &[u8] = &[0, 0];
/// Class 2 with 16 and 15 bits, not scaled.
#[rustfmt::skip]
pub(crate) const CLASS_2: &[u8] = &[
    0, 0x02, 0x00, 0x01, 0x00, 0x00, 0x80, 0x00, 0x00, 0x00, 0, 0, 0, 0, 0, 0, 0, 0,
];
/// The same with a time base of 100 ms.
#[rustfmt::skip]
pub(crate) const SCANCON: &[u8] = &[
    0, 0x02, 0x00, 0x01, 0x00, 0x00, 0x80, 0x00, 0x00, 0x00, 0, 0, 0, 0, 0, 0, 0, 0, 1,
];

/// How long an answer may take before the request is repeated.
const ANSWER_WITHIN: Duration = Duration::from_millis(500);
/// How long nothing has to come for silence.
pub(crate) const SILENCE: Duration = Duration::from_millis(60);

/// A telegram without data.
pub(crate) fn sd1(da: u8, sa: u8, fc: u8) -> Vec<u8> {
    vec![0x10, da, sa, fc, sum(&[da, sa, fc]), 0x16]
}

/// A telegram with data; addresses as on the wire.
pub(crate) fn sd2(da: u8, sa: u8, fc: u8, data: &[u8]) -> Vec<u8> {
    let body = [&[da, sa, fc], data].concat();
    let le = u8::try_from(body.len()).expect("not too long");
    [&[0x68, le, le, 0x68], &body[..], &[sum(&body), 0x16]].concat()
}

/// Asks for the FDL status.
pub(crate) fn status(address: u8) -> Vec<u8> {
    sd1(address, MASTER, 0x49)
}

/// A slave's answer to it.
pub(crate) fn status_answer(address: u8) -> Vec<u8> {
    sd1(MASTER, address, 0x00)
}

pub(crate) fn sum(octets: &[u8]) -> u8 {
    octets.iter().fold(0, |sum: u8, octet| sum.wrapping_add(*octet))
}

/// How long the telegram is that begins so; `None`: no telegram does.
pub(crate) fn length(octets: &[u8]) -> Option<usize> {
    match octets {
        [0xE5, ..] => Some(1),
        [0x10, ..] => Some(6),
        [0xA2, ..] => Some(14),
        [0x68, le, ..] => Some(usize::from(*le) + 6),
        [0x68] => Some(10),
        _ => None,
    }
}

/// The terminal side of the bus, as a master has it open.
#[derive(Debug)]
pub(crate) struct Terminal(OwnedFd);

impl Terminal {
    pub(crate) fn open(path: &Path, rate: u32) -> Self {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let terminal = rustix::fs::open(path, flags, Mode::empty()).expect("a terminal");
        let mut settings = tcgetattr(&terminal).expect("settings");
        settings.make_raw();
        settings.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD | ControlModes::CS8;
        settings.set_speed(rate).expect("a rate");
        tcsetattr(&terminal, OptionalActions::Now, &settings).expect("settings");
        Self(terminal)
    }

    /// The far side of a serial device that is none: a new pseudo terminal, whose path a program opens.
    pub(crate) fn cable() -> (Self, PathBuf) {
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let far = openpt(flags).expect("a pseudo terminal");
        rustix::io::ioctl_fionbio(&far, true).expect("a pseudo terminal");
        grantpt(&far).expect("its rights");
        unlockpt(&far).expect("its other side");
        let path = ptsname(&far, Vec::new()).expect("its name");
        (Self(far), PathBuf::from(path.into_string().expect("a path")))
    }

    /// The rate that is set now, at either side.
    pub(crate) fn rate(&self) -> u32 {
        tcgetattr(&self.0).expect("settings").output_speed()
    }

    /// Sends all of it.
    pub(crate) fn send(&self, octets: &[u8]) {
        let mut left = octets;
        while !left.is_empty() {
            match rustix::io::write(&self.0, left) {
                Ok(count) => left = &left[count..],
                Err(Errno::AGAIN | Errno::INTR) => assert!(
                    self.is_ready(PollFlags::OUT, Duration::from_secs(5)),
                    "nobody takes what is sent"
                ),
                Err(error) => panic!("cannot send: {error}"),
            }
        }
    }

    /// Whatever is there now.
    pub(crate) fn read(&self) -> Vec<u8> {
        let mut buffer = [0; 4096];
        match rustix::io::read(&self.0, &mut buffer) {
            Ok(count) => buffer[..count].to_vec(),
            Err(_) => Vec::new(),
        }
    }

    /// A telegram; what came of it, when it does not come in time.
    pub(crate) fn answer(&self, within: Duration) -> Vec<u8> {
        let until = Instant::now() + within;
        let mut octets = Vec::new();
        loop {
            octets.extend(self.read());
            let whole = if octets.is_empty() { Some(1) } else { length(&octets) };
            let left = until.saturating_duration_since(Instant::now());
            if whole.is_none_or(|whole| octets.len() >= whole) || left.is_zero() {
                return octets;
            }
            self.is_ready(PollFlags::IN, left);
        }
    }

    /// Sends a request and gives its answer; asks again where none comes, as masters do.
    pub(crate) fn ask(&self, request: &[u8]) -> Vec<u8> {
        self.read();
        for _ in 0..4 {
            self.send(request);
            let answer = self.answer(ANSWER_WITHIN);
            if !answer.is_empty() {
                return answer;
            }
        }
        Vec::new()
    }

    /// Sends a request; whether nothing comes back.
    pub(crate) fn is_silent(&self, request: &[u8]) -> bool {
        self.read();
        self.send(request);
        self.answer(SILENCE).is_empty()
    }

    fn is_ready(&self, flags: PollFlags, within: Duration) -> bool {
        let within = Timespec::try_from(within).expect("a time");
        poll(&mut [PollFd::new(&self.0, flags)], Some(&within)).is_ok_and(|count| count > 0)
    }
}

/// A master that speaks to one slave.
#[derive(Debug)]
pub(crate) struct Master {
    pub(crate) terminal: Terminal,
    pub(crate) slave: u8,
    /// The frame count bit of the next request; `None`: a new sequence begins.
    bit: Option<bool>,
}

/// The octets of a diagnosis, numbered from 1 as in the manual.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Diagnosis(pub(crate) Vec<u8>);

impl Diagnosis {
    pub(crate) fn octet(&self, number: usize) -> u8 {
        self.0[number - 1]
    }

    pub(crate) fn octets(&self, numbers: std::ops::RangeInclusive<usize>) -> &[u8] {
        &self.0[numbers.start() - 1..*numbers.end()]
    }

    /// Octets 32-35 (manual 4.2.14).
    pub(crate) fn offset(&self) -> i32 {
        i32::from_be_bytes(self.octets(32..=35).try_into().expect("four"))
    }
}

impl Master {
    pub(crate) fn new(terminal: Terminal, slave: u8) -> Self {
        Self { terminal, slave, bit: None }
    }

    /// SRD high: `6D` begins a sequence, then `5D` and `7D` take turns.
    fn fc(&mut self) -> u8 {
        let fc = self.bit.map_or(0x6D, |bit| if bit { 0x7D } else { 0x5D });
        self.bit = Some(self.bit.is_some_and(|bit| !bit));
        fc
    }

    /// A request to a service access point, with the next frame count bit.
    pub(crate) fn request(&mut self, sap: u8, data: &[u8]) -> Vec<u8> {
        let fc = self.fc();
        sd2(self.slave | 0x80, MASTER | 0x80, fc, &[&[sap, 62], data].concat())
    }

    /// The octets of the answer to such a request.
    pub(crate) fn service(&mut self, sap: u8, data: &[u8]) -> Vec<u8> {
        let request = self.request(sap, data);
        self.terminal.ask(&request)
    }

    /// A Data_Exchange request, with the next frame count bit.
    pub(crate) fn outputs(&mut self, outputs: &[u8]) -> Vec<u8> {
        let fc = self.fc();
        if outputs.is_empty() { sd1(self.slave, MASTER, fc) } else { sd2(self.slave, MASTER, fc, outputs) }
    }

    /// Outputs for inputs.
    #[track_caller]
    pub(crate) fn exchange(&mut self, outputs: &[u8]) -> Vec<u8> {
        let request = self.outputs(outputs);
        let answer = self.terminal.ask(&request);
        inputs(&answer, self.slave)
    }

    /// The position that a Data_Exchange shows.
    #[track_caller]
    pub(crate) fn position(&mut self) -> u32 {
        number(&self.exchange(&[0; 4])[..4])
    }

    #[track_caller]
    pub(crate) fn diagnosis(&mut self) -> Diagnosis {
        let answer = self.service(60, &[]);
        let end = answer.len().saturating_sub(2);
        assert!(answer.len() > 10, "{answer:02X?}");
        assert_eq!(answer[4..9], [MASTER | 0x80, self.slave | 0x80, 0x08, 62, 60], "{answer:02X?}");
        assert_eq!(answer[end..], [sum(&answer[4..end]), 0x16]);
        Diagnosis(answer[9..end].to_vec())
    }

    /// Set_Prm without watchdog; `user` is octets 8 and up.
    pub(crate) fn set_prm(&mut self, ident: [u8; 2], user: &[u8]) -> Vec<u8> {
        let data = [&[0x80, 1, 1, 11, ident[0], ident[1], 0], user].concat();
        self.service(61, &data)
    }

    pub(crate) fn chk_cfg(&mut self, octets: &[u8]) -> Vec<u8> {
        self.service(62, octets)
    }

    /// From Slave_Diag to data exchange; gives the diagnosis then.
    #[track_caller]
    pub(crate) fn start_up(&mut self, user: &[u8], configuration: &[u8]) -> Diagnosis {
        self.start_up_as(IDENT, user, configuration)
    }

    #[track_caller]
    pub(crate) fn start_up_as(&mut self, ident: [u8; 2], user: &[u8], configuration: &[u8]) -> Diagnosis {
        self.diagnosis();
        assert_eq!(self.set_prm(ident, user), [0xE5]);
        assert_eq!(self.chk_cfg(configuration), [0xE5]);
        let diagnosis = self.diagnosis();
        // Neither Station_Not_Ready nor a fault; nothing required; this master's.
        assert_eq!(diagnosis.octet(1) & !0x08, 0x00, "{diagnosis:02X?}");
        assert_eq!(diagnosis.octet(2) & 0x01, 0x00, "{diagnosis:02X?}");
        assert_eq!(diagnosis.octet(4), MASTER);
        diagnosis
    }
}

/// The inputs in the answer to a Data_Exchange.
#[track_caller]
pub(crate) fn inputs(answer: &[u8], slave: u8) -> Vec<u8> {
    let end = answer.len().saturating_sub(2);
    assert!(answer.len() > 8 && answer[0] == 0x68, "{answer:02X?}");
    assert_eq!(answer[4..6], [MASTER, slave]);
    assert!(matches!(answer[6], 0x08 | 0x0A), "{answer:02X?}");
    assert_eq!(answer[end..], [sum(&answer[4..end]), 0x16]);
    answer[7..end].to_vec()
}

/// A number of four octets.
#[track_caller]
pub(crate) fn number(octets: &[u8]) -> u32 {
    u32::from_be_bytes(octets.try_into().expect("four octets"))
}
