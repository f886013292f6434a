//! `cargo xtask recording`: what the demonstration looks like on a terminal, as a moving picture for
//! the README.
//!
//! The program runs on a pseudo terminal, its output goes through a terminal emulator, and every line of the
//! screen becomes a text that is visible for as long as it stood there.

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::Read;
use std::os::fd::{AsFd, OwnedFd};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rustix::pty::{OpenptFlags, grantpt, ioctl_tiocgptpeer, openpt, unlockpt};
use rustix::termios::{Winsize, tcsetwinsize};

use crate::process::{Show, run};
use crate::project::Project;

const COLUMNS: u16 = 124;
const ROWS: u16 = 46;
/// The screen is looked at so often.
const FRAME: Duration = Duration::from_millis(200);
/// How long the last screen stays before it begins anew.
const REST: f64 = 4.0;
/// Longer than any demonstration.
const LIMIT: Duration = Duration::from_mins(1);
/// In pixels.
const CHARACTER: (f64, f64) = (7.25, 16.0);
const MARGIN: f64 = 12.0;

/// What stood in a row, from one moment to another, in seconds.
#[derive(Debug, PartialEq)]
struct Stood {
    row: u16,
    text: String,
    bold: bool,
    from: f64,
    until: f64,
}

/// Makes `docs/demo.svg`.
///
/// # Errors
///
/// When the program cannot be built or run, or the file not written.
pub(crate) fn record(project: &Project) -> Result<(), String> {
    let mut build = project.cargo(["build", "--release", "--quiet", "--package", "cli"]);
    run(&mut build, Duration::from_mins(15), Show::Live)?.expect_success("Building the program")?;
    let mut demo = Command::new(project.target.join("release/sch108bex"));
    demo.args(["demo", "--seconds", "10"]).env("TERM", "xterm-256color");
    let (stood, length) = watch(&mut demo)?;
    let path = project.root.join("docs/demo.svg");
    fs::write(&path, svg(&stood, length + REST))
        .map_err(|error| format!("{} cannot be written: {error}.", path.display()))?;
    println!("docs/demo.svg: {length:.1} s, {} pieces of text", stood.len());
    Ok(())
}

/// Runs a command on a terminal; what stood there, and for how long it ran.
fn watch(command: &mut Command) -> Result<(Vec<Stood>, f64), String> {
    let (controller, terminal) = pty().map_err(|error| format!("No pseudo terminal can be had: {error}."))?;
    let own = |fd: &OwnedFd| fd.try_clone().map(Stdio::from).map_err(|error| error.to_string());
    command.stdin(Stdio::null()).stdout(own(&terminal)?).stderr(own(&terminal)?);
    let mut child = command.spawn().map_err(|error| format!("The program cannot be started: {error}."))?;
    // The command's own copies, and this one, are what keeps the terminal open.
    command.stdout(Stdio::null()).stderr(Stdio::null());
    drop(terminal);
    let begun = Instant::now();
    let (pieces, from_terminal) = std::sync::mpsc::channel();
    let mut output = File::from(controller);
    std::thread::spawn(move || {
        let mut buffer = [0; 4096];
        // An error is the end: nobody has the terminal open any more.
        while let Ok(count @ 1..) = output.read(&mut buffer) {
            if pieces.send(buffer[..count].to_vec()).is_err() {
                return;
            }
        }
    });
    let mut screen = Screen::new();
    let mut next = begun + FRAME;
    loop {
        use std::sync::mpsc::RecvTimeoutError::{Disconnected, Timeout};
        match from_terminal.recv_timeout(next.saturating_duration_since(Instant::now())) {
            Ok(octets) => screen.emulator.process(&octets),
            Err(Timeout) => {
                screen.look(begun.elapsed().as_secs_f64());
                next += FRAME;
            }
            Err(Disconnected) => break,
        }
        if begun.elapsed() > LIMIT {
            let _ = child.kill();
        }
    }
    let status = child.wait().map_err(|error| format!("The program's end cannot be seen: {error}."))?;
    if !status.success() {
        return Err(format!("The demonstration failed:\n{}", screen.emulator.screen().contents()));
    }
    let length = begun.elapsed().as_secs_f64();
    screen.look(length);
    Ok((screen.finish(length + REST), length))
}

fn pty() -> rustix::io::Result<(OwnedFd, OwnedFd)> {
    let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
    let controller = openpt(flags)?;
    grantpt(&controller)?;
    unlockpt(&controller)?;
    let terminal = ioctl_tiocgptpeer(&controller, flags)?;
    let size = Winsize { ws_row: ROWS, ws_col: COLUMNS, ws_xpixel: 0, ws_ypixel: 0 };
    tcsetwinsize(terminal.as_fd(), size)?;
    Ok((controller, terminal))
}

/// A terminal's screen, and what stood on it.
struct Screen {
    emulator: vt100::Parser,
    /// What stands in each row, and since when.
    rows: Vec<(String, bool, f64)>,
    stood: Vec<Stood>,
}

impl Screen {
    fn new() -> Self {
        Self {
            emulator: vt100::Parser::new(ROWS, COLUMNS, 0),
            rows: vec![Default::default(); ROWS.into()],
            stood: Vec::new(),
        }
    }

    /// Notes what has changed by now.
    fn look(&mut self, now: f64) {
        let screen = self.emulator.screen();
        for ((row, text), old) in (0..).zip(screen.rows(0, COLUMNS)).zip(&mut self.rows) {
            let text = text.trim_end();
            if text != old.0 {
                let bold = screen.cell(row, 0).is_some_and(vt100::Cell::bold);
                let (text, bold, from) = std::mem::replace(old, (text.to_owned(), bold, now));
                self.stood.push(Stood { row, text, bold, from, until: now });
            }
        }
    }

    fn finish(mut self, end: f64) -> Vec<Stood> {
        let last =
            (0..).zip(self.rows).map(|(row, (text, bold, from))| Stood { row, text, bold, from, until: end });
        self.stood.extend(last);
        self.stood.retain(|stood| !stood.text.is_empty());
        self.stood
    }
}

/// A picture in which each text is visible for its time, over and over.
fn svg(stood: &[Stood], length: f64) -> String {
    let rows = stood.iter().map(|stood| stood.row + 1).max().unwrap_or(1);
    let width = f64::from(COLUMNS) * CHARACTER.0 + 2.0 * MARGIN;
    let height = f64::from(rows) * CHARACTER.1 + 2.0 * MARGIN;
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" \
         height=\"{height:.0}\" role=\"img\" aria-label=\"The demonstration on a terminal\">\n\
         <rect width=\"100%\" height=\"100%\" rx=\"6\" fill=\"#12171c\">\
         <animate id=\"t\" attributeName=\"x\" values=\"0\" begin=\"0s;t.end\" dur=\"{length:.2}s\"/></rect>\n\
         <g font-family=\"ui-monospace,SFMono-Regular,Menlo,Consolas,DejaVu Sans Mono,monospace\" font-size=\"12\" \
         fill=\"#d6dde4\" xml:space=\"preserve\">\n"
    );
    for Stood { row, text: words, bold, from, until } in stood {
        let y = f64::from(*row) * CHARACTER.1 + MARGIN + 12.0;
        let columns = words.chars().count();
        #[expect(clippy::cast_precision_loss, reason = "a hundred columns")]
        let span = columns as f64 * CHARACTER.0;
        let weight = if *bold { " font-weight=\"bold\" fill=\"#ffffff\"" } else { "" };
        let last = *until >= length - 0.01;
        // Where nothing moves, the last screen is what one sees.
        let visibility = if last { "" } else { " visibility=\"hidden\"" };
        let _ = write!(
            text,
            "<text x=\"{MARGIN}\" y=\"{y}\" textLength=\"{span:.1}\" lengthAdjust=\"spacingAndGlyphs\"{weight}{visibility}>{}",
            escaped(words)
        );
        if last {
            let _ = write!(
                text,
                "<set attributeName=\"visibility\" to=\"hidden\" begin=\"t.begin\" dur=\"{from:.2}s\"/>"
            );
        } else {
            let _ = write!(
                text,
                "<set attributeName=\"visibility\" to=\"visible\" begin=\"t.begin+{from:.2}s\" dur=\"{:.2}s\"/>",
                until - from
            );
        }
        text.push_str("</text>\n");
    }
    text.push_str("</g>\n</svg>\n");
    text
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stood_is_kept_with_its_time() {
        let mut screen = Screen::new();
        screen.emulator.process(b"\x1b[1mone\x1b[0m\r\ntwo");
        screen.look(1.0);
        screen.emulator.process(b"\x1b[1A\r\x1b[Jthree");
        screen.look(2.0);
        let row =
            |row, text: &str, bold, from, until| Stood { row, text: text.to_owned(), bold, from, until };
        let due =
            [row(0, "one", true, 1.0, 2.0), row(1, "two", false, 1.0, 2.0), row(0, "three", false, 2.0, 9.0)];
        assert_eq!(screen.finish(9.0), due);
    }

    #[test]
    fn a_picture_is_whole_and_escaped() {
        let stood = [Stood { row: 3, text: "a < b & c".to_owned(), bold: false, from: 1.0, until: 2.0 }];
        let picture = svg(&stood, 5.0);
        assert!(picture.contains("a &lt; b &amp; c<set") && picture.ends_with("</svg>\n"), "{picture}");
        assert!(picture.contains("begin=\"t.begin+1.00s\" dur=\"1.00s\""), "{picture}");
    }
}
