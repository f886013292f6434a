//! What is on a segment, as packets, for whoever shows it while it happens.

use std::sync::Arc;

use profibus_dp::time::Instant;

use super::{Shared, Store, Tap, tell};
use crate::assembler::Assembler;
use crate::packet::Packet;

/// Packets of one segment, taken when it suits. The segment never waits: what finds no room is counted.
#[derive(Debug, Default)]
pub struct Listener {
    shared: Arc<Shared>,
    taken: Store,
    assembler: Assembler,
}

impl Listener {
    /// One that has heard nothing so far.
    pub fn new() -> Self {
        Self::default()
    }

    /// Who listens for it on the segment. The times of the packets are those of the segment's clock.
    pub fn tap(&self) -> Tap {
        Tap { shared: Arc::clone(&self.shared), writer: None, origin: Some(0), is_virtual: false }
    }

    /// What has come since the last time; `now` is the time on the segment. Says how many events are missing.
    pub fn take(&mut self, now: Instant, take: &mut dyn FnMut(Packet)) -> u64 {
        let Self { shared, taken, assembler } = self;
        shared.lock().hand_over(taken);
        if taken.events.is_empty() {
            assembler.pass(now.as_nanos(), take);
        }
        taken.drain(|nanos, what, octets| tell(assembler, nanos, what, octets, take));
        if taken.missing > 0 {
            assembler.finish(take);
        }
        std::mem::take(&mut taken.missing)
    }
}
