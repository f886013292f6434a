//! A small remote I/O station: two input octets, one output octet, a filter time as its only
//! parameter, and a diagnosis when its output is overloaded. Run it to see a master's start-up.

use profibus_dp::dp::{Application, Configuration, DpSlave, Event, ExtendedDiagnosis, PrmVerdict, Refused};
use profibus_dp::fdl::{BaudSetting, ReceiverMode, Station};
use profibus_dp::time::{Baudrate, Duration, Instant};
use profibus_dp::wire::chk_cfg::Lengths;
use profibus_dp::wire::telegram::sum;
use profibus_dp::wire::{SetPrm, octet};

/// The device behind the slave.
#[derive(Debug, Default)]
pub struct RemoteIo {
    /// Both input octets.
    pub inputs: [u8; 2],
    /// The output octet in force.
    pub output: u8,
    /// Input filter in milliseconds, octet 9 of Set_Prm, 1 to 20.
    pub filter: u8,
    /// The output driver reports an overload.
    pub overload: bool,
    /// What the slave has told, as sentences.
    pub log: Vec<String>,
}

/// Two input octets, one output octet.
const CONFIGURATION: [u8; 2] = [0x11, 0x20];

impl Application for RemoteIo {
    fn ident_number(&self) -> u16 {
        0x1234
    }

    fn set_prm(&mut self, _: Instant, prm: &SetPrm<'_>, _: bool) -> PrmVerdict {
        match octet(prm.octets, 9) {
            Some(filter @ 1..=20) if prm.octets.len() == 9 => {
                self.filter = filter;
                PrmVerdict::Accepted
            }
            other => {
                self.log
                    .push(format!("Set_Prm octet 9 (filter) is {other:?}, but must be 1 to 20 and the last"));
                PrmVerdict::Refused
            }
        }
    }

    fn chk_cfg(&mut self, _: Instant, octets: &[u8]) -> Result<Lengths, Refused> {
        if octets == CONFIGURATION { Ok(Lengths { inputs: 2, outputs: 1 }) } else { Err(Refused) }
    }

    fn configuration(&self, _: bool) -> &[u8] {
        &CONFIGURATION
    }

    fn read_inputs(&self, to: &mut [u8]) -> u8 {
        to.copy_from_slice(&self.inputs);
        sum(to)
    }

    fn write_outputs(&mut self, _: Instant, octets: &[u8]) {
        self.output = octets[0];
    }

    fn clear_outputs(&mut self, _: Instant) {
        self.output = 0;
    }

    fn read_outputs(&self, to: &mut [u8]) {
        to.fill(self.output);
    }

    fn diagnosis(&self, _: bool, to: &mut [u8]) -> ExtendedDiagnosis {
        // A device related block of two octets: the header and one octet of bits.
        to[..2].copy_from_slice(&[0x02, u8::from(self.overload)]);
        ExtendedDiagnosis { length: 2, overflow: false }
    }

    fn external_diagnosis(&self, _: bool) -> bool {
        self.overload
    }

    fn observe(&mut self, _: Instant, event: &Event) {
        self.log.push(event.to_string());
    }
}

/// The slave at address 11.
pub fn remote_io() -> DpSlave<RemoteIo, 2, 1> {
    let configuration = Configuration {
        address: Some(11),
        baud: BaudSetting::Fixed(Baudrate::B1500000),
        receiver: ReceiverMode::Idle,
    };
    DpSlave::new(Instant::ZERO, configuration, RemoteIo::default())
}

/// Sends a request and fetches the answer; each call is a millisecond later.
pub fn ask(slave: &mut DpSlave<RemoteIo, 2, 1>, now: &mut Instant, request: &[u8]) -> Vec<u8> {
    *now += Duration::from_millis(1);
    let Some(window) = slave.receive(*now, request) else {
        return Vec::new();
    };
    slave.transmit(window.not_before).map(<[u8]>::to_vec).unwrap_or_default()
}

fn main() {
    let mut slave = remote_io();
    slave.application_mut().inputs = [0xCA, 0xFE];
    let mut now = Instant::ZERO;
    let requests: [(&str, &[u8]); 6] = [
        ("FDL status", &[0x10, 0x0B, 0x02, 0x49, 0x56, 0x16]),
        ("Slave_Diag", &[0x68, 0x05, 0x05, 0x68, 0x8B, 0x82, 0x6D, 0x3C, 0x3E, 0xF4, 0x16]),
        (
            "Set_Prm with filter 0",
            &[
                0x68, 0x0E, 0x0E, 0x68, 0x8B, 0x82, 0x5D, 0x3D, 0x3E, 0x80, 0x00, 0x00, 0x0B, 0x12, 0x34,
                0x00, 0x00, 0x00, 0xB6, 0x16,
            ],
        ),
        (
            "Set_Prm with filter 5",
            &[
                0x68, 0x0E, 0x0E, 0x68, 0x8B, 0x82, 0x7D, 0x3D, 0x3E, 0x80, 0x00, 0x00, 0x0B, 0x12, 0x34,
                0x00, 0x00, 0x05, 0xDB, 0x16,
            ],
        ),
        ("Chk_Cfg", &[0x68, 0x07, 0x07, 0x68, 0x8B, 0x82, 0x5D, 0x3E, 0x3E, 0x11, 0x20, 0x17, 0x16]),
        ("Data_Exchange, output 55", &[0x68, 0x04, 0x04, 0x68, 0x0B, 0x02, 0x7D, 0x55, 0xDF, 0x16]),
    ];
    for (name, request) in requests {
        let answer = ask(&mut slave, &mut now, request);
        println!("{name}\n  > {request:02X?}\n  < {answer:02X?}");
        for line in slave.application_mut().log.drain(..) {
            println!("    {line}");
        }
    }
    println!("output {:02X}", slave.application().output);
}
