//! A reply that was not fetched is dropped by whatever comes next, and kept for the retry.

use profibus_dp::dp::{Application, Configuration, DpSlave, ExtendedDiagnosis, PrmVerdict, Refused};
use profibus_dp::fdl::{BaudSetting, ReceiverMode, Station, Window};
use profibus_dp::time::{Baudrate, Duration, Instant};
use profibus_dp::wire::chk_cfg::Lengths;
use profibus_dp::wire::{SetPrm, Telegram, telegram};

/// A device of which only Slave_Diag is asked.
#[derive(Debug)]
struct Silent;

impl Application for Silent {
    fn ident_number(&self) -> u16 {
        0x4711
    }
    fn set_prm(&mut self, _: Instant, _: &SetPrm<'_>, _: bool) -> PrmVerdict {
        PrmVerdict::Refused
    }
    fn chk_cfg(&mut self, _: Instant, _: &[u8]) -> Result<Lengths, Refused> {
        Err(Refused)
    }
    fn configuration(&self, _: bool) -> &[u8] {
        &[]
    }
    fn read_inputs(&self, _: &mut [u8]) -> u8 {
        0
    }
    fn write_outputs(&mut self, _: Instant, _: &[u8]) {}
    fn clear_outputs(&mut self, _: Instant) {}
    fn read_outputs(&self, _: &mut [u8]) {}
    fn diagnosis(&self, _: bool, _: &mut [u8]) -> ExtendedDiagnosis {
        ExtendedDiagnosis::default()
    }
}

type Slave = DpSlave<Silent, 0, 0>;

// DP slave reference, section 1.5; the retry by hand: 8B + 82 + 7D + 3C + 3E = 204.
const DIAG: &[u8] = &[0x68, 0x05, 0x05, 0x68, 0x8B, 0x82, 0x6D, 0x3C, 0x3E, 0xF4, 0x16];
const RETRY: &[u8] = &[0x68, 0x05, 0x05, 0x68, 0x8B, 0x82, 0x7D, 0x3C, 0x3E, 0x04, 0x16];
const ANSWER: &[u8] =
    &[0x68, 0x0B, 0x0B, 0x68, 0x82, 0x8B, 0x08, 0x3E, 0x3C, 0x02, 0x05, 0x00, 0xFF, 0x47, 0x11, 0xED, 0x16];

/// What may come between a request and its reply.
const INTERRUPTIONS: [&[u8]; 6] = [
    &[0x10, 0x0C, 0x02, 0x49, 0x57, 0x16], // FDL status of station 12
    &[0xDC, 0x03, 0x02],
    &[0xE5],
    &[0x10],
    &[0x68, 0x05],
    &[0xFF],
];

fn slave(receiver: ReceiverMode) -> (Slave, Instant) {
    let baud = BaudSetting::Fixed(Baudrate::B500000);
    let configuration = Configuration { address: Some(11), baud, receiver };
    let now = Instant::from_millis(5);
    (Slave::new(now, configuration, Silent), now + Duration::from_millis(20))
}

/// Nothing is sent in all of the window, and the retry gets the stored answer.
fn dropped_but_kept(slave: &mut Slave, window: Window, case: &str) {
    for at in [window.not_before, window.not_after] {
        assert_eq!(slave.transmit(at), None, "{case}");
    }
    let later = window.not_after + Duration::from_millis(20);
    let again = slave.receive(later, RETRY).expect("a retry is answered");
    assert_eq!(slave.transmit(again.not_before), Some(ANSWER), "{case}");
    assert_eq!(slave.transmit(again.not_before), None, "{case}: once");
}

const MODES: [ReceiverMode; 2] = [ReceiverMode::Idle, ReceiverMode::Stream];

#[test]
fn octets_that_follow_in_another_read_drop_the_reply() {
    for mode in MODES {
        for octets in INTERRUPTIONS {
            let (mut slave, now) = slave(mode);
            let window = slave.receive(now, DIAG).expect("a request is answered");
            assert_eq!(slave.receive(now + Duration::from_micros(2), octets), None);
            dropped_but_kept(&mut slave, window, &format!("{mode:?} {octets:02X?}"));
        }
    }
}

#[test]
fn octets_that_follow_one_by_one_drop_the_reply() {
    for octets in INTERRUPTIONS {
        let (mut slave, now) = slave(ReceiverMode::Idle);
        let [begun @ .., last] = DIAG else { unreachable!() };
        for octet in begun {
            assert_eq!(slave.receive_octet(now, *octet), None);
        }
        let window = slave.receive_octet(now, *last).expect("a request is answered");
        assert_eq!(slave.receive_octet(now + Duration::from_micros(2), octets[0]), None);
        dropped_but_kept(&mut slave, window, &format!("{octets:02X?}"));
    }
}

#[test]
fn octets_that_follow_in_the_same_read_drop_the_reply() {
    for mode in MODES {
        for octets in INTERRUPTIONS {
            let (mut slave, now) = slave(mode);
            let joined = [DIAG, octets].concat();
            assert_eq!(slave.receive(now, &joined), None, "{mode:?} {octets:02X?}");
            let not_after = now + Baudrate::B500000.duration(profibus_dp::time::BitTimes(111));
            let window = Window { not_before: now, not_after };
            dropped_but_kept(&mut slave, window, &format!("{mode:?} {octets:02X?}"));
        }
    }
}

#[test]
fn a_telegram_that_the_segment_has_parsed_drops_the_reply() {
    for octets in &INTERRUPTIONS[..3] {
        let (mut slave, now) = slave(ReceiverMode::Idle);
        let parse = |octets| match telegram::parse(octets) {
            telegram::Parsed::Complete(telegram, _) => telegram,
            other => panic!("{other:?}"),
        };
        let diag: Telegram<'_> = parse(DIAG);
        let window = slave.indicate(now, &diag).expect("a request is answered");
        assert_eq!(slave.indicate(now + Duration::from_micros(2), &parse(octets)), None);
        dropped_but_kept(&mut slave, window, &format!("{octets:02X?}"));
    }
}

#[test]
fn a_damaged_character_drops_the_reply() {
    for mode in MODES {
        let (mut slave, now) = slave(mode);
        let window = slave.receive(now, DIAG).expect("a request is answered");
        slave.line_error(now + Duration::from_micros(2));
        dropped_but_kept(&mut slave, window, &format!("{mode:?}"));
    }
}
