//! The proof that the core cannot panic: `benches/no-panic` links without its panic handler.
//!
//! The handler calls a function that exists nowhere. Sections that nothing reaches are collected
//! by the linker; so the link succeeds only if no call of the device's public functions, whatever
//! it is given, can end in the handler.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use crate::process::{Show, run};
use crate::project::Project;
use crate::steps::Run;
use crate::tally::Tally;
use crate::thumb::{Compiler, TARGET, Thumb};

/// What the panic handler calls.
const NOWHERE: &str = "a_panic_can_be_reached";
const ON_M4: &str = "no-panic: the core on a Cortex-M4";
const LIMIT: Duration = Duration::from_mins(10);

/// The core without a panic, on the host and on a Cortex-M4, and the core with one, which must show.
pub(crate) fn prove(run: &Run<'_>) -> Result<Tally, String> {
    let project = run.project;
    let mut tally = Tally::default();
    let host = link_host(project, false)?;
    report(&mut tally, "no-panic: the core on the host", host.is_none(), host.as_deref());
    let bad = link_host(project, true)?;
    let seen = bad.as_ref().is_some_and(|reason| reason.contains(NOWHERE));
    report(&mut tally, "no-panic: a panic put in on purpose is detected", seen, bad.as_deref());
    if let Some(thumb) = &run.tools.thumb {
        let m4 = link_thumb(project, thumb)?;
        report(&mut tally, ON_M4, m4.is_none(), m4.as_deref());
    } else {
        tally.skip(ON_M4, "no core library for thumbv7em-none-eabihf");
    }
    Ok(tally)
}

fn report(tally: &mut Tally, name: &str, passed: bool, reason: Option<&str>) {
    println!("{name}: {}", if passed { "passed" } else { "FAILED" });
    if !passed {
        println!("{}", reason.unwrap_or("The link succeeded, but should not have."));
    }
    tally.check(name, passed);
}

/// Builds and links for the host; the reason when a panic can be reached.
fn link_host(project: &Project, with_panic: bool) -> Result<Option<String>, String> {
    let name = if with_panic { "no-panic-bad" } else { "no-panic" };
    let folder = project.target.join(name);
    let mut cargo =
        project.cargo(["build", "--release", "--quiet", "--manifest-path=benches/no-panic/Cargo.toml"]);
    cargo.arg("--target-dir").arg(&folder);
    if with_panic {
        cargo.args(["--features", "panic-on-purpose"]);
    }
    run(&mut cargo, LIMIT, Show::Nothing)?.expect_success("Building benches/no-panic")?;
    let image = folder.join("no-panic.elf");
    let link = |extra: &[&str]| {
        // The C library gives memcpy and its like, and nothing else.
        let words = ["-nostartfiles", "-nostdlib", "-Wl,--gc-sections", "-Wl,-e,entry", "-Wl,-u,entry"];
        let mut link = project.command("cc", words);
        link.args(extra).arg("-o").arg(&image).arg(folder.join("release/libno_panic.a")).arg("-lc");
        link
    };
    let Some(reason) = judge(project, link(&[]), &image)? else { return Ok(None) };
    // Once more with the symbol, to see who panics.
    run(&mut link(&[&format!("-Wl,--defsym={NOWHERE}=0")]), LIMIT, Show::Nothing)?;
    Ok(Some(format!("{reason}{}", callers(project, &image)?)))
}

/// Which functions of an image call something whose name tells of a panic.
fn callers(project: &Project, image: &Path) -> Result<String, String> {
    let mut objdump = project.command("objdump", ["-dC", "--no-show-raw-insn"]);
    let listing = run(objdump.arg(image), LIMIT, Show::Nothing)?.expect_success("objdump")?;
    let mut function = "";
    let mut found = BTreeSet::new();
    for line in listing.lines() {
        if let Some((_, name)) = line.strip_suffix(">:").and_then(|line| line.split_once('<')) {
            function = name;
        } else if line.contains("panic") && !function.is_empty() && !function.contains("panic") {
            found.insert(function);
        }
    }
    Ok(found.into_iter().fold(String::new(), |text, name| format!("{text}A panic is called by {name}.\n")))
}

/// Builds and links for the Cortex-M4, where nothing at all comes from elsewhere.
fn link_thumb(project: &Project, thumb: &Thumb) -> Result<Option<String>, String> {
    run(thumb.cargo(project, "build", "no-panic").arg("--quiet"), LIMIT, Show::Nothing)?
        .expect_success("Building benches/no-panic for the Cortex-M4")?;
    let compiler = Compiler::ask(project)?;
    let linker = compiler.sysroot.join("lib/rustlib").join(&compiler.host).join("bin/rust-lld");
    let folder = project.target.join("no-panic").join(TARGET);
    let image = folder.join("no-panic.elf");
    let mut link =
        project.command(linker, ["-flavor", "gnu", "--gc-sections", "-e", "entry", "-u", "entry", "-o"]);
    link.arg(&image).arg(folder.join("release/libno_panic.a"));
    judge(project, link, &image)
}

/// Links, and looks for what a panic would leave behind; `None`: nothing.
fn judge(project: &Project, mut link: Command, image: &Path) -> Result<Option<String>, String> {
    let linked = run(&mut link, LIMIT, Show::Nothing)?;
    if !linked.success {
        return Ok(Some(linked.both));
    }
    let names = symbols(project, image)?;
    if !names.lines().any(|line| line.ends_with(" entry")) {
        return Err(format!("{} has no entry: the proof proves nothing.", image.display()));
    }
    let left: Vec<&str> = names.lines().filter(|line| line.to_lowercase().contains("panic")).collect();
    Ok((!left.is_empty()).then(|| format!("Symbols of a panic in the image:\n{}", left.join("\n"))))
}

fn symbols(project: &Project, image: &Path) -> Result<String, String> {
    let image: PathBuf = image.into();
    run(project.command("nm", ["-C"]).arg(image), LIMIT, Show::Nothing)?.expect_success("nm")
}
