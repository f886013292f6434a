//! Standard output and standard error, either of which may be closed.

use std::io::{self, ErrorKind, Write};
use std::sync::OnceLock;

use serde::Serialize;

/// Why some of what was printed has got nowhere, though somebody wanted it.
static LOST: OnceLock<io::Error> = OnceLock::new();

/// Prints a line at once. Nobody has to read it: a closed standard output is no error.
pub(crate) fn line(text: &str) {
    let _ = try_line(text);
}

/// The same; whether anybody can still read it, for commands that go on and on.
pub(crate) fn try_line(text: &str) -> bool {
    let mut out = io::stdout().lock();
    got_out(writeln!(out, "{text}").and_then(|()| out.flush()))
}

/// Prints a text as it is.
pub(crate) fn text(text: &str) {
    let mut out = io::stdout().lock();
    got_out(out.write_all(text.as_bytes()).and_then(|()| out.flush()));
}

/// Whether it did. Nobody misses what goes to a pipe or a terminal that is closed; a file that is not whole is
/// another matter.
pub(crate) fn got_out(written: io::Result<()>) -> bool {
    let Err(error) = written else { return true };
    if matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge) {
        let _ = LOST.set(error);
    }
    false
}

/// The sentence for an output that is not whole.
pub(crate) fn lost() -> Option<String> {
    LOST.get().map(|error| format!("standard output is not whole: {error}; make room, and do it again"))
}

/// Prints a line on standard error, which nobody has to read either.
pub(crate) fn aside(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

/// Prints a document, for people to read too.
pub(crate) fn json(document: &impl Serialize) {
    // What is printed are structures of text and numbers, which always can be.
    if let Ok(text) = serde_json::to_string_pretty(document) {
        line(&text);
    }
}

/// Prints a document in one line.
pub(crate) fn json_line(document: &impl Serialize) -> bool {
    serde_json::to_string(document).is_ok_and(|text| try_line(&text))
}
