//! Reads QEMU's log: instructions, exceptions, accesses to USARTs.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

/// One run through an interrupt, without those that interrupted it.
#[derive(Debug, Default)]
pub(crate) struct Passage {
    /// Number of the exception.
    pub(crate) exception: u32,
    /// Instructions of it.
    pub(crate) instructions: u32,
    /// Reads of a data register.
    pub(crate) reads: u32,
    /// Instructions up to the first write of a data register, that one included.
    pub(crate) to_first_write: u32,
    /// The same, to the second.
    pub(crate) to_second_write: u32,
    /// How many are in which function.
    pub(crate) functions: Vec<(String, u32)>,
}

/// All that the log tells of, in the order of their ends.
pub(crate) fn passages(log: &Path) -> Result<Vec<Passage>, String> {
    let trouble = |error| format!("{}: {error}.", log.display());
    let mut reader = BufReader::new(File::open(log).map_err(trouble)?);
    let (mut open, mut done): (Vec<Passage>, Vec<Passage>) = (Vec::new(), Vec::new());
    let mut line = Vec::new();
    loop {
        line.clear();
        if reader.read_until(b'\n', &mut line).map_err(trouble)? == 0 {
            return Ok(done);
        }
        let text = String::from_utf8_lossy(&line);
        let text = text.trim();
        if let Some(rest) =
            text.split_once("taking pending").and_then(|(_, rest)| rest.split_once("exception "))
        {
            let exception = rest.1.trim().parse().map_err(|_| format!("Not an exception: {text}"))?;
            open.push(Passage { exception, ..Passage::default() });
        } else if text.starts_with("Exception return: ") {
            done.extend(open.pop());
        } else if let Some(passage) = open.last_mut() {
            note(passage, text);
        }
    }
}

fn note(passage: &mut Passage, text: &str) {
    if text.starts_with("Trace ") {
        passage.instructions += 1;
        let function = text.rsplit_once("] ").map_or("", |(_, function)| function);
        match passage.functions.iter_mut().find(|(name, _)| name == function) {
            Some((_, count)) => *count += 1,
            None => passage.functions.push((function.to_owned(), 1)),
        }
    } else if text.starts_with("Stopped execution") {
        // The one before was not run after all.
        passage.instructions -= 1;
    } else if text.contains("usart_read") && text.contains("ofs 0x04") {
        passage.reads += 1;
    } else if text.contains("usart_write") && text.contains("ofs 0x04") {
        // The line of the instruction comes before that of its access.
        if passage.to_first_write == 0 {
            passage.to_first_write = passage.instructions;
        } else if passage.to_second_write == 0 {
            passage.to_second_write = passage.instructions;
        }
    }
}
