//! The demonstration: what it claims is what happened.

use crate::driver::{Ended, end_of, program};

#[test]
fn without_a_command_it_shows_the_main_job() {
    let Ended { status, output, errors } = end_of(&mut program());
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
        "encoder: preset: position ",
        "encoder: warning: temperature above 65 degrees C",
        "Ext_Diag 1, Stat_Diag 0",
        "All as it should be.",
    ] {
        assert!(output.contains(claim), "no `{claim}` in\n{output}");
    }
    // 300 RPM of 4096 steps: 2048 in 100 ms, give or take the latch.
    let positions: Vec<i64> = output
        .lines()
        .filter(|line| line.contains("acceleration"))
        .filter_map(|line| line.split_whitespace().nth(1)?.parse().ok())
        .collect();
    assert_eq!(positions.len(), 6, "{output}");
    for pair in positions.windows(2) {
        assert!((2_037..=2_063).contains(&(pair[1] - pair[0])), "{positions:?}");
    }
    let preset = output.lines().find(|line| line.contains("a millisecond later")).expect("after the preset");
    let position: i64 = preset.split_whitespace().nth(1).unwrap().parse().unwrap();
    // 20.48 steps in a millisecond.
    assert!((1_000_000..1_000_100).contains(&position), "{preset}");
}

#[test]
fn the_demonstration_has_a_name_too() {
    let unnamed = end_of(&mut program());
    let named = end_of(program().arg("demo"));
    assert_eq!(named.status, Some(0));
    // It runs in virtual time: nothing depends on the computer.
    assert_eq!(named.output, unnamed.output);
}
