//! A master's end of a terminal, and a PTY made by hand.

use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::os::fd::{AsFd, OwnedFd};
use std::path::Path;

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, SpecialCodeIndex, tcgetattr, tcsetattr};

const RATE: u32 = 500_000;

/// A terminal as a master opens it: raw, at 500 kbit/s, with reads that end after two seconds.
pub(crate) struct Port(File);

impl Port {
    pub(crate) fn open(path: &Path) -> Result<Self, String> {
        let trouble =
            |what: &str, error: &dyn std::fmt::Display| format!("{}: {what}: {error}.", path.display());
        let file =
            OpenOptions::new().read(true).write(true).open(path).map_err(|error| trouble("open", &error))?;
        raw(&file, true).map_err(|error| trouble("raw mode", &error))?;
        Ok(Self(file))
    }

    /// Sends a request and reads an answer of that length.
    pub(crate) fn turn(&mut self, request: &[u8], answer: &mut [u8]) -> Result<(), String> {
        self.0.write_all(request).map_err(|error| format!("The request cannot be sent: {error}."))?;
        let mut length = 0;
        while length < answer.len() {
            match self.0.read(&mut answer[length..]) {
                Ok(0) => {
                    return Err(format!("No answer to {request:02x?}; so far {:02x?}.", &answer[..length]));
                }
                Ok(more) => length += more,
                Err(error) => return Err(format!("The answer cannot be read: {error}.")),
            }
        }
        Ok(())
    }
}

fn raw(terminal: impl AsFd, timeout: bool) -> rustix::io::Result<()> {
    let mut settings = tcgetattr(&terminal)?;
    settings.make_raw();
    settings.set_speed(RATE)?;
    if timeout {
        settings.special_codes[SpecialCodeIndex::VMIN] = 0;
        settings.special_codes[SpecialCodeIndex::VTIME] = 20;
    }
    tcsetattr(&terminal, OptionalActions::Now, &settings)
}

/// A new PTY, raw, and the name of its other side.
pub(crate) fn make_pty() -> Result<(File, String), String> {
    let open = || -> rustix::io::Result<(OwnedFd, String)> {
        let own = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        grantpt(&own)?;
        unlockpt(&own)?;
        raw(&own, false)?;
        let name = ptsname(&own, Vec::new())?;
        Ok((own, name.to_string_lossy().into_owned()))
    };
    let (own, name) = open().map_err(|error| format!("No PTY can be had: {error}."))?;
    Ok((File::from(own), name))
}
