//! What clients come through: a Unix socket, or a TCP port of this computer.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::time::Duration;

use bus::{EndError, UnixSocket};

use super::address::ControlAddress;

/// Where clients knock.
#[derive(Debug)]
pub(super) enum Listener {
    Unix(UnixSocket),
    Tcp(TcpListener),
}

/// A client.
#[derive(Debug)]
pub(super) enum Stream {
    Unix(UnixStream),
    Tcp(TcpStream),
}

impl Listener {
    /// Listens, and says where: with a port 0 resolved.
    pub(super) fn open(address: &ControlAddress) -> Result<(Self, ControlAddress), EndError> {
        let wanted = match address {
            ControlAddress::Path(path) => {
                return Ok((Self::Unix(UnixSocket::listen_privately(path)?), address.clone()));
            }
            ControlAddress::Tcp(wanted) => *wanted,
        };
        let failed = |source: io::Error| EndError::Socket {
            step: "listen on",
            name: address.to_string(),
            remedy: match source.kind() {
                ErrorKind::AddrInUse => {
                    "another program listens there: end it, or choose another port (0 takes any that is free)"
                }
                ErrorKind::PermissionDenied => "choose a port from 1024 up",
                _ => "write tcp:127.0.0.1:0",
            },
            source,
        };
        let listener = TcpListener::bind(wanted).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        let found = ControlAddress::Tcp(listener.local_addr().map_err(failed)?);
        Ok((Self::Tcp(listener), found))
    }

    /// A client who has just been let in.
    pub(super) fn client(&self, socket: OwnedFd) -> Stream {
        match self {
            Self::Unix(_) => Stream::Unix(socket.into()),
            Self::Tcp(_) => {
                let stream = TcpStream::from(socket);
                // Replies are short lines, and somebody waits for each. Without it they are slower only.
                let _ = stream.set_nodelay(true);
                Stream::Tcp(stream)
            }
        }
    }
}

impl AsFd for Listener {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match self {
            Self::Unix(socket) => socket.as_fd(),
            Self::Tcp(socket) => socket.as_fd(),
        }
    }
}

impl Stream {
    pub(super) fn try_clone(&self) -> io::Result<Self> {
        match self {
            Self::Unix(stream) => stream.try_clone().map(Self::Unix),
            Self::Tcp(stream) => stream.try_clone().map(Self::Tcp),
        }
    }

    pub(super) fn shutdown(&self, how: Shutdown) -> io::Result<()> {
        match self {
            Self::Unix(stream) => stream.shutdown(how),
            Self::Tcp(stream) => stream.shutdown(how),
        }
    }

    /// Whether a browser of this computer reaches it, for whatever page it has open.
    pub(super) fn is_open_to_browsers(&self) -> bool {
        matches!(self, Self::Tcp(_))
    }

    /// No more is told; what comes is thrown away for a moment, so that what was told gets there.
    pub(super) fn hang_up(&mut self) {
        const PATIENCE: Duration = Duration::from_millis(200);
        const MOST_READS: usize = 64;
        let _ = self.shutdown(Shutdown::Write);
        let set = match self {
            Self::Unix(stream) => stream.set_read_timeout(Some(PATIENCE)),
            Self::Tcp(stream) => stream.set_read_timeout(Some(PATIENCE)),
        };
        let mut away = [0; 4096];
        if set.is_ok() {
            for _ in 0..MOST_READS {
                if !matches!(self.read(&mut away), Ok(1..)) {
                    return;
                }
            }
        }
    }
}

impl Read for Stream {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Unix(stream) => stream.read(buffer),
            Self::Tcp(stream) => stream.read(buffer),
        }
    }
}

impl Write for Stream {
    fn write(&mut self, octets: &[u8]) -> io::Result<usize> {
        match self {
            Self::Unix(stream) => stream.write(octets),
            Self::Tcp(stream) => stream.write(octets),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
