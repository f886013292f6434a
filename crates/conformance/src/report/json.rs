//! For programs: one document.

use serde_json::{Value, json};

use crate::case::{Case, Profile};
use crate::report::{Run, Tally};
use crate::result::CaseResult;

/// The table of the cases as one JSON document.
#[must_use]
pub fn list_json(cases: &[Case]) -> String {
    let cases: Vec<Value> = cases
        .iter()
        .map(|case| {
            json!({
                "id": case.id,
                "title": case.title,
                "area": case.area,
                "rule": case.rule,
                "disputed": case.disputed,
                "profile": match case.profile {
                    Profile::DpV0 => "dp-v0",
                    Profile::Encoder => "encoder",
                },
                "long": case.long,
            })
        })
        .collect();
    format!("{:#}", json!({ "cases": cases }))
}

/// The run as one JSON document.
pub fn json(run: &Run, results: &[CaseResult]) -> String {
    let tally = Tally::of(results);
    let cases: Vec<Value> = results.iter().map(case).collect();
    let document = json!({
        "program": run.program,
        "port": run.port,
        "address": run.address,
        "ident": format!("0x{:04X}", run.ident),
        "when": run.when,
        "passed": tally.passed,
        "failed": tally.failed,
        "skipped": tally.skipped,
        "cases": cases,
    });
    format!("{document:#}")
}

fn case(result: &CaseResult) -> Value {
    let steps: Vec<Value> = result
        .records
        .iter()
        .map(|record| {
            json!({
                "what": record.what,
                "sent": record.sent,
                "came": record.came,
                "due": record.due,
                "delay_ns": record.delay_ns,
                "fault": record.fault,
            })
        })
        .collect();
    json!({
        "id": result.id,
        "title": result.title,
        "area": result.area,
        "rule": result.rule,
        "result": result.outcome.word(),
        "reason": result.reason,
        "seconds": result.seconds,
        "steps": steps,
    })
}
