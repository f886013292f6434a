//! Standard output that may be closed.

use std::io::Write;

use serde::Serialize;

/// Prints a line at once. Nobody has to read it: a closed standard output is no error.
pub(crate) fn line(text: &str) {
    let _ = try_line(text);
}

/// The same; whether anybody can still read it, for commands that go on and on.
pub(crate) fn try_line(text: &str) -> bool {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{text}").and_then(|()| out.flush()).is_ok()
}

/// Prints a text as it is.
pub(crate) fn text(text: &str) {
    let mut out = std::io::stdout().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
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
