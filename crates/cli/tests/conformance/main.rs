//! The encoder passes every case of the slave checks, in virtual time.

mod encoder;
mod remote_io;

use conformance::{CaseResult, Device, Options, Outcome, Subject, VirtualRig, cases, run_virtual};

use encoder::Encoder;

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
    all_pass(&run(Encoder::full(), &Encoder::full().device(), Options::default(), false));
}

#[test]
fn the_encoder_passes_with_srd_low_and_octet_by_octet() {
    let options = Options { srd_low: true, ..Options::default() };
    all_pass(&run(Encoder::full(), &Encoder::full().device(), options, true));
}
