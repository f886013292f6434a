//! What passed, failed and was skipped, summed over all that a run has run.

use std::fmt;

/// The count, with the names of what did not pass.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Tally {
    /// How many passed.
    pub(crate) passed: usize,
    /// The names of the failed.
    pub(crate) failed: Vec<String>,
    /// The names of the skipped, with the reason.
    pub(crate) skipped: Vec<String>,
}

impl Tally {
    /// The tally of one check.
    pub(crate) fn of_one(name: impl Into<String>, passed: bool) -> Self {
        let mut tally = Self::default();
        tally.check(name, passed);
        tally
    }

    /// One check more.
    pub(crate) fn check(&mut self, name: impl Into<String>, passed: bool) {
        if passed {
            self.passed += 1;
        } else {
            self.failed.push(name.into());
        }
    }

    /// One check that could not be made.
    pub(crate) fn skip(&mut self, name: &str, reason: &str) {
        self.skipped.push(format!("{name}: {reason}"));
    }

    /// Adds another tally to this one.
    pub(crate) fn add(&mut self, other: Self) {
        self.passed += other.passed;
        self.failed.extend(other.failed);
        self.skipped.extend(other.skipped);
    }

    /// Tests that skipped themselves told so in the skip log: they had passed for their runner.
    pub(crate) fn move_skipped(&mut self, log: &str) {
        for line in log.lines().filter(|line| !line.trim().is_empty()) {
            self.passed = self.passed.saturating_sub(1);
            self.skipped.push(line.trim().replace('\t', ": "));
        }
    }

    /// In continuous integration a skip is a failure.
    pub(crate) fn forbid_skips(&mut self) {
        let skipped = std::mem::take(&mut self.skipped);
        self.failed
            .extend(skipped.into_iter().map(|skip| format!("{skip} (skipped, which CI does not allow)")));
    }

    /// Reads the closing lines of `cargo test` and `cargo nextest`.
    ///
    /// `None` when there is none: the runner did not come to an end.
    pub(crate) fn of_test_run(output: &str) -> Option<Self> {
        let mut tally = Self::default();
        let mut closed = false;
        for whole in output.lines() {
            // Cargo's own lines begin at the margin: nextest indents what a failed test has printed.
            let line = whole.trim();
            if let Some(counts) = whole.strip_prefix("test result:") {
                closed = true;
                tally.passed += counted(counts, "passed");
                tally.skip_unnamed(counted(counts, "ignored"));
            } else if line.starts_with("Summary [") {
                closed = true;
                tally.passed += counted(line, "passed");
                tally.skip_unnamed(counted(line, "skipped"));
            } else if let Some(name) = failed_test(whole)
                && !tally.failed.iter().any(|known| known == name)
            {
                tally.failed.push(name.into());
            }
        }
        closed.then_some(tally)
    }

    fn skip_unnamed(&mut self, count: usize) {
        for _ in 0..count {
            self.skip("a test marked #[ignore]", "its runner passed over it");
        }
    }
}

/// The number before a word, as in `5 passed`.
fn counted(line: &str, word: &str) -> usize {
    let words: Vec<&str> = line.split([' ', ',', ';', '(', ')']).filter(|word| !word.is_empty()).collect();
    words.windows(2).filter(|pair| pair[1] == word).find_map(|pair| pair[0].parse().ok()).unwrap_or(0)
}

/// How nextest begins the line of a test that failed.
const STATUS: [&str; 7] =
    ["FAIL [", "TIMEOUT [", "SIGABRT [", "SIGSEGV [", "SIGBUS [", "SIGKILL [", "SIGTERM ["];

/// The name in a line that tells of a failed test: `test NAME ... FAILED`, or nextest's
/// `FAIL [   0.003s] (1/3) BINARY NAME` and the like.
fn failed_test(whole: &str) -> Option<&str> {
    if let Some(name) = whole.strip_prefix("test ").and_then(|rest| rest.strip_suffix("... FAILED")) {
        return Some(name.trim());
    }
    let line = whole.trim();
    let after = STATUS.iter().find_map(|status| line.strip_prefix(status))?;
    let rest = after.split_once(']')?.1.trim();
    let rest = rest.strip_prefix('(').and_then(|rest| rest.split_once(')')).map_or(rest, |(_, name)| name);
    Some(rest.trim()).filter(|name| !name.is_empty())
}

impl fmt::Display for Tally {
    /// The names, then the one line that sums up.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for skipped in &self.skipped {
            writeln!(f, "skipped: {skipped}")?;
        }
        for failed in &self.failed {
            writeln!(f, "failed: {failed}")?;
        }
        write!(f, "{} passed, {} failed, {} skipped", self.passed, self.failed.len(), self.skipped.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_closing_lines_of_cargo_test_are_summed() {
        let tally = Tally::of_test_run(
            "test a ... ok\ntest result: ok. 3 passed; 0 failed; 1 ignored; 0 measured; 0 filtered out; finished in 0.1s\n\
             test wire::b ... FAILED\n    wire::b\n\
             test result: FAILED. 4 passed; 1 failed; 0 ignored; 0 measured; 0 filtered out; finished in 0.1s\n",
        )
        .unwrap();
        assert_eq!((tally.passed, tally.skipped.len()), (7, 1));
        assert_eq!(tally.failed, ["wire::b"]);
    }

    #[test]
    fn the_closing_line_of_nextest_is_read_with_its_failures_once_each() {
        let tally = Tally::of_test_run(
            "        FAIL [   0.006s] (1/4) xtask tally::a\n\
             \x20   test tally::a ... FAILED\n    test result: FAILED. 0 passed; 1 failed; 5 ignored\n\
             ────────────\n     Summary [   0.007s] 4 tests run: 2 passed (1 slow), 1 failed, 1 timed out, 3 skipped\n\
             \x20       FAIL [   0.006s] (1/4) xtask tally::a\n     TIMEOUT [ 300.006s] (2/4) bus::pty b\n",
        )
        .unwrap();
        assert_eq!((tally.passed, tally.skipped.len()), (2, 3));
        assert_eq!(tally.failed, ["xtask tally::a", "bus::pty b"]);
    }

    #[test]
    fn a_run_without_a_closing_line_has_no_count() {
        assert_eq!(Tally::of_test_run("error: could not compile `bus`\n"), None);
    }

    #[test]
    fn tests_that_skip_themselves_are_not_counted_as_passed() {
        let mut tally = Tally { passed: 5, ..Tally::default() };
        tally.move_skipped("pyprofibus::class_2\tno Python with pyprofibus\n\n");
        assert_eq!(
            tally.to_string(),
            "skipped: pyprofibus::class_2: no Python with pyprofibus\n4 passed, 0 failed, 1 skipped"
        );
        tally.forbid_skips();
        assert!(tally.to_string().ends_with("4 passed, 1 failed, 0 skipped"));
    }
}
