//! The firmware, in an emulator, passes every slave check that needs no exact bus time.

mod rig;
#[path = "../../../cli/tests/tools/mod.rs"]
mod tools;

use std::collections::BTreeMap;

use conformance::{Case, CaseResult, Device, Options, Outcome, Runner, cases};
use rig::BoardRig;

/// Cases that do need it, without saying so: on this bus replies go at once, so that nobody can be faster.
const NEED_TIME: [&str; 3] = ["20", "21", "N013"];
/// A million octets, each of which takes the emulator some 50 us; the same with fewer is N-cases.
const TOO_LONG: [&str; 1] = ["39"];

/// The cases are dealt out to boards that run side by side.
const BOARDS: usize = 4;

fn device() -> Device {
    let mut device = Device::encoder(5, 16, 15);
    device.ident = Some(0x108B);
    device.encoder.as_mut().expect("an encoder").serial = Some("1234567".to_owned());
    device
}

/// Plays every fourth case from `first` on.
fn play(test: &str, first: usize) -> Option<Vec<CaseResult>> {
    let mut rig = BoardRig::start(tools::firmware(test)?);
    let options = Options { strict: true, ..Options::default() };
    let device = device();
    let mut runner = Runner::new(&device, &mut rig, options).expect("the device has a mode");
    let wanted =
        |case: &&Case| !NEED_TIME.contains(&case.id.as_str()) && !TOO_LONG.contains(&case.id.as_str());
    let chosen = cases().iter().filter(wanted).skip(first).step_by(BOARDS);
    Some(chosen.map(|case| runner.run(case).expect("the board runs")).collect())
}

fn all_pass(test: &str, first: usize) {
    let Some(results) = play(test, first) else { return };
    let mut reasons: BTreeMap<&str, usize> = BTreeMap::new();
    let mut failed = Vec::new();
    for result in &results {
        match result.outcome {
            Outcome::Pass => {}
            Outcome::Skip => *reasons.entry(&result.reason).or_default() += 1,
            Outcome::Fail => {
                failed.push(result.id.as_str());
                eprintln!("case {} {}: {}", result.id, result.title, result.reason);
                for record in &result.records {
                    eprintln!(
                        "    {} [{}] -> [{}] due {}",
                        record.what, record.sent, record.came, record.due
                    );
                }
            }
        }
    }
    eprintln!("left out: {reasons:#?}");
    assert!(failed.is_empty(), "failed: {}", failed.join(", "));
    let passed = results.iter().filter(|result| result.outcome == Outcome::Pass).count();
    // Of more than 440; some 65 need exact times, other rates or damaged characters.
    assert!(passed >= 90, "only {passed} could be tried");
}

/// A test for each board.
macro_rules! boards {
    ($($name:ident: $first:literal;)*) => {$(
        #[test]
        fn $name() {
            all_pass(concat!("conformance::", stringify!($name)), $first);
        }
    )*};
}

boards! {
    the_first_quarter_of_the_cases: 0;
    the_second_quarter_of_the_cases: 1;
    the_third_quarter_of_the_cases: 2;
    the_last_quarter_of_the_cases: 3;
}
