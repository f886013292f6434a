//! Rust's core library for Cortex-M4: rustup's, or built from Debian's source of the same release.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;
use std::{env, process};

use crate::debian::Apt;
use crate::process::{Show, run};
use crate::project::{Project, has_program};

/// A Cortex-M4 or M7 with floating point unit.
pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// Where Debian may have the source of a release, likeliest first.
const SUITES: [&str; 5] = ["trixie-backports", "forky", "sid", "trixie", "experimental"];

/// How to compile for [`TARGET`].
#[derive(Debug, Clone)]
pub(crate) struct Thumb {
    /// `None`: the toolchain has the target.
    sysroot: Option<PathBuf>,
}

impl Thumb {
    /// The target in the toolchain, or in the folder that an earlier [`install`] has filled.
    pub(crate) fn find(project: &Project) -> Option<Self> {
        let compiler = Compiler::ask(project).ok()?;
        if has_core(&compiler.sysroot) {
            return Some(Self { sysroot: None });
        }
        Some(compiler.private_sysroot()).filter(|own| has_core(own)).map(|own| Self { sysroot: Some(own) })
    }

    /// `cargo` for a package of its own that is built for the target into a folder of its own.
    pub(crate) fn cargo(&self, project: &Project, command: &str, package: &str) -> Command {
        self.cargo_at(project, command, &format!("benches/{package}/Cargo.toml"), package)
    }

    /// The same for a manifest anywhere, into that folder below `target`.
    pub(crate) fn cargo_at(&self, project: &Project, command: &str, manifest: &str, folder: &str) -> Command {
        let mut cargo =
            project.cargo([command, "--release", "--target", TARGET, "--manifest-path", manifest]);
        cargo.arg("--target-dir").arg(project.target.join(folder));
        if let Some(sysroot) = &self.sysroot {
            cargo.env(
                "CARGO_TARGET_THUMBV7EM_NONE_EABIHF_RUSTFLAGS",
                format!("--sysroot={}", sysroot.display()),
            );
        }
        cargo
    }
}

fn has_core(sysroot: &Path) -> bool {
    let folder = sysroot.join("lib/rustlib").join(TARGET).join("lib");
    let files = fs::read_dir(folder).into_iter().flatten().flatten();
    files.into_iter().any(|file| file.file_name().to_string_lossy().starts_with("libcore-"))
}

/// The compiler in use.
#[derive(Debug)]
pub(crate) struct Compiler {
    /// Where it is installed.
    pub(crate) sysroot: PathBuf,
    /// As in `1.95.0`.
    release: String,
    commit: String,
    /// As in `x86_64-unknown-linux-gnu`.
    pub(crate) host: String,
}

impl Compiler {
    /// Asks the compiler for its names and places.
    pub(crate) fn ask(project: &Project) -> Result<Self, String> {
        let ask = |words: &[&str]| {
            let rustc = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
            let mut command = project.command(rustc, words);
            run(&mut command, Duration::from_secs(30), Show::Nothing)?.expect_success("rustc")
        };
        let version = ask(&["-vV"])?;
        let field = |name: &str| {
            let value = version.lines().find_map(|line| line.strip_prefix(name));
            value.map_or_else(String::new, |value| value.trim().into())
        };
        Ok(Self {
            sysroot: ask(&["--print", "sysroot"])?.trim().into(),
            release: field("release:"),
            commit: field("commit-hash:").chars().take(10).collect(),
            host: field("host:"),
        })
    }

    /// One folder for each compiler, kept from project to project.
    fn cache(&self) -> PathBuf {
        let home = || env::var_os("HOME").map(|home| PathBuf::from(home).join(".cache"));
        let cache = env::var_os("XDG_CACHE_HOME").map(PathBuf::from).or_else(home);
        let name = format!("{}-{}", self.release, self.commit);
        cache.unwrap_or_else(env::temp_dir).join("sch108bex-setup").join(name)
    }

    fn private_sysroot(&self) -> PathBuf {
        self.cache().join("sysroot")
    }
}

/// Adds the target by rustup, else builds it.
///
/// # Errors
///
/// A sentence, when neither works.
pub(crate) fn install(project: &Project) -> Result<(), String> {
    let compiler = Compiler::ask(project)?;
    if has_program("rustup") {
        println!("Asking rustup for {TARGET}.");
        let mut rustup = project.command("rustup", ["target", "add", TARGET]);
        let asked = run(&mut rustup, Duration::from_mins(3), Show::Nothing);
        if asked.is_ok_and(|finished| finished.success) && has_core(&compiler.sysroot) {
            return Ok(());
        }
    }
    let work = compiler.cache().join(format!("work-{}", process::id()));
    let built = fresh_folder(&work)
        .and_then(|()| find_library(project, &compiler, &work))
        .and_then(|library| build(project, &compiler, &library, &work));
    let _ = fs::remove_dir_all(&work);
    built.map_err(|error| {
        format!(
            "{TARGET} is not to be had: run `rustup target add {TARGET}`, or on Debian mend this: {error}"
        )
    })
}

fn fresh_folder(folder: &Path) -> Result<(), String> {
    let _ = fs::remove_dir_all(folder);
    fs::create_dir_all(folder).map_err(|error| format!("{} cannot be made: {error}.", folder.display()))
}

/// The source of the standard library: the toolchain's, else that of Debian's package.
fn find_library(project: &Project, compiler: &Compiler, work: &Path) -> Result<PathBuf, String> {
    let own = compiler.sysroot.join("lib/rustlib/src/rust/library");
    if own.join("core/Cargo.toml").exists() {
        return Ok(own);
    }
    let begin = format!("{}+", compiler.release);
    let found = SUITES.iter().find_map(|suite| {
        let apt = Apt::private(project, &[suite]).ok()?;
        let version = apt.version(project, "rust-src", &begin)?;
        Some((apt, version))
    });
    let (apt, version) = found.ok_or_else(|| {
        format!("Debian has no source package rust-src {begin}... (asked: {}).", SUITES.join(", "))
    })?;
    println!("Fetching Debian's rust-src {version}.");
    let package = apt.download(project, &format!("rust-src={version}"), work)?;
    let unpack = "dpkg-deb --fsys-tarfile \"$1\" | \
                  tar x -C \"$2\" --strip-components=4 --wildcards './usr/src/rustc-*/library'";
    let mut shell = project.command("sh", ["-c", unpack, "sh"]);
    run(shell.arg(&package).arg(work), Duration::from_mins(5), Show::Nothing)?
        .expect_success("Unpacking rust-src")?;
    Ok(work.join("library"))
}

/// Compiles core, alloc and compiler_builtins into the private sysroot.
fn build(project: &Project, compiler: &Compiler, library: &Path, work: &Path) -> Result<(), String> {
    println!("Building Rust's core library for {TARGET}.");
    let seed = work.join("seed");
    fresh_folder(&seed.join("src"))?;
    let write = |name: &str, text: &str| {
        fs::write(seed.join(name), text).map_err(|error| format!("{name}: {error}."))
    };
    write("src/lib.rs", "#![no_std]\n")?;
    write(
        "Cargo.toml",
        "[package]\nname = \"seed\"\nversion = \"0.0.0\"\nedition = \"2024\"\n[workspace]\n\
         [profile.release]\nopt-level = 3\ncodegen-units = 1\ndebug = \"line-tables-only\"\n",
    )?;
    let mut cargo = project.cargo(["build", "--quiet", "--release", "--target", TARGET]);
    // Bitcode, so that the libraries serve fat LTO too, as rustup's own do.
    let remap = format!("--remap-path-prefix={}=/rustc/{}/library", library.display(), compiler.release);
    let mut flags = OsString::from("-Cembed-bitcode=yes\u{1f}");
    flags.push(remap);
    cargo
        .args(["-Zbuild-std=core,alloc", "-Zbuild-std-features=compiler-builtins-mem", "--target-dir"])
        .arg(seed.join("target"))
        .current_dir(&seed)
        .env("RUSTC_BOOTSTRAP", "1")
        .env("__CARGO_TESTS_ONLY_SRC_ROOT", library)
        .env("CARGO_ENCODED_RUSTFLAGS", flags);
    let vendor = library.join("vendor");
    if vendor.exists() {
        cargo.args(["--config", "source.crates-io.replace-with=\"vendored\"", "--config"]);
        cargo.arg(format!("source.vendored.directory=\"{}\"", vendor.display()));
    }
    run(&mut cargo, Duration::from_mins(15), Show::Nothing)?.expect_success("Building core")?;
    assemble(compiler, &seed.join("target").join(TARGET).join("release/deps"), work)
}

/// Lays the libraries out as a sysroot, with the host's tools borrowed, and moves it into place.
fn assemble(compiler: &Compiler, built: &Path, work: &Path) -> Result<(), String> {
    let trouble = |error| format!("The private sysroot cannot be written: {error}.");
    let fresh = work.join("sysroot");
    let libraries = fresh.join("lib/rustlib").join(TARGET).join("lib");
    fs::create_dir_all(&libraries).map_err(trouble)?;
    for file in fs::read_dir(built).map_err(trouble)?.flatten() {
        let name = file.file_name();
        let text = name.to_string_lossy();
        let wanted =
            ["libcore-", "liballoc-", "libcompiler_builtins-"].iter().any(|begin| text.starts_with(begin));
        if wanted && text.ends_with(".rlib") {
            fs::copy(file.path(), libraries.join(&name)).map_err(trouble)?;
        }
    }
    let host = Path::new("lib/rustlib").join(&compiler.host);
    std::os::unix::fs::symlink(compiler.sysroot.join(&host), fresh.join(&host)).map_err(trouble)?;
    let place = compiler.private_sysroot();
    let _ = fs::remove_dir_all(&place);
    fs::rename(&fresh, &place).map_err(trouble)
}
