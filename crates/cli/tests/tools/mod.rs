//! Tools that a test needs and a computer may not have, each named by a variable of the environment.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::PathBuf;

/// The tool that `variable` names. Without one the test says so, in the log of skipped tests too.
fn named(variable: &str, what: &str, test: &str) -> Option<PathBuf> {
    if let Some(tool) = std::env::var_os(variable) {
        return Some(tool.into());
    }
    skipped(test, &format!("{variable} does not name {what}"));
    None
}

/// Says so, in the log of skipped tests too.
fn skipped(test: &str, reason: &str) {
    eprintln!("SKIPPED {test}: {reason}");
    if let Some(log) = std::env::var_os("SCH108BEX_SKIP_LOG") {
        let log = OpenOptions::new().create(true).append(true).open(log);
        writeln!(log.expect("the log of skipped tests"), "{test}\t{reason}")
            .expect("the log of skipped tests");
    }
}

/// A Python that has pyprofibus.
#[allow(dead_code, reason = "not every binary of tests runs Python")]
pub(crate) fn python(test: &str) -> Option<PathBuf> {
    named("SCH108BEX_PYTHON", "a Python that has pyprofibus", test)
}

/// A Python that has schemathesis.
#[allow(dead_code, reason = "not every binary of tests looks at HTTP")]
pub(crate) fn schemathesis(test: &str) -> Option<PathBuf> {
    let python = named("SCH108BEX_PYTHON", "a Python that has schemathesis", test)?;
    let mut probe = std::process::Command::new(&python);
    let probed = probe.args(["-c", "import schemathesis"]).stderr(std::process::Stdio::null()).status();
    if probed.is_ok_and(|status| status.success()) {
        return Some(python);
    }
    skipped(test, "the Python that SCH108BEX_PYTHON names has no schemathesis");
    None
}

/// A tshark.
#[allow(dead_code, reason = "not every binary of tests looks at captures")]
pub(crate) fn tshark(test: &str) -> Option<PathBuf> {
    named("SCH108BEX_TSHARK", "a tshark", test)
}

/// The emulator, and the firmware's image that it runs.
#[allow(dead_code, reason = "not every binary of tests runs the firmware")]
pub(crate) fn firmware(test: &str) -> Option<[PathBuf; 2]> {
    let emulator = named("SCH108BEX_QEMU", "a QEMU for ARM", test)?;
    Some([emulator, named("SCH108BEX_FIRMWARE", "the firmware's image", test)?])
}
