//! For build servers: JUnit XML.

use std::fmt::Write as _;

use crate::report::{Run, Tally, areas, case_text, escaped};
use crate::result::{CaseResult, Outcome};

/// The run as JUnit XML, an area being a test suite.
pub fn junit(run: &Run, results: &[CaseResult]) -> String {
    let tally = Tally::of(results);
    let seconds: f64 = results.iter().map(|result| result.seconds).sum();
    let mut xml = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    let _ = writeln!(
        xml,
        "<testsuites name=\"DP-V0 slave {} on {}\" tests=\"{}\" failures=\"{}\" skipped=\"{}\" errors=\"0\" time=\"{seconds:.3}\">",
        run.address,
        escaped(&run.port),
        tally.total(),
        tally.failed,
        tally.skipped
    );
    for (area, cases) in areas(results) {
        let tally = Tally::of(cases.iter().copied());
        let seconds: f64 = cases.iter().map(|result| result.seconds).sum();
        let _ = writeln!(
            xml,
            "  <testsuite name=\"{}\" tests=\"{}\" failures=\"{}\" skipped=\"{}\" errors=\"0\" time=\"{seconds:.3}\">",
            escaped(area),
            tally.total(),
            tally.failed,
            tally.skipped
        );
        for result in cases {
            case(&mut xml, result);
        }
        xml.push_str("  </testsuite>\n");
    }
    xml.push_str("</testsuites>\n");
    xml
}

fn case(xml: &mut String, result: &CaseResult) {
    let _ = write!(
        xml,
        "    <testcase classname=\"{}\" name=\"{} {}\" time=\"{:.3}\"",
        escaped(&result.area),
        escaped(&result.id),
        escaped(&result.title),
        result.seconds
    );
    match result.outcome {
        Outcome::Pass => xml.push_str("/>\n"),
        Outcome::Skip => {
            let _ = writeln!(xml, "><skipped message=\"{}\"/></testcase>", escaped(&result.reason));
        }
        Outcome::Fail => {
            let _ = writeln!(
                xml,
                "><failure message=\"{}\">{}</failure></testcase>",
                escaped(&result.reason),
                escaped(&case_text(result, true))
            );
        }
    }
}
