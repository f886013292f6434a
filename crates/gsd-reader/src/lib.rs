//! Reading a GSD file that may be anything: Latin-1 as most are, broken, or made to do harm.
//!
//! Everybody who takes a GSD from a user takes it through this.

#![forbid(unsafe_code)]

use std::cell::Cell;
use std::io::Read;
use std::path::Path;
use std::sync::Once;

use gsd_parser::GenericStationDescription;

/// The longest file that is read: more than ten times the longest GSD that is likely.
pub const MOST_OCTETS: u64 = 4 * 1024 * 1024;

/// As much of a parser's message as a person will read.
const MOST_LINES: usize = 10;
const MOST_OF_A_LINE: usize = 120;

/// Why a file cannot be read as a GSD.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// It is not there, or may not be read.
    #[error("cannot be read: {0}; write the path of a GSD file that you may read")]
    Io(#[from] std::io::Error),
    /// A directory, a pipe, a device.
    #[error("is no file; write the path of a GSD file")]
    NoFile,
    /// Longer than [`MOST_OCTETS`].
    #[error("has more than {MOST_OCTETS} octets; a GSD file has some thousand. Is it the right file?")]
    TooLong,
    /// Not in the form of a GSD file; the parser's words.
    #[error(
        "is no GSD file that can be read; is it the right one, and whole? The first that does not fit:\n{0}"
    )]
    Syntax(String),
    /// Refers to what is not in it, or a value is of the wrong kind.
    #[error("is broken: it refers to something that is not in it, or a value is of the wrong kind")]
    Broken,
}

/// A GSD file as text. Most are in Latin-1, as they were made on Windows; UTF-8 is recognised.
///
/// # Errors
///
/// [`ReadError`] of the first three kinds.
pub fn read_text(path: &Path) -> Result<String, ReadError> {
    // Not opened before this: a pipe would not return.
    if !std::fs::metadata(path)?.is_file() {
        return Err(ReadError::NoFile);
    }
    let mut octets = Vec::new();
    std::fs::File::open(path)?.take(MOST_OCTETS + 1).read_to_end(&mut octets)?;
    if octets.len() as u64 > MOST_OCTETS {
        return Err(ReadError::TooLong);
    }
    let octets = octets.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(&octets);
    Ok(match std::str::from_utf8(octets) {
        Ok(text) => text.to_owned(),
        Err(_) => octets.iter().map(|&octet| char::from(octet)).collect(),
    })
}

/// Reads the text of a GSD; `path` is for messages.
///
/// Slot definitions are left out: nothing here needs them, and in a hostile file they take for ever.
///
/// # Errors
///
/// [`ReadError::Syntax`] or [`ReadError::Broken`]
pub fn read(path: &Path, text: &str) -> Result<GenericStationDescription, ReadError> {
    let source = without_slots(text);
    // The parser gives up by a panic on some broken files.
    let parsed = quietly(|| std::panic::catch_unwind(|| gsd_parser::parser::parse(path, &source)));
    match parsed {
        Ok(Ok(gsd)) => Ok(gsd),
        Ok(Err(error)) => Err(ReadError::Syntax(printable(&error.to_string()))),
        Err(_) => Err(ReadError::Broken),
    }
}

fn without_slots(text: &str) -> String {
    let mut inside = false;
    let mut kept = String::with_capacity(text.len());
    for line in text.split_inclusive('\n') {
        let word = line.trim().to_ascii_lowercase();
        inside |= word.starts_with("slotdefinition");
        // Blank lines in their place, so that line numbers in messages hold.
        let line = if inside { "\n" } else { line };
        // Names are shown, too: no control characters on somebody's terminal.
        kept.extend(line.chars().map(|c| if c.is_control() && !"\r\n\t".contains(c) { ' ' } else { c }));
        inside &= !word.starts_with("endslotdefinition");
    }
    kept
}

/// What of a message can be shown on a terminal, and will be read.
fn printable(message: &str) -> String {
    let lines = message.lines().take(MOST_LINES).map(|line| {
        let shown = |c: &char| !c.is_control();
        let mut short: String = line.chars().filter(shown).take(MOST_OF_A_LINE).collect();
        if line.chars().filter(shown).count() > MOST_OF_A_LINE {
            short.push_str(" ...");
        }
        short
    });
    lines.collect::<Vec<_>>().join("\n")
}

thread_local! {
    static QUIET: Cell<bool> = const { Cell::new(false) };
}

/// Runs `work` without a word on standard error if it panics. Other threads keep theirs.
fn quietly<T>(work: impl FnOnce() -> T) -> T {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |information| {
            if !QUIET.get() {
                before(information);
            }
        }));
    });
    QUIET.set(true);
    let done = work();
    QUIET.set(false);
    done
}

#[cfg(test)]
mod tests {
    use std::fmt::Write;

    use super::*;

    const SMALL: &str = "#Profibus_DP\nGSD_Revision = 2\nVendor_Name = \"V\"\nIdent_Number = 0x4711\n";

    fn written(octets: &[u8]) -> (tempfile::TempDir, std::path::PathBuf) {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("file.gsd");
        std::fs::write(&path, octets).expect("writes");
        (directory, path)
    }

    #[test]
    fn latin_1_is_read_as_it_was_meant() {
        let text = SMALL.replace("\"V\"", "\"K\u{fc}bler\"");
        let latin_1: Vec<u8> = text.chars().map(|c| u8::try_from(u32::from(c)).expect("Latin-1")).collect();
        let with_mark = [b"\xEF\xBB\xBF", text.as_bytes()].concat();
        for octets in [latin_1.as_slice(), text.as_bytes(), &with_mark] {
            let (_directory, path) = written(octets);
            let read = read(&path, &read_text(&path).expect("reads")).expect("a GSD");
            assert_eq!(read.vendor, "K\u{fc}bler");
        }
    }

    #[test]
    fn what_is_no_file_or_too_long_is_refused_unread() {
        let directory = tempfile::tempdir().expect("a directory");
        assert!(matches!(read_text(directory.path()), Err(ReadError::NoFile)));
        assert!(matches!(read_text(Path::new("/dev/zero")), Err(ReadError::NoFile)));
        assert!(matches!(read_text(&directory.path().join("none")), Err(ReadError::Io(_))));
        let (_directory, path) = written(&vec![b' '; usize::try_from(MOST_OCTETS).expect("fits") + 1]);
        assert!(matches!(read_text(&path), Err(ReadError::TooLong)));
    }

    #[test]
    fn binary_files_are_refused_with_a_message_that_can_be_shown() {
        let noise: Vec<u8> =
            (0..100_000_u32).map(|i| i.wrapping_mul(2_654_435_761).to_le_bytes()[2]).collect();
        for octets in [&noise[..], &[0; 5000], b"", b"\x7FELF\x1b[31m", b"#Profibus_DP\n\x1b]0;x\x07\n"] {
            let (_directory, path) = written(octets);
            let error = read(&path, &read_text(&path).expect("reads")).expect_err("no GSD").to_string();
            assert!(error.starts_with("is no GSD file"), "{error}");
            assert!(error.chars().all(|c| c == '\n' || !c.is_control()) && error.len() < 5_000, "{error}");
            assert!(error.lines().all(|line| line.chars().count() < 130), "{error}");
        }
    }

    // Found by the fuzz target `gsd`: names are shown in notes and refusals.
    #[test]
    fn names_hold_no_commands_for_a_terminal() {
        let text = format!("{SMALL}Module = \"\u{1b}[2J\u{9b}\" 0xD1\nEndModule\n");
        let gsd = read(Path::new("a.gsd"), &text).expect("a GSD");
        assert_eq!(gsd.available_modules[0].name, " [2J ");
    }

    // A slot refers to modules by ranges; each number of each range is looked for among all modules.
    #[test]
    fn a_million_slots_take_no_time() {
        let mut text = SMALL.to_owned();
        for number in 0..2_000 {
            let _ = write!(text, "Module = \"M{number}\" 0x10\n{number}\nEndModule\n");
        }
        text.push_str("SlotDefinition\n");
        for _ in 0..20_000 {
            text.push_str("Slot(1) = \"S\" 1 0-65535\n");
        }
        text.push_str("EndSlotDefinition\nFail_Safe = 1\n");
        let start = std::time::Instant::now();
        let gsd = read(Path::new("slots.gsd"), &text).expect("a GSD");
        assert!(gsd.fail_safe && gsd.available_modules.len() == 2_000);
        assert!(start.elapsed().as_secs() < 30, "{:?}", start.elapsed());
    }

    #[test]
    fn what_the_parser_panics_at_is_broken() {
        let module = "Module = \"A\" 0xF1\nExt_User_Prm_Data_Ref(0) = 9\nEndModule\n";
        let error = read(Path::new("a.gsd"), &format!("{SMALL}{module}")).expect_err("no parameter 9");
        assert!(matches!(error, ReadError::Broken), "{error}");
    }
}
