//! The control socket: requests as lines of JSON on a Unix socket or a TCP port of this computer, a reply for each.
//!
//! Everything is bounded, so that no client disturbs the bus:
//!
//! | what a client may do | what happens |
//! |---|---|
//! | send a line without end | what is longer than [`MOST_OCTETS`] is skipped to its end, and refused |
//! | connect again and again | one of more than [`MOST_CONNECTIONS`] is told so, and closed |
//! | send requests as fast as it can | all clients together get two requests done in a millisecond, after the first 64 |
//! | never read | its own thread waits for it; events are dropped and counted |
//! | never write | its own thread waits for it |
//! | be a browser, sent by some page to a TCP port | what does not begin with a JSON object is answered once and closed, and nothing after it is read |

mod address;
mod connection;
mod stream;
mod turns;

use std::collections::HashMap;
use std::fmt;
use std::io::Write;
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use bus::EndError;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::net::{SocketFlags, accept_with};

use crate::control::apply::Steer;
use crate::control::envelope::Reply;
use crate::control::subscriptions::Subscriptions;
pub use address::{ControlAddress, ControlAddressError};
use stream::{Listener, Stream};
pub use turns::Turns;

/// A longer line is no request.
pub const MOST_OCTETS: usize = 65_536;

/// More clients at once are not served.
pub const MOST_CONNECTIONS: usize = 16;

/// Takes requests until it is dropped.
#[derive(Debug)]
pub struct Server {
    address: ControlAddress,
    shared: Arc<Shared>,
    /// Closing it ends the thread that lets clients in.
    door: Option<UnixStream>,
    thread: Option<JoinHandle<()>>,
}

/// What all connections share.
struct Shared {
    steered: Box<dyn Steer>,
    subscriptions: Subscriptions,
    on_shutdown: Box<dyn Fn() + Send + Sync>,
    turns: Turns,
    connections: Mutex<Connections>,
    /// One more connection has ended.
    ended: Condvar,
}

#[derive(Debug, Default)]
struct Connections {
    next: u64,
    open: HashMap<u64, Stream>,
}

impl Server {
    /// Listens at a path, for the user who runs this program alone, or at a TCP port, for everybody on this
    /// computer. A file that nobody listens on is replaced, and the file is removed at the end. `on_shutdown`
    /// is called when a client asks for the end of the program; it must not wait for this server.
    ///
    /// # Errors
    ///
    /// Somebody listens there, another kind of file is there, or the directory or the port is not allowed.
    pub fn start(
        address: &ControlAddress,
        steered: impl Steer + 'static,
        subscriptions: Subscriptions,
        on_shutdown: impl Fn() + Send + Sync + 'static,
    ) -> Result<Self, EndError> {
        let broken = |source| EndError::Broken { name: address.to_string(), step: "serve", source };
        let (listener, address) = Listener::open(address)?;
        let (door, closed) = UnixStream::pair().map_err(broken)?;
        let shared = Arc::new(Shared {
            steered: Box::new(steered),
            subscriptions,
            on_shutdown: Box::new(on_shutdown),
            turns: Turns::new(),
            connections: Mutex::default(),
            ended: Condvar::new(),
        });
        let inside = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("control".to_owned())
            .spawn(move || let_in(&inside, &listener, &closed))
            .map_err(broken)?;
        Ok(Self { address, shared, door: Some(door), thread: Some(thread) })
    }

    /// Where it listens, with a port 0 resolved.
    pub fn address(&self) -> &ControlAddress {
        &self.address
    }
}

impl Drop for Server {
    /// Ends every connection; what a client was told before, it can still read.
    fn drop(&mut self) {
        drop(self.door.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        self.shared.close_all();
    }
}

/// Lets clients in until the far side of `closed` is.
fn let_in(shared: &Arc<Shared>, listener: &Listener, closed: &UnixStream) {
    /// So long nobody is let in where the system has no room for him.
    const PAUSE: Timespec = Timespec { tv_sec: 0, tv_nsec: 100_000_000 };
    let mut full = false;
    loop {
        let door = PollFd::new(closed, PollFlags::IN);
        let knocks = PollFd::new(listener, if full { PollFlags::empty() } else { PollFlags::IN });
        let mut watch = [door, knocks];
        match poll(&mut watch, full.then_some(&PAUSE)) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(_) => return,
        }
        if !watch[0].revents().is_empty() {
            return;
        }
        full = false;
        if watch[1].revents().is_empty() {
            continue;
        }
        match accept_with(listener, SocketFlags::CLOEXEC) {
            Ok(client) => shared.welcome(listener.client(client)),
            Err(Errno::MFILE | Errno::NFILE | Errno::NOBUFS | Errno::NOMEM) => full = true,
            Err(Errno::BADF | Errno::INVAL | Errno::NOTSOCK) => return,
            // Has gone again.
            Err(_) => {}
        }
    }
}

impl Shared {
    fn connections(&self) -> MutexGuard<'_, Connections> {
        // Each change is whole by itself, so a panic elsewhere does not matter.
        self.connections.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn welcome(self: &Arc<Self>, mut client: Stream) {
        let mut connections = self.connections();
        if connections.open.len() >= MOST_CONNECTIONS {
            send_away(&mut client);
            return;
        }
        let Ok(own) = client.try_clone() else {
            return;
        };
        let number = connections.next;
        connections.next += 1;
        connections.open.insert(number, own);
        drop(connections);
        let shared = Arc::clone(self);
        let served = std::thread::Builder::new().name(format!("control {number}")).spawn(move || {
            connection::serve(&shared, client);
            shared.forget(number);
        });
        if served.is_err() {
            self.forget(number);
        }
    }

    fn forget(&self, number: u64) {
        self.connections().open.remove(&number);
        self.ended.notify_all();
    }

    fn close_all(&self) {
        /// Longer than anything takes that a client can ask for.
        const PATIENCE: Duration = Duration::from_secs(5);
        let connections = self.connections();
        for client in connections.open.values() {
            // Gone already: all the same.
            let _ = client.shutdown(Shutdown::Both);
        }
        let _ = self.ended.wait_timeout_while(connections, PATIENCE, |left| !left.open.is_empty());
    }
}

impl fmt::Debug for Shared {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Shared").field("steered", &self.steered).finish_non_exhaustive()
    }
}

/// There is room in a new connection for a line: this does not wait.
fn send_away(client: &mut Stream) {
    let error =
        format!("{MOST_CONNECTIONS} clients are connected already; close one of them and connect again");
    if let Ok(mut line) = serde_json::to_vec(&Reply::refused(None, error)) {
        line.push(b'\n');
        let _ = client.write_all(&line);
    }
}
