//! Lines that come again and again are thinned out, so that what matters does not scroll away.
//!
//! A master that is refused tries again for ever, some of them a thousand times a second. A line is
//! printed as it comes up to five times within a second; after that once a second with the number
//! of those left out, then once in two seconds, and so on up to a minute.

use std::collections::HashMap;
use std::time::{Duration, Instant};

const FIRST_WINDOW: Duration = Duration::from_secs(1);
const LONGEST_WINDOW: Duration = Duration::from_mins(1);
/// So often a line is printed within its first window.
const AT_FIRST: u32 = 5;
/// More different lines than these are not remembered.
const MOST: usize = 256;

/// Decides which lines are printed.
#[derive(Debug, Default)]
pub(crate) struct Thinning {
    lines: HashMap<String, Line>,
}

#[derive(Debug)]
struct Line {
    since: Instant,
    window: Duration,
    /// So often it may still be printed in this window.
    left: u32,
    /// So often it was left out.
    held: u64,
}

impl Thinning {
    /// Whether a line is printed now, and how often it was left out before.
    pub(crate) fn admit(&mut self, text: &str, now: Instant) -> Option<u64> {
        if !self.lines.contains_key(text) {
            if self.lines.len() >= MOST {
                self.lines.retain(|_, line| line.held > 0 || now.duration_since(line.since) < line.window);
            }
            if self.lines.len() < MOST {
                let line = Line { since: now, window: FIRST_WINDOW, left: AT_FIRST - 1, held: 0 };
                self.lines.insert(text.to_owned(), line);
            }
            return Some(0);
        }
        let line = self.lines.get_mut(text)?;
        if now.duration_since(line.since) >= line.window {
            let held = std::mem::take(&mut line.held);
            (line.window, line.left) = if held > 0 {
                ((line.window * 2).min(LONGEST_WINDOW), 0)
            } else {
                (FIRST_WINDOW, AT_FIRST - 1)
            };
            line.since = now;
            return Some(held);
        }
        if line.left > 0 {
            line.left -= 1;
            return Some(0);
        }
        line.held += 1;
        None
    }

    /// The lines left out and not told yet, with how often; for a moment of quiet.
    pub(crate) fn take_held(&mut self) -> Vec<(String, u64)> {
        let held = self.lines.iter_mut().filter(|(_, line)| line.held > 0);
        held.map(|(text, line)| (text.clone(), std::mem::take(&mut line.held))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_master_that_tries_for_ever_fills_no_screen() {
        let mut thinning = Thinning::default();
        let begun = Instant::now();
        // Three lines in turn, a thousand times a second, for two minutes.
        let mut printed = 0u64;
        let mut told = 0u64;
        for millis in 0..120_000u64 {
            for text in ["a", "b", "c"] {
                if let Some(held) = thinning.admit(text, begun + Duration::from_millis(millis)) {
                    printed += 1;
                    told += held;
                }
            }
        }
        assert!(printed < 60, "{printed}");
        told += thinning.take_held().iter().map(|(_, held)| held).sum::<u64>();
        assert_eq!(printed + told, 360_000, "none is lost without being counted");
    }

    #[test]
    fn what_happens_now_and_then_is_always_printed() {
        let mut thinning = Thinning::default();
        let begun = Instant::now();
        for second in 0..1_000 {
            assert_eq!(thinning.admit("preset", begun + Duration::from_secs(second)), Some(0));
        }
        for number in 0..1_000 {
            assert_eq!(thinning.admit(&format!("line {number}"), begun), Some(0));
        }
        assert!(thinning.take_held().is_empty());
    }
}
