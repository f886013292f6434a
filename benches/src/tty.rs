//! A master's end of a terminal, and a PTY made by hand.

use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::os::fd::{AsFd, OwnedFd};
use std::path::Path;

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, QueueSelector, SpecialCodeIndex, tcflush, tcgetattr, tcsetattr};

const RATE: u32 = 500_000;

/// A terminal as a master opens it: raw, at 500 kbit/s, with reads that end after two seconds.
pub(crate) struct Port(File);

impl Port {
    pub(crate) fn open(path: &Path) -> Result<Self, String> {
        Self::open_for(path, 20)
    }

    /// The same, with reads that end after so many tenths of a second.
    pub(crate) fn open_for(path: &Path, patience: u8) -> Result<Self, String> {
        let trouble =
            |what: &str, error: &dyn std::fmt::Display| format!("{}: {what}: {error}.", path.display());
        let file =
            OpenOptions::new().read(true).write(true).open(path).map_err(|error| trouble("open", &error))?;
        raw(&file, Some(patience)).map_err(|error| trouble("raw mode", &error))?;
        Ok(Self(file))
    }

    /// Sends a request and reads an answer of that length.
    pub(crate) fn turn(&mut self, request: &[u8], answer: &mut [u8]) -> Result<(), String> {
        match self.ask(request, answer)? {
            length if length == answer.len() => Ok(()),
            length => Err(format!("No answer to {request:02x?}; so far {:02x?}.", &answer[..length])),
        }
    }

    /// The same; says how much of the answer came in time.
    pub(crate) fn ask(&mut self, request: &[u8], answer: &mut [u8]) -> Result<usize, String> {
        self.0.write_all(request).map_err(|error| format!("The request cannot be sent: {error}."))?;
        let mut length = 0;
        while length < answer.len() {
            match self.0.read(&mut answer[length..]) {
                Ok(0) => break,
                Ok(more) => length += more,
                Err(error) => return Err(format!("The answer cannot be read: {error}.")),
            }
        }
        Ok(length)
    }

    /// Forgets what came too late for its request.
    pub(crate) fn forget(&mut self) -> Result<(), String> {
        tcflush(&self.0, QueueSelector::IFlush)
            .map_err(|error| format!("The terminal cannot be flushed: {error}."))
    }
}

fn raw(terminal: impl AsFd, patience: Option<u8>) -> rustix::io::Result<()> {
    let mut settings = tcgetattr(&terminal)?;
    settings.make_raw();
    settings.set_speed(RATE)?;
    if let Some(patience) = patience {
        settings.special_codes[SpecialCodeIndex::VMIN] = 0;
        settings.special_codes[SpecialCodeIndex::VTIME] = patience;
    }
    tcsetattr(&terminal, OptionalActions::Now, &settings)
}

/// A new PTY, raw, and the name of its other side.
pub(crate) fn make_pty() -> Result<(File, String), String> {
    let open = || -> rustix::io::Result<(OwnedFd, String)> {
        let own = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        grantpt(&own)?;
        unlockpt(&own)?;
        raw(&own, None)?;
        let name = ptsname(&own, Vec::new())?;
        Ok((own, name.to_string_lossy().into_owned()))
    };
    let (own, name) = open().map_err(|error| format!("No PTY can be had: {error}."))?;
    Ok((File::from(own), name))
}
