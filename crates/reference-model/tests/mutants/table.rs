//! `docs/mutants.md`: which case caught which.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::{env, fs};

use conformance::cases;

use crate::laboratory::Laboratory;
use crate::list::{Mutant, reasons};

/// Set to anything: the page is written anew.
const REWRITE: &str = "REWRITE_MUTANTS";

const HEAD: &str = "# The tester is tested

The cases of `sch108bex conformance` are tried on wrong slaves. Each is the reference model
(`crates/reference-model`), a DP-V0 slave written to be read, with one line changed (`mutants.txt` there). A
test holds that the model passes every case that is for any slave, and that each wrong slave

- fails every case of the rule that it breaks,
- passes nine in ten of the others at least,
- reaches data exchange, unless its rule forbids that.

Every case that no wrong slave fails has its reason beside it. This page is written by the test: `REWRITE_MUTANTS=1
cargo nextest run -p reference-model wrong_slave`.
";

/// Compares the page with what has just been found.
pub(crate) fn compare(mutants: &[Mutant], caught: &[Vec<&str>], laboratory: &Laboratory) {
    let page = page(mutants, caught, laboratory);
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../docs/mutants.md");
    if env::var_os(REWRITE).is_some() {
        fs::write(&path, &page).expect("docs can be written");
    }
    let found = fs::read_to_string(&path).unwrap_or_default();
    assert!(found == page, "docs/mutants.md is not up to date: run this test with {REWRITE}=1");
}

fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}

fn page(mutants: &[Mutant], caught: &[Vec<&str>], laboratory: &Laboratory) -> String {
    let mut page = HEAD.to_owned();
    let mut line = |text: &str| writeln!(page, "{text}").expect("a string");
    let played = (0..caught.len()).filter(|at| laboratory.plays(*at)).count();
    line(&format!("\n{} wrong slaves, {played} cases that can be played on the model.", mutants.len()));
    line("\n## The wrong slaves\n\n| slave | what it does | its rule | failed by it |\n|---|---|---|---|");
    for mutant in mutants {
        let failed = cases().iter().zip(caught).filter(|(_, by)| by.contains(&mutant.name));
        let numbers: Vec<_> = failed.map(|(case, _)| case.id.as_str()).collect();
        let Mutant { name, breaks, .. } = mutant;
        line(&format!("| {name} | {} | {} | {} |", cell(breaks), mutant.rule(), numbers.join(" ")));
    }
    line("\n## The cases\n\n| case | rule | failed by |\n|---|---|---|");
    let reasons = reasons();
    for (at, (case, result)) in cases().iter().zip(laboratory.model()).enumerate() {
        let by = match caught[at][..] {
            [] if laboratory.plays(at) => format!("none: {}", reasons.of(&case.id).unwrap_or_default()),
            [] => format!("not played: {}", result.reason),
            ref by => by.join(", "),
        };
        line(&format!("| {} | {} | {} |", case.id, cell(&case.title), cell(&by)));
    }
    line("\n## The changed lines\n");
    for Mutant { name, old, new, .. } in mutants {
        line(&format!("    {name}\n    - {old}\n    + {new}"));
    }
    page
}
