//! A bus as a master sees it: octets out, octets back, and time.

use bus::{Answer, EndError, VirtualSegment};
use profibus_dp::Station;
use profibus_dp::time::{Duration, Instant};
use profibus_dp::wire::telegram::MAX_OCTETS;

/// Room for a reply, and for one that comes twice.
pub type ReplyBuffer = [u8; 2 * MAX_OCTETS];

/// What came back after a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Heard {
    /// So many octets are at the start of the buffer; 0: nothing came within the slot time.
    pub length: usize,
    /// From the end of the request to the start of the reply; in real time, to when it was there.
    pub delay: Duration,
    /// The line has seen character errors.
    pub damaged: bool,
}

impl Heard {
    /// Nothing came, and it was waited for so long.
    pub const fn silence(waited: Duration) -> Self {
        Self { length: 0, delay: waited, damaged: false }
    }
}

/// A bus as a master sees it.
pub trait Line {
    /// The time on the bus.
    fn now(&self) -> Instant;

    /// Sends a request, and waits for a reply until the slot time is over.
    ///
    /// # Errors
    ///
    /// The line is broken for good; silence is none.
    fn ask(&mut self, request: &[u8], reply: &mut ReplyBuffer) -> Result<Heard, EndError>;

    /// Sends what nobody answers.
    ///
    /// # Errors
    ///
    /// The line is broken for good.
    fn tell(&mut self, octets: &[u8]) -> Result<(), EndError>;

    /// Lets time pass.
    ///
    /// # Errors
    ///
    /// The line is broken for good.
    fn wait(&mut self, span: Duration) -> Result<(), EndError>;
}

impl<L: Line + ?Sized> Line for &mut L {
    fn now(&self) -> Instant {
        (**self).now()
    }

    fn ask(&mut self, request: &[u8], reply: &mut ReplyBuffer) -> Result<Heard, EndError> {
        (**self).ask(request, reply)
    }

    fn tell(&mut self, octets: &[u8]) -> Result<(), EndError> {
        (**self).tell(octets)
    }

    fn wait(&mut self, span: Duration) -> Result<(), EndError> {
        (**self).wait(span)
    }
}

impl<S: Station> Line for VirtualSegment<S> {
    #[inline]
    fn now(&self) -> Instant {
        VirtualSegment::now(self)
    }

    #[inline]
    fn ask(&mut self, request: &[u8], reply: &mut ReplyBuffer) -> Result<Heard, EndError> {
        self.send_only(request);
        let asked = VirtualSegment::now(self);
        Ok(match self.listen() {
            Answer::Reply(heard) => {
                let length = heard.octets.len();
                reply[..length].copy_from_slice(heard.octets);
                Heard { length, delay: heard.delay, damaged: heard.damaged }
            }
            Answer::Silence { until } => Heard::silence(until.since(asked)),
        })
    }

    fn tell(&mut self, octets: &[u8]) -> Result<(), EndError> {
        self.send_only(octets);
        Ok(())
    }

    fn wait(&mut self, span: Duration) -> Result<(), EndError> {
        VirtualSegment::wait(self, span);
        Ok(())
    }
}
