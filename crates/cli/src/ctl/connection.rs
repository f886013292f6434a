//! The way to the program that is steered.

use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

use serde_json::Value;

use crate::Failure;
use crate::ctl::show;
use crate::output;

/// Longer than anything takes that can be asked for.
const PATIENCE: Duration = Duration::from_secs(10);

/// More than any reply has.
const MOST_OCTETS: u64 = 64 << 20;

pub(super) struct Connection {
    reader: BufReader<UnixStream>,
    name: String,
}

impl Connection {
    pub(super) fn open(path: &Path) -> Result<Self, Failure> {
        let name = path.display().to_string();
        let failed = |error| {
            Failure::Failed(format!(
                "cannot connect to {name}: {error}; start `sch108bex run --control {name}`, or write the path it was given"
            ))
        };
        let stream = UnixStream::connect(path).map_err(failed)?;
        stream.set_read_timeout(Some(PATIENCE)).map_err(failed)?;
        stream.set_write_timeout(Some(PATIENCE)).map_err(failed)?;
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
        self.reader.get_mut().set_read_timeout(None).map_err(lost)?;
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
