//! What the demonstration shows: lines of text, and on a terminal below them a panel that is drawn
//! anew in place.

use std::collections::VecDeque;
use std::io::{IsTerminal, Write};

use crate::output;

/// A panel is redrawn after this; plain lines come more seldom.
pub(super) const FRAME_MILLIS: u64 = 50;
/// One plain line for so many frames.
const FRAMES_PER_LINE: u32 = 10;
/// So many velocities are drawn.
const HISTORY: usize = 40;
/// The panel never takes more than this many columns.
const MOST_COLUMNS: usize = 110;
/// Eighths of a character cell, for a line of little bars.
const BARS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];

/// What is shown of a moment.
#[derive(Debug, Clone, Default)]
pub(super) struct Facts {
    /// In scaled steps.
    pub(super) position: u32,
    /// In steps per 100 ms.
    pub(super) velocity: i32,
    /// In steps per 100 ms, per 100 ms.
    pub(super) acceleration: i32,
    /// Where in the turn the shaft is: 0 to 999 thousandths.
    pub(super) turn_thousandths: u32,
    /// From request to request, in microseconds of bus time.
    pub(super) cycle_us: u64,
    /// Exchanges so far.
    pub(super) exchanges: u64,
    /// Requests that had to be repeated.
    pub(super) retries: u64,
    /// What the diagnosis that was fetched last says.
    pub(super) diagnosis: String,
    /// The last request and its answer.
    pub(super) request: Vec<u8>,
    pub(super) answer: Vec<u8>,
}

/// Where lines and facts go to.
#[derive(Debug)]
pub(super) enum Screen {
    /// One line after the other.
    Plain {
        /// Facts since the last line.
        frames: u32,
    },
    /// A panel below the lines.
    Live {
        /// How many lines of the panel are on the screen.
        drawn: usize,
        velocities: VecDeque<i32>,
    },
}

impl Screen {
    /// A panel if standard output is a terminal that can draw one, and nobody wants plain lines.
    pub(super) fn new(plain: bool) -> Self {
        let dumb = std::env::var_os("TERM").is_none_or(|kind| kind.is_empty() || kind == "dumb");
        if plain || dumb || !std::io::stdout().is_terminal() {
            Self::Plain { frames: 0 }
        } else {
            Self::Live { drawn: 0, velocities: VecDeque::with_capacity(HISTORY) }
        }
    }

    /// A line that stays.
    pub(super) fn line(&mut self, text: &str) {
        self.erase();
        output::line(text);
    }

    /// A line that begins something new.
    pub(super) fn heading(&mut self, text: &str) {
        self.line("");
        match self {
            Self::Plain { .. } => self.line(text),
            Self::Live { .. } => self.line(&format!("\x1b[1m{text}\x1b[0m")),
        }
    }

    /// The facts of a frame: a panel, or now and then a line.
    pub(super) fn show(&mut self, facts: &Facts) {
        match self {
            Self::Plain { frames } => {
                if frames.is_multiple_of(FRAMES_PER_LINE) {
                    output::line(&plain(facts));
                }
                *frames += 1;
            }
            Self::Live { velocities, .. } => {
                if velocities.len() == HISTORY {
                    velocities.pop_front();
                }
                velocities.push_back(facts.velocity);
                let panel = panel(facts, velocities, columns());
                self.erase();
                let text: String = panel.iter().flat_map(|line| [line.as_str(), "\n"]).collect();
                let mut out = std::io::stdout().lock();
                let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
                if let Self::Live { drawn, .. } = self {
                    *drawn = panel.len();
                }
            }
        }
    }

    /// The end of a watch: one line of it stays.
    pub(super) fn keep(&mut self, facts: &Facts) {
        self.line(&plain(facts));
        if let Self::Plain { frames } = self {
            *frames = 0;
        }
    }

    fn erase(&mut self) {
        if let Self::Live { drawn, .. } = self
            && *drawn > 0
        {
            // Up, and everything from there on cleared.
            let mut out = std::io::stdout().lock();
            let _ = write!(out, "\x1b[{drawn}A\x1b[J");
            *drawn = 0;
        }
    }
}

/// How wide the terminal is.
fn columns() -> usize {
    let size = rustix::termios::tcgetwinsize(std::io::stdout());
    let columns = size.map_or(80, |size| usize::from(size.ws_col));
    if columns == 0 { 80 } else { columns.min(MOST_COLUMNS) }
}

fn plain(facts: &Facts) -> String {
    format!(
        "  position {:9}   velocity {:6}   acceleration {:5}   cycle {} us   {}",
        facts.position, facts.velocity, facts.acceleration, facts.cycle_us, facts.diagnosis
    )
}

/// The lines of the panel, none longer than `columns`.
fn panel(facts: &Facts, velocities: &VecDeque<i32>, columns: usize) -> Vec<String> {
    let rule = "─".repeat(columns.min(78));
    let rpm = f64::from(facts.velocity) * 600.0 / f64::from(super::STEPS);
    let lines = [
        rule.clone(),
        format!("  position      {:>12}   {}", facts.position, dial(facts.turn_thousandths)),
        format!("  velocity      {:>12}   {rpm:+8.1} RPM  {}", facts.velocity, bars(velocities)),
        format!("  acceleration  {:>12}", facts.acceleration),
        format!("  diagnosis     {}", facts.diagnosis),
        format!(
            "  bus           cycle {} us, {} exchanges, {} retries",
            facts.cycle_us, facts.exchanges, facts.retries
        ),
        format!("  request       {}", hex(&facts.request)),
        format!("  answer        {}", hex(&facts.answer)),
        rule,
    ];
    lines.into_iter().map(|line| line.chars().take(columns).collect()).collect()
}

/// The shaft in its turn, as a mark on a line that is one turn long.
fn dial(thousandths: u32) -> String {
    const WIDTH: usize = 40;
    let at = (thousandths as usize * WIDTH / 1000).min(WIDTH - 1);
    (0..WIDTH).map(|place| if place == at { '█' } else { '·' }).collect()
}

/// Velocities as little bars, the lowest of them the least.
fn bars(velocities: &VecDeque<i32>) -> String {
    let low = velocities.iter().copied().min().unwrap_or(0).min(0);
    let high = velocities.iter().copied().max().unwrap_or(0).max(0);
    let span = i64::from(high) - i64::from(low);
    let bar = |velocity: &i32| {
        let height = (i64::from(*velocity) - i64::from(low)) * 7;
        BARS[usize::try_from(height.checked_div(span).unwrap_or(0)).unwrap_or(0).min(7)]
    };
    velocities.iter().map(bar).collect()
}

/// Octets as two hex digits each.
fn hex(octets: &[u8]) -> String {
    octets.iter().map(|octet| format!("{octet:02X}")).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn facts() -> Facts {
        Facts {
            position: 1_000_000,
            velocity: 2048,
            turn_thousandths: 500,
            cycle_us: 281,
            diagnosis: "no alarm, no warning".to_owned(),
            request: vec![0x68, 0x07],
            ..Facts::default()
        }
    }

    #[test]
    fn the_panel_says_what_there_is_and_fits() {
        let panel_of = |columns| panel(&facts(), &VecDeque::from([0, 2048]), columns);
        let wide = panel_of(100).join("\n");
        for claim in ["1000000", "+300.0 RPM", "▁█", "cycle 281 us", "no alarm, no warning", "68 07"] {
            assert!(wide.contains(claim), "no `{claim}` in\n{wide}");
        }
        for columns in [1, 20, 79] {
            let lines = panel_of(columns);
            assert!(lines.iter().all(|line| line.chars().count() <= columns), "{lines:?}");
            assert_eq!(lines.len(), panel_of(100).len(), "or the next panel would not lie over this one");
        }
    }

    #[test]
    fn bars_reach_from_the_least_to_the_most() {
        let of = |velocities: &[i32]| bars(&velocities.iter().copied().collect());
        assert_eq!(of(&[]), "");
        assert_eq!(of(&[0, 0]), "▁▁");
        assert_eq!(of(&[-7, 0, 7]), "▁▄█");
        assert_eq!(of(&[i32::MIN, i32::MAX]), "▁█");
    }

    #[test]
    fn the_dial_has_one_mark_wherever_the_shaft_is() {
        for thousandths in [0, 500, 999, u32::MAX / 1000] {
            assert_eq!(dial(thousandths).matches('█').count(), 1, "{thousandths}");
        }
        assert!(dial(0).starts_with('█') && dial(999).ends_with('█'));
    }

    #[test]
    fn plain_lines_come_at_half_seconds() {
        let mut screen = Screen::Plain { frames: 0 };
        for _ in 0..11 {
            screen.show(&facts());
        }
        assert!(matches!(screen, Screen::Plain { frames: 11 }));
        screen.keep(&facts());
        assert!(matches!(screen, Screen::Plain { frames: 0 }));
    }
}
