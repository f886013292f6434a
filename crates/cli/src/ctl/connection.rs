//! The way to the program that is steered.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixStream;
use std::time::Duration;

use plant::control::ControlAddress;
use serde_json::Value;

use crate::Failure;
use crate::ctl::show;
use crate::output;

/// Longer than anything takes that can be asked for.
const PATIENCE: Duration = Duration::from_secs(10);

/// More than any reply has.
const MOST_OCTETS: u64 = 64 << 20;

pub(super) struct Connection {
    reader: BufReader<Stream>,
    name: String,
}

enum Stream {
    Unix(UnixStream),
    Tcp(TcpStream),
}

impl Stream {
    fn open(address: &ControlAddress) -> io::Result<Self> {
        match address {
            ControlAddress::Path(path) => UnixStream::connect(path).map(Self::Unix),
            ControlAddress::Tcp(address) => TcpStream::connect_timeout(address, PATIENCE).map(Self::Tcp),
        }
    }

    fn set_timeouts(&self, read: Option<Duration>) -> io::Result<()> {
        match self {
            Self::Unix(stream) => {
                stream.set_read_timeout(read).and_then(|()| stream.set_write_timeout(Some(PATIENCE)))
            }
            Self::Tcp(stream) => {
                stream.set_read_timeout(read).and_then(|()| stream.set_write_timeout(Some(PATIENCE)))
            }
        }
    }
}

impl Read for Stream {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Unix(stream) => stream.read(buffer),
            Self::Tcp(stream) => stream.read(buffer),
        }
    }
}

impl Write for Stream {
    fn write(&mut self, octets: &[u8]) -> io::Result<usize> {
        match self {
            Self::Unix(stream) => stream.write(octets),
            Self::Tcp(stream) => stream.write(octets),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Connection {
    pub(super) fn open(address: &ControlAddress) -> Result<Self, Failure> {
        let name = address.to_string();
        let failed = |error| {
            let (start, it) = match address {
                ControlAddress::Path(_) => (name.as_str(), "the path it was given"),
                ControlAddress::Tcp(_) => ("tcp:127.0.0.1:0", "the port that it prints"),
            };
            Failure::Failed(format!(
                "cannot connect to {name}: {error}; start `sch108bex run --control {start}`, or write {it}"
            ))
        };
        let stream = Stream::open(address).map_err(failed)?;
        stream.set_timeouts(Some(PATIENCE)).map_err(failed)?;
        Ok(Self { reader: BufReader::new(stream), name })
    }

    /// Sends a request and gives its reply, as it came and as a value.
    pub(super) fn ask(&mut self, line: &str) -> Result<(String, Value), Failure> {
        // One that was sent away finds a reply all the same.
        let written = self.reader.get_mut().write_all(format!("{line}\n").as_bytes());
        let mut reply = Vec::new();
        let read = self.reader.by_ref().take(MOST_OCTETS).read_until(b'\n', &mut reply);
        if let (Err(error), _) | (Ok(()), Err(error)) = (&written, &read)
            && reply.is_empty()
        {
            return Err(Failure::Failed(format!("no reply from {}: {error}", self.name)));
        }
        let line = String::from_utf8_lossy(reply.trim_ascii_end()).into_owned();
        let value = serde_json::from_str::<Value>(&line).ok().filter(|reply| reply["ok"].is_boolean());
        value.map(|value| (line, value)).ok_or_else(|| {
            Failure::Failed(format!("{} does not reply as `sch108bex run --control` does", self.name))
        })
    }

    /// Prints what happens until nobody tells it, or nobody reads it any more.
    pub(super) fn follow(mut self, json: bool) -> Result<(), Failure> {
        let lost = |error| Failure::Failed(format!("no more events: {error}"));
        self.reader.get_mut().set_timeouts(None).map_err(lost)?;
        for line in self.reader.lines() {
            let line = line.map_err(lost)?;
            let text = if json { line } else { show::event(&line) };
            if !output::try_line(&text) {
                return Ok(());
            }
        }
        Ok(())
    }
}
