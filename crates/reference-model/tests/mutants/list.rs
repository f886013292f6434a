//! `mutants.txt` and `uncaught.txt`.

use std::collections::BTreeMap;

use conformance::{Case, cases};

use crate::laboratory::Laboratory;
use crate::wrong::{PowerOn, made};

/// A wrong slave.
pub(crate) struct Mutant {
    pub(crate) name: &'static str,
    /// What it does wrong.
    pub(crate) breaks: &'static str,
    /// Tags of the rule; `a+b`: cases that carry both.
    tags: Vec<&'static str>,
    /// Numbers of cases, where the rule is finer than the tags.
    numbers: Vec<&'static str>,
    pub(crate) never_exchanges: bool,
    pub(crate) old: &'static str,
    pub(crate) new: &'static str,
    pub(crate) power_on: PowerOn,
}

impl Mutant {
    /// Whether the case is about the rule that it breaks.
    pub(crate) fn concerns(&self, case: &Case) -> bool {
        let has = |tag: &str| case.tags.iter().any(|of_case| of_case == tag);
        self.numbers.contains(&case.id.as_str()) || self.tags.iter().any(|tags| tags.split('+').all(has))
    }

    /// The rule by its tags and numbers.
    pub(crate) fn rule(&self) -> String {
        self.tags.iter().chain(&self.numbers).copied().collect::<Vec<_>>().join(", ")
    }
}

/// All of them, in the order of the file.
pub(crate) fn mutants() -> Vec<Mutant> {
    let made: BTreeMap<_, _> = made::ALL.iter().copied().collect();
    let texts = include_str!("../../mutants.txt").split("\nmutant ").skip(1);
    texts.map(|text| parse(text, &made)).collect()
}

fn parse(text: &'static str, made: &BTreeMap<&str, PowerOn>) -> Mutant {
    let name = text.lines().next().unwrap_or_default().trim();
    let line = |key: &str| text.lines().find_map(|line| line.strip_prefix(key)).unwrap_or_default().trim();
    let mutant = Mutant {
        name,
        breaks: line("breaks "),
        tags: line("tags ").split_whitespace().collect(),
        numbers: line("cases ").split_whitespace().collect(),
        never_exchanges: text.lines().any(|line| line == "never exchanges"),
        old: line("- "),
        new: line("+ "),
        power_on: made[name],
    };
    for number in &mutant.numbers {
        assert!(cases().iter().any(|case| case.id == *number), "{name}: there is no case {number}");
    }
    mutant
}

/// Why cases are failed by no wrong slave.
pub(crate) struct Reasons(BTreeMap<&'static str, &'static str>);

pub(crate) fn reasons() -> Reasons {
    let lines = include_str!("../../uncaught.txt").lines().filter(|line| !line.starts_with(';'));
    Reasons(lines.filter_map(|line| line.split_once(' ')).collect())
}

impl Reasons {
    pub(crate) fn of(&self, case: &str) -> Option<&'static str> {
        self.0.get(case).copied()
    }

    /// Cases without a wrong slave and without a reason, and reasons that are none.
    pub(crate) fn judge(&self, caught: &[Vec<&str>], laboratory: &Laboratory) -> Vec<String> {
        let mut faults = Vec::new();
        for (at, case) in cases().iter().enumerate() {
            let needed = caught[at].is_empty() && laboratory.plays(at);
            match (needed, self.of(&case.id)) {
                (true, None) => {
                    faults.push(format!(
                        "case {} {}: no wrong slave fails it; uncaught.txt has no reason",
                        case.id, case.title
                    ));
                }
                (false, Some(_)) => {
                    faults.push(format!("case {}: a reason in uncaught.txt, but none is needed", case.id));
                }
                _ => {}
            }
        }
        faults
    }
}
