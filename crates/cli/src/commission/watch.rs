//! What goes on: a panel that is drawn anew in place on a terminal, lines elsewhere.

use std::io::{IsTerminal, Write};

use crate::output;

/// Eighths of a character cell, for a line of little bars.
const BARS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
/// The panel never takes more columns than this.
const MOST_COLUMNS: usize = 140;

/// A panel on standard output, where that is a terminal that can draw one.
#[derive(Debug)]
pub(super) struct Panel {
    drawn: usize,
}

impl Panel {
    /// `None`: lines have to do.
    pub(super) fn new(plain: bool) -> Option<Self> {
        let dumb = std::env::var_os("TERM").is_none_or(|kind| kind.is_empty() || kind == "dumb");
        (!plain && !dumb && std::io::stdout().is_terminal()).then_some(Self { drawn: 0 })
    }

    /// Draws it over the one before. What does not fit on the screen is cut off, and counted.
    pub(super) fn draw(&mut self, lines: &[String]) {
        let (columns, rows) = size();
        let mut shown: Vec<String> = lines.iter().take(rows).map(|line| cut(line, columns)).collect();
        if lines.len() > rows {
            shown.truncate(rows.saturating_sub(1));
            shown.push(format!("... and {} lines more", lines.len() - shown.len()));
        }
        let up = if self.drawn == 0 { String::new() } else { format!("\x1b[{}A\x1b[J", self.drawn) };
        let mut out = std::io::stdout().lock();
        output::got_out(
            out.write_all(format!("{up}{}\n", shown.join("\n")).as_bytes()).and_then(|()| out.flush()),
        );
        self.drawn = shown.len();
    }
}

fn cut(line: &str, columns: usize) -> String {
    line.chars().take(columns).collect()
}

/// Columns, and rows but for the one of the cursor.
fn size() -> (usize, usize) {
    let size = rustix::termios::tcgetwinsize(std::io::stdout()).ok();
    let or =
        |size: Option<u16>, usual: usize| size.map(usize::from).filter(|size| *size > 1).unwrap_or(usual);
    let columns = or(size.map(|size| size.ws_col), 80).min(MOST_COLUMNS);
    (columns, or(size.map(|size| size.ws_row), 24) - 1)
}

/// Values as little bars, from the least of them to the most.
pub(super) fn bars<'a>(values: impl Iterator<Item = &'a f64> + Clone) -> String {
    let low = values.clone().copied().fold(f64::INFINITY, f64::min);
    let high = values.clone().copied().fold(f64::NEG_INFINITY, f64::max);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 7")]
    let bar = |value: &f64| {
        let share = if high > low { (value - low) / (high - low) } else { 0.0 };
        BARS[((share * 7.0).round() as usize).min(7)]
    };
    values.map(bar).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_reach_from_the_least_to_the_most() {
        let of = |values: &[f64]| bars(values.iter());
        assert_eq!(of(&[]), "");
        assert_eq!(of(&[3.0, 3.0]), "▁▁");
        assert_eq!(of(&[-7.0, 0.0, 7.0]), "▁▅█");
        assert_eq!(of(&[1e300, -1e300]), "█▁");
    }
}
