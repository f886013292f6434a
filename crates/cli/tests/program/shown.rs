//! What the options make the encoder show on the bus: position, identity, alarms and warnings.

use std::time::Instant;

use crate::driver::run;
use crate::master::{CLASS_1, CLASS_2, SCANCON, number, sd2};

/// Class 2 with 13 and 12 bits, scaled to what there is anyway.
#[rustfmt::skip]
const CLASS_2_OF_13X12: &[u8] = &[
    0, 0x0A, 0x00, 0x00, 0x20, 0x00, 0x02, 0x00, 0x00, 0x00, 0, 0, 0, 0, 0, 0, 0, 0,
];

#[test]
fn a_still_shaft_is_where_it_was_put() {
    for raw in [0, 1, 491_520, 0x7FFF_FFFF_u32] {
        let mut program = run(["--switches", "0B", "--shaft", &format!("still@{raw}")]);
        let mut master = program.master(11);
        master.start_up(CLASS_2, &[0xF1]);
        for _ in 0..3 {
            assert_eq!(master.position(), raw);
        }
    }
}

#[test]
fn all_three_functionalities_show_the_position() {
    let mut program = run(["--switches", "0B", "--shaft", "still@305419896"]);
    let mut master = program.master(11);
    // 305419896 is 12345678h.
    master.start_up(CLASS_1, &[0xD1]);
    assert_eq!(master.exchange(&[]), [0x12, 0x34, 0x56, 0x78]);
    master.set_prm([0x10, 0x8B], &[]);
    for configuration in [&[0xF1, 0xD1, 0xD1][..], &[0xF1, 0xD3]] {
        let mut program = run(["--switches", "0B", "--shaft", "still@305419896"]);
        let mut master = program.master(11);
        master.start_up(SCANCON, configuration);
        assert_eq!(master.exchange(&[0; 4]), [0x12, 0x34, 0x56, 0x78, 0, 0, 0, 0, 0, 0, 0, 0]);
    }
}

#[test]
fn a_turning_shaft_is_where_the_time_puts_it() {
    // 60 RPM: 65536 counts a second, 65.536 in a millisecond; both directions.
    for (shaft, direction) in [("constant:60@1000000", 1.0), ("constant:-60@1000000", -1.0)] {
        let before_start = Instant::now();
        let mut program = run(["--switches", "0B", "--shaft", shaft]);
        let ready = Instant::now();
        let mut master = program.master(11);
        master.start_up(SCANCON, &[0xF1, 0xD1, 0xD1]);
        for _ in 0..5 {
            std::thread::sleep(std::time::Duration::from_millis(60));
            let least = ready.elapsed();
            let inputs = master.exchange(&[0; 4]);
            let most = before_start.elapsed();
            let turned = direction * (f64::from(number(&inputs[..4])) - 1e6);
            // A latch is at most 500 us old: 33 counts; floor may take one more.
            assert!(
                turned >= least.as_secs_f64() * 65_536.0 - 34.0
                    && turned <= most.as_secs_f64() * 65_536.0 + 1.0,
                "{shaft}: {turned} counts after {least:?} to {most:?}"
            );
        }
        // Per 100 ms: 6553.6 steps.
        let inputs = master.exchange(&[0; 4]);
        let velocity = f64::from(number(&inputs[4..8]).cast_signed()) * direction;
        assert!((6_553.0..=6_554.0).contains(&velocity), "{velocity}");
    }
}

#[test]
fn a_shaft_that_turns_begins_at_0_when_nothing_is_said() {
    let mut program = run(["--switches", "0B", "--shaft", "constant:0.001"]);
    let mut master = program.master(11);
    master.start_up(CLASS_2, &[0xF1]);
    // A thousandth of a turn a minute: a count a second.
    assert!(master.position() <= 12);
}

#[test]
fn bits_ident_and_serial_number_are_in_the_diagnosis() {
    let mut program = run(["--switches", "0B", "--bits", "13x12", "--ident", "0x4711", "--serial", "123456"]);
    let mut master = program.master(11);
    // Manual 4.2: 2^13 = 2000h steps and 2^12 = 1000h revolutions.
    let due = [0x02, 0x05, 0x00, 0xFF, 0x47, 0x11, 0x0A, 0, 0, 2, 0, 0, 0x20, 0, 0x10, 0];
    assert_eq!(master.diagnosis().0, due);
    let diagnosis = master.start_up_as([0x47, 0x11], CLASS_2_OF_13X12, &[0xF1]);
    #[rustfmt::skip]
    let due = [
        // Fixed bit; owner; ident number
        0x00, 0x04, 0x00, 0x02, 0x47, 0x11,
        // 51 octets; no alarm; class 2 and scaling; type 2; 8192 steps; 4096 revolutions
        0x33, 0x00, 0x0A, 0x02, 0x00, 0x00, 0x20, 0x00, 0x10, 0x00,
        // Additional alarms; supported alarms; warnings; supported warnings; profile; software
        0x00, 0x00, 0x03, 0x00, 0x00, 0x00, 0x36, 0x01, 0x01, 0x01, 0x01,
        // Operating time; offset; the manufacturer's offset
        0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
        // 8192 units per revolution, 33554432 in all; serial number
        0x00, 0x00, 0x20, 0x00, 0x02, 0x00, 0x00, 0x00,
        0x31, 0x32, 0x33, 0x34, 0x35, 0x36, 0x20, 0x20, 0x20, 0x20,
    ];
    assert_eq!(diagnosis.0, due);
}

#[test]
fn the_smallest_variant_has_four_steps() {
    let mut program = run(["--switches", "0B", "--bits", "2x0", "--shaft", "still@3", "--serial", "7654321"]);
    let mut master = program.master(11);
    let diagnosis = master.start_up(CLASS_2, &[0xF1]);
    assert_eq!(diagnosis.octets(11..=16), [0, 0, 0, 4, 0, 1]);
    assert_eq!(diagnosis.octets(40..=47), [0, 0, 0, 4, 0, 0, 0, 4]);
    assert_eq!(diagnosis.octets(48..=57), b"7654321   ");
    assert_eq!(master.position(), 3);
}

/// Octets 1, 2 and 8, and 20-21 of the diagnosis after start-up in class 2.
fn bits_with(arguments: &[&str]) -> (u8, u8, u8, [u8; 2]) {
    let mut program = run(["--switches", "0B"].iter().chain(arguments));
    let mut master = program.master(11);
    let diagnosis = master.start_up(CLASS_2, &[0xF1]);
    (
        diagnosis.octet(1),
        diagnosis.octet(2),
        diagnosis.octet(8),
        diagnosis.octets(20..=21).try_into().unwrap(),
    )
}

#[test]
fn the_world_shows_in_alarms_and_warnings() {
    const NOTHING: (u8, u8, u8, [u8; 2]) = (0x00, 0x04, 0, [0, 0]);
    // Octet 1, bit 3: Ext_Diag. Octet 2, bit 1: Stat_Diag, with alarms only. Octet 8, bit 1: supply.
    const SUPPLY: (u8, u8, u8, [u8; 2]) = (0x08, 0x06, 0b10, [0, 0]);
    let warning = |bit: u8| (0x08, 0x04, 0, [0, 1 << bit]);
    // Manual 4.2.2 and 4.2.9: limits belong to the good side, save that 65 degrees is not above 65.
    for (arguments, due) in [
        (vec![], NOTHING),
        (vec!["--temperature", "65.0"], NOTHING),
        (vec!["--temperature", "65.1"], warning(1)),
        (vec!["--temperature", "-40"], NOTHING),
        (vec!["--light", "low"], warning(2)),
        (vec!["--battery", "low"], warning(5)),
        (vec!["--supply", "8.9"], SUPPLY),
        (vec!["--supply", "8.999"], SUPPLY),
        (vec!["--supply", "9.0"], NOTHING),
        (vec!["--supply", "30"], NOTHING),
        (vec!["--supply", "30.1"], SUPPLY),
        (vec!["--light", "low", "--temperature", "70", "--supply", "31"], (0x08, 0x06, 0b10, [0, 0b110])),
    ] {
        assert_eq!(bits_with(&arguments), due, "{arguments:?}");
    }
}

#[test]
fn an_empty_battery_warns_and_loses_the_turn_count() {
    // Nothing was kept before: the encoder finds the turn count lost. Alarm bit 0 and warning bit 5.
    assert_eq!(bits_with(&["--battery", "empty"]), (0x08, 0x06, 0b01, [0, 1 << 5]));
}

#[test]
fn what_is_sent_is_told() {
    let mut program = run(["--switches", "0B", "--temperature", "70", "--supply", "8"]);
    program.wait_for(&["encoder: power on, station address 11"]);
    program.wait_for(&["encoder: warning: temperature above 65 degrees C"]);
    program.wait_for(&["encoder: alarm: supply voltage"]);
    let mut master = program.master(11);
    master.start_up(CLASS_2, &[0xF1]);
    program.wait_for(&["bus: a master has opened the bus at"]);
    program.wait_for(&["encoder: parameterized by master 2"]);
    program.wait_for(&["encoder: the configuration chose class 2"]);
    program.wait_for(&["encoder: data exchange with master 2 begins"]);
    // Position 0 becomes 4660.
    master.exchange(&[0x80, 0x00, 0x12, 0x34]);
    program.wait_for(&["encoder: preset: position 0 is now 4660, offset value 4660"]);
    drop(master);
    program.wait_for(&["bus: the master has closed the bus"]);
}

#[test]
fn an_alarm_makes_answers_high_priority() {
    for (supply, code) in [("24", 0x08), ("31", 0x0A)] {
        let mut program = run(["--switches", "0B", "--supply", supply]);
        let mut master = program.master(11);
        master.start_up(CLASS_2, &[0xF1]);
        let request = master.outputs(&[0; 4]);
        assert_eq!(master.terminal.ask(&request), sd2(2, 11, code, &[0; 4]), "{supply} V");
    }
}
