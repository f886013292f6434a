//! What became of a run, for people, programs and build servers.

mod html;
mod json;
mod junit;
mod text;

use crate::result::{CaseResult, Outcome};

pub use html::html;
pub use json::{json, list_json};
pub use junit::junit;
pub use text::{case as case_text, list, summary};

/// What a report says of the run as a whole.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Run {
    /// The program and its version.
    pub program: String,
    /// The port, as the user wrote it.
    pub port: String,
    /// The slave's address.
    pub address: u8,
    /// Its ident number.
    pub ident: u16,
    /// When, as text; empty where nobody is to know.
    pub when: String,
}

/// How many cases passed, failed and were left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tally {
    /// Passed.
    pub passed: usize,
    /// Failed.
    pub failed: usize,
    /// Left out.
    pub skipped: usize,
}

impl Tally {
    /// Counts.
    pub fn of<'a>(results: impl IntoIterator<Item = &'a CaseResult>) -> Self {
        results.into_iter().fold(Self::default(), |mut tally, result| {
            match result.outcome {
                Outcome::Pass => tally.passed += 1,
                Outcome::Fail => tally.failed += 1,
                Outcome::Skip => tally.skipped += 1,
            }
            tally
        })
    }

    /// All of them.
    pub const fn total(self) -> usize {
        self.passed + self.failed + self.skipped
    }
}

/// The areas in the order in which they come, each with its results.
fn areas(results: &[CaseResult]) -> Vec<(&str, Vec<&CaseResult>)> {
    let mut areas: Vec<(&str, Vec<&CaseResult>)> = Vec::new();
    for result in results {
        match areas.iter_mut().find(|(area, _)| *area == result.area) {
            Some((_, cases)) => cases.push(result),
            None => areas.push((&result.area, vec![result])),
        }
    }
    areas
}

/// Text inside XML and HTML; characters that neither may have become a question mark.
fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            '\n' | '\t' => safe.push(character),
            character if character.is_control() || matches!(character, '\u{FFFE}' | '\u{FFFF}') => {
                safe.push('?');
            }
            character => safe.push(character),
        }
    }
    safe
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_could_end_a_tag_is_escaped() {
        assert_eq!(escaped("<a href=\"x\">&'\u{1}"), "&lt;a href=&quot;x&quot;&gt;&amp;&#39;?");
    }
}
