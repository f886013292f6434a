//! Standard output that may be closed.

use std::io::Write;

/// Prints a line at once. Nobody has to read it: a closed standard output is no error.
pub(crate) fn line(text: &str) {
    let mut out = std::io::stdout().lock();
    let _ = writeln!(out, "{text}").and_then(|()| out.flush());
}
