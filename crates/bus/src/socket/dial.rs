//! Connecting to somebody who must be there already.

use std::io::{self, ErrorKind};
use std::os::fd::OwnedFd;
use std::path::Path;

use profibus_dp::time::Duration;
use rustix::event::{PollFd, PollFlags};
use rustix::io::Errno;
use rustix::net::{AddressFamily, SocketAddrUnix, SocketFlags, SocketType, connect, socket_with};

use super::connect::{Connector, Pending};
use super::ready;
use crate::end::EndError;
use crate::socket::TcpAddress;

/// A connection to a TCP port; each address of a name is tried once.
pub(super) fn tcp(address: &TcpAddress) -> Result<OwnedFd, EndError> {
    let mut connector = Connector::new(address.resolve()?);
    loop {
        match connector.go_on() {
            Ok(socket) => return Ok(socket),
            Err(Pending::Still) => wait_for(&connector),
            Err(Pending::Failed(error)) => {
                let source = io::Error::from(error);
                let remedy = match source.kind() {
                    ErrorKind::ConnectionRefused => "nobody listens there: start the other side first",
                    _ => "check the address, and that the network leads there",
                };
                return Err(failed(format!("tcp:{address}"), source, remedy));
            }
        }
    }
}

fn wait_for(connector: &Connector) {
    if let Some((socket, left)) = connector.attempt() {
        let left = Duration::from(left);
        // Whatever comes of it shows when it is looked at.
        let _ = ready([PollFd::new(socket, PollFlags::OUT)], Some(left));
    }
}

/// A connection to a Unix socket.
pub(super) fn unix(path: &Path) -> Result<OwnedFd, EndError> {
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let connected = SocketAddrUnix::new(path).and_then(|address| {
        let socket = socket_with(AddressFamily::UNIX, SocketType::STREAM, flags, None)?;
        connect(&socket, &address)?;
        Ok(socket)
    });
    connected.map_err(|error| {
        let source = io::Error::from(error);
        let remedy = match source.kind() {
            ErrorKind::NotFound => "there is no such socket: start the other side first, or check the path",
            ErrorKind::ConnectionRefused => "nobody listens on it: start the other side first",
            ErrorKind::PermissionDenied => "you may not write to it: change its rights",
            ErrorKind::WouldBlock => "too many wait there already: see to the program that listens",
            _ if error == Errno::NAMETOOLONG => "choose a shorter path, of at most 107 octets",
            _ => "check the path",
        };
        failed(format!("unix:{}", path.display()), source, remedy)
    })
}

fn failed(name: String, source: io::Error, remedy: &'static str) -> EndError {
    EndError::Socket { step: "connect to", name, source, remedy }
}
