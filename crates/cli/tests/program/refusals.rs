//! Refusals explain themselves: octet, value, rule and section of the manual on standard output.

use crate::driver::{Program, run};
use crate::master::{CLASS_1, CLASS_2, IDENT, Master, SCANCON, sd1};

/// `user` with one octet changed; `number` counts from 1 over the whole Set_Prm, as in the manual.
fn with(user: &[u8], number: usize, value: u8) -> Vec<u8> {
    let mut user = user.to_vec();
    user[number - 8] = value;
    user
}

/// Scaling on, so many units per revolution and in all.
fn scaled(units: u32, range: u32) -> Vec<u8> {
    let mut user = with(CLASS_2, 9, 0x0A);
    user[2..6].copy_from_slice(&units.to_be_bytes());
    user[6..10].copy_from_slice(&range.to_be_bytes());
    user
}

fn encoder() -> (Program, Master) {
    let mut program = run(["--switches", "0B"]);
    let master = program.master(11);
    (program, master)
}

#[test]
fn refused_parameters_say_which_octet_which_value_and_why() {
    let (mut program, mut master) = encoder();
    for (user, parts) in [
        (
            vec![0],
            &["Set_Prm: 8 octets", "9 (class 1), 25 (class 2) or 26 (Scancon 2.0)", "(manual 4.1)"][..],
        ),
        (with(SCANCON, 9, 0x00), &["Set_Prm octet 9: 00h", "bit 1", "must be on", "(manual 4.1.1)"]),
        (with(CLASS_2, 9, 0x06), &["Set_Prm octet 9: 06h", "bit 2", "must be off", "(manual 4.1.1)"]),
        (vec![0, 0x10], &["Set_Prm octet 9: 10h", "bits 4-7", "must be off", "(manual 4.1.1)"]),
        (
            scaled(65_537, 65_537),
            &["Set_Prm octets 10-13: 65537", "at most 65536", "16 singleturn bits", "(manual 4.1.2)"],
        ),
        (scaled(0, 1), &["Set_Prm octets 10-13: 0 ", "1 to 65536", "(manual 4.1.2)"]),
        (
            scaled(4_096, 0x8000_0001),
            &[
                "Set_Prm octets 14-17: 2147483649",
                "at most 2147483648",
                "15 multiturn bits",
                "(manual 4.1.3)",
            ],
        ),
        (scaled(4_096, 0), &["Set_Prm octets 14-17: 0 ", "1 to 2147483648", "(manual 4.1.3)"]),
        (with(CLASS_2, 18, 1), &["Set_Prm octet 18: 01h", "reserved and must be 0", "(manual 4.1.4)"]),
        (with(CLASS_2, 25, 0xFF), &["Set_Prm octet 25: FFh", "reserved and must be 0", "(manual 4.1.4)"]),
        (with(SCANCON, 26, 4), &["Set_Prm octet 26: time base 4", "3 (RPM)", "(manual 4.1.5)"]),
        (with(CLASS_2, 8, 0x80), &["Set_Prm octet 8", "80", "bits 0, 1, 2 and 6"]),
    ] {
        let before = program.lines_so_far();
        assert_eq!(master.set_prm(IDENT, &user), [0xE5]);
        let line = program.wait_for_after(before, parts);
        assert!(line.contains("encoder: "), "{line}");
        // Octet 1: Prm_Fault and Station_Not_Ready; nobody owns it.
        let diagnosis = master.diagnosis();
        assert_eq!((diagnosis.octet(1), diagnosis.octet(4)), (0x42, 0xFF), "{line}");
    }
    // Good ones are taken, and nothing more is refused.
    let before = program.lines_so_far();
    master.start_up(CLASS_2, &[0xF1]);
    program.wait_for_after(before, &["data exchange with master 2 begins"]);
    let refused = program.seen[before..].iter().find(|line| line.contains("refused"));
    assert_eq!(refused, None);
}

#[test]
fn what_the_standard_refuses_is_told_too() {
    let (mut program, mut master) = encoder();
    master.set_prm([0x47, 0x11], CLASS_2);
    program.wait_for(&["Set_Prm octets 5-6", "4711", "this device has 108B"]);
    assert_eq!(master.diagnosis().octet(1), 0x42);
    // Bits 0 to 2 of Station_Status; a watchdog factor of 0; less than the standard part.
    master.service(61, &[&[0x81, 1, 1, 11, 0x10, 0x8B, 0], CLASS_2].concat());
    program.wait_for(&["Set_Prm octet 1 ", "81", "must be 0"]);
    master.service(61, &[&[0x88, 1, 0, 11, 0x10, 0x8B, 0], CLASS_2].concat());
    program.wait_for(&["Set_Prm octet 3 ", "must be 1 to 255"]);
    master.service(61, &[0x80, 1, 1, 11, 0x10, 0x8B]);
    program.wait_for(&["Set_Prm has 6 octets", "7"]);
    // Another master while this one owns it.
    master.start_up(CLASS_2, &[0xF1]);
    let from_3 =
        crate::master::sd2(0x8B, 0x83, 0x6D, &[&[61, 62, 0x80, 1, 1, 11, 0x10, 0x8B, 0], CLASS_2].concat());
    assert_eq!(master.terminal.ask(&from_3), sd1(3, 11, 0x03));
    program.wait_for(&["Set_Prm from master 3 is refused: master 2 owns this slave"]);
    // A wrong number of outputs.
    let wrong = master.outputs(&[0; 3]);
    assert_eq!(master.terminal.ask(&wrong), sd1(2, 11, 0x03));
    program.wait_for(&["Data_Exchange carries 3 output octets, but 4 were agreed on"]);
}

#[test]
fn a_refused_configuration_says_what_there_is() {
    let (mut program, mut master) = encoder();
    for (user, octets, parts) in [
        (
            CLASS_2,
            &[0xD3][..],
            &["Chk_Cfg: D3,", "D1 (class 1), F1 (class 2), F1 D1 D1 or F1 D3 (Scancon 2.0)", "(manual 4.3)"]
                [..],
        ),
        (SCANCON, &[0xF1, 0xD1], &["Chk_Cfg: F1 D1,", "F1 D1 D1 or F1 D3", "(manual 4.3)"]),
        (SCANCON, &[0xF1; 10], &["Chk_Cfg: F1 F1 F1 F1 F1 F1 F1 F1 and 2 octets more", "(manual 4.3)"]),
        (SCANCON, &[], &["Chk_Cfg: no octets", "(manual 4.3)"]),
        (CLASS_1, &[0xF1], &["Chk_Cfg: class 2 needs a Set_Prm of 25 octets", "had 9", "(manual 4.1)"]),
        (CLASS_2, &[0xF1, 0xD3], &["Chk_Cfg: Scancon 2.0 needs", "of 26 octets", "had 25", "(manual 4.1)"]),
    ] {
        let before = program.lines_so_far();
        assert_eq!(master.set_prm(IDENT, user), [0xE5]);
        assert_eq!(master.chk_cfg(octets), [0xE5]);
        program.wait_for_after(before, parts);
        // Octet 1: Cfg_Fault and Station_Not_Ready; nobody owns it.
        let diagnosis = master.diagnosis();
        assert_eq!((diagnosis.octet(1), diagnosis.octet(4)), (0x06, 0xFF), "{octets:02X?}");
    }
}

#[test]
fn parameters_too_short_for_what_was_agreed_are_told() {
    let (mut program, mut master) = encoder();
    master.start_up(SCANCON, &[0xF1, 0xD1, 0xD1]);
    assert_eq!(master.set_prm(IDENT, CLASS_2), [0xE5]);
    program.wait_for(&["Set_Prm: 25 octets of new parameters", "Scancon 2.0 needs 26", "(manual 4.1)"]);
    // It leaves the master, without a fault bit.
    let diagnosis = master.diagnosis();
    assert_eq!((diagnosis.octet(1), diagnosis.octet(4)), (0x02, 0xFF));
}

#[test]
fn a_preset_above_the_range_is_refused_and_told() {
    let (mut program, mut master) = encoder();
    master.start_up(&scaled(1_000, 10_000), &[0xF1]);
    // 10000 is one too many; 9999 is not.
    let before = program.lines_so_far();
    master.exchange(&[0x80, 0, 0x27, 0x10]);
    program.wait_for_after(
        before,
        &["preset refused", "output octets 1-4", "preset to 10000", "at most 9999", "(manual 4.3.2)"],
    );
    assert_eq!(master.position(), 0);
    assert_eq!(master.diagnosis().offset(), 0);
    master.exchange(&[0x80, 0, 0x27, 0x0F]);
    program.wait_for_after(before, &["preset: position 0 is now 9999, offset value 9999"]);
    std::thread::sleep(std::time::Duration::from_millis(1));
    assert_eq!(master.position(), 9_999);
}

#[test]
fn a_refused_address_says_why() {
    // The switches decide: manual 3.4.
    let (mut program, mut master) = encoder();
    master.service(55, &[12, 0x10, 0x8B, 0]);
    program.wait_for(&["Set_Slave_Add", "0B", "7E", "(manual 3.4)"]);
    assert_eq!(master.terminal.ask(&crate::master::status(11)), crate::master::status_answer(11));

    let mut program = run::<&str>([]);
    let mut master = program.master(126);
    for (data, parts) in [
        (&[126, 0x10, 0x8B, 0][..], &["Set_Slave_Add octet 1", "126", "1 to 125", "(manual 3.4)"][..]),
        (&[0, 0x10, 0x8B, 0], &["Set_Slave_Add octet 1", "address 0", "1 to 125", "(manual 3.4)"]),
        (&[12, 0x47, 0x11, 0], &["Set_Slave_Add octets 2-3", "4711", "108B", "(manual 3.4)"]),
        (&[12, 0x10, 0x8B], &["Set_Slave_Add", "3 octets", "4 ", "(manual 3.4)"]),
    ] {
        let before = program.lines_so_far();
        assert_eq!(master.service(55, data), [0xE5]);
        program.wait_for_after(before, parts);
    }
    assert!(master.terminal.is_silent(&crate::master::status(12)));
    assert_eq!(master.terminal.ask(&crate::master::status(126)), crate::master::status_answer(126));
}
