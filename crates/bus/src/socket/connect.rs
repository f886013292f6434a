//! Connecting to a master that listens.

use std::net::SocketAddr;
use std::os::fd::OwnedFd;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags};
use rustix::io::Errno;
use rustix::net::{
    AddressFamily, SocketFlags, SocketType, connect, getpeername, getsockname, socket_with, sockopt,
};

use super::ready;

/// How long an attempt to connect may take.
const ATTEMPT: Duration = Duration::from_secs(3);

/// Tries the addresses of a master in turn.
#[derive(Debug)]
pub(super) struct Connector {
    addresses: Vec<SocketAddr>,
    /// The address whose turn it is.
    at: usize,
    /// A connection under way, and when it is given up.
    attempt: Option<(OwnedFd, Instant)>,
}

/// Why there is no connection.
pub(super) enum Pending {
    /// It is under way, or the next address has not been tried.
    Still,
    /// No address leads to anybody; this is what is wrong with the last.
    Failed(Errno),
}

impl Connector {
    pub(super) fn new(addresses: Vec<SocketAddr>) -> Self {
        Self { addresses, at: 0, attempt: None }
    }

    /// The attempt under way, which can be written to once it is decided, and how long it may still take.
    pub(super) fn attempt(&self) -> Option<(&OwnedFd, Duration)> {
        let (socket, until) = self.attempt.as_ref()?;
        Some((socket, until.saturating_duration_since(Instant::now())))
    }

    /// Begins an attempt, or sees to the one under way.
    pub(super) fn go_on(&mut self) -> Result<OwnedFd, Pending> {
        let (socket, until) = match self.attempt.take() {
            Some(attempt) => attempt,
            None => match begin(self.addresses[self.at]) {
                Ok(socket) => (socket, Instant::now() + ATTEMPT),
                Err(error) => return self.failed(error),
            },
        };
        match conclude(&socket) {
            Ok(true) => Ok(socket),
            Ok(false) if Instant::now() < until => {
                self.attempt = Some((socket, until));
                Err(Pending::Still)
            }
            Ok(false) => self.failed(Errno::TIMEDOUT),
            Err(error) => self.failed(error),
        }
    }

    fn failed(&mut self, error: Errno) -> Result<OwnedFd, Pending> {
        self.at = (self.at + 1) % self.addresses.len();
        Err(if self.at > 0 { Pending::Still } else { Pending::Failed(error) })
    }
}

fn begin(address: SocketAddr) -> Result<OwnedFd, Errno> {
    let family = if address.is_ipv4() { AddressFamily::INET } else { AddressFamily::INET6 };
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let socket = socket_with(family, SocketType::STREAM, flags, None)?;
    match connect(&socket, &address) {
        Ok(()) | Err(Errno::INPROGRESS | Errno::INTR) => Ok(socket),
        Err(error) => Err(error),
    }
}

/// Whether an attempt has come to a connection.
fn conclude(socket: &OwnedFd) -> Result<bool, Errno> {
    let [decided] = ready([PollFd::new(socket, PollFlags::OUT)], Some(profibus_dp::time::Duration::ZERO))?;
    if !decided {
        return Ok(false);
    }
    sockopt::socket_error(socket)??;
    // Who tries often enough to reach a port of his own computer that nobody has may get that very port
    // for himself, and is then connected to himself.
    let own = getsockname(socket)?;
    if getpeername(socket)? == Some(own) { Err(Errno::CONNREFUSED) } else { Ok(true) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_connection_to_itself_is_none() {
        // As it happens by chance: bound to a port, and connected to the same.
        let socket = socket_with(AddressFamily::INET, SocketType::STREAM, SocketFlags::CLOEXEC, None)
            .expect("a socket");
        rustix::net::bind(&socket, &SocketAddr::from(([127, 0, 0, 1], 0))).expect("a port");
        let own: SocketAddr = getsockname(&socket).expect("a name").try_into().expect("an address");
        connect(&socket, &own).expect("itself");
        assert_eq!(conclude(&socket), Err(Errno::CONNREFUSED));
    }
}
