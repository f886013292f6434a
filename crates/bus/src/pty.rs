//! A pseudo terminal as the end of a segment: masters open its terminal side like a serial port.
//!
//! | what masters run into otherwise | what is done here |
//! |---|---|
//! | A pseudo terminal does not keep even parity. When nothing else changes either, glibc's `tcsetattr` says `EINVAL`: a master that opens 8E1 at the rate the terminal has already dies | the terminal is *parked* raw at 50 baud before its name is known and after everybody has closed it, and at 50 baud again once the rate that a master chose has been read |
//! | A fresh one echoes, and turns 0D into 0A | parked raw |
//! | While nobody has the terminal side open, `poll` returns at once | it is not held open here; hang-ups are waited for at their edge, so an end that nobody uses costs nothing |
//! | The next master reads what the one before left unread | thrown away when a master leaves, and nothing is written while nobody is there |
//! | A master that does not read blocks the writer | writes never wait: what does not fit is dropped |

use std::mem::MaybeUninit;
use std::os::fd::{AsFd, OwnedFd};
use std::path::Path;
use std::sync::Arc;

use profibus_dp::time::{Baudrate, Duration};
use rustix::event::{PollFd, PollFlags, epoll, poll};
use rustix::io::{Errno, read, write};
use rustix::pty::{OpenptFlags, grantpt, ioctl_tiocgptpeer, openpt, ptsname, unlockpt};
use rustix::termios::{
    ControlModes, OptionalActions, QueueSelector, ioctl_tiocnxcl, tcflush, tcgetattr, tcsetattr,
};

use crate::brisk::Pace;
use crate::end::{End, EndError, Event, Waker, Written};
use crate::wake::{EventFd, timespec};

/// The rate of a parked terminal, which no master of a bus ever chooses.
const PARKED: u32 = 50;

/// After a pause of this length the rate is looked at again: a master that changes its rate, or
/// closes and opens again so fast that no hang-up is seen, takes longer than this.
const PAUSE: std::time::Duration = std::time::Duration::from_micros(100);

/// The controlling side of a pseudo terminal.
#[derive(Debug)]
pub struct PtyEnd {
    controller: OwnedFd,
    /// Watches the edges of `controller`, for when nobody is there.
    edges: OwnedFd,
    wake: Arc<EventFd>,
    name: String,
    presence: Presence,
    /// The rate that the master chose.
    rate: Option<Baudrate>,
    /// What is known to be ready already.
    ready: PollFlags,
    pace: Pace,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Presence {
    /// Nobody has sent octets since the last hang-up.
    Away,
    There,
    /// Octets came together with a hang-up: they may be read, but nobody waits for a reply.
    HungUp,
}

impl PtyEnd {
    /// Opens a new pseudo terminal; its [`name`](End::name) can be opened from now on.
    ///
    /// # Errors
    ///
    /// The system has none left, or none at all.
    pub fn open() -> Result<Self, EndError> {
        let failed = |step| move |error: Errno| EndError::Pty { step, source: error.into() };
        let controller =
            openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).map_err(failed("open"))?;
        rustix::io::ioctl_fionbio(&controller, true).map_err(failed("open"))?;
        grantpt(&controller).map_err(failed("own"))?;
        let name = ptsname(&controller, Vec::new()).map_err(failed("name"))?;
        park(&controller).map_err(failed("set up"))?;
        unlockpt(&controller).map_err(failed("unlock"))?;
        let wake = EventFd::new().map_err(failed("watch"))?;
        let edges = epoll::create(epoll::CreateFlags::CLOEXEC).map_err(failed("watch"))?;
        let flags = epoll::EventFlags::IN | epoll::EventFlags::ET;
        epoll::add(&edges, &controller, epoll::EventData::new_u64(0), flags).map_err(failed("watch"))?;
        Ok(Self {
            controller,
            edges,
            wake: Arc::new(wake),
            name: name.to_string_lossy().into_owned(),
            presence: Presence::Away,
            rate: None,
            ready: PollFlags::empty(),
            pace: Pace::new(),
        })
    }

    /// The terminal side, as a path.
    pub fn path(&self) -> &Path {
        Path::new(&self.name)
    }

    fn broken(&self, step: &'static str) -> impl FnOnce(Errno) -> EndError {
        let name = self.name.clone();
        move |error| EndError::Broken { name, step, source: error.into() }
    }

    /// Looks for octets until the master is no longer brisk.
    #[inline]
    fn catch(&mut self, timeout: Option<Duration>, buffer: &mut [u8]) -> Option<Event> {
        let begun = std::time::Instant::now();
        if self.pace.pause(begun) > PAUSE {
            // The rate is to be looked at before the next octets.
            self.pace.relax();
            return None;
        }
        let Self { controller, wake, pace, .. } = self;
        pace.catch(begun, timeout, wake, || read(&*controller, &mut *buffer)).map(Event::Octets)
    }

    /// Waits until the terminal or the waker is ready; `None`: there is something to look at.
    #[inline]
    fn sleep(&mut self, timeout: Option<Duration>) -> Result<Option<Event>, Errno> {
        let timeout = timeout.map(timespec);
        let away = self.presence == Presence::Away;
        let watched = if away { self.edges.as_fd() } else { self.controller.as_fd() };
        let mut watch =
            [PollFd::from_borrowed_fd(watched, PollFlags::IN), PollFd::new(&*self.wake, PollFlags::IN)];
        if self.wake.is_set() {
            self.wake.clear();
            return Ok(Some(Event::Woken));
        }
        match poll(&mut watch, timeout.as_ref()) {
            Ok(0) | Err(Errno::INTR) => return Ok(Some(Event::TimedOut)),
            Ok(_) => {}
            Err(error) => return Err(error),
        }
        let [terminal, wake] = watch.map(|watched| watched.revents());
        if wake.is_empty() {
            self.ready = terminal;
        } else {
            self.wake.clear();
            // An edge shows once only, and is looked at the next time; a level shows again.
            return Ok(Some(Event::Woken));
        }
        if away {
            self.ready = self.edge()?;
        }
        Ok(None)
    }

    /// What the edge was about.
    fn edge(&self) -> Result<PollFlags, Errno> {
        let mut events = [MaybeUninit::<epoll::Event>::uninit(); 1];
        let (events, _) = epoll::wait(&self.edges, &mut events, Some(&timespec(Duration::ZERO)))?;
        let flags = events.first().map_or(epoll::EventFlags::empty(), |event| event.flags);
        Ok(PollFlags::from_bits_truncate(u16::try_from(flags.bits()).unwrap_or(0)))
    }

    /// Looks at what is ready; `None`: nothing that matters to anybody else.
    #[inline]
    fn look(&mut self, buffer: &mut [u8]) -> Result<Option<Event>, Errno> {
        let ready = std::mem::replace(&mut self.ready, PollFlags::empty());
        if !ready.contains(PollFlags::IN) {
            return if ready.is_empty() { Ok(None) } else { self.hang_up() };
        }
        let now = std::time::Instant::now();
        if (self.presence == Presence::Away || self.pace.pause(now) > PAUSE)
            && let Some(event) = self.look_at_rate()?
        {
            self.ready = ready;
            self.pace.begin(now);
            return Ok(Some(event));
        }
        match read(&self.controller, buffer) {
            Ok(0) | Err(Errno::IO) => self.hang_up(),
            Ok(count) => {
                self.pace.slept(now);
                self.presence =
                    if ready.contains(PollFlags::HUP) { Presence::HungUp } else { Presence::There };
                Ok(Some(Event::Octets(count)))
            }
            Err(Errno::AGAIN | Errno::INTR) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Reads the rate that a master has set, and parks the rate so that the next one differs.
    #[cold]
    fn look_at_rate(&mut self) -> Result<Option<Event>, Errno> {
        let mut settings = tcgetattr(&self.controller)?;
        let speed = settings.output_speed();
        let rate = Baudrate::from_bits_per_second(speed);
        let known = self.rate;
        if speed != PARKED {
            // Nothing but the rate: the rest is the master's own.
            settings.set_speed(PARKED)?;
            tcsetattr(&self.controller, OptionalActions::Now, &settings)?;
            self.rate = rate;
        }
        if self.presence == Presence::Away {
            self.rate = rate;
            self.presence = Presence::There;
            return Ok(Some(Event::Came(rate)));
        }
        Ok((self.rate != known).then_some(Event::Rate(self.rate)))
    }

    /// Nobody has the terminal side open any more, or had it a moment ago.
    #[cold]
    fn hang_up(&mut self) -> Result<Option<Event>, Errno> {
        let was_there = self.presence != Presence::Away;
        if was_there {
            self.throw_away_unread()?;
        }
        let settings = tcgetattr(&self.controller)?;
        if settings.output_speed() != PARKED || is_cooked(&settings) {
            self.park_if_nobody_is_there()?;
        }
        self.presence = Presence::Away;
        Ok(was_there.then_some(Event::Left))
    }

    fn park_if_nobody_is_there(&self) -> Result<(), Errno> {
        let mut watch = [PollFd::new(&self.controller, PollFlags::IN)];
        poll(&mut watch, Some(&timespec(Duration::ZERO)))?;
        // The next master may have set its rate already: it is read with his first octets.
        if watch[0].revents().contains(PollFlags::HUP) { park(&self.controller) } else { Ok(()) }
    }

    /// Replies that nobody has read: the next master would take them for answers to him.
    fn throw_away_unread(&self) -> Result<(), Errno> {
        tcflush(&self.controller, QueueSelector::OFlush)?;
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        match ioctl_tiocgptpeer(&self.controller, flags) {
            Ok(terminal) => {
                // A master that was killed may have left it claimed for himself alone.
                ioctl_tiocnxcl(&terminal)?;
                tcflush(terminal, QueueSelector::IFlush)
            }
            // So it is, and only a privileged user may open it now.
            Err(Errno::BUSY) => Ok(()),
            Err(error) => Err(error),
        }
    }
}

impl End for PtyEnd {
    #[inline]
    fn wait(&mut self, timeout: Option<Duration>, buffer: &mut [u8]) -> Result<Event, EndError> {
        if self.ready.is_empty() {
            if self.pace.is_brisk()
                && self.presence == Presence::There
                && let Some(event) = self.catch(timeout, buffer)
            {
                return Ok(event);
            }
            match self.sleep(timeout) {
                Ok(None) => {}
                Ok(Some(event)) => return Ok(event),
                Err(error) => return Err(self.broken("wait at")(error)),
            }
        }
        match self.look(buffer) {
            Ok(event) => Ok(event.unwrap_or(Event::TimedOut)),
            Err(error) => Err(self.broken("read from")(error)),
        }
    }

    #[inline]
    fn write(&mut self, octets: &[u8]) -> Result<Written, EndError> {
        if self.presence != Presence::There {
            return Ok(Written::Dropped(octets.len()));
        }
        match write(&self.controller, octets) {
            Ok(count) if count == octets.len() => Ok(Written::All),
            Ok(count) => Ok(Written::Dropped(octets.len() - count)),
            Err(Errno::AGAIN | Errno::INTR | Errno::IO) => Ok(Written::Dropped(octets.len())),
            Err(error) => Err(self.broken("write to")(error)),
        }
    }

    fn name(&self) -> &str {
        &self.name
    }

    fn waker(&self) -> Waker {
        let wake: Arc<EventFd> = Arc::clone(&self.wake);
        Waker::new(wake)
    }
}

/// Raw, 8N1, 50 baud: every master's settings differ from it in the rate at least.
fn park(controller: &OwnedFd) -> Result<(), Errno> {
    let mut settings = tcgetattr(controller)?;
    settings.make_raw();
    settings.control_modes |= ControlModes::CREAD | ControlModes::CLOCAL;
    settings.set_speed(PARKED)?;
    tcsetattr(controller, OptionalActions::Now, &settings)
}

fn is_cooked(settings: &rustix::termios::Termios) -> bool {
    let mut raw = settings.clone();
    raw.make_raw();
    raw.input_modes != settings.input_modes
        || raw.output_modes != settings.output_modes
        || raw.local_modes != settings.local_modes
}
