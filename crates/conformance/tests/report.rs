//! Reports: whatever a slave sends and a user writes, they stay whole.

use conformance::report::{Run, Tally, case_text, html, json, junit, summary};
use conformance::{CaseResult, Outcome, Record};

fn run() -> Run {
    Run {
        program: "sch108bex 0.1.0".to_owned(),
        port: "unix:/tmp/<a&\"b\">".to_owned(),
        address: 5,
        ident: 0x108B,
        when: "2026-03-01 12:00 UTC".to_owned(),
    }
}

fn result(id: &str, area: &str, outcome: Outcome, reason: &str) -> CaseResult {
    let record = Record {
        what: "STAT".to_owned(),
        sent: "10 05 02 49 50 16".to_owned(),
        came: String::new(),
        due: "OK".to_owned(),
        delay_ns: None,
        fault: (outcome == Outcome::Fail).then(|| reason.to_owned()),
    };
    CaseResult {
        id: id.to_owned(),
        title: "FDL status is <answered> & more".to_owned(),
        area: area.to_owned(),
        rule: "2.4".to_owned(),
        outcome,
        reason: reason.to_owned(),
        records: if outcome == Outcome::Skip { Vec::new() } else { vec![record] },
        seconds: 0.5,
    }
}

fn results() -> Vec<CaseResult> {
    vec![
        result("1", "One", Outcome::Pass, ""),
        result("2", "One", Outcome::Fail, "silent, but \"OK\" was due"),
        result("3", "Two", Outcome::Skip, "it needs <power>"),
    ]
}

#[test]
fn the_document_has_each_case_with_result_and_reason() {
    let document: serde_json::Value = serde_json::from_str(&json(&run(), &results())).expect("JSON");
    let cases = document["cases"].as_array().expect("a list");
    let of = |at: usize, key: &str| cases[at][key].as_str().expect("text").to_owned();
    assert_eq!([of(0, "id"), of(1, "id"), of(2, "id")], ["1", "2", "3"]);
    assert_eq!([of(0, "result"), of(1, "result"), of(2, "result")], ["pass", "fail", "skip"]);
    assert_eq!(of(1, "reason"), "silent, but \"OK\" was due");
    assert_eq!(of(2, "title"), "FDL status is <answered> & more");
    assert_eq!(cases[1]["steps"][0]["sent"], "10 05 02 49 50 16");
    assert_eq!((&document["passed"], &document["failed"]), (&1.into(), &1.into()));
    assert_eq!(document["ident"], "0x108B");
}

#[test]
fn build_servers_get_suites_with_failures_and_skips_counted() {
    let xml = junit(&run(), &results());
    assert!(xml.starts_with("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites "), "{xml}");
    assert!(xml.contains("tests=\"3\" failures=\"1\" skipped=\"1\""), "{xml}");
    assert!(xml.contains("<testsuite name=\"One\" tests=\"2\" failures=\"1\" skipped=\"0\""), "{xml}");
    assert!(xml.contains("<failure message=\"silent, but &quot;OK&quot; was due\">"), "{xml}");
    assert!(xml.contains("<skipped message=\"it needs &lt;power&gt;\"/>"), "{xml}");
    balanced(&xml, &["testsuites", "testsuite", "testcase", "failure"]);
}

#[test]
fn the_page_shows_everything_and_nothing_of_it_is_markup() {
    let page = html(&run(), &results());
    for part in [
        "unix:/tmp/&lt;a&amp;&quot;b&quot;&gt;",
        "FDL status is &lt;answered&gt; &amp; more",
        "it needs &lt;power&gt;",
        "10 05 02 49 50 16",
        "1 of 2 cases that could be tried failed",
        "prefers-color-scheme: dark",
        "2026-03-01 12:00 UTC",
        "108B",
    ] {
        assert!(page.contains(part), "{part} is missing");
    }
    for foreign in ["http:", "https:", "<script", "src=", "@import", "url("] {
        assert!(!page.contains(foreign), "one file, with {foreign} in it");
    }
    balanced(&page, &["html", "head", "body", "details", "table", "tr", "td", "th", "summary"]);
}

#[test]
fn people_read_what_was_sent_what_came_and_what_was_due() {
    let results = results();
    let failed = case_text(&results[1], false);
    for part in ["fail 2", "sent 10 05 02 49 50 16", "came silence", "due  OK", "rule: 2.4", "why: silent"] {
        assert!(failed.contains(part), "{part} is missing in {failed}");
    }
    assert_eq!(case_text(&results[0], false), "pass 1     FDL status is <answered> & more");
    assert!(case_text(&results[0], true).contains("sent 10 05 02 49 50 16"));
    assert!(case_text(&results[2], false).ends_with("left out: it needs <power>"));
    let rows: Vec<_> =
        summary(&results).lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" ")).collect();
    assert_eq!(rows, ["area passed failed left out", "One 1 1 0", "Two 0 0 1", "all 1 1 1"]);
    assert_eq!(Tally::of(&results).total(), 3);
}

/// Each of the tags is closed as often as it is opened.
fn balanced(text: &str, tags: &[&str]) {
    for tag in tags {
        let opened = text.matches(&format!("<{tag}>")).count() + text.matches(&format!("<{tag} ")).count();
        let mark = format!("<{tag} ");
        let at_once = text
            .match_indices(&mark)
            .filter(|(at, _)| text[*at..].find('>').is_some_and(|end| text[*at..*at + end].ends_with('/')));
        assert_eq!(opened - at_once.count(), text.matches(&format!("</{tag}>")).count(), "{tag}");
    }
}
