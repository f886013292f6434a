//! A quarter of an hour of bus time in everyday tests; `cargo xtask soak` runs as long as you like.

use profibus_dp::time::Duration;
use soak::{Options, Report, run};

fn soaked(seconds: u64, seed: u64) -> Report {
    println!("seed {seed}, {seconds} s");
    run(&Options::new(Duration::from_secs(seconds), seed), |_| ())
        .unwrap_or_else(|violation| panic!("seed {seed}: {violation}"))
}

#[test]
fn a_quarter_of_an_hour_in_which_everything_holds() {
    let report = soaked(900, 7);
    println!("{report}");
    // It did happen: 3600 exchanges a second, and each kind of trouble many times.
    assert!(report.exchanges > 2_000_000, "{report}");
    assert!(report.diagnoses > 10_000 && report.presets > 2_000 && report.watchdogs > 50, "{report}");
    assert!(report.unconfirmed_presets > 5 && report.moves > 10 && report.retries > 5_000, "{report}");
    let happened = report.disturbances;
    let rarest = [happened.shafts, happened.worlds, happened.power_cuts, happened.outages, happened.switches];
    assert!(rarest.into_iter().all(|count| count > 50) && happened.pauses > 50, "{report}");
    assert!(report.faults.damaged_request_characters > 1_000, "{report}");
    // Two shadows with 2000 latches a second, less what the outages cost.
    assert!(report.shadow_latches > 2_500_000 && report.shadow_replies > 100_000, "{report}");
}

#[test]
fn the_same_seed_gives_the_same_run_and_another_one_another() {
    let [one, same, other] = [11, 11, 12].map(|seed| soaked(20, seed));
    assert_eq!(one, same);
    assert_ne!(one, other);
}

// What a clean line must not need.
#[test]
fn without_errors_nothing_is_sent_again_but_to_those_that_are_off_or_gone() {
    let mut options = Options::new(Duration::from_secs(60), 3);
    options.bit_errors = 0.0;
    let report = run(&options, |_| ()).unwrap_or_else(|violation| panic!("{violation}"));
    assert_eq!(report.faults, bus::FaultCounters::default());
    assert_eq!(report.unconfirmed_presets, report.unconfirmed_presets.min(3), "{report}");
}
