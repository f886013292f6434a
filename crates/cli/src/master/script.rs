//! `sch108bex master script`: one command a line, from a file, from standard input, or at a prompt.
//!
//! Between two commands a station that exchanges data is kept in data exchange, however long somebody thinks.

mod command;
mod desk;

use std::io::{BufRead, BufReader, IsTerminal, Write};
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::Duration;

use clap::Args;

use super::Master;
use crate::commission::{Light, until_stopped};
use crate::{Failure, output};
use command::Command;
use desk::Desk;

/// How long a station waits for its master at most while nobody writes a command.
const KEPT_ALIVE_EVERY: Duration = Duration::from_millis(50);

/// Where the commands come from.
#[derive(Debug, Args)]
pub(super) struct Script {
    /// A file with one command a line; without it standard input, on a terminal with a prompt. `help` lists them
    #[arg(value_name = "FILE")]
    file: Option<PathBuf>,
}

impl Script {
    pub(super) fn run(&self, master: &Master, light: &mut Light) -> Result<(), Failure> {
        let stop = until_stopped()?;
        let lines = self.lines()?;
        let prompts = self.prompts(master);
        let mut desk = Desk::new(light, master.address, master.place.baud);
        let mut number = 0_u32;
        let done = loop {
            if prompts {
                prompt();
            }
            let Some(line) = next(&lines, &mut desk, &stop)? else { break Ok(()) };
            number += 1;
            match one(&line, master.json, number, &mut desk) {
                Ok(true) => {}
                Ok(false) => break Ok(()),
                // At a prompt somebody sees it and goes on.
                Err(failure) if prompts => output::aside(&format!("error: {failure}")),
                Err(failure) => break Err(at_line(number, failure)),
            }
        };
        desk.leave();
        done
    }

    fn prompts(&self, master: &Master) -> bool {
        self.file.is_none() && !master.json && std::io::stdin().is_terminal()
    }

    /// Lines as they come. Reading is a thread's: the station wants to be asked meanwhile.
    fn lines(&self) -> Result<Receiver<String>, Failure> {
        let (to, lines) = mpsc::sync_channel(1);
        let input: Box<dyn BufRead + Send> = match &self.file {
            None => Box::new(BufReader::new(std::io::stdin())),
            Some(path) => {
                let file = std::fs::File::open(path).map_err(|error| {
                    Failure::Failed(format!("{}: cannot be read: {error}", path.display()))
                })?;
                Box::new(BufReader::new(file))
            }
        };
        std::thread::spawn(move || {
            for line in input.lines() {
                if line.map(|line| to.send(line)).is_err() {
                    return;
                }
            }
        });
        Ok(lines)
    }
}

fn prompt() {
    let mut out = std::io::stdout().lock();
    output::got_out(out.write_all(b"master> ").and_then(|()| out.flush()));
}

/// The next line; `None` at the end of them.
fn next(
    lines: &Receiver<String>,
    desk: &mut Desk<'_>,
    stop: &std::sync::atomic::AtomicBool,
) -> Result<Option<String>, Failure> {
    while !stop.load(Ordering::Relaxed) {
        match lines.recv_timeout(KEPT_ALIVE_EVERY) {
            Ok(line) => return Ok(Some(line)),
            Err(RecvTimeoutError::Disconnected) => return Ok(None),
            Err(RecvTimeoutError::Timeout) => desk.keep_alive()?,
        }
    }
    Ok(None)
}

/// Does what a line says, and prints what came of it; whether there is more to come.
fn one(line: &str, json: bool, number: u32, desk: &mut Desk<'_>) -> Result<bool, Failure> {
    let Some(command) = Command::parse(line).map_err(Failure::Usage)? else { return Ok(true) };
    if matches!(command, Command::Quit) {
        return Ok(false);
    }
    let answer = desk.act(&command)?;
    if json {
        let mut document = answer.document;
        document["line"] = number.into();
        document["command"] = line.trim().into();
        output::json_line(&document);
    } else if !answer.text.is_empty() {
        output::line(&answer.text);
    }
    Ok(true)
}

fn at_line(number: u32, failure: Failure) -> Failure {
    match failure {
        Failure::Usage(why) => Failure::Usage(format!("line {number}: {why}")),
        Failure::Failed(why) => Failure::Failed(format!("line {number}: {why}")),
    }
}
