//! Random octets: whatever a slave answers must have been asked.

use profibus_dp::time::Duration;

use crate::reply::{self, Reply, hex};
use crate::rig::{Expect, Signal};
use crate::runner::{Played, Runner, Stop};

/// Octets in one go where time is virtual, each go with the silence after it.
const CHUNK: usize = 256;
/// In one go over a port; a pseudo terminal holds no more than four of these.
const PORT_CHUNK: usize = 4_096;
/// How long a slave behind a port gets to read them.
const READING: Duration = Duration::from_millis(3);

impl Runner<'_> {
    /// Sends `count` random octets. The sequence is always the same one.
    pub(crate) fn random(&mut self, count: usize) -> Played {
        let mut state = 0x9E37_79B9_7F4A_7C15_u64;
        let exact = self.rig.abilities().exact_time;
        let mut asked = Vec::new();
        let mut left = count;
        while left > 0 {
            let length = left.min(if exact { CHUNK } else { PORT_CHUNK });
            let octets: Vec<u8> = (0..length).map(|_| random_octet(&mut state)).collect();
            left -= length;
            let signals: Vec<_> = octets.iter().copied().map(Signal::Octet).collect();
            self.rig.send(&signals)?;
            let came =
                if exact { self.rig.listen(Expect::Silence)?.octets } else { self.rig.wait(READING)? };
            // The end of one go and the beginning of the next may be a request together.
            asked.drain(..asked.len().saturating_sub(PORT_CHUNK));
            asked.extend(octets);
            if !came.is_empty() && !self.was_asked(&asked) {
                return Err(Stop::Fault(format!(
                    "random octets without a request to the slave were answered: {}",
                    hex(&came)
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
