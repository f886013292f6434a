//! TCP and Unix sockets as the end of a segment: for masters on other computers, in containers, and for
//! those that insist on even parity, which no pseudo terminal keeps.
//!
//! | what masters run into otherwise | what is done here |
//! |---|---|
//! | Two masters at once hear each other's replies | one is served; another one is closed at once and noted, until the first has gone |
//! | A master that closes and connects again at once finds its own old connection in the way | a connection that the far side has closed does not count as one, though what came on it is served first |
//! | A master whose computer was switched off is never known to have gone | it is asked for signs of life after 5 s of silence, and given up 6 s later |
//! | Small telegrams wait for each other's acknowledgement, 40 ms a turn | `TCP_NODELAY` |
//! | A master that does not read blocks the writer, and later reads the replies of an hour | writes never wait, and only some 32 kB are kept for him: what does not fit is dropped |
//! | The socket's file is left behind by `kill -9` | a file that nobody listens on is replaced |

mod address;
mod connect;
mod dial;
mod open;
mod retry;

use std::os::fd::OwnedFd;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration as Time, Instant as Moment};

use profibus_dp::time::Duration;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::{Errno, read};
use rustix::net::{SendFlags, SocketFlags, accept_with, send, sockopt};

pub use address::{AddressError, TcpAddress};
use connect::{Connector, Pending};
use open::SocketFile;
pub use open::UnixSocket;
use retry::Retry;

use crate::brisk::Pace;
use crate::end::{End, EndError, Event, Note, Waker, Written};
use crate::wake::{EventFd, timespec};

/// What is kept at least for a master that does not read; the system doubles it.
const KEPT: usize = 16_384;

/// One of so many waits for a brisk master also looks for others that knock.
const GLANCE: u8 = 64;

/// A TCP or Unix socket, with at most one master at its far side.
#[derive(Debug)]
pub struct SocketEnd {
    name: String,
    /// The master that is there.
    master: Option<OwnedFd>,
    source: Source,
    pace: Pace,
    /// Goes round; see [`GLANCE`].
    glance: u8,
    /// For what does not work at once.
    retry: Retry,
    wake: Arc<EventFd>,
}

/// Where masters come from.
#[derive(Debug)]
enum Source {
    Listen(Listener),
    Connect(Connector),
    /// Was connected from the beginning; once lost, nothing comes any more.
    Dialled {
        unannounced: bool,
    },
}

#[derive(Debug)]
struct Listener {
    /// Goes before the socket: as long as that listens, nobody takes the file for a stale one.
    _file: Option<SocketFile>,
    socket: OwnedFd,
    /// Came when the one before had closed already, but had left something to read.
    next: Option<OwnedFd>,
    /// Somebody knocks while the master sends.
    knock: bool,
}

impl SocketEnd {
    /// Listens on a TCP port. Its [`name`](End::name) is `tcp:ADDRESS:PORT`, with a port 0 resolved.
    ///
    /// # Errors
    ///
    /// The address is not known or not this computer's, or the port is taken or not allowed.
    pub fn listen_tcp(address: &TcpAddress) -> Result<Self, EndError> {
        let (socket, name) = open::tcp(address)?;
        Self::new(name, Source::Listen(Listener::new(socket, None)))
    }

    /// Listens on a Unix socket, whose file is removed at the end. A file that nobody listens on
    /// is replaced. The [`name`](End::name) is `unix:PATH`.
    ///
    /// # Errors
    ///
    /// Somebody listens there, another kind of file is there, or the directory does not allow it.
    pub fn listen_unix(path: &Path) -> Result<Self, EndError> {
        let (socket, file) = open::unix(path, None)?;
        Self::new(format!("unix:{}", path.display()), Source::Listen(Listener::new(socket, Some(file))))
    }

    /// Connects to a TCP port, and again whenever the connection is lost; while nobody listens,
    /// at growing intervals of up to a second. The [`name`](End::name) is `tcp:ADDRESS:PORT`.
    ///
    /// # Errors
    ///
    /// The address is not known. That nobody listens is none.
    pub fn connect_tcp(address: &TcpAddress) -> Result<Self, EndError> {
        let connector = Connector::new(address.resolve()?);
        Self::new(format!("tcp:{address}"), Source::Connect(connector))
    }

    /// Connects to a TCP port where somebody listens, once. The [`name`](End::name) is
    /// `tcp:ADDRESS:PORT`.
    ///
    /// # Errors
    ///
    /// The address is not known, or nobody listens there.
    pub fn dial_tcp(address: &TcpAddress) -> Result<Self, EndError> {
        Self::dialled(format!("tcp:{address}"), dial::tcp(address)?)
    }

    /// Connects to a Unix socket where somebody listens, once. The [`name`](End::name) is `unix:PATH`.
    ///
    /// # Errors
    ///
    /// There is no such socket, or nobody listens on it.
    pub fn dial_unix(path: &Path) -> Result<Self, EndError> {
        Self::dialled(format!("unix:{}", path.display()), dial::unix(path)?)
    }

    fn dialled(name: String, socket: OwnedFd) -> Result<Self, EndError> {
        let mut end = Self::new(name, Source::Dialled { unannounced: true })?;
        end.welcome(socket);
        Ok(end)
    }

    fn new(name: String, source: Source) -> Result<Self, EndError> {
        match EventFd::new() {
            Ok(wake) => Ok(Self {
                name,
                master: None,
                source,
                pace: Pace::new(),
                glance: 0,
                retry: Retry::default(),
                wake: Arc::new(wake),
            }),
            Err(error) => Err(EndError::Broken { name, step: "watch", source: error.into() }),
        }
    }

    /// Waits for the master, the waker, and whoever else knocks.
    #[inline]
    fn serve(&mut self, timeout: Option<Duration>, buffer: &mut [u8]) -> Result<Event, Errno> {
        if let Source::Listen(Listener { knock: true, .. }) = self.source {
            return self.open_door();
        }
        if let Source::Dialled { unannounced } = &mut self.source
            && std::mem::take(unannounced)
        {
            return Ok(Event::Came(None));
        }
        let Some(master) = &self.master else {
            return Ok(Event::TimedOut);
        };
        if self.pace.is_brisk() {
            self.glance = (self.glance + 1) % GLANCE;
            if self.glance > 0
                && let Some(count) =
                    self.pace.catch(Moment::now(), timeout, &self.wake, || read(master, &mut *buffer))
            {
                return Ok(Event::Octets(count));
            }
        }
        let wake = PollFd::new(&*self.wake, PollFlags::IN);
        let master_in = PollFd::new(master, PollFlags::IN);
        let [woken, octets, knock] = match &self.source {
            Source::Listen(listener) if listener.next.is_none() && !self.retry.is_waiting() => {
                ready([wake, master_in, PollFd::new(&listener.socket, PollFlags::IN)], timeout)?
            }
            _ => {
                let [woken, octets] = ready([wake, master_in], timeout)?;
                [woken, octets, false]
            }
        };
        if let Source::Listen(listener) = &mut self.source {
            // Once what the master has sent is on its way.
            listener.knock = knock;
        }
        if woken {
            self.wake.clear();
            return Ok(Event::Woken);
        }
        if !octets {
            return Ok(Event::TimedOut);
        }
        match read(master, buffer) {
            Ok(count) if count > 0 => {
                self.pace.slept(Moment::now());
                self.retry.is_proven();
                Ok(Event::Octets(count))
            }
            Err(Errno::AGAIN | Errno::INTR) => Ok(Event::TimedOut),
            // Closed or broken: all the same.
            Ok(_) | Err(_) => Ok(self.lose_master()),
        }
    }

    #[cold]
    fn lose_master(&mut self) -> Event {
        self.master = None;
        if matches!(self.source, Source::Connect(_)) {
            self.retry.later();
        }
        Event::Left
    }

    /// Waits for a master to come.
    #[cold]
    fn wait_at_door(&mut self, timeout: Option<Duration>) -> Result<Event, Errno> {
        let Source::Listen(listener) = &mut self.source else {
            return self.go_and_look(timeout);
        };
        if let Some(next) = listener.next.take() {
            return Ok(self.welcome(next));
        }
        if listener.knock {
            return self.open_door();
        }
        let shut = self.retry.remaining();
        let flags = if shut.is_some() { PollFlags::empty() } else { PollFlags::IN };
        let watch = [PollFd::new(&*self.wake, PollFlags::IN), PollFd::new(&listener.socket, flags)];
        let [woken, knock] = ready(watch, shorter(timeout, shut))?;
        listener.knock = knock;
        if woken {
            self.wake.clear();
            return Ok(Event::Woken);
        }
        if knock { self.open_door() } else { Ok(Event::TimedOut) }
    }

    /// Looks for a master to connect to.
    fn go_and_look(&mut self, timeout: Option<Duration>) -> Result<Event, Errno> {
        let wake = PollFd::new(&*self.wake, PollFlags::IN);
        let Source::Connect(connector) = &self.source else {
            let [woken] = ready([wake], timeout)?;
            return Ok(if woken { self.woken() } else { Event::TimedOut });
        };
        let [woken, go_on] = if let Some((socket, left)) = connector.attempt() {
            let [woken, done] =
                ready([wake, PollFd::new(socket, PollFlags::OUT)], shorter(timeout, Some(left)))?;
            [woken, done || left.is_zero()]
        } else if let Some(pause) = self.retry.remaining() {
            let [woken] = ready([wake], shorter(timeout, Some(pause)))?;
            [woken, false]
        } else {
            [false, true]
        };
        if woken {
            return Ok(self.woken());
        }
        Ok(if go_on { self.go_on_connecting() } else { Event::TimedOut })
    }

    fn woken(&self) -> Event {
        self.wake.clear();
        Event::Woken
    }

    /// Somebody knocks.
    #[cold]
    fn open_door(&mut self) -> Result<Event, Errno> {
        let Source::Listen(listener) = &mut self.source else {
            return Ok(Event::TimedOut);
        };
        listener.knock = false;
        let newcomer = match accept_with(&listener.socket, SocketFlags::CLOEXEC | SocketFlags::NONBLOCK) {
            Ok(newcomer) => newcomer,
            Err(error @ (Errno::MFILE | Errno::NFILE | Errno::NOBUFS | Errno::NOMEM)) => {
                return Ok(self.retry.failed(error, Note::NotAccepted));
            }
            Err(error @ (Errno::BADF | Errno::INVAL | Errno::NOTSOCK)) => return Err(error),
            // Has gone again, or the network has.
            Err(_) => return Ok(Event::TimedOut),
        };
        match &self.master {
            None => Ok(self.welcome(newcomer)),
            Some(master) if has_gone(master)? => {
                listener.next = Some(newcomer);
                Ok(Event::TimedOut)
            }
            Some(_) => Ok(Event::Noted(Note::Refused)),
        }
    }

    /// Begins an attempt to connect, or sees to the one that goes on.
    fn go_on_connecting(&mut self) -> Event {
        let Source::Connect(connector) = &mut self.source else {
            return Event::TimedOut;
        };
        match connector.go_on() {
            Ok(socket) => self.welcome(socket),
            Err(Pending::Still) => Event::TimedOut,
            Err(Pending::Failed(error)) => self.retry.failed(error, Note::Unreachable),
        }
    }

    fn welcome(&mut self, socket: OwnedFd) -> Event {
        // None of it matters enough to send a master away. Unix sockets refuse what only TCP needs.
        let _ = sockopt::set_socket_send_buffer_size(&socket, KEPT);
        let _ = sockopt::set_tcp_nodelay(&socket, true);
        let _ = sockopt::set_tcp_keepidle(&socket, Time::from_secs(5));
        let _ = sockopt::set_tcp_keepintvl(&socket, Time::from_secs(2));
        let _ = sockopt::set_tcp_keepcnt(&socket, 3);
        let _ = sockopt::set_socket_keepalive(&socket, true);
        self.retry.succeeded();
        self.master = Some(socket);
        Event::Came(None)
    }

    fn broken(&self, step: &'static str) -> impl FnOnce(Errno) -> EndError {
        let name = self.name.clone();
        move |error| EndError::Broken { name, step, source: error.into() }
    }
}

impl End for SocketEnd {
    #[inline]
    fn wait(&mut self, timeout: Option<Duration>, buffer: &mut [u8]) -> Result<Event, EndError> {
        if self.wake.is_set() {
            self.wake.clear();
            return Ok(Event::Woken);
        }
        let event =
            if self.master.is_some() { self.serve(timeout, buffer) } else { self.wait_at_door(timeout) };
        match event {
            Ok(event) => Ok(event),
            Err(Errno::INTR) => Ok(Event::TimedOut),
            Err(error) => Err(self.broken("wait at")(error)),
        }
    }

    #[inline]
    fn write(&mut self, octets: &[u8]) -> Result<Written, EndError> {
        let Some(master) = &self.master else {
            return Ok(Written::Dropped(octets.len()));
        };
        // Whatever is wrong with the connection shows when it is read.
        let count = send(master, octets, SendFlags::NOSIGNAL | SendFlags::DONTWAIT).unwrap_or(0);
        Ok(if count == octets.len() { Written::All } else { Written::Dropped(octets.len() - count) })
    }

    fn name(&self) -> &str {
        &self.name
    }

    fn has_rate(&self) -> bool {
        false
    }

    fn waker(&self) -> Waker {
        let wake: Arc<EventFd> = Arc::clone(&self.wake);
        Waker::new(wake)
    }
}

impl Listener {
    fn new(socket: OwnedFd, file: Option<SocketFile>) -> Self {
        Self { _file: file, socket, next: None, knock: false }
    }
}

/// Whether the far side has closed, even if there is something left to read.
fn has_gone(master: &OwnedFd) -> Result<bool, Errno> {
    let mut watch = [PollFd::new(master, PollFlags::RDHUP)];
    poll(&mut watch, Some(&timespec(Duration::ZERO)))?;
    Ok(!watch[0].revents().is_empty())
}

/// Which of them are ready; none when the time is over.
#[inline]
fn ready<const N: usize>(mut watch: [PollFd<'_>; N], timeout: Option<Duration>) -> Result<[bool; N], Errno> {
    let timeout = timeout.map(timespec);
    poll(&mut watch, timeout.as_ref())?;
    Ok(watch.map(|watched| !watched.revents().is_empty()))
}

fn shorter(timeout: Option<Duration>, own: Option<Time>) -> Option<Duration> {
    let own = own.map(|own| Duration::from_nanos(u64::try_from(own.as_nanos()).unwrap_or(u64::MAX)));
    match (timeout, own) {
        (Some(timeout), Some(own)) => Some(timeout.min(own)),
        (timeout, own) => timeout.or(own),
    }
}
