//! The tester is tested: wrong slaves, each the model with one line changed, and which case of the
//! slave checks caught which.

mod laboratory;
mod list;
mod subject;
mod table;
mod wrong;

use conformance::{Outcome, Profile, cases};

use laboratory::{Laboratory, exchanges};
use list::{Mutant, mutants, reasons};

#[test]
fn the_model_passes_every_case_for_any_slave() {
    let laboratory = Laboratory::new();
    let mut failed = Vec::new();
    for (case, result) in cases().iter().zip(laboratory.model()) {
        if case.profile == Profile::DpV0 && result.outcome == Outcome::Fail {
            failed.push(format!("case {} {}: {}", case.id, case.title, result.reason));
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

#[test]
fn every_wrong_slave_is_found_out_and_nothing_else_is_blamed() {
    let laboratory = Laboratory::new();
    let mutants = mutants();
    assert!(mutants.len() >= 40, "only {} wrong slaves", mutants.len());
    let mut faults = Vec::new();
    let mut caught: Vec<Vec<&str>> = vec![Vec::new(); cases().len()];
    for (mutant, failed) in mutants.iter().zip(laboratory.try_all(&mutants)) {
        faults.extend(judge(mutant, &failed, &laboratory));
        for (case, _) in failed.iter().enumerate().filter(|(_, failed)| **failed) {
            caught[case].push(mutant.name);
        }
        if exchanges(mutant.power_on) == mutant.never_exchanges {
            let does = if mutant.never_exchanges { "reaches" } else { "does not reach" };
            faults.push(format!("{} {does} data exchange", mutant.name));
        }
    }
    faults.extend(reasons().judge(&caught, &laboratory));
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    table::compare(&mutants, &caught, &laboratory);
}

/// What is wrong with a wrong slave.
fn judge(mutant: &Mutant, failed: &[bool], laboratory: &Laboratory) -> Vec<String> {
    let mut faults = Vec::new();
    let tagged: Vec<bool> = cases().iter().map(|case| mutant.concerns(case)).collect();
    let played = |at: &usize| laboratory.plays(*at);
    let missed: Vec<&str> = (0..failed.len())
        .filter(played)
        .filter(|at| tagged[*at] && !failed[*at])
        .map(|at| cases()[at].id.as_str())
        .collect();
    if !missed.is_empty() {
        faults.push(format!("{}: these cases ought to fail: {}", mutant.name, missed.join(" ")));
    }
    let others: Vec<usize> = (0..failed.len()).filter(played).filter(|at| !tagged[*at]).collect();
    let failing = others.iter().filter(|at| failed[**at]).count();
    if failing * 10 > others.len() {
        faults.push(format!("{}: {failing} of {} other cases fail", mutant.name, others.len()));
    }
    let found = (0..failed.len()).filter(played).any(|at| tagged[at]);
    if !found {
        faults.push(format!("{}: no case is about it; {:?} fail", mutant.name, failing_ids(failed)));
    }
    faults
}

fn failing_ids(failed: &[bool]) -> Vec<&str> {
    cases().iter().zip(failed).filter(|(_, failed)| **failed).map(|(case, _)| case.id.as_str()).collect()
}
