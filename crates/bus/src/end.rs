//! The end of a segment: where its octets come from and go to.

use std::fmt;
use std::io;
use std::sync::Arc;

use profibus_dp::time::{Baudrate, Duration};

use crate::serial::{Delay, Latency, Rates};

/// What [`End::wait`] came back with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// So many octets are in the buffer.
    Octets(usize),
    /// A character with a parity or framing error; what was octets before it has been told.
    LineError,
    /// Somebody new is at the far side, and has set this rate. Comes before his first octets.
    ///
    /// `None`: a rate that is none of the ten, or an end that has no rate.
    Came(Option<Baudrate>),
    /// The same far side has set another rate. Comes before the octets that follow.
    Rate(Option<Baudrate>),
    /// Nobody is at the far side any more; a telegram that was under way will never be complete.
    Left,
    /// Something that a user may want to know, and that changes nothing for the segment.
    Noted(Note),
    /// A [`Waker`] of this end was used.
    Woken,
    /// The time is over, or the end has had something of its own to do.
    TimedOut,
}

/// What [`Event::Noted`] is about. Prints as a sentence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Note {
    /// A second master connected while one was there, and was closed at once.
    Refused,
    /// Nobody can be reached at the far side; it is tried again. Told once for each reason.
    Unreachable(io::ErrorKind),
    /// A master that knocks cannot be let in; it is tried again. Told once for each reason.
    NotAccepted(io::ErrorKind),
    /// The driver of a serial device refuses these rates: at them nothing is heard.
    RatesRefused(Rates),
    /// Whether the driver of a serial device switches the transmitter of RS-485.
    Rs485 {
        /// It has this mode, and is in it; else the adapter must see to it.
        by_driver: bool,
    },
    /// How long a serial device may keep what it has received.
    Latency(Latency),
    /// Through the adapter of a serial device answers can be later than max T_SDR.
    Delay(Delay),
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Refused => f.write_str("a second master was refused: one is connected already"),
            Self::Unreachable(why) => {
                write!(f, "no master can be reached yet ({why}); it is tried again until one can")
            }
            Self::NotAccepted(why) => {
                write!(f, "a master cannot be accepted ({why}); it is tried again until it can")
            }
            Self::RatesRefused(rates) => {
                write!(f, "the driver refuses {rates} bit/s: no master is heard at these")
            }
            Self::Rs485 { by_driver: true } => {
                f.write_str("the driver switches the transmitter (RS-485 mode)")
            }
            Self::Rs485 { by_driver: false } => f.write_str(
                "the driver has no RS-485 mode: the adapter must switch its transmitter by itself",
            ),
            Self::Latency(latency) => latency.fmt(f),
            Self::Delay(delay) => delay.fmt(f),
        }
    }
}

/// What became of octets given to [`End::write`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[must_use]
pub enum Written {
    /// All are on their way.
    All,
    /// So many were dropped: nobody is there, or he does not read.
    Dropped(usize),
}

/// Why an end cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum EndError {
    /// The system gave no pseudo terminal.
    #[error(
        "cannot {step} a pseudo terminal: {source}; check that /dev/ptmx and /dev/pts are there and usable"
    )]
    Pty {
        /// What was tried.
        step: &'static str,
        /// What the system said.
        source: io::Error,
    },
    /// A socket cannot be had.
    #[error("cannot {step} {name}: {source}; {remedy}")]
    Socket {
        /// What was tried.
        step: &'static str,
        /// With what, as the user wrote it.
        name: String,
        /// What the system said, or what was found.
        source: io::Error,
        /// What the user can do.
        remedy: &'static str,
    },
    /// A serial device cannot be used.
    #[error("cannot {step} {name}: {source}; {remedy}")]
    Device {
        /// What was tried.
        step: &'static str,
        /// Its path.
        name: String,
        /// What the system said, or what was found.
        source: io::Error,
        /// What the user can do.
        remedy: String,
    },
    /// A port that does not serve the purpose.
    #[error("{name} does not serve here: {why}")]
    Unfit {
        /// The port, as the user wrote it.
        name: String,
        /// Why, and what to write instead.
        why: &'static str,
    },
    /// The end broke while it was in use.
    #[error("cannot {step} {name}: {source}; start the segment again")]
    Broken {
        /// The end's name.
        name: String,
        /// What was tried.
        step: &'static str,
        /// What the system said.
        source: io::Error,
    },
}

/// Where a segment's octets come from and go to. One thread uses it.
pub trait End: Send + fmt::Debug {
    /// Waits for something to happen, at most for `timeout` (`None`: for ever).
    ///
    /// Octets are put at the start of `buffer`, which must not be empty.
    ///
    /// # Errors
    ///
    /// The end is broken for good; masters that come and go are no errors.
    fn wait(&mut self, timeout: Option<Duration>, buffer: &mut [u8]) -> Result<Event, EndError>;

    /// Sends octets without ever waiting.
    ///
    /// # Errors
    ///
    /// The end is broken for good; what nobody takes is [`Written::Dropped`].
    fn write(&mut self, octets: &[u8]) -> Result<Written, EndError>;

    /// What a user opens to get to the far side, such as `/dev/pts/3`.
    fn name(&self) -> &str;

    /// Whether masters set a rate here: [`Event::Came`] with `None` is then a rate that is none of
    /// the ten.
    fn has_rate(&self) -> bool {
        true
    }

    /// Whether it hears one rate at a time, which [`tune`](Self::tune) chooses: a serial device.
    ///
    /// On such an end octets take their time, so replies keep min T_SDR.
    fn is_tunable(&self) -> bool {
        false
    }

    /// Hears and sends at this rate from now on; what came at another is thrown away. Where the device
    /// refuses the rate, nothing is heard until the next call.
    ///
    /// # Errors
    ///
    /// The end is broken for good.
    fn tune(&mut self, rate: Baudrate) -> Result<(), EndError> {
        let _ = rate;
        Ok(())
    }

    /// Something that ends a [`wait`](Self::wait) from any thread.
    fn waker(&self) -> Waker;
}

/// What a kind of end does to end a wait.
pub trait Wake: Send + Sync {
    /// Ends the wait that goes on, or the next one.
    fn wake(&self);
}

/// Ends the [`End::wait`] of one end, from any thread; clones do the same.
#[derive(Clone)]
pub struct Waker(Arc<dyn Wake>);

impl Waker {
    /// A waker that calls `wake`.
    pub fn new(wake: Arc<dyn Wake>) -> Self {
        Self(wake)
    }

    /// Ends the wait that goes on, or the next one.
    pub fn wake(&self) {
        self.0.wake();
    }
}

impl fmt::Debug for Waker {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Waker")
    }
}
