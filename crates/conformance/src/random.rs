//! Random octets: whatever a slave answers must have been asked.

use crate::reply::{self, Reply, hex};
use crate::rig::{Expect, Signal};
use crate::runner::{Played, Runner, Stop};

/// Octets in one go.
const CHUNK: usize = 256;
/// A go over a port, where each costs the silence after it.
const LONG_CHUNK: usize = 65_536;

impl Runner<'_> {
    /// Sends `count` random octets. The sequence is always the same one.
    pub(crate) fn random(&mut self, count: usize) -> Played {
        let mut state = 0x9E37_79B9_7F4A_7C15_u64;
        let chunk = if self.rig.abilities().exact_time { CHUNK } else { LONG_CHUNK };
        let mut left = count;
        while left > 0 {
            let octets: Vec<u8> = (0..chunk.min(left)).map(|_| random_octet(&mut state)).collect();
            left -= octets.len();
            let signals: Vec<_> = octets.iter().copied().map(Signal::Octet).collect();
            self.rig.send(&signals)?;
            let heard = self.rig.listen(Expect::Silence)?;
            if !heard.octets.is_empty() && !self.was_asked(&octets) {
                return Err(Stop::Fault(format!(
                    "random octets without a request to the slave were answered: {}",
                    hex(&heard.octets)
                )));
            }
        }
        self.note("", &format!("{count} random octets"), &[]);
        Ok(())
    }

    /// Whether octets hold a whole request to the slave anywhere.
    fn was_asked(&self, octets: &[u8]) -> bool {
        (0..octets.len()).any(|at| {
            let rest = &octets[at..];
            let Some(length) = reply::length(rest).filter(|length| *length <= rest.len()) else {
                return false;
            };
            matches!(Reply::parse(&rest[..length]), Ok(Reply::Data { da, fc, .. })
                if da == self.address && fc & 0x40 != 0)
        })
    }
}

/// xorshift: the same octets in every run, so that any of them can be repeated.
fn random_octet(state: &mut u64) -> u8 {
    *state ^= *state << 13;
    *state ^= *state >> 7;
    *state ^= *state << 17;
    // A start delimiter now and then, or hardly anything would get past the first octet.
    match state.to_be_bytes() {
        [a, b, ..] if a < 16 => [0x10, 0x68, 0xA2, 0xDC][usize::from(b & 3)],
        [_, b, ..] => b,
    }
}
