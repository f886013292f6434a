//! The bench page in a real browser: `crates/web/tests/browser`, and the pictures of the docs that it makes.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use crate::debian;
use crate::process::{Show, run};
use crate::project::{Project, has_program};
use crate::steps::Run;
use crate::tally::Tally;

/// Debian's packages, each with the program that it brings.
const PACKAGES: [&str; 3] = ["chromium", "nodejs", "npm"];
const PROGRAMS: [&str; 3] = ["chromium", "node", "npm"];

const TESTS: &str = "crates/web/tests/browser";
const LIMIT: Duration = Duration::from_mins(15);

/// Whether a browser, Node.js and the library between them are there, in the versions of the lock file.
pub(crate) fn is_there(project: &Project) -> bool {
    let locked = fs::read(project.root.join(TESTS).join("package-lock.json"));
    let installed = fs::read(folder(project).join("package-lock.json"));
    PROGRAMS.iter().all(|program| has_program(program))
        && locked.is_ok_and(|locked| installed.is_ok_and(|installed| installed == locked))
        && folder(project).join("node_modules/playwright-core").is_dir()
}

/// Installs them; what npm fetches goes below the target folder.
///
/// # Errors
///
/// A sentence, when something cannot be had.
pub(crate) fn install(project: &Project) -> Result<(), String> {
    for (package, program) in PACKAGES.iter().zip(PROGRAMS) {
        if !has_program(program) {
            debian::install(project, package)?;
        }
    }
    let folder = folder(project);
    let trouble = |error| format!("{} cannot be written: {error}.", folder.display());
    fs::create_dir_all(&folder).map_err(trouble)?;
    for name in ["package.json", "package-lock.json"] {
        fs::copy(project.root.join(TESTS).join(name), folder.join(name)).map_err(trouble)?;
    }
    println!("Installing what the browser tests need from npm.");
    let mut npm = project.command("npm", ["ci", "--no-audit", "--no-fund", "--ignore-scripts"]);
    run(npm.current_dir(&folder), Duration::from_mins(10), Show::Nothing)?
        .expect_success("npm ci (is the package registry of npm reachable?)")?;
    Ok(())
}

fn folder(project: &Project) -> PathBuf {
    project.target.join("browser")
}

/// Clicks through the page; screenshots go to `target/screenshots`.
///
/// # Errors
///
/// A sentence, when the program cannot be built or the runner does not come to an end.
pub(crate) fn test(run_of: &Run<'_>) -> Result<Tally, String> {
    let mut tally = Tally::default();
    if !run_of.tools.browser {
        tally.skip("browser", "no chromium, Node.js or playwright-core");
        return Ok(tally);
    }
    let project = run_of.project;
    build(project)?;
    let finished = run(&mut node(project, &["--test", "--test-reporter=tap"]), LIMIT, Show::Live)?;
    for (name, passed) in finished.stdout.lines().filter_map(result) {
        tally.check(name, passed);
    }
    if tally.passed == 0 || (!finished.success && tally.failed.is_empty()) {
        tally.check("browser (the runner did not come to an end)", false);
    }
    Ok(tally)
}

/// `cargo xtask pictures`: `docs/pictures` anew.
///
/// # Errors
///
/// A sentence, when a tool is missing or the page cannot be shown.
pub(crate) fn pictures(project: &Project) -> Result<(), String> {
    if !is_there(project) {
        return Err("There is no chromium, Node.js or playwright-core: cargo xtask setup".into());
    }
    build(project)?;
    run(&mut node(project, &["pictures.mjs"]), LIMIT, Show::Live)?.expect_success("pictures.mjs").map(drop)
}

fn build(project: &Project) -> Result<(), String> {
    run(&mut project.cargo(["build", "--quiet", "--package", "cli"]), LIMIT, Show::Live)?
        .expect_success("cargo build --package cli")
        .map(drop)
}

fn node(project: &Project, arguments: &[&str]) -> Command {
    let mut command = project.command("node", arguments);
    command
        .current_dir(project.root.join(TESTS))
        .env("SCH108BEX_PROGRAM", project.target.join("debug/sch108bex"))
        .env("SCH108BEX_BROWSER", folder(project))
        .env("SCH108BEX_CHROMIUM", "chromium")
        .env("SCH108BEX_SCREENSHOTS", project.target.join("screenshots"));
    command
}

/// A line of the Test Anything Protocol, `ok 3 - NAME`. Lines of whole files are none.
fn result(line: &str) -> Option<(&str, bool)> {
    let line = line.trim();
    let (rest, passed) = match line.strip_prefix("not ok ") {
        Some(rest) => (rest, false),
        None => (line.strip_prefix("ok ")?, true),
    };
    let (number, name) = rest.split_once(" - ")?;
    let is_file = Path::new(name).extension().is_some_and(|end| end == "mjs");
    let is_test = number.parse::<usize>().is_ok() && !is_file;
    is_test.then_some((name, passed))
}

#[cfg(test)]
mod tests {
    use super::result;

    #[test]
    fn results_are_read_and_files_are_not() {
        assert_eq!(result("ok 1 - a turned switch"), Some(("a turned switch", true)));
        assert_eq!(result("    not ok 12 - words - octets"), Some(("words - octets", false)));
        assert_eq!(result("ok 1 - /home/somebody/end_cap.test.mjs"), None);
        assert_eq!(result("# Subtest: ok 1 - nothing"), None);
    }
}
