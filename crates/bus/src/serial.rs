//! A serial device as the end of a segment: an RS-485 adapter, a UART, or a pseudo terminal that
//! somebody else has made.
//!
//! | what goes wrong otherwise | what is done here |
//! |---|---|
//! | A character with a parity or framing error looks like a good one | the system marks it (`INPCK`, `PARMRK`), and it is [`Event::LineError`] |
//! | The system takes settings that the driver does not have | all are read back |
//! | The kernel writes its messages to the bus | its console is not opened |
//! | A second program takes half of the octets | the device is claimed, for programs that ask (`flock`) and for those that do not (`TIOCEXCL`) |
//! | Octets of another rate are heard after a change | thrown away |
//! | An adapter keeps octets for 16 ms before it hands them over | told to keep them for 1 ms, where the driver has that |
//! | The transmitter is never switched on, or never off | RS-485 mode, where the driver has it |

mod adapter;
mod delay;
mod marks;
mod rates;
mod settings;
mod trouble;

use std::collections::VecDeque;
use std::os::fd::OwnedFd;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant as Moment;

use profibus_dp::fdl::BaudSetting;
use profibus_dp::time::{Baudrate, Duration};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::fs::{FlockOperation, Mode, OFlags, flock, open};
use rustix::io::{Errno, read, write};
use rustix::termios::{ioctl_tiocexcl, isatty};

use crate::brisk::Pace;
use crate::end::{End, EndError, Event, Note, Waker, Written};
use crate::wake::{EventFd, timespec};
pub use adapter::Latency;
use adapter::Rs485;
pub use delay::Delay;
use marks::{Found, Marks};
pub use rates::Rates;
use settings::{Kind, Refusal};
use trouble::Trouble;

/// So many octets are read at once.
const CHUNK: usize = 4096;

/// A serial device.
#[derive(Debug)]
pub struct SerialEnd {
    name: String,
    device: OwnedFd,
    kind: Kind,
    rate: Baudrate,
    /// The device refuses this rate.
    deaf: bool,
    /// Kept for its end.
    _rs485: Option<Rs485>,
    /// Still to be told.
    notes: VecDeque<Note>,
    /// For a master: somebody can be there from the beginning, and may leave.
    for_master: bool,
    /// That is still to be told.
    unannounced: bool,
    marks: Marks,
    /// What was read and not looked at: all in `read` between these.
    read: Box<[u8]>,
    rest: std::ops::Range<usize>,
    gone: bool,
    pace: Pace,
    wake: Arc<EventFd>,
}

impl SerialEnd {
    /// Opens a device for slaves: it hears one rate at a time, which [`tune`](End::tune) changes.
    ///
    /// # Errors
    ///
    /// There is no such device, it may not be opened, another program has it, it is no serial device
    /// or refuses the fixed rate, or all where one is searched.
    pub fn open(path: &Path, baud: BaudSetting) -> Result<Self, EndError> {
        Self::at(path, baud, false)
    }

    /// Opens a device for a master, with the master's rate.
    ///
    /// # Errors
    ///
    /// As [`open`](Self::open).
    pub fn open_for_master(path: &Path, rate: Baudrate) -> Result<Self, EndError> {
        Self::at(path, BaudSetting::Fixed(rate), true)
    }

    fn at(path: &Path, baud: BaudSetting, for_master: bool) -> Result<Self, EndError> {
        let trouble = Trouble::new(path);
        let kind = Kind::of(path).map_err(|error| trouble.cannot_open(error))?;
        if settings::is_console(path) {
            return Err(trouble.console());
        }
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let device = open(path, flags, Mode::empty()).map_err(|error| trouble.cannot_open(error))?;
        if !isatty(&device) {
            return Err(trouble.no_terminal());
        }
        claim(&device, kind).map_err(|error| trouble.cannot_open(error))?;
        let (rate, refused) = settings::set_up_for(&device, kind, baud)
            .map_err(|refusal| trouble.cannot_set(&device, kind, refusal))?;
        let mut notes = VecDeque::new();
        let mut rs485 = None;
        if kind == Kind::Uart {
            rs485 = Rs485::switch_on(&device);
            notes.extend(adapter::notes(&device, rs485.as_ref(), (!for_master).then_some(baud)));
        }
        if !refused.is_empty() {
            notes.push_back(Note::RatesRefused(refused));
        }
        let wake = EventFd::new().map_err(|error| trouble.cannot_open(error))?;
        Ok(Self {
            name: path.display().to_string(),
            device,
            kind,
            rate,
            deaf: false,
            _rs485: rs485,
            notes,
            for_master,
            unannounced: for_master,
            marks: Marks::default(),
            read: vec![0; CHUNK].into_boxed_slice(),
            rest: 0..0,
            gone: false,
            pace: Pace::new(),
            wake: Arc::new(wake),
        })
    }

    /// The rate it hears and sends with.
    pub fn rate(&self) -> Baudrate {
        self.rate
    }

    /// Whether it is a pseudo terminal, which has neither parity nor a rate of its own.
    pub fn is_pseudo_terminal(&self) -> bool {
        self.kind == Kind::PseudoTerminal
    }

    /// What is left of the last read; `None`: nothing.
    #[inline]
    fn look(&mut self, buffer: &mut [u8]) -> Option<Event> {
        while !self.rest.is_empty() {
            let rest = self.read.get(self.rest.clone()).unwrap_or_default();
            let (used, found) = self.marks.look(rest, buffer);
            self.rest.start += used;
            match found {
                Found::Octets(0) => {}
                Found::Octets(count) => return Some(Event::Octets(count)),
                Found::Error => return Some(Event::LineError),
            }
        }
        None
    }

    /// Waits until there is something to read, and reads it; `None`: nothing came.
    #[inline]
    fn fill(&mut self, timeout: Option<Duration>) -> Result<Option<Event>, EndError> {
        let Self { pace, wake, device, read: chunk, .. } = self;
        if pace.is_brisk()
            && let Some(count) = pace.catch(Moment::now(), timeout, wake, || read(&*device, &mut **chunk))
        {
            self.take(count);
            return Ok(None);
        }
        let timeout = timeout.map(timespec);
        // Whoever has gone would be ready for ever.
        let flags = if self.gone { PollFlags::empty() } else { PollFlags::IN };
        let mut watch = [PollFd::new(&*self.wake, PollFlags::IN), PollFd::new(&self.device, flags)];
        let watch = if self.gone { watch.split_at_mut(1).0 } else { &mut watch[..] };
        match poll(watch, timeout.as_ref()) {
            Ok(0) | Err(Errno::INTR) => return Ok(Some(Event::TimedOut)),
            Ok(_) => {}
            Err(error) => return Err(self.broken("wait at", error)),
        }
        if !watch[0].revents().is_empty() {
            self.wake.clear();
            return Ok(Some(Event::Woken));
        }
        match read(&self.device, &mut *self.read) {
            Ok(count) if count > 0 => {
                self.pace.slept(Moment::now());
                self.take(count);
                Ok(None)
            }
            Err(Errno::AGAIN | Errno::INTR) => Ok(Some(Event::TimedOut)),
            Ok(_) | Err(Errno::IO) if self.kind == Kind::PseudoTerminal && self.for_master => {
                self.gone = true;
                Ok(Some(Event::Left))
            }
            Ok(_) => Err(self.broken("read from", Errno::IO)),
            Err(error) => Err(self.broken("read from", error)),
        }
    }

    /// So many octets were read.
    fn take(&mut self, count: usize) {
        self.rest = 0..if self.deaf { 0 } else { count };
    }

    fn broken(&self, step: &'static str, error: Errno) -> EndError {
        Trouble::new(Path::new(&self.name)).broken(step, error)
    }
}

impl End for SerialEnd {
    #[inline]
    fn wait(&mut self, timeout: Option<Duration>, buffer: &mut [u8]) -> Result<Event, EndError> {
        if self.wake.is_set() {
            self.wake.clear();
            return Ok(Event::Woken);
        }
        if std::mem::take(&mut self.unannounced) {
            return Ok(Event::Came(Some(self.rate)));
        }
        if let Some(event) = self.look(buffer) {
            return Ok(event);
        }
        if let Some(note) = self.notes.pop_front() {
            return Ok(Event::Noted(note));
        }
        if let Some(event) = self.fill(timeout)? {
            return Ok(event);
        }
        Ok(self.look(buffer).unwrap_or(Event::TimedOut))
    }

    #[inline]
    fn write(&mut self, octets: &[u8]) -> Result<Written, EndError> {
        if self.gone || self.deaf {
            return Ok(Written::Dropped(octets.len()));
        }
        match write(&self.device, octets) {
            Ok(count) if count == octets.len() => Ok(Written::All),
            Ok(count) => Ok(Written::Dropped(octets.len() - count)),
            // That the far side has gone shows when it is read.
            Err(Errno::AGAIN | Errno::INTR | Errno::IO) => Ok(Written::Dropped(octets.len())),
            Err(error) => Err(self.broken("write to", error)),
        }
    }

    fn name(&self) -> &str {
        &self.name
    }

    fn is_tunable(&self) -> bool {
        !self.for_master
    }

    fn tune(&mut self, rate: Baudrate) -> Result<(), EndError> {
        if rate == self.rate && !self.deaf {
            return Ok(());
        }
        self.rest = 0..0;
        self.marks.forget();
        self.rate = rate;
        match settings::set_up(&self.device, self.kind, rate) {
            Ok(()) => self.deaf = false,
            Err(Refusal::Rate { .. }) => self.deaf = true,
            Err(refusal) => {
                return Err(Trouble::new(Path::new(&self.name)).cannot_set(&self.device, self.kind, refusal));
            }
        }
        Ok(())
    }

    fn waker(&self) -> Waker {
        let wake: Arc<EventFd> = Arc::clone(&self.wake);
        Waker::new(wake)
    }
}

/// Keeps other programs away for as long as the device is open.
fn claim(device: &OwnedFd, kind: Kind) -> Result<(), Errno> {
    match flock(device, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => {}
        Err(Errno::WOULDBLOCK) => return Err(Errno::BUSY),
        Err(error) => return Err(error),
    }
    // A pseudo terminal would stay claimed after its user has gone.
    if kind == Kind::PseudoTerminal { Ok(()) } else { ioctl_tiocexcl(device) }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

    use super::*;

    const SOON: Option<Duration> = Some(Duration::from_millis(10));

    #[test]
    fn at_a_rate_that_the_device_refuses_nothing_is_heard_or_said() {
        let far = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&far).unwrap();
        unlockpt(&far).unwrap();
        let path = PathBuf::from(ptsname(&far, Vec::new()).unwrap().into_string().unwrap());
        let mut end = SerialEnd::open(&path, BaudSetting::Fixed(Baudrate::B9600)).unwrap();
        // As after a refusal, which no pseudo terminal gives.
        end.deaf = true;
        let mut buffer = [0; 16];
        write(&far, &[0x10, 0x0B]).unwrap();
        assert_eq!(end.wait(SOON, &mut buffer).unwrap(), Event::TimedOut);
        assert_eq!(end.write(&[0xE5]).unwrap(), Written::Dropped(1));
        end.tune(Baudrate::B9600).unwrap();
        assert_eq!(end.wait(SOON, &mut buffer).unwrap(), Event::TimedOut, "what came before");
        write(&far, &[0xE5]).unwrap();
        assert_eq!(end.wait(Some(Duration::from_secs(5)), &mut buffer).unwrap(), Event::Octets(1));
        assert_eq!(end.write(&[0xE5]).unwrap(), Written::All);
    }
}
