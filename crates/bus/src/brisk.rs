//! Masters whose requests follow each other so fast that it does not pay to sleep in between.

use std::time::{Duration as Time, Instant as Moment};

use profibus_dp::time::Duration;
use rustix::io::Errno;

use crate::wake::EventFd;

/// Requests that follow each other within this are caught without going to sleep in between: falling
/// asleep and waking up would take longer than they do.
const BRISK: Time = Time::from_micros(40);

/// When none came in this time, that was work for nothing: so many are slept for after it. So an attempt
/// costs next to nothing with masters that are not always brisk, or on a busy computer.
const SLEEPY: u32 = 64;

/// How fast a master goes on.
#[derive(Debug)]
pub(crate) struct Pace {
    last_octets: Moment,
    /// The newest octets came within [`BRISK`].
    brisk: bool,
    /// So many reads are to be slept for before they may be caught again.
    sleepy: u32,
}

impl Pace {
    pub(crate) fn new() -> Self {
        Self { last_octets: Moment::now(), brisk: false, sleepy: 0 }
    }

    /// Whether the next octets should be [caught](Self::catch).
    #[inline]
    pub(crate) fn is_brisk(&self) -> bool {
        self.brisk
    }

    /// How long ago the newest octets came.
    #[inline]
    pub(crate) fn pause(&self, now: Moment) -> Time {
        now.duration_since(self.last_octets)
    }

    /// As if octets had come now.
    pub(crate) fn begin(&mut self, now: Moment) {
        self.last_octets = now;
    }

    /// Octets have come that were slept for.
    #[inline]
    pub(crate) fn slept(&mut self, now: Moment) {
        self.sleepy = self.sleepy.saturating_sub(1);
        self.brisk = self.sleepy == 0 && self.pause(now) < BRISK;
        self.last_octets = now;
    }

    /// The next octets are slept for.
    pub(crate) fn relax(&mut self) {
        self.brisk = false;
    }

    /// Looks for octets until the master is no longer brisk; says how many there are, if any.
    #[inline]
    pub(crate) fn catch(
        &mut self,
        begun: Moment,
        timeout: Option<Duration>,
        wake: &EventFd,
        mut read: impl FnMut() -> Result<usize, Errno>,
    ) -> Option<usize> {
        let patience = timeout.map_or(BRISK, |timeout| BRISK.min(timeout.into()));
        while !wake.is_set() {
            match read() {
                Ok(count) if count > 0 => {
                    self.last_octets = begun;
                    return Some(count);
                }
                // The master, or the kernel's thread that carries octets across, may need this processor.
                Err(Errno::AGAIN | Errno::INTR) if begun.elapsed() < patience => std::thread::yield_now(),
                _ => break,
            }
        }
        (self.brisk, self.sleepy) = (false, SLEEPY);
        None
    }
}
