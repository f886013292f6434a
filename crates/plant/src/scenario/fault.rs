//! What is wrong with a scenario file, where, and what to write instead.

use std::fmt::Write as _;
use std::ops::Range;

/// One thing that is wrong.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// Which octets of the file; `None`: the file as a whole.
    pub span: Option<Range<usize>>,
    /// What is wrong.
    pub message: String,
    /// What to write instead.
    pub hint: String,
}

/// Everything that is wrong with a file, in the order of its lines; at least one thing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Faults(pub Vec<Fault>);

/// Where an octet of a text is: line and column, both from 1; the column counts characters.
pub fn position(source: &str, octet: usize) -> (usize, usize) {
    let mut at = octet.min(source.len());
    while !source.is_char_boundary(at) {
        at -= 1;
    }
    let before = &source[..at];
    let begin = before.rfind('\n').map_or(0, |newline| newline + 1);
    (before.matches('\n').count() + 1, before[begin..].chars().count() + 1)
}

impl Fault {
    pub(super) fn new(span: Range<usize>, message: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { span: Some(span), message: message.into(), hint: hint.into() }
    }

    /// The whole for people: file, line and column, what is wrong, the line itself, and what to write.
    pub fn render(&self, file: &str, source: &str) -> String {
        let Self { span, message, hint } = self;
        let mut text = String::new();
        let place = span.as_ref().map(|span| (position(source, span.start), span));
        // Writing to a text cannot fail.
        let _ = match place {
            None => write!(text, "{file}: {message}"),
            Some(((line, column), _)) => write!(text, "{file}:{line}:{column}: {message}"),
        };
        if let Some(((line, column), span)) = place {
            let marked = source.get(span.clone()).unwrap_or_default().lines().next().unwrap_or_default();
            let (shown, before) = excerpt(source.lines().nth(line - 1).unwrap_or_default(), column);
            let room = shown.chars().count().saturating_sub(before).max(1);
            let marks = "^".repeat(marked.chars().count().clamp(1, room));
            let _ = write!(text, "\n{line:>6} | {shown}\n       | {}{marks}", " ".repeat(before));
        }
        if !hint.is_empty() {
            let _ = write!(text, "\n  hint: {hint}");
        }
        text
    }
}

/// What is shown of a line, and how many characters of it are before the column. What a terminal could take
/// for a command is a dot.
fn excerpt(line: &str, column: usize) -> (String, usize) {
    const BEFORE: usize = 60;
    const WIDTH: usize = 110;
    let skipped = (column - 1).saturating_sub(BEFORE);
    let shown = line.chars().skip(skipped).take(WIDTH);
    let plain = |character: char| match character {
        '\t' => ' ',
        character if character.is_control() => '.',
        character => character,
    };
    (shown.map(plain).collect(), column - 1 - skipped)
}

impl Faults {
    /// A file that is wrong as a whole.
    pub fn of_the_file(message: impl Into<String>, hint: impl Into<String>) -> Self {
        Self(vec![Fault { span: None, message: message.into(), hint: hint.into() }])
    }

    /// All of them for people.
    pub fn render(&self, file: &str, source: &str) -> String {
        let all: Vec<_> = self.0.iter().map(|fault| fault.render(file, source)).collect();
        all.join("\n")
    }
}

/// The word that was probably meant.
pub(super) fn nearest<'a>(word: &str, words: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let short: String = word.chars().take(40).collect::<String>().to_lowercase();
    let near = words.map(|known| (strsim::jaro_winkler(&short, &known.to_lowercase()), known));
    let best = near.filter(|(likeness, _)| *likeness > 0.8).max_by(|(a, _), (b, _)| a.total_cmp(b));
    best.map(|(_, known)| known)
}

/// A word as it is quoted in a sentence: not too long, and nothing that a terminal takes for a command.
pub(super) fn quoted(word: &str) -> String {
    let short: String = word.chars().take(40).collect();
    let dots = if short.len() < word.len() { "..." } else { "" };
    format!("{short:?}{dots}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_shows_its_line_and_marks_the_place() {
        let source = "title = \"a\"\nrate = 115200\n";
        let fault = Fault::new(19..25, "no rate", "write 500000");
        assert_eq!(
            fault.render("x.toml", source),
            "x.toml:2:8: no rate\n     2 | rate = 115200\n       |        ^^^^^^\n  hint: write 500000"
        );
    }

    #[test]
    fn long_lines_and_control_characters_are_no_trouble() {
        let source = format!("{}\u{1b}[2J\u{e4}", "x".repeat(5000));
        let text = Fault::new(5000..5004, "odd", "").render("f", &source);
        assert!(text.lines().all(|line| line.len() < 140 && !line.contains('\u{1b}')), "{text}");
        // In the middle of a character, and past the end.
        for span in [5005..5006, 9000..9001] {
            assert!(Fault::new(span, "odd", "").render("f", &source).contains("odd"));
        }
    }

    #[test]
    fn what_was_meant_is_found() {
        let known = ["supply", "switches", "state"];
        assert_eq!(nearest("suply", known.into_iter()), Some("supply"));
        assert_eq!(nearest("Switch", known.into_iter()), Some("switches"));
        assert_eq!(nearest("colour", known.into_iter()), None);
    }
}
