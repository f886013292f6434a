//! An end of a real bus as a master's line.

use bus::{End, EndError, Event, WallClock, Written};
use profibus_dp::time::{Duration, Instant};
use profibus_dp::wire::telegram::{self, Parsed};

use crate::line::{Heard, Line, ReplyBuffer};

/// How long a reply may take where no operating system answers within a few bit times.
pub const USUAL_SLOT: Duration = Duration::from_millis(20);

/// A line over an end: a serial port, a pseudo terminal, a socket or memory.
#[derive(Debug)]
pub struct Wire {
    end: Box<dyn End>,
    clock: WallClock,
    slot: Duration,
    /// Octets are given to the end and may be on their way still; a serial port takes this long for each.
    octet: Duration,
    gone: bool,
}

impl Wire {
    /// A line that waits [`USUAL_SLOT`] for a reply.
    pub fn new(end: Box<dyn End>) -> Self {
        Self { end, clock: WallClock::new(), slot: USUAL_SLOT, octet: Duration::ZERO, gone: false }
    }

    /// Waits so long for a reply, and for the rest of one that has begun.
    #[must_use]
    pub fn with_slot_time(mut self, slot: Duration) -> Self {
        self.slot = slot;
        self
    }

    /// An octet takes this long on the line, in both directions: more time is left for the answer.
    #[must_use]
    pub fn with_octet_time(mut self, octet: Duration) -> Self {
        self.octet = octet;
        self
    }

    /// What a user opened.
    pub fn name(&self) -> &str {
        self.end.name()
    }

    /// The end, for another master.
    pub fn into_end(self) -> Box<dyn End> {
        self.end
    }

    /// Waits until somebody is at the far side, which may be later where a socket listens; whether he came.
    ///
    /// # Errors
    ///
    /// The end is broken.
    pub fn await_peer(&mut self, patience: Duration) -> Result<bool, EndError> {
        let until = self.clock.now() + patience;
        let mut buffer = [0; 256];
        loop {
            let left = until.since(self.clock.now());
            if let Event::Came(_) = self.end.wait(Some(left), &mut buffer)? {
                return Ok(true);
            }
            if left == Duration::ZERO {
                return Ok(false);
            }
        }
    }

    /// Whether the far side has closed the line.
    pub fn is_gone(&self) -> bool {
        self.gone
    }

    fn note(&mut self, event: Event) {
        match event {
            Event::Left => self.gone = true,
            Event::Came(_) => self.gone = false,
            _ => {}
        }
    }

    /// Drops what has come without being asked for.
    fn clear(&mut self, buffer: &mut ReplyBuffer) -> Result<(), EndError> {
        // Whoever never stops sending does not stop this for ever.
        for _ in 0..1024 {
            let event = self.end.wait(Some(Duration::ZERO), buffer)?;
            if event == Event::TimedOut {
                break;
            }
            self.note(event);
        }
        Ok(())
    }

    fn on_the_line(&self, octets: usize) -> Duration {
        self.octet.times(u64::try_from(octets).unwrap_or(u64::MAX))
    }
}

impl Line for Wire {
    fn now(&self) -> Instant {
        self.clock.now()
    }

    fn ask(&mut self, request: &[u8], reply: &mut ReplyBuffer) -> Result<Heard, EndError> {
        self.clear(reply)?;
        let asked = self.clock.now();
        // Dropped octets are octets that are not answered.
        let (Written::All | Written::Dropped(_)) = self.end.write(request)?;
        let mut until = asked + self.on_the_line(request.len()) + self.slot;
        let mut length = 0;
        loop {
            let now = self.clock.now();
            let left = until.since(now);
            let Some(room) = reply.get_mut(length..).filter(|room| !room.is_empty() && left > Duration::ZERO)
            else {
                return Ok(Heard { length, delay: now.since(asked), damaged: false });
            };
            match self.end.wait(Some(left), room)? {
                Event::Octets(count) => length += count,
                event => {
                    self.note(event);
                    if event == Event::Left {
                        length = 0;
                    }
                    continue;
                }
            }
            let now = self.clock.now();
            match telegram::parse(&reply[..length]) {
                Parsed::Incomplete { missing } => until = now + self.slot + self.on_the_line(missing),
                Parsed::Complete(..) | Parsed::Invalid(_) => {
                    return Ok(Heard { length, delay: now.since(asked), damaged: false });
                }
            }
        }
    }

    fn tell(&mut self, octets: &[u8]) -> Result<(), EndError> {
        let (Written::All | Written::Dropped(_)) = self.end.write(octets)?;
        let span = self.on_the_line(octets.len());
        self.wait(span)
    }

    fn wait(&mut self, span: Duration) -> Result<(), EndError> {
        let until = self.clock.now() + span;
        let mut buffer = [0; 256];
        loop {
            let left = until.since(self.clock.now());
            if left == Duration::ZERO {
                return Ok(());
            }
            // What comes meanwhile is for nobody.
            let event = self.end.wait(Some(left), &mut buffer)?;
            self.note(event);
        }
    }
}
