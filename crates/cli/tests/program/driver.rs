//! Starts the program, reads what it prints, and sees to its end.

use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Read};
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{self, Receiver};
use std::thread;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

use crate::master::{Master, Terminal};

/// Longer than anything takes on a busy computer.
const PATIENCE: Duration = Duration::from_secs(10);

/// `sch108bex run` while it runs. It is ended when this is dropped.
pub(crate) struct Program {
    child: Child,
    lines: Receiver<String>,
    /// All lines that it has printed and somebody has waited for.
    pub(crate) seen: Vec<String>,
    errors: Option<thread::JoinHandle<String>>,
}

/// What a program that ended by itself has left.
#[derive(Debug)]
pub(crate) struct Ended {
    pub(crate) status: Option<i32>,
    pub(crate) output: String,
    pub(crate) errors: String,
}

/// A command that runs the program.
pub(crate) fn program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sch108bex"));
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// `sch108bex run`, and its bus can be used.
pub(crate) fn run<A: AsRef<OsStr>>(arguments: impl IntoIterator<Item = A>) -> Program {
    let mut command = program();
    command.arg("run").args(arguments);
    let mut program = Program::start(&mut command);
    program.wait_for(&["ready"]);
    program
}

/// Runs the program to its end, which must come soon.
pub(crate) fn end_of(command: &mut Command) -> Ended {
    Program::start(command).ended()
}

impl Program {
    /// Starts a command whose outputs are pipes.
    pub(crate) fn start(command: &mut Command) -> Self {
        let mut child = command.spawn().expect("the program starts");
        let (to, lines) = mpsc::channel();
        if let Some(output) = child.stdout.take() {
            thread::spawn(move || {
                for line in BufReader::new(output).lines().map_while(Result::ok) {
                    if to.send(line).is_err() {
                        return;
                    }
                }
            });
        }
        let errors = child.stderr.take().map(|mut errors| {
            thread::spawn(move || {
                let mut text = Vec::new();
                let _ = errors.read_to_end(&mut text);
                String::from_utf8_lossy(&text).into_owned()
            })
        });
        Self { child, lines, seen: Vec::new(), errors }
    }

    /// The first line that holds all of `parts`, printed before or soon.
    #[track_caller]
    pub(crate) fn wait_for(&mut self, parts: &[&str]) -> String {
        self.wait_for_after(0, parts)
    }

    /// The same, but only what comes after the first `count` lines.
    #[track_caller]
    pub(crate) fn wait_for_after(&mut self, count: usize, parts: &[&str]) -> String {
        let fits = |line: &&String| parts.iter().all(|part| line.contains(part));
        if let Some(line) = self.seen.iter().skip(count).find(fits) {
            return line.clone();
        }
        let until = Instant::now() + PATIENCE;
        loop {
            match self.lines.recv_timeout(until.saturating_duration_since(Instant::now())) {
                Ok(line) => {
                    self.seen.push(line.clone());
                    if self.seen.len() > count && fits(&&line) {
                        return line;
                    }
                }
                Err(error) => {
                    panic!("waited in vain for {parts:?}: {error}; it has printed {:#?}", self.seen)
                }
            }
        }
    }

    /// How many lines it has printed so far.
    pub(crate) fn lines_so_far(&mut self) -> usize {
        self.seen.extend(self.lines.try_iter());
        self.seen.len()
    }

    /// Where its bus is.
    #[track_caller]
    pub(crate) fn bus(&mut self) -> PathBuf {
        self.wait_for(&["bus: /dev/pts/"])["bus: ".len()..].into()
    }

    /// Its bus, opened by a master at 500 kbit/s.
    #[track_caller]
    pub(crate) fn terminal(&mut self) -> Terminal {
        Terminal::open(&self.bus(), 500_000)
    }

    /// A master for one of its encoders.
    #[track_caller]
    pub(crate) fn master(&mut self, slave: u8) -> Master {
        Master::new(self.terminal(), slave)
    }

    /// Sends a signal and waits for the end.
    pub(crate) fn end_with(&mut self, signal: Signal) -> ExitStatus {
        kill_process(Pid::from_child(&self.child), signal).expect("it runs");
        self.wait()
    }

    /// What it leaves when it ends by itself, which must be soon.
    #[track_caller]
    pub(crate) fn ended(mut self) -> Ended {
        let status = self.wait();
        let output: Vec<String> = self.lines.iter().collect();
        Ended { status: status.code(), output: output.join("\n"), errors: self.take_errors() }
    }

    /// Ends it in order, as Ctrl-C does.
    #[track_caller]
    pub(crate) fn end(mut self) {
        let status = self.end_with(Signal::INT);
        assert_eq!(status.code(), Some(0), "{}", self.take_errors());
    }

    /// `kill -9`.
    pub(crate) fn kill(&mut self) {
        self.child.kill().expect("it runs");
        self.child.wait().expect("it ends");
    }

    /// Its process.
    #[allow(dead_code, reason = "not every test file looks at the process")]
    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// Whether it is still there.
    pub(crate) fn is_running(&mut self) -> bool {
        self.child.try_wait().expect("a status").is_none()
    }

    /// What it has printed on standard error, once it has ended.
    pub(crate) fn take_errors(&mut self) -> String {
        self.errors.take().map_or_else(String::new, |errors| errors.join().expect("text"))
    }

    #[track_caller]
    fn wait(&mut self) -> ExitStatus {
        let until = Instant::now() + PATIENCE;
        loop {
            if let Some(status) = self.child.try_wait().expect("a status") {
                return status;
            }
            if Instant::now() > until {
                let _ = self.child.kill();
                panic!("it does not end");
            }
            thread::sleep(Duration::from_millis(2));
        }
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
