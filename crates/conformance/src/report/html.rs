//! To hand to a customer: one HTML file with nothing outside it.

use std::fmt::Write as _;

use crate::report::{Run, Tally, areas, escaped};
use crate::result::{CaseResult, Outcome, Record};

/// Light and dark as the reader's system has it.
const STYLE: &str = "
:root { color-scheme: light dark; --line: #8884; --soft: #8882; --pass: #1a7f37; --fail: #c62828; --skip: #777; }
@media (prefers-color-scheme: dark) { :root { --pass: #56d364; --fail: #ff7b72; --skip: #999; } }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; }
table { border-collapse: collapse; width: 100%; } th, td { text-align: left; padding: .3rem .6rem; border-bottom: 1px solid var(--line); vertical-align: top; }
td.n { text-align: right; } code { font: .85rem/1.4 ui-monospace, monospace; overflow-wrap: anywhere; }
details { border-bottom: 1px solid var(--line); padding: .3rem 0; } summary { cursor: pointer; }
.pass { color: var(--pass); } .fail { color: var(--fail); font-weight: 600; } .skip { color: var(--skip); }
.why { background: var(--soft); padding: .5rem .8rem; border-radius: .3rem; } .muted { color: var(--skip); font-size: .9rem; }
@media print { details { break-inside: avoid; } }
";

/// The run as one HTML file: a verdict, a table of areas, every case with what was sent and what came.
pub fn html(run: &Run, results: &[CaseResult]) -> String {
    let tally = Tally::of(results);
    let title = format!("PROFIBUS DP-V0 slave {}: test report", run.address);
    let verdict = if tally.failed == 0 {
        format!("<p class=\"pass\">All {} cases that could be tried passed.</p>", tally.passed)
    } else {
        format!(
            "<p class=\"fail\">{} of {} cases that could be tried failed.</p>",
            tally.failed,
            tally.passed + tally.failed
        )
    };
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{title}</title>\n\
         <style>{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n{verdict}\n{}{}",
        facts(run, tally),
        overview(results),
    );
    for (area, cases) in areas(results) {
        let _ = writeln!(page, "<h2>{}</h2>", escaped(area));
        for result in cases {
            case(&mut page, result);
        }
    }
    page.push_str(
        "<p class=\"muted\">These cases follow public sources of the DP-V0 rules. They are no certification.</p>\n\
         </body>\n</html>\n",
    );
    page
}

fn facts(run: &Run, tally: Tally) -> String {
    let mut table = String::from("<table>\n");
    let mut row = |name: &str, value: &str| {
        let _ = writeln!(table, "<tr><th>{name}</th><td>{}</td></tr>", escaped(value));
    };
    row("Slave", &format!("address {}, ident number {:04X}", run.address, run.ident));
    row("Port", &run.port);
    row("Tested by", &run.program);
    if !run.when.is_empty() {
        row("When", &run.when);
    }
    row("Left out", &format!("{} of {} cases", tally.skipped, tally.total()));
    table + "</table>\n"
}

fn overview(results: &[CaseResult]) -> String {
    let mut table = String::from(
        "<h2>Areas</h2>\n<table>\n<tr><th>Area</th><th>Passed</th><th>Failed</th><th>Left out</th></tr>\n",
    );
    for (area, cases) in areas(results) {
        let tally = Tally::of(cases);
        let failed = if tally.failed > 0 { "n fail" } else { "n" };
        let _ = writeln!(
            table,
            "<tr><td>{}</td><td class=\"n\">{}</td><td class=\"{failed}\">{}</td><td class=\"n\">{}</td></tr>",
            escaped(area),
            tally.passed,
            tally.failed,
            tally.skipped
        );
    }
    table + "</table>\n"
}

fn case(page: &mut String, result: &CaseResult) {
    let word = result.outcome.word();
    let open = if result.outcome == Outcome::Fail { " open" } else { "" };
    let _ = writeln!(
        page,
        "<details{open}><summary><span class=\"{word}\">{word}</span> {} {}</summary>",
        escaped(&result.id),
        escaped(&result.title)
    );
    if !result.reason.is_empty() {
        let _ = writeln!(page, "<p class=\"why\">{}</p>", escaped(&result.reason));
    }
    if !result.records.is_empty() {
        page.push_str("<table>\n<tr><th>What</th><th>Sent</th><th>Came</th><th>Due</th></tr>\n");
        for record in &result.records {
            row(page, record);
        }
        page.push_str("</table>\n");
    }
    let _ = writeln!(page, "<p class=\"muted\">Follows {}</p></details>", escaped(&result.rule));
}

fn row(page: &mut String, record: &Record) {
    let came = match (record.came.is_empty(), record.due.is_empty()) {
        (true, true) => "",
        (true, false) => "silence",
        _ => &record.came,
    };
    let fault = record.fault.as_ref().map(|fault| format!("<div class=\"fail\">{}</div>", escaped(fault)));
    let _ = writeln!(
        page,
        "<tr><td>{}</td><td><code>{}</code></td><td><code>{}</code>{}</td><td>{}</td></tr>",
        escaped(&record.what),
        escaped(&record.sent),
        escaped(came),
        fault.unwrap_or_default(),
        escaped(&record.due)
    );
}
