//! Devices that differ: without Sync and Freeze, without fail-safe, without inputs or outputs.

use profibus_dp::fdl::Station;
use profibus_dp::time::Duration;
use profibus_dp::wire::chk_cfg::Lengths;

use crate::device::{Line, TestDevice};
use crate::telegrams::{OWNER, PRM, SELF, Sent, sd2, telegram};

/// Set_Slave_Add where the address is not set over the bus: RS in every state (reference 3.2
/// "if enabled, else RS").
#[test]
fn set_slave_add_is_refused_where_it_is_not_enabled() {
    let device = TestDevice { address_changeable: false, ..TestDevice::of_the_table() };
    let request = telegram(SELF, OWNER, 0x6D, Some(0x37), &[12, 0x12, 0x34, 0]);
    let refused = telegram(OWNER, SELF, 0x03, None, &[]);
    let mut line = Line::new(SELF, device);
    line.ask_ok(&request, &refused);
    line.parameterize(&PRM);
    line.ask_ok(&request, &refused);
    assert_eq!(line.slave.address(), Some(SELF));
}

/// Reference 7.4 case 98: Sync and Freeze not supported, but asked for.
#[test]
fn what_is_not_supported_is_a_prm_fault_with_not_supported() {
    let device = TestDevice { sync: false, freeze: false, ..TestDevice::of_the_table() };
    for status in [0xA0, 0x90, 0xB0] {
        let mut line = Line::new(SELF, device.clone());
        let prm = [&[status], &PRM[1..]].concat();
        line.parameterize(&prm);
        assert_eq!(line.diagnosis(SELF), [0x52, 0x05, 0x00, 0xFF, 0x12, 0x34]);
        line.parameterize(&PRM);
        assert_eq!(line.diagnosis(SELF), [0x02, 0x04, 0x00, OWNER, 0x12, 0x34]);
    }
}

/// Reference 7.8 case 167: Sync and Freeze commands to a device without them.
#[test]
fn sync_and_freeze_without_support_are_ignored() {
    let device = TestDevice { sync: false, freeze: false, ..TestDevice::of_the_table() };
    let mut line = Line::new(SELF, device);
    line.start_up(&PRM);
    line.ask_ok(&telegram(0x7F, OWNER, 0x46, Some(0x3A), &[0x28, 0]), &[]);
    line.slave.application_mut().inputs = vec![0xCC, 0xDD];
    let exchange = telegram(SELF, OWNER, 0x7D, None, &[0x77]);
    line.ask_ok(&exchange, &sd2(&[OWNER, SELF, 0x08, 0xCC, 0xDD]));
    assert_eq!(line.slave.application().outputs, [0x77]);
    assert_eq!(line.diagnosis(SELF), [0x00, 0x04, 0x00, OWNER, 0x12, 0x34]);
}

/// Reference 7.7 case 145: an empty Data_Exchange to a device with Fail_Safe = 0.
#[test]
fn an_empty_exchange_without_fail_safe_is_a_wrong_length() {
    let device = TestDevice { fail_safe: false, ..TestDevice::of_the_table() };
    let mut line = Line::new(SELF, device);
    line.start_up(&PRM);
    let exchange = telegram(SELF, OWNER, 0x7D, None, &[0x77]);
    line.ask_ok(&exchange, &sd2(&[OWNER, SELF, 0x08, 0xAA, 0xBB]));
    let empty = telegram(SELF, OWNER, 0x5D, None, &[]);
    line.ask_ok(&empty, &telegram(OWNER, SELF, 0x03, None, &[]));
    assert_eq!(line.diagnosis(SELF), [0x02, 0x05, 0x00, 0xFF, 0x12, 0x34]);
    assert_eq!(line.slave.application().outputs, [0x00]);
}

/// Reference 7.6 case 141, 2.3 "E5 exactly when": a device without inputs.
#[test]
fn a_device_without_inputs_answers_e5_and_announces_by_sd1() {
    let device = TestDevice {
        inputs: Vec::new(),
        cfg: vec![0x20],
        lengths: Lengths { inputs: 0, outputs: 1 },
        ..TestDevice::of_the_table()
    };
    let mut line = Line::new(SELF, device);
    line.start_up(&PRM);
    line.ask_ok(&telegram(SELF, OWNER, 0x7D, None, &[0x77]), &[0xE5]);
    line.slave.application_mut().warning = true;
    line.slave.diagnosis_changed();
    let announced = [0x10, 0x02, 0x0B, 0x0A, 0x17, 0x16];
    line.ask_ok(&telegram(SELF, OWNER, 0x5D, None, &[0x77]), &announced);
    let read = telegram(SELF, OWNER, 0x7D, Some(0x3C), &[]);
    let body = [0x82, 0x8B, 0x08, 0x3E, 0x3C, 0x08, 0x04, 0x00, OWNER, 0x12, 0x34];
    line.ask_ok(&read, &sd2(&body));
    line.ask_ok(&telegram(SELF, OWNER, 0x5D, None, &[0x77]), &[0xE5]);
    line.ask_ok(&telegram(SELF, OWNER, 0x7D, Some(0x38), &[]), &[0xE5]);
}

/// Reference 2.3: RD_Outp of a device without outputs is E5, its Data_Exchange comes as SD1.
#[test]
fn a_device_without_outputs() {
    let device = TestDevice {
        outputs: Vec::new(),
        cfg: vec![0x11],
        lengths: Lengths { inputs: 2, outputs: 0 },
        ..TestDevice::of_the_table()
    };
    let mut line = Line::new(SELF, device);
    line.start_up(&PRM);
    let exchange = telegram(SELF, OWNER, 0x7D, None, &[]);
    line.ask_ok(&exchange, &sd2(&[OWNER, SELF, 0x08, 0xAA, 0xBB]));
    line.ask_ok(&telegram(SELF, OWNER, 0x5D, Some(0x39), &[]), &[0xE5]);
    let wrong = telegram(SELF, OWNER, 0x7D, None, &[0x00]);
    line.ask_ok(&wrong, &telegram(OWNER, SELF, 0x03, None, &[]));
    assert_eq!(line.diagnosis(SELF), [0x02, 0x05, 0x00, 0xFF, 0x12, 0x34]);
}

/// Reference 7.7 case 150: eight outputs may come as SD3 or as SD2.
#[test]
fn eight_outputs_as_sd3() {
    let device = TestDevice {
        outputs: vec![0; 8],
        cfg: vec![0x11, 0x27],
        lengths: Lengths { inputs: 2, outputs: 8 },
        ..TestDevice::of_the_table()
    };
    let mut line = Line::new(SELF, device);
    line.start_up(&PRM);
    let inputs = sd2(&[OWNER, SELF, 0x08, 0xAA, 0xBB]);
    line.ask_ok(&Sent::Sd3([1, 2, 3, 4, 5, 6, 7, 8]).wire(SELF, OWNER, 0x7D), &inputs);
    assert_eq!(line.slave.application().outputs, [1, 2, 3, 4, 5, 6, 7, 8]);
    line.ask_ok(&telegram(SELF, OWNER, 0x5D, None, &[8; 8]), &inputs);
    assert_eq!(line.slave.application().outputs, [8; 8]);
}

/// Reference 7.7 case 152: inputs of one answer belong together, whatever changes in between.
#[test]
fn no_answer_is_torn() {
    let mut line = Line::new(SELF, TestDevice::of_the_table());
    line.start_up(&PRM);
    for round in 0..10_000_u16 {
        let value = round.to_le_bytes()[0];
        line.slave.application_mut().inputs = vec![value, !value];
        let fc = if round % 2 == 0 { 0x7D } else { 0x5D };
        line.ask_ok(&telegram(SELF, OWNER, fc, None, &[value]), &sd2(&[OWNER, SELF, 0x08, value, !value]));
    }
}

/// Reference 4.6, Not_Supported: gone with the next good Set_Prm, and not with a bad one.
#[test]
fn not_supported_stays_until_a_good_set_prm() {
    let device = TestDevice { sync: false, ..TestDevice::of_the_table() };
    let mut line = Line::new(SELF, device);
    line.parameterize(&[&[0xA0], &PRM[1..]].concat());
    line.parameterize(&[&PRM[..4], &[0x12, 0x35], &PRM[6..]].concat());
    assert_eq!(line.diagnosis(SELF), [0x52, 0x05, 0x00, 0xFF, 0x12, 0x34]);
    line.parameterize(&PRM);
    assert_eq!(line.diagnosis(SELF), [0x02, 0x04, 0x00, OWNER, 0x12, 0x34]);
}

/// A device that offers more octets than its slave was built for (8 and 8 here) gets a Cfg_Fault.
#[test]
fn a_configuration_beyond_what_the_slave_was_built_for_is_a_cfg_fault() {
    for (inputs, outputs) in [(9, 1), (2, 9)] {
        let lengths = Lengths { inputs, outputs };
        let mut line = Line::new(SELF, TestDevice { lengths, ..TestDevice::of_the_table() });
        line.start_up(&PRM);
        assert_eq!(line.diagnosis(SELF), [0x06, 0x05, 0x00, 0xFF, 0x12, 0x34]);
    }
}

/// Reference 5.2: without any telegram, at its deadline (here 200 ms after the Chk_Cfg) and not before.
#[test]
fn the_watchdog_expires_at_its_deadline() {
    let mut line = Line::new(SELF, TestDevice::of_the_table());
    line.start_up(&[&[0x88, 0x01, 0x14], &PRM[3..]].concat());
    // Chk_Cfg ended 11 bit times of 2 us before now.
    let expiry = line.now() + Duration::from_micros(200_000 - 22);
    line.slave.poll(expiry - Duration::from_nanos(1));
    assert!(line.slave.slave().state().is_data_exchange());
    line.slave.poll(expiry);
    assert!(!line.slave.slave().state().is_data_exchange());
}
