//! Running a command: seen live, kept for reading, and never for longer than allowed.

use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::thread;
use std::time::{Duration, Instant};

/// How long a command may take to end after it was asked to, and its output to close after its end.
const GRACE: Duration = Duration::from_secs(3);

/// Whether the lines of a command are printed as they come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Show {
    /// Every line.
    Live,
    /// Nothing; the caller decides.
    Nothing,
}

/// What a command that ended by itself has left.
#[derive(Debug)]
pub(crate) struct Finished {
    /// Exit status 0.
    pub(crate) success: bool,
    /// Standard output.
    pub(crate) stdout: String,
    /// Both outputs, line by line as they came.
    pub(crate) both: String,
}

impl Finished {
    /// The standard output, or what the command said when it failed.
    pub(crate) fn expect_success(self, what: &str) -> Result<String, String> {
        if self.success { Ok(self.stdout) } else { Err(format!("{what} failed:\n{}", tail(&self.both, 40))) }
    }
}

/// The last `lines` lines of a text.
fn tail(text: &str, lines: usize) -> String {
    let all: Vec<&str> = text.trim_end().lines().collect();
    all.get(all.len().saturating_sub(lines)..).unwrap_or_default().join("\n")
}

enum Line {
    Out(String),
    Err(String),
}

/// Runs a command with empty standard input, at most for `limit`.
///
/// # Errors
///
/// A sentence, when it cannot be started or had to be ended.
pub(crate) fn run(command: &mut Command, limit: Duration, show: Show) -> Result<Finished, String> {
    let name = command.get_program().to_string_lossy().into_owned();
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|error| format!("`{name}` cannot be started: {error}."))?;
    let (sender, lines) = mpsc::channel();
    if let Some(out) = child.stdout.take() {
        forward(out, sender.clone(), Line::Out);
    }
    if let Some(err) = child.stderr.take() {
        forward(err, sender, Line::Err);
    }
    let mut finished = Finished { success: false, stdout: String::new(), both: String::new() };
    let status = follow(&mut child, &lines, Instant::now() + limit, |line| {
        keep(&mut finished, &line, show);
    });
    let Some(status) = status else {
        end(&mut child);
        return Err(format!("`{name}` was ended: it took longer than {} s.", limit.as_secs()));
    };
    finished.success = status.success();
    Ok(finished)
}

fn keep(finished: &mut Finished, line: &Line, show: Show) {
    let (Line::Out(text) | Line::Err(text)) = line;
    if matches!(line, Line::Out(_)) {
        finished.stdout.push_str(text);
    }
    finished.both.push_str(text);
    if show == Show::Live {
        print!("{text}");
    }
}

/// Takes lines until the command has ended and its outputs are closed; `None`: it took too long.
fn follow(
    child: &mut Child,
    lines: &Receiver<Line>,
    deadline: Instant,
    mut take: impl FnMut(Line),
) -> Option<ExitStatus> {
    let mut ended: Option<(ExitStatus, Instant)> = None;
    loop {
        match lines.recv_timeout(Duration::from_millis(20)) {
            Ok(line) => take(line),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => thread::sleep(Duration::from_millis(1)),
        }
        if ended.is_none() {
            ended = child.try_wait().ok().flatten().map(|status| (status, Instant::now()));
        }
        match ended {
            // A grandchild may hold the outputs open for ever: it gets a grace.
            Some((status, at)) => match lines.try_recv() {
                Ok(line) => take(line),
                Err(mpsc::TryRecvError::Disconnected) => return Some(status),
                Err(mpsc::TryRecvError::Empty) if at.elapsed() > GRACE => return Some(status),
                Err(mpsc::TryRecvError::Empty) => {}
            },
            None if Instant::now() > deadline => return None,
            None => {}
        }
    }
}

fn forward(from: impl Read + Send + 'static, to: Sender<Line>, kind: fn(String) -> Line) {
    thread::spawn(move || {
        let mut reader = BufReader::new(from);
        let mut line = Vec::new();
        while reader.read_until(b'\n', &mut line).is_ok_and(|octets| octets > 0) {
            if to.send(kind(String::from_utf8_lossy(&line).into_owned())).is_err() {
                break;
            }
            line.clear();
        }
    });
}

/// Ends a command and everything that it has started: asked first, then made to.
fn end(child: &mut Child) {
    let tree = descendants(child.id());
    signal("-TERM", &tree);
    let asked = Instant::now();
    while asked.elapsed() < GRACE && child.try_wait().is_ok_and(|status| status.is_none()) {
        thread::sleep(Duration::from_millis(50));
    }
    signal("-KILL", &tree);
    let _ = child.kill();
    let _ = child.wait();
}

/// A process and all below it, as the proc file system tells; itself alone where there is none.
fn descendants(root: u32) -> Vec<u32> {
    let parents: Vec<(u32, u32)> = std::fs::read_dir("/proc")
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| {
            let pid = entry.file_name().to_str()?.parse().ok()?;
            let stat = std::fs::read_to_string(entry.path().join("stat")).ok()?;
            let parent = stat.rsplit(')').next()?.split_whitespace().nth(1)?.parse().ok()?;
            Some((pid, parent))
        })
        .collect();
    let mut tree = vec![root];
    let mut at = 0;
    while let Some(&one) = tree.get(at) {
        tree.extend(parents.iter().filter(|(_, parent)| *parent == one).map(|(pid, _)| *pid));
        at += 1;
    }
    tree
}

fn signal(which: &str, tree: &[u32]) {
    let pids = tree.iter().map(u32::to_string);
    let _ = Command::new("sh").args(["-c", "kill \"$@\" 2>/dev/null", "sh", which]).args(pids).status();
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sh(script: &str, seconds: u64) -> Result<Finished, String> {
        run(Command::new("sh").args(["-c", script]), Duration::from_secs(seconds), Show::Nothing)
    }

    #[test]
    fn both_outputs_and_the_status_are_kept() {
        let finished = sh("echo out; echo err >&2; exit 3", 10).unwrap();
        assert!(!finished.success);
        assert_eq!(finished.stdout, "out\n");
        assert!(finished.both.contains("err\n"));
        assert!(finished.expect_success("The script").unwrap_err().starts_with("The script failed:\n"));
    }

    #[test]
    fn a_command_that_hangs_is_ended_with_its_children() {
        let started = Instant::now();
        let error = sh("sleep 60 & sleep 60", 1).unwrap_err();
        assert!(error.contains("longer than 1 s"), "{error}");
        assert!(started.elapsed() < Duration::from_secs(20));
    }

    #[test]
    fn a_grandchild_that_holds_the_outputs_open_does_not_hold_the_run() {
        let started = Instant::now();
        assert_eq!(sh("sleep 20 & echo done", 15).unwrap().stdout, "done\n");
        assert!(started.elapsed() < Duration::from_secs(12));
    }
}
