//! Octets written as hexadecimal text.
//!
//! Two digits an octet, together or apart; `0x` before them, and between them spaces, commas, colons,
//! `|`, `>` and `<`, are ignored. A comment runs from `#`, `;` or `/` to the end of its line.

use std::fmt::{self, Write};

/// Why text is no hexadecimal octets.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HexError {
    /// The line, from 1.
    pub line: u64,
    /// The character in it, from 1.
    pub column: u64,
    /// What stands there.
    pub found: Found,
}

/// What is no octet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Found {
    /// A character that has no place in hexadecimal text.
    Character(u8),
    /// One digit on its own.
    HalfAnOctet,
}

impl fmt::Display for HexError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { line, column, found } = self;
        match found {
            Found::Character(octet @ 0x21..=0x7E) => {
                write!(f, "line {line}, column {column}: '{}' is no hexadecimal digit", char::from(*octet))?;
            }
            Found::Character(octet) => {
                write!(f, "line {line}, column {column}: {octet:02X}h is no hexadecimal digit")?;
            }
            Found::HalfAnOctet => {
                write!(f, "line {line}, column {column}: an octet has two digits, here is one")?;
            }
        }
        f.write_str("; write octets like 10 0B 02 49 56 16, comments after #")
    }
}

impl std::error::Error for HexError {}

/// Reads text piece by piece, in constant memory.
#[derive(Debug)]
pub struct Reader {
    line: u64,
    column: u64,
    comment: bool,
    /// The first digit of an octet, and whether a 0 that an `x` may follow.
    half: Option<u8>,
    /// Whether a word has just begun, so that `0x` may come.
    begun: bool,
    /// Whether the line has held nothing so far.
    blank: bool,
}

/// What text comes to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Token {
    /// An octet.
    Octet(u8),
    /// A line without anything in it: a gap.
    Gap,
}

impl Default for Reader {
    fn default() -> Self {
        Self { line: 1, column: 0, comment: false, half: None, begun: true, blank: true }
    }
}

impl Reader {
    /// Reads the next piece of the text.
    ///
    /// # Errors
    ///
    /// [`HexError`] at the first character that is wrong.
    pub fn read(&mut self, text: &[u8], mut take: impl FnMut(Token)) -> Result<(), HexError> {
        for &character in text {
            self.column += 1;
            if character == b'\n' {
                self.end_of_word()?;
                if self.blank {
                    take(Token::Gap);
                }
                *self = Self { line: self.line + 1, ..Self::default() };
                continue;
            }
            if self.comment {
                continue;
            }
            match character {
                b'#' | b';' | b'/' => {
                    self.end_of_word()?;
                    (self.comment, self.blank) = (true, false);
                }
                b' ' | b'\t' | b'\r' | 0x0C | b',' | b':' | b'|' | b'>' | b'<' => self.end_of_word()?,
                b'x' | b'X' if self.half == Some(0) && self.begun => {
                    (self.half, self.begun) = (None, false);
                }
                _ => {
                    let digit = char::from(character).to_digit(16).and_then(|digit| u8::try_from(digit).ok());
                    let digit = digit.ok_or(self.error(Found::Character(character)))?;
                    self.blank = false;
                    match self.half.take() {
                        Some(high) => {
                            self.begun = false;
                            take(Token::Octet(high << 4 | digit));
                        }
                        None => self.half = Some(digit),
                    }
                }
            }
        }
        Ok(())
    }

    /// The end of the text.
    ///
    /// # Errors
    ///
    /// [`HexError`] if it ends in the middle of an octet.
    pub fn finish(&mut self) -> Result<(), HexError> {
        self.end_of_word()
    }

    fn end_of_word(&mut self) -> Result<(), HexError> {
        self.begun = true;
        if self.half.take().is_some() { Err(self.error(Found::HalfAnOctet)) } else { Ok(()) }
    }

    fn error(&self, found: Found) -> HexError {
        HexError { line: self.line, column: self.column, found }
    }
}

/// The octets of a whole text.
///
/// # Errors
///
/// [`HexError`]
pub fn octets(text: &str) -> Result<Vec<u8>, HexError> {
    let mut octets = Vec::new();
    let mut reader = Reader::default();
    reader.read(text.as_bytes(), |token| {
        if let Token::Octet(octet) = token {
            octets.push(octet);
        }
    })?;
    reader.finish()?;
    Ok(octets)
}

/// Octets as text: two digits each, with spaces between.
pub fn text(octets: &[u8]) -> String {
    let mut text = String::with_capacity(octets.len() * 3);
    for octet in octets {
        if !text.is_empty() {
            text.push(' ');
        }
        let _ = write!(text, "{octet:02X}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_ways_of_writing_are_read() {
        let due = vec![0x10, 0x0B, 0x02, 0x49, 0x56, 0x16];
        for text in [
            "10 0B 02 49 56 16",
            "100b02495616",
            "0x10,0x0B,0x02,0x49,0x56,0x16",
            "10:0B:02:49:56:16",
            "> 10 0B 02 # to the slave\r\n\t49 56 16 ; end\n// 68 more",
            "0X100B 02495616",
        ] {
            assert_eq!(octets(text), Ok(due.clone()), "{text}");
        }
        assert_eq!(octets(" \n# 10\n"), Ok(vec![]));
        assert_eq!(octets("00 0x00"), Ok(vec![0, 0]));
    }

    #[test]
    fn what_is_wrong_is_told_with_its_place() {
        for (text, words) in [
            ("10 0G", "line 1, column 5: 'G'"),
            ("10\n0", "line 2, column 1: an octet has two digits"),
            ("1 0", "line 1, column 2: an octet has two digits"),
            ("10x0", "line 1, column 3: 'x'"),
            ("0x0x10", "line 1, column 4: 'x'"),
            ("\u{df}", "line 1, column 1: C3h"),
            ("100\n", "an octet has two digits"),
        ] {
            let error = octets(text).expect_err(text).to_string();
            assert!(error.contains(words) && error.contains("write octets like"), "{text}: {error}");
        }
    }

    #[test]
    fn blank_lines_are_gaps_and_pieces_may_be_cut_anywhere() {
        let text = b"10 0B\n\n02 #\n#\n \n49";
        let read = |size: usize| {
            let mut tokens = Vec::new();
            let mut reader = Reader::default();
            for piece in text.chunks(size) {
                reader.read(piece, |token| tokens.push(token)).expect("good text");
            }
            tokens
        };
        let o = Token::Octet;
        assert_eq!(read(1), [o(0x10), o(0x0B), Token::Gap, o(2), Token::Gap, o(0x49)]);
        for size in 2..text.len() {
            assert_eq!(read(size), read(1));
        }
    }

    #[test]
    fn octets_become_text_and_back() {
        let all: Vec<u8> = (0..=255).collect();
        assert_eq!(octets(&text(&all)), Ok(all));
        assert_eq!(text(&[]), "");
    }
}
