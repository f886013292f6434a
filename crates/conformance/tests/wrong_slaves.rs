//! The tester sees what is wrong with a reply: a slave whose replies are spoilt on purpose.

use conformance::{Device, Features, Fresher, Mode, Options, Outcome, VirtualRig, cases, run_virtual};
use profibus_dp::dp::{Application, Configuration, DpSlave, ExtendedDiagnosis, PrmVerdict, Refused};
use profibus_dp::fdl::{BaudSetting, ReceiverMode, Station, Window};
use profibus_dp::time::{Baudrate, Duration, Instant};
use profibus_dp::wire::chk_cfg::Lengths;
use profibus_dp::wire::telegram::sum;
use profibus_dp::wire::{SetPrm, Telegram};

const CFG: [u8; 2] = [0x11, 0x21];

/// Two octets in, two out.
struct Io {
    outputs: [u8; 2],
}

impl Application for Io {
    fn ident_number(&self) -> u16 {
        0x1234
    }

    fn set_prm(&mut self, _: Instant, prm: &SetPrm<'_>, _: bool) -> PrmVerdict {
        if prm.octets.len() == 8 { PrmVerdict::Accepted } else { PrmVerdict::Refused }
    }

    fn chk_cfg(&mut self, _: Instant, octets: &[u8]) -> Result<Lengths, Refused> {
        if octets == CFG { Ok(Lengths { inputs: 2, outputs: 2 }) } else { Err(Refused) }
    }

    fn configuration(&self, _: bool) -> &[u8] {
        &CFG
    }

    fn read_inputs(&self, to: &mut [u8]) -> u8 {
        to.fill(0x5A);
        sum(to)
    }

    fn write_outputs(&mut self, _: Instant, octets: &[u8]) {
        self.outputs.copy_from_slice(octets);
    }

    fn clear_outputs(&mut self, _: Instant) {
        self.outputs = [0; 2];
    }

    fn read_outputs(&self, to: &mut [u8]) {
        to.copy_from_slice(&self.outputs);
    }

    fn diagnosis(&self, _: bool, to: &mut [u8]) -> ExtendedDiagnosis {
        to[..2].copy_from_slice(&[0x02, 0x00]);
        ExtendedDiagnosis { length: 2, overflow: false }
    }
}

/// What becomes of a reply: its octets, and when it starts.
type Spoil = fn(&mut Vec<u8>);

/// A slave and what is wrong with it.
struct Wrong {
    slave: DpSlave<Io, 2, 2>,
    spoil: Spoil,
    /// Nanoseconds that it begins earlier (or later, below 0).
    early: i64,
    window: Option<Window>,
    reply: Vec<u8>,
}

impl Wrong {
    fn moved(&mut self, window: Option<Window>) -> Option<Window> {
        self.window = window;
        window.map(|Window { not_before, not_after }| {
            let nanos = Duration::from_nanos(self.early.unsigned_abs());
            let not_before = if self.early > 0 { not_before - nanos } else { not_before + nanos };
            Window { not_before, not_after: not_after.max(not_before) }
        })
    }
}

impl Station for Wrong {
    fn receive(&mut self, now: Instant, octets: &[u8]) -> Option<Window> {
        let window = self.slave.receive(now, octets);
        self.moved(window)
    }

    fn indicate(&mut self, now: Instant, telegram: &Telegram<'_>) -> Option<Window> {
        let window = self.slave.indicate(now, telegram);
        self.moved(window)
    }

    fn line_error(&mut self, now: Instant) {
        self.slave.line_error(now);
    }

    fn transmit(&mut self, _: Instant) -> Option<&[u8]> {
        let due = self.window.take()?.not_before;
        self.reply = self.slave.transmit(due)?.to_vec();
        (self.spoil)(&mut self.reply);
        Some(&self.reply)
    }

    fn poll(&mut self, now: Instant) {
        self.slave.poll(now);
    }

    fn next_deadline(&self) -> Option<Instant> {
        self.slave.next_deadline()
    }

    fn listening_rate(&self) -> Baudrate {
        self.slave.listening_rate()
    }

    fn address(&self) -> Option<u8> {
        self.slave.address()
    }
}

/// What becomes of a case with a slave whose replies are spoilt: how it ends, and why.
fn case(id: &str, spoil: Spoil, early: i64) -> (Outcome, String) {
    let mode =
        Mode { name: "the only one".to_owned(), user_prm: vec![0], cfg: CFG.to_vec(), inputs: 2, outputs: 2 };
    let able =
        Features { freeze: true, sync: true, fail_safe: true, set_slave_add: false, asic_octet_8: true };
    let device = Device { ident: Some(0x1234), ..Device::slave(11, mode, able) };
    let make = move |now| {
        let configuration = Configuration {
            address: Some(11),
            baud: BaudSetting::Fixed(Baudrate::B500000),
            receiver: ReceiverMode::Idle,
        };
        let slave = DpSlave::new(now, configuration, Io { outputs: [0; 2] });
        Wrong { slave, spoil, early, window: None, reply: Vec::new() }
    };
    let mut rig = VirtualRig::new(Fresher(make), false);
    let one: Vec<_> = cases().iter().filter(|case| case.id == id).cloned().collect();
    let result = run_virtual(&one, &device, &mut rig, Options::default()).expect("a mode").remove(0);
    (result.outcome, result.reason)
}

#[track_caller]
fn caught(id: &str, spoil: Spoil, why: &str) {
    assert_eq!(case(id, |_| {}, 0), (Outcome::Pass, String::new()), "case {id} with a right slave");
    let (outcome, reason) = case(id, spoil, 0);
    assert_eq!(outcome, Outcome::Fail, "case {id}");
    assert!(reason.contains(why), "case {id}: {reason}");
}

/// Puts the check sum right again after a change, so that only the change is wrong.
fn summed(reply: &mut [u8]) {
    let from = if reply[0] == 0x68 { 4 } else { 1 };
    let at = reply.len() - 2;
    reply[at] = sum(&reply[from..at]);
}

#[test]
fn a_reply_that_is_no_sound_telegram() {
    caught("1", |reply| reply[4] ^= 1, "the check sum is 0C, but 0D is right");
    caught("1", |reply| reply[5] = 0x17, "the end delimiter is 17, not 16");
    caught("1", |reply| reply.truncate(5), "breaks off: 5 octets of 6");
    caught("1", |reply| reply.push(0xE5), "1 octets follow the reply");
    caught("1", |reply| reply[0] = 0x11, "no telegram");
    let lengths: Spoil = |reply| {
        if reply[0] == 0x68 {
            reply[2] ^= 1;
        }
    };
    caught("44", lengths, "no telegram");
    caught("1", Vec::clear, "silent");
}

#[test]
fn a_reply_from_or_to_somebody_else() {
    let spoil: Spoil = |reply| {
        reply[1] = 3;
        summed(reply);
    };
    caught("1", spoil, "goes to station 3, but 2 asked");
    let spoil: Spoil = |reply| {
        reply[2] = 12;
        summed(reply);
    };
    caught("1", spoil, "comes from station 12, but 11 was asked");
}

#[test]
fn a_reply_with_a_wrong_function_code_or_form() {
    let spoil: Spoil = |reply| {
        reply[3] = 0x20;
        summed(reply);
    };
    caught("1", spoil, "bits 4 to 7");
    let spoil: Spoil = |reply| *reply = vec![0xE5];
    caught("1", spoil, "E5 came");
    // The SAPs of a diagnosis the other way round.
    let spoil: Spoil = |reply| {
        if reply.len() > 10 {
            reply.swap(7, 8);
            summed(reply);
        }
    };
    caught("47", spoil, "the SAPs of the reply are not those of the request, exchanged");
}

#[test]
fn a_diagnosis_with_bits_or_blocks_that_cannot_be() {
    fn octet(at: usize, value: u8) -> impl Fn(&mut Vec<u8>) {
        move |reply| {
            if reply.len() > 14 {
                reply[8 + at] = value;
                summed(reply);
            }
        }
    }
    // As plain functions, since a slave keeps no closure.
    caught("47", |reply| octet(1, 0x82)(reply), "bits 0, 5 and 7 belong to the master");
    caught("47", |reply| octet(2, 0x01)(reply), "bit 2 is always 1");
    caught("47", |reply| octet(2, 0x45)(reply), "bits 6 and 7 are always 0");
    caught("47", |reply| octet(3, 0x01)(reply), "bits 0 to 6 are reserved");
    caught("47", |reply| octet(4, 0x02)(reply), "the owner is master 2, not nobody");
    caught("47", |reply| octet(5, 0x13)(reply), "not the ident number 1234");
    caught("47", |reply| octet(7, 0x05)(reply), "a block with header 05, so of 5 octets, but 2 follow");
    caught("47", |reply| octet(1, 0x42)(reply), "Prm_Fault is 1");
}

#[test]
fn a_reply_that_begins_too_early_or_too_late() {
    // 500 kbit/s: a bit takes 2 us; min T_SDR is 11, max T_SDR 100 bit times.
    let (outcome, reason) = case("1", |_| {}, 2_000);
    assert_eq!(outcome, Outcome::Fail);
    assert!(reason.contains("20000 ns after the request, earlier than min T_SDR = 11"), "{reason}");
    let (outcome, _) = case("1", |_| {}, -178_000);
    assert_eq!(outcome, Outcome::Pass, "100 bit times");
    let (outcome, reason) = case("1", |_| {}, -184_000);
    assert_eq!(outcome, Outcome::Fail);
    assert!(reason.contains("206000 ns after the request, later than max T_SDR = 100"), "{reason}");
}

#[test]
fn data_that_are_too_many_or_not_those_that_were_due() {
    let longer: Spoil = |reply| {
        if reply[0] == 0x68 && reply[6] == 0x08 && reply[4] < 0x80 {
            reply.insert(7, 0x5A);
            (reply[1], reply[2]) = (reply[1] + 1, reply[2] + 1);
            summed(reply);
        }
    };
    caught("143", longer, "3 octets of data came, but 2 were due");
    let other: Spoil = |reply| {
        if reply[0] == 0x68 && reply[8] == 0x39 {
            reply[9] ^= 0x03;
            summed(reply);
        }
    };
    caught("N148", other, "00 03 came, but 03 03 was due");
    let high: Spoil = |reply| {
        if reply[0] == 0x68 && reply[4] < 0x80 {
            reply[6] = 0x0A;
            summed(reply);
        }
    };
    caught("N136", high, "DH (data, high: a diagnosis is pending) came, but DL (data, low) was due");
}
