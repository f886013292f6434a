//! The bus as a replay needs it: octets out, a telegram back.

use std::time::{Duration, Instant as Moment};

use bus::{End, EndError, Event, Written};
use profibus_dp::wire::telegram::{Parsed, parse};

/// Somebody comes to the far side within that, or what is sent is lost.
const COMING: Duration = Duration::from_secs(2);

pub(super) struct Line {
    end: Box<dyn End>,
    there: bool,
}

impl Line {
    pub(super) fn new(end: Box<dyn End>) -> Self {
        Self { end, there: false }
    }

    /// Waits until somebody can be there.
    pub(super) fn come(&mut self) -> Result<(), EndError> {
        let until = Moment::now() + COMING;
        while !self.there && Moment::now() < until {
            self.take(until)?;
        }
        Ok(())
    }

    /// Lets time pass; what comes belongs to nothing.
    pub(super) fn idle_until(&mut self, until: Moment) -> Result<(), EndError> {
        while Moment::now() < until {
            self.take(until)?;
        }
        Ok(())
    }

    pub(super) fn send(&mut self, octets: &[u8]) -> Result<(), EndError> {
        match self.end.write(octets)? {
            // Lost octets are lost telegrams: the answer will be missing.
            Written::All | Written::Dropped(_) => Ok(()),
        }
    }

    /// A telegram, or what there is of one after `patience`.
    pub(super) fn listen(&mut self, patience: Duration) -> Result<Vec<u8>, EndError> {
        let until = Moment::now() + patience;
        let mut got = Vec::new();
        loop {
            got.extend(self.take(until)?);
            let whole = !got.is_empty() && !matches!(parse(&got), Parsed::Incomplete { .. });
            if whole || Moment::now() >= until {
                return Ok(got);
            }
        }
    }

    fn take(&mut self, until: Moment) -> Result<Vec<u8>, EndError> {
        let mut buffer = [0; 1024];
        let left = until.saturating_duration_since(Moment::now());
        let nanos = u64::try_from(left.as_nanos()).unwrap_or(u64::MAX);
        match self.end.wait(Some(profibus_dp::time::Duration::from_nanos(nanos)), &mut buffer)? {
            Event::Octets(count) => return Ok(buffer.get(..count).unwrap_or_default().to_vec()),
            Event::Came(_) => self.there = true,
            Event::Left => self.there = false,
            _ => {}
        }
        Ok(Vec::new())
    }
}
