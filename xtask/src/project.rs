//! Where the project's things are, and the commands that work on them.

use std::env;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The work tree, its target folder, and whether this is a run of continuous integration.
#[derive(Debug, Clone)]
pub(crate) struct Project {
    /// The folder with the workspace's `Cargo.toml`.
    pub(crate) root: PathBuf,
    /// Where everything that is built goes.
    pub(crate) target: PathBuf,
    /// `CI=true`: a skip is a failure, and timings are judged.
    pub(crate) ci: bool,
}

impl Project {
    /// The project that this task runner belongs to.
    pub(crate) fn find() -> Result<Self, String> {
        let manifest = env::var("CARGO_MANIFEST_DIR")
            .map_err(|_| "Run this as `cargo xtask`: cargo says where the project is.")?;
        let root = Path::new(&manifest).parent().ok_or("xtask has no parent folder.")?;
        let target =
            env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), |given| root.join(given));
        Ok(Self { root: root.into(), target, ci: env::var("CI").is_ok_and(|ci| ci == "true") })
    }

    /// `cargo` with these arguments, at the root.
    pub(crate) fn cargo<S: AsRef<OsStr>>(&self, arguments: impl IntoIterator<Item = S>) -> Command {
        let mut command = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
        command.args(arguments).current_dir(&self.root);
        command
    }

    /// A program or script of the shell's search path, at the root.
    pub(crate) fn command<S: AsRef<OsStr>>(
        &self,
        program: impl AsRef<OsStr>,
        arguments: impl IntoIterator<Item = S>,
    ) -> Command {
        let mut command = Command::new(program);
        command.args(arguments).current_dir(&self.root);
        command
    }
}

/// Whether the shell's search path has a program of that name.
pub(crate) fn has_program(name: &str) -> bool {
    env::var_os("PATH").is_some_and(|path| env::split_paths(&path).any(|folder| folder.join(name).is_file()))
}
