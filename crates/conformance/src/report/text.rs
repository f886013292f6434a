//! For people, on a terminal.

use std::fmt::Write as _;

use crate::case::Case;
use crate::report::{Tally, areas};
use crate::result::{CaseResult, Outcome, Record};

/// A case in lines; what was done only where `all` asks for it or it failed.
pub fn case(result: &CaseResult, all: bool) -> String {
    let mut text = format!("{} {:<5} {}", result.outcome.word(), result.id, result.title);
    if result.outcome == Outcome::Skip {
        let _ = write!(text, "\n           left out: {}", result.reason);
    }
    if result.outcome == Outcome::Fail || (all && result.outcome == Outcome::Pass) {
        for record in &result.records {
            lines(&mut text, record);
        }
        let _ = write!(text, "\n           rule: {}", result.rule);
    }
    if result.outcome == Outcome::Fail {
        let _ = write!(text, "\n           why: {}", result.reason);
    } else if result.outcome == Outcome::Pass && !result.reason.is_empty() {
        let _ = write!(text, "\n           note: {}", result.reason);
    }
    text
}

fn lines(text: &mut String, record: &Record) {
    let _ = write!(text, "\n           {}", record.what);
    if !record.sent.is_empty() {
        let _ = write!(text, "\n             sent {}", record.sent);
    }
    if !record.due.is_empty() {
        let came = if record.came.is_empty() { "silence" } else { &record.came };
        let _ = write!(text, "\n             came {came}\n             due  {}", record.due);
    }
    if let Some(delay) = record.delay_ns {
        let _ = write!(text, "\n             after {delay} ns");
    }
    if let Some(fault) = &record.fault {
        let _ = write!(text, "\n             WRONG: {fault}");
    }
}

/// What became of the areas, and of all.
pub fn summary(results: &[CaseResult]) -> String {
    let mut text = format!("{:<42} {:>6} {:>6} {:>8}\n", "area", "passed", "failed", "left out");
    let mut row = |name: &str, tally: Tally| {
        let _ = writeln!(text, "{name:<42} {:>6} {:>6} {:>8}", tally.passed, tally.failed, tally.skipped);
    };
    for (area, cases) in areas(results) {
        row(area, Tally::of(cases));
    }
    row("all", Tally::of(results));
    text.truncate(text.trim_end().len());
    text
}

/// The cases as a table in Markdown.
pub fn list(cases: &[Case]) -> String {
    let mut text = String::from("| case | rule | follows | disputed | long |\n|---|---|---|---|---|\n");
    let mut area = "";
    for case in cases {
        if case.area != area {
            area = &case.area;
            let _ = writeln!(text, "| | **{area}** | | | |");
        }
        let disputed = case.disputed.join(", ");
        let long = if case.long { "long" } else { "" };
        let title = case.title.replace('|', "\\|");
        let _ = writeln!(text, "| {} | {title} | {} | {disputed} | {long} |", case.id, case.rule);
    }
    text.truncate(text.trim_end().len());
    text
}
