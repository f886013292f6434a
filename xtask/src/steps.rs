//! `cargo xtask test` and `cargo xtask check`: a list of steps, each timed, counted and bounded.

use std::fs;
use std::process::Command;
use std::time::{Duration, Instant};

use crate::process::{Show, run};
use crate::project::{Project, has_program};
use crate::setup::{self, Tools};
use crate::tally::Tally;
use crate::{bench, book, browser, firmware, measure, no_panic, package, traceability};

/// One thing that a run does.
struct Step {
    name: &'static str,
    work: fn(&Run<'_>) -> Result<Tally, String>,
}

/// What a step may use.
pub(crate) struct Run<'a> {
    pub(crate) project: &'a Project,
    pub(crate) tools: Tools,
    /// All tests, or only those that need nothing but Rust.
    everything: bool,
}

/// What both lists begin with.
const DAILY: [Step; 4] = [
    Step { name: "fmt", work: fmt },
    Step { name: "clippy", work: clippy },
    Step { name: "tests", work: tests },
    Step { name: "traceability", work: traced },
];

const REST: [Step; 10] = [
    Step { name: "doc", work: doc },
    Step { name: "doc tests", work: doc_tests },
    Step { name: "no-panic", work: no_panic::prove },
    Step { name: "m4 image", work: m4_image },
    Step { name: "firmware", work: firmware::step },
    Step { name: "firmware logic", work: firmware::logic_tests },
    Step { name: "book", work: the_book },
    Step { name: "package", work: the_package },
    Step { name: "browser", work: browser::test },
    Step { name: "figures", work: bench::gate },
];

/// `cargo xtask check`.
///
/// # Errors
///
/// When anything failed.
pub(crate) fn check(project: &Project) -> Result<(), String> {
    let run = Run { project, tools: Tools::find(project), everything: false };
    report(project, all(&run, DAILY.iter()))
}

/// `cargo xtask test`: all steps, or the one of that name.
///
/// # Errors
///
/// When anything failed, or in continuous integration was skipped.
pub(crate) fn test(project: &Project, only: Option<&str>) -> Result<(), String> {
    let steps = || DAILY.iter().chain(&REST).filter(|step| only.is_none_or(|only| only == step.name));
    if steps().next().is_none() {
        let names: Vec<&str> = DAILY.iter().chain(&REST).map(|step| step.name).collect();
        return Err(format!("There is no such step. There are: {}.", names.join(", ")));
    }
    let started = Instant::now();
    println!("== setup");
    if let Err(text) = setup::setup(project, setup::may_install(project)) {
        println!("{text}\nWhat needs it is skipped.");
    }
    println!("== setup: {:.1} s\n", started.elapsed().as_secs_f64());
    let run = Run { project, tools: Tools::find(project), everything: true };
    report(project, all(&run, steps()))
}

fn all<'a>(run: &Run<'_>, steps: impl Iterator<Item = &'a Step>) -> Tally {
    let mut total = Tally::default();
    let mut times = Vec::new();
    for Step { name, work } in steps {
        println!("== {name}");
        let started = Instant::now();
        let tally = work(run).unwrap_or_else(|text| {
            println!("{text}");
            Tally::of_one(*name, false)
        });
        let verdict = if tally.failed.is_empty() { "fine" } else { "FAILED" };
        times.push(format!("{name} {:.0} s", started.elapsed().as_secs_f64()));
        println!("== {name}: {verdict}, {:.1} s\n", started.elapsed().as_secs_f64());
        total.add(tally);
    }
    println!("Times: {}.", times.join(", "));
    total
}

fn report(project: &Project, mut tally: Tally) -> Result<(), String> {
    if project.ci {
        tally.forbid_skips();
    }
    println!("{tally}");
    match tally.failed.len() {
        0 => Ok(()),
        1 => Err("One check failed.".into()),
        failed => Err(format!("{failed} checks failed.")),
    }
}

/// Runs commands one after the other, all of them one check.
pub(crate) fn one_check(name: &str, commands: impl IntoIterator<Item = Command>) -> Result<Tally, String> {
    let mut passed = true;
    for mut command in commands {
        passed &= run(&mut command, Duration::from_mins(15), Show::Live)?.success;
    }
    Ok(Tally::of_one(name, passed))
}

fn fmt(run: &Run<'_>) -> Result<Tally, String> {
    let apart = ["benches/m4", "benches/no-panic", "firmware", "fuzz"]
        .map(|package| format!("--manifest-path={package}/Cargo.toml"));
    let all = ["--all".to_string()].into_iter().chain(apart);
    one_check("fmt", all.map(|which| run.project.cargo(["fmt", which.as_str(), "--check"])))
}

fn clippy(run: &Run<'_>) -> Result<Tally, String> {
    const DENY: [&str; 3] = ["--", "-D", "warnings"];
    let mut workspace =
        run.project.cargo(["clippy", "--quiet", "--keep-going", "--workspace", "--all-targets"]);
    workspace.args(DENY);
    let mut commands = vec![workspace];
    if let Some(thumb) = &run.tools.thumb {
        for package in ["m4", "no-panic"] {
            let mut apart = thumb.cargo(run.project, "clippy", package);
            apart.arg("--quiet").args(DENY);
            commands.push(apart);
        }
        commands.extend(firmware::clippy(run.project, thumb).into_iter().map(|mut apart| {
            apart.arg("--quiet").args(DENY);
            apart
        }));
    }
    one_check("clippy", commands)
}

fn doc(run: &Run<'_>) -> Result<Tally, String> {
    let mut doc = run.project.cargo(["doc", "--quiet", "--workspace", "--no-deps"]);
    doc.env("RUSTDOCFLAGS", "-D warnings");
    one_check("doc", [doc])
}

/// The tests of all crates. Those that need a tool find it by an environment variable; without it
/// they write their name and the reason to the skip log.
fn tests(run: &Run<'_>) -> Result<Tally, String> {
    let project = run.project;
    let mut command = if has_program("cargo-nextest") {
        project.cargo(["nextest", "run", "--workspace", "--no-tests=pass", "--status-level=fail"])
    } else {
        project.cargo(["test", "--workspace", "--all-targets", "--no-fail-fast"])
    };
    for tool in ["PYTHON", "TSHARK", "QEMU", "FIRMWARE"] {
        command.env_remove(format!("SCH108BEX_{tool}"));
    }
    if run.everything
        && let Some(python) = &run.tools.python
    {
        command.env("SCH108BEX_PYTHON", python);
    }
    if run.everything && run.tools.tshark {
        command.env("SCH108BEX_TSHARK", "tshark");
    }
    if run.everything && run.tools.qemu && run.tools.lacks_for_firmware().is_none() {
        command.env("SCH108BEX_QEMU", "qemu-system-arm");
        command.env("SCH108BEX_FIRMWARE", firmware::shipped_image(project, &run.tools)?);
    }
    counted("tests", project, command)
}

fn doc_tests(run: &Run<'_>) -> Result<Tally, String> {
    counted(
        "doc tests",
        run.project,
        run.project.cargo(["test", "--quiet", "--workspace", "--doc", "--no-fail-fast"]),
    )
}

/// Runs a test runner and takes over what it counted.
pub(crate) fn counted(name: &str, project: &Project, mut command: Command) -> Result<Tally, String> {
    let log = project.target.join(format!("skipped-{}.log", std::process::id()));
    command.env("SCH108BEX_SKIP_LOG", &log);
    let finished = run(&mut command, Duration::from_mins(25), Show::Live)?;
    let mut tally = Tally::of_test_run(&finished.both).unwrap_or_default();
    tally.move_skipped(&fs::read_to_string(&log).unwrap_or_default());
    let _ = fs::remove_file(&log);
    if !finished.success && tally.failed.is_empty() {
        tally.check(format!("{name} (the runner did not come to an end)"), false);
    }
    Ok(tally)
}

fn traced(run: &Run<'_>) -> Result<Tally, String> {
    println!("{}", traceability::check(&run.project.root)?);
    Ok(Tally::of_one("traceability", true))
}

fn the_book(run: &Run<'_>) -> Result<Tally, String> {
    let Some(mdbook) = &run.tools.mdbook else {
        let mut tally = Tally::default();
        tally.skip("book", "no mdbook");
        return Ok(tally);
    };
    book::build(run.project, mdbook)?;
    Ok(Tally::of_one("book", true))
}

fn the_package(run: &Run<'_>) -> Result<Tally, String> {
    if !has_program("dpkg-deb") {
        let mut tally = Tally::default();
        tally.skip("package", "no dpkg-deb: Debian's packages are built on Debian");
        return Ok(tally);
    }
    package::prove(run.project)
}

fn m4_image(run: &Run<'_>) -> Result<Tally, String> {
    let Some(thumb) = &run.tools.thumb else {
        let mut tally = Tally::default();
        tally.skip("m4 image", "no core library for thumbv7em-none-eabihf");
        return Ok(tally);
    };
    one_check("m4 image", [measure::m4_build(run.project, thumb)])
}
