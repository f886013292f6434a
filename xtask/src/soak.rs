//! `cargo xtask soak`: the long run of the crate `soak`, built for speed.

use crate::project::Project;

/// Runs it with these options of its own, to the end, however long that takes.
///
/// # Errors
///
/// When something that must hold does not; what, it has told.
pub(crate) fn run(project: &Project, options: &[String]) -> Result<(), String> {
    let mut soak = project.cargo(["run", "--quiet", "--release", "--package", "soak", "--"]);
    soak.args(options);
    match soak.status() {
        Ok(status) if status.success() => Ok(()),
        Ok(_) => Err("The soak has ended before its time.".to_owned()),
        Err(error) => Err(format!("cargo cannot be started: {error}")),
    }
}
