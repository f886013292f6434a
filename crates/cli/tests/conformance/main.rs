//! The encoder passes every case of the slave checks, in virtual time.

mod encoder;
mod masters;
mod ports;
mod remote_io;
#[path = "../tools/mod.rs"]
mod tools;

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use conformance::{CaseResult, Device, Options, Outcome, Subject, VirtualRig, cases, run_virtual};

use encoder::Encoder;
use remote_io::RemoteIo;

/// Our own slave reads disputed points as the first alternative says.
fn strict() -> Options {
    Options { strict: true, ..Options::default() }
}

/// Plays all cases; gives back what became of them.
fn run<S: Subject>(subject: S, device: &Device, options: Options, octetwise: bool) -> Vec<CaseResult> {
    let mut rig = VirtualRig::new(subject, octetwise);
    run_virtual(cases(), device, &mut rig, options).expect("the device has a mode")
}

/// Fails with all that was wrong, telegram by telegram.
fn all_pass(results: &[CaseResult]) {
    let failed: Vec<_> = results.iter().filter(|result| result.outcome == Outcome::Fail).collect();
    for result in &failed {
        eprintln!("case {} {}: {}", result.id, result.title, result.reason);
        for record in &result.records {
            eprintln!("    {} [{}] -> [{}] due {}", record.what, record.sent, record.came, record.due);
        }
    }
    let count = |outcome| results.iter().filter(|result| result.outcome == outcome).count();
    eprintln!("{} passed, {} skipped", count(Outcome::Pass), count(Outcome::Skip));
    for result in results.iter().filter(|result| result.outcome == Outcome::Skip) {
        eprintln!("case {} skipped: {}", result.id, result.reason);
    }
    let numbers: Vec<_> = failed.iter().map(|result| result.id.as_str()).collect();
    assert!(failed.is_empty(), "failed: {}", numbers.join(", "));
}

#[test]
fn the_encoder_passes_in_virtual_time() {
    let began = Instant::now();
    let results = run(Encoder::full(), &Encoder::full().device(), strict(), false);
    let took = began.elapsed();
    all_pass(&results);
    eprintln!("{} cases in {took:?}", results.len());
    assert!(took < Duration::from_secs(10), "{took:?}");
}

#[test]
fn the_encoder_passes_with_srd_low_and_octet_by_octet() {
    let options = Options { srd_low: true, ..strict() };
    all_pass(&run(Encoder::full(), &Encoder::full().device(), options, true));
}

#[test]
fn encoders_with_fewer_bits_pass_what_is_not_for_one_resolution() {
    for (n, m) in [(13, 12), (16, 0), (2, 0)] {
        let encoder = Encoder::new(n, m);
        let device = encoder.device();
        let results = run(encoder, &device, strict(), false);
        eprintln!("{n}x{m}");
        all_pass(&results);
    }
}

#[test]
fn slaves_that_are_no_encoders_pass_and_no_case_is_left_over() {
    let mut tried: BTreeSet<String> = BTreeSet::new();
    let mut results = run(Encoder::full(), &Encoder::full().device(), strict(), false);
    for kind in [RemoteIo::NO_OUTPUTS, RemoteIo::NO_INPUTS, RemoteIo::PLAIN] {
        let mut rig = VirtualRig::new(kind, false).with_stream_receivers();
        let device = kind.device();
        results.extend(run_virtual(cases(), &device, &mut rig, strict()).expect("a mode"));
    }
    all_pass(&results);
    let passed = results.iter().filter(|result| result.outcome == Outcome::Pass);
    tried.extend(passed.map(|result| result.id.clone()));
    let left: Vec<_> = cases().iter().filter(|case| !tried.contains(&case.id)).map(|case| &case.id).collect();
    assert!(left.is_empty(), "never tried: {left:?}");
}
