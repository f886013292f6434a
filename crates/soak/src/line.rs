//! One bus for two masters, who remember when they asked.

use std::cell::{RefCell, RefMut};
use std::rc::Rc;

use bus::{Answer, EndError, VirtualSegment};
use master::line::{Heard, Line, ReplyBuffer};
use profibus_dp::time::{Duration, Instant};

use crate::station::SoakStation;

/// The bus, and the ends of the attempts at the newest request.
#[derive(Debug)]
pub(crate) struct Bus {
    pub(crate) segment: VirtualSegment<SoakStation>,
    attempts: [Instant; 4],
    count: usize,
}

/// The bus as one of several sees it.
#[derive(Debug, Clone)]
pub(crate) struct Shared(Rc<RefCell<Bus>>);

impl Shared {
    pub(crate) fn new(segment: VirtualSegment<SoakStation>) -> Self {
        Self(Rc::new(RefCell::new(Bus { segment, attempts: [Instant::ZERO; 4], count: 0 })))
    }

    pub(crate) fn bus(&self) -> RefMut<'_, Bus> {
        self.0.borrow_mut()
    }

    /// From here on attempts are counted anew.
    pub(crate) fn begin_request(&self) {
        self.bus().count = 0;
    }

    /// When the attempts since then ended.
    pub(crate) fn attempts(&self) -> ([Instant; 4], usize) {
        let bus = self.bus();
        (bus.attempts, bus.count)
    }
}

impl Line for Shared {
    fn now(&self) -> Instant {
        self.bus().segment.now()
    }

    fn ask(&mut self, request: &[u8], reply: &mut ReplyBuffer) -> Result<Heard, EndError> {
        let Bus { segment, attempts, count } = &mut *self.bus();
        segment.send_only(request);
        let asked = segment.now();
        attempts[*count % 4] = asked;
        *count = (*count + 1).min(4);
        Ok(match segment.listen() {
            Answer::Reply(heard) => {
                let length = heard.octets.len().min(reply.len());
                reply[..length].copy_from_slice(&heard.octets[..length]);
                Heard { length, delay: heard.delay, damaged: heard.damaged }
            }
            Answer::Silence { until } => Heard::silence(until.since(asked)),
        })
    }

    fn tell(&mut self, octets: &[u8]) -> Result<(), EndError> {
        self.bus().segment.send_only(octets);
        Ok(())
    }

    fn wait(&mut self, span: Duration) -> Result<(), EndError> {
        self.bus().segment.wait(span);
        Ok(())
    }
}
