//! How a figure is measured: by valgrind, by the host's bench program, by the emulated Cortex-M4.

use std::cell::OnceCell;
use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use crate::firmware;
use crate::process::{Show, run};
use crate::project::Project;
use crate::setup::Tools;
use crate::thumb::{TARGET, Thumb};

/// How the reason begins when a tool is missing.
pub(crate) const ABSENT: &str = "no ";

const BUILD: Duration = Duration::from_mins(15);
const MEASURE: Duration = Duration::from_mins(2);

/// What a figure must keep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Limit {
    Unlimited,
    AtMost(f64),
    AtLeast(f64),
}

impl Limit {
    /// Whether a value keeps it.
    pub(crate) fn holds(self, value: f64) -> bool {
        match self {
            Self::Unlimited => true,
            Self::AtMost(limit) => value <= limit,
            Self::AtLeast(limit) => value >= limit,
        }
    }
}

/// Where a figure comes from.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Source {
    /// Instructions of a work of the host's bench program, by valgrind.
    Callgrind(&'static str),
    /// A number that a work of the host's bench program prints.
    Host(&'static str),
    /// The same, but a time: it depends on the machine and on what else runs there.
    Timed(&'static str),
    /// The same, of the program `sch108bex` as a whole.
    Program(&'static str),
    /// Printed by the image for the Cortex-M4.
    M4,
    /// What stands in the firmware's image.
    Image,
    /// Instructions of the firmware's image, counted while an emulator runs it.
    Firmware,
}

/// Measures figures, each given by its name, its source and its limit; in place of a value the
/// reason why there is none.
///
/// In continuous integration a time has seven attempts to stay within its limit.
///
/// # Errors
///
/// When the bench cannot be built.
pub(crate) fn measure(
    project: &Project,
    tools: &Tools,
    figures: &[(&str, Source, Limit)],
) -> Result<Vec<Result<f64, String>>, String> {
    let program = OnceCell::new();
    if figures.iter().any(|(_, source, _)| !matches!(source, Source::M4 | Source::Image | Source::Firmware)) {
        build(project, "sch108bex-bench")?;
    }
    let attempts = if project.ci { 7 } else { 1 };
    let m4 = OnceCell::new();
    let emulated = OnceCell::new();
    let value = |&(name, source, limit): &(&str, Source, Limit)| match source {
        Source::Callgrind(work) => callgrind(project, tools, work),
        Source::Host(work) => host(project, work),
        Source::Timed(work) => best(attempts, limit, || host(project, work)),
        Source::Program(work) => {
            let built = program.get_or_init(|| build(project, "cli"));
            built.clone().and_then(|()| best(attempts, limit, || host(project, work)))
        }
        Source::Image => firmware::figure(project, tools, name),
        Source::Firmware => {
            let output = emulated.get_or_init(|| firmware::counted(project, tools));
            output.as_ref().map_err(Clone::clone).and_then(|output| named(output, name))
        }
        Source::M4 => {
            let output = m4.get_or_init(|| m4_output(project, tools));
            output.as_ref().map_err(Clone::clone).and_then(|output| named(output, name))
        }
    };
    Ok(figures.iter().map(value).collect())
}

fn build(project: &Project, package: &str) -> Result<(), String> {
    println!("Building {package}.");
    let mut cargo = project.cargo(["build", "--release", "--quiet", "--package", package]);
    run(&mut cargo, BUILD, Show::Nothing)?.expect_success(&format!("Building {package}"))?;
    Ok(())
}

/// The first value within the limit, else the last.
fn best(attempts: u32, limit: Limit, measure: impl Fn() -> Result<f64, String>) -> Result<f64, String> {
    let mut last = measure();
    for _ in 1..attempts {
        if last.as_ref().is_ok_and(|value| limit.holds(*value)) {
            break;
        }
        last = measure();
    }
    last
}
/// The host's bench program with these arguments, or another program that runs it.
fn bench_program(project: &Project) -> PathBuf {
    project.target.join("release/sch108bex-bench")
}

fn host(project: &Project, work: &str) -> Result<f64, String> {
    let mut command = project.command(bench_program(project), [work]);
    let finished = run(&mut command, MEASURE, Show::Nothing)?;
    // What it says beside its number: the two sides of a ratio, and how they were spread.
    for line in finished.both.lines().filter(|line| line.trim() != finished.stdout.trim()) {
        println!("{line}");
    }
    number(&finished.expect_success(work)?)
}

/// Instructions of one round: the difference of two run lengths, so that the start-up cancels.
fn callgrind(project: &Project, tools: &Tools, work: &str) -> Result<f64, String> {
    const FEW: u32 = 1_000;
    const MANY: u32 = 5_000;
    if !tools.valgrind {
        return Err(format!("{ABSENT}valgrind"));
    }
    let total = |rounds: u32| {
        let mut command = project.command("valgrind", ["--tool=callgrind", "--callgrind-out-file=/dev/null"]);
        command.arg(bench_program(project)).args([work, &rounds.to_string()]);
        let finished = run(&mut command, MEASURE, Show::Nothing)?;
        let said = finished.both.clone();
        finished.expect_success(&format!("valgrind on {work}"))?;
        let collected = said.lines().find_map(|line| line.split_once("Collected :"));
        number(collected.map_or("", |(_, count)| count))
    };
    match (total(MANY)? - total(FEW)?) / f64::from(MANY - FEW) {
        none if none < 1.0 => Err(format!("{work} does no work")),
        instructions => Ok(instructions),
    }
}

/// `cargo build` of the image for the Cortex-M4.
pub(crate) fn m4_build(project: &Project, thumb: &Thumb) -> Command {
    let mut cargo = thumb.cargo(project, "build", "m4");
    cargo.arg("--quiet");
    cargo
}

/// Builds the image, runs it, and returns what it printed.
fn m4_output(project: &Project, tools: &Tools) -> Result<String, String> {
    /// One `movw`, and 1000 times `subs` and `bne`.
    const KNOWN_LOOP: f64 = 2001.0;
    /// What the compiler may put between two readings of the timer.
    const BETWEEN: f64 = 3.0;
    let thumb = tools.thumb.as_ref().ok_or_else(|| format!("{ABSENT}core library for {TARGET}"))?;
    if !tools.qemu {
        return Err(format!("{ABSENT}qemu-system-arm"));
    }
    run(&mut m4_build(project, thumb), BUILD, Show::Nothing)?.expect_success("Building benches/m4")?;
    // The emulator does not always end when asked to: `timeout -k` makes it.
    let words = ["-k", "2", "60", "qemu-system-arm", "-machine", "netduinoplus2", "-icount", "shift=0"];
    let mut qemu = project.command("timeout", words);
    qemu.args(["-nographic", "-monitor", "none", "-serial", "none"]);
    qemu.args(["-semihosting-config", "enable=on,target=native", "-kernel"]);
    qemu.arg(project.target.join("m4").join(TARGET).join("release/m4"));
    let finished = run(&mut qemu, MEASURE, Show::Nothing)?;
    let output = finished.both.clone();
    finished.expect_success("The image under qemu-system-arm")?;
    let known = named(&output, "known_loop_instructions")?;
    if (known - KNOWN_LOOP).abs() > BETWEEN {
        return Err(format!("the emulator counts {known} instructions where there are {KNOWN_LOOP}"));
    }
    Ok(output)
}

/// The number in the line `NAME NUMBER`.
fn named(output: &str, name: &str) -> Result<f64, String> {
    let found = output.lines().find_map(|line| line.trim().strip_prefix(name)?.strip_prefix(' '));
    found.map_or_else(|| Err(format!("the image did not print {name}")), number)
}

fn number(text: &str) -> Result<f64, String> {
    text.trim().parse().map_err(|_| format!("not a number: {:?}", text.trim()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_is_taken_until_it_is_within_its_limit() {
        let taken = std::cell::Cell::new(0.0);
        let slower = || {
            taken.set(taken.get() + 1.0);
            Ok(3.0 - taken.get())
        };
        assert_eq!(best(3, Limit::AtMost(1.5), slower), Ok(1.0));
        assert!(best(2, Limit::AtMost(-9.0), slower).is_ok_and(|value| value < 0.0));
    }

    #[test]
    fn a_named_number_is_found_by_its_whole_name() {
        let output = "m4_octet_instructions_long 1\nm4_octet_instructions 39\n";
        assert_eq!(named(output, "m4_octet_instructions"), Ok(39.0));
        assert!(named(output, "m4_octet").is_err());
    }
}
