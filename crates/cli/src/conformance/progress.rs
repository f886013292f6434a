//! How far the run is, on a terminal; and the date of the report.

use std::io::Write;
use std::time::{SystemTime, UNIX_EPOCH};

/// So many signs the bar is long.
const WIDTH: usize = 30;

/// A bar on standard error, where that is a terminal.
pub(super) struct Progress {
    on: bool,
    total: usize,
    done: usize,
    failed: usize,
}

impl Progress {
    pub(super) fn new(total: usize, on: bool) -> Self {
        Self { on, total, done: 0, failed: 0 }
    }

    /// Draws the bar before a case.
    pub(super) fn show(&self, case: &str) {
        if self.on {
            let _ = write!(std::io::stderr(), "\r\x1b[2K{}", self.bar(case));
            let _ = std::io::stderr().flush();
        }
    }

    fn bar(&self, case: &str) -> String {
        let filled = WIDTH * self.done / self.total.max(1);
        let failed = if self.failed > 0 { format!(", {} failed", self.failed) } else { String::new() };
        format!(
            "[{}{}] {}/{}{failed}, case {case}",
            "#".repeat(filled),
            ".".repeat(WIDTH - filled),
            self.done,
            self.total
        )
    }

    /// Takes the bar away, so that lines can be printed.
    pub(super) fn clear(&self) {
        if self.on {
            let _ = write!(std::io::stderr(), "\r\x1b[2K");
            let _ = std::io::stderr().flush();
        }
    }

    pub(super) fn done(&mut self, failed: bool) {
        self.done += 1;
        self.failed += usize::from(failed);
    }
}

/// `2026-03-01 12:00 UTC`
pub(super) fn utc(time: SystemTime) -> String {
    let seconds = time.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let (days, minutes) = (seconds / 86_400, seconds / 60 % 1_440);
    // Years begin in March here, so that the leap day is the last of its year.
    let days = days + 719_468;
    let era = days / 146_097;
    let of_era = days % 146_097;
    let year_of_era = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * of_year + 2) / 153;
    let day = of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02} {:02}:{:02} UTC", minutes / 60, minutes % 60)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn seconds_become_a_date() {
        for (seconds, date) in [
            (0, "1970-01-01 00:00 UTC"),
            (951_782_399, "2000-02-28 23:59 UTC"),
            (951_782_400, "2000-02-29 00:00 UTC"),
            (1_709_251_200, "2024-03-01 00:00 UTC"),
            (4_102_444_799, "2099-12-31 23:59 UTC"),
        ] {
            assert_eq!(utc(UNIX_EPOCH + Duration::from_secs(seconds)), date);
        }
    }

    #[test]
    fn the_bar_fills_and_tells_failures() {
        let mut progress = Progress::new(4, false);
        assert_eq!(progress.bar("1"), "[..............................] 0/4, case 1");
        progress.done(false);
        progress.done(true);
        assert_eq!(progress.bar("3"), "[###############...............] 2/4, 1 failed, case 3");
    }
}
