//! The demonstration: what it claims is what happened.

use rustix::process::Signal;

use crate::driver::{Ended, Program, end_of, program};

/// The positions of the lines that show a moment.
fn positions(output: &str) -> Vec<i64> {
    let lines = output.lines().filter(|line| line.contains("acceleration") && line.contains("cycle"));
    lines.filter_map(|line| line.split_whitespace().nth(1)?.parse().ok()).collect()
}

#[test]
fn without_a_command_it_shows_the_main_job() {
    let Ended { status, output, errors } = end_of(program().args(["--seconds", "3"]));
    assert_eq!((status, errors.as_str()), (Some(0), ""), "{output}");
    for claim in [
        "encoder: power on, station address 126",
        "encoder: new station address 5",
        "Set_Prm octets 10-13: 70000 measuring units per revolution, but at most 65536 are possible with 16 \
         singleturn bits (manual 4.1.2)",
        "encoder: the configuration chose Scancon 2.0",
        "encoder: data exchange with master 2 begins",
        // 4096 steps, 32768 turns: 2^27.
        "65536 steps x 32768 turns on the disc, 4096 of 134217728 units in force, serial number 1234567",
        "no alarm, no warning",
        "encoder: preset: position ",
        "encoder: warning: temperature above 65 degrees C",
        "Ext_Diag 1, Stat_Diag 0",
        "no alarm; warning: temperature above 65 degrees C",
        // 300 RPM of 4096 steps: 2048 in 100 ms.
        "velocity   2048   acceleration     0   cycle 281 us",
        "velocity  -2048   ",
        "0 retries",
        "All as it should be.",
    ] {
        assert!(output.contains(claim), "no `{claim}` in\n{output}");
    }
    assert!(!output.contains('\x1b'), "plain lines where nobody can see colours");
    // The first watch takes 1.2 s, of which 0.3 s pass before its first line, one every half second and one
    // in the end. A line is ten frames of 50 ms, each to the end of its 178th exchange of 281.3 us: 10256
    // steps in 500.8 ms, give or take a latch.
    let [first, second, third, ..] = positions(&output)[..] else { panic!("{output}") };
    for moved in [second - first, third - second] {
        assert!((10_245..=10_267).contains(&moved), "{output}");
    }
    let preset = output.lines().find(|line| line.contains("a millisecond later")).expect("after the preset");
    let position: i64 = preset.split_whitespace().nth(1).unwrap().parse().unwrap();
    // 20.48 steps in a millisecond.
    assert!((1_000_000..1_000_100).contains(&position), "{preset}");
}

#[test]
fn the_demonstration_has_a_name_too() {
    let unnamed = end_of(program().args(["--seconds", "0.5"]));
    let named = end_of(program().args(["demo", "--seconds", "0.5"]));
    assert_eq!(named.status, Some(0));
    // It runs in virtual time: nothing depends on the computer.
    assert_eq!(named.output, unnamed.output);
}

#[test]
fn it_takes_as_long_as_it_is_told() {
    let begun = std::time::Instant::now();
    assert_eq!(end_of(program().args(["demo", "--seconds", "2"])).status, Some(0));
    assert!(begun.elapsed() >= std::time::Duration::from_millis(1_900), "{:?}", begun.elapsed());
}

#[test]
fn a_length_that_is_none_is_refused() {
    for text in ["0", "-1", "nan", "inf", "1e9", "soon", ""] {
        let Ended { status, errors, .. } = end_of(program().arg(format!("--seconds={text}")));
        assert_eq!(status, Some(2), "{text}: {errors}");
        assert!(errors.contains("write seconds between 0.1 and 86400, like 12"), "{text}: {errors}");
    }
}

#[test]
fn ctrl_c_ends_the_waiting_and_not_the_checks() {
    let mut demo = Program::start(program().args(["demo", "--seconds", "600"]));
    demo.wait_for(&["The shaft turns clockwise"]);
    assert_eq!(demo.end_with(Signal::INT).code(), Some(0));
    demo.wait_for(&["(interrupted: the rest goes by without waiting)"]);
    demo.wait_for(&["All as it should be."]);
}
