//! Sockets that listen, and what may be in their way.

use std::fs;
use std::io::{self, ErrorKind};
use std::net::TcpListener;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::{Path, PathBuf};

use rustix::fs::{Mode, fchmod};
use rustix::io::Errno;
use rustix::net::{
    AddressFamily, SocketAddrUnix, SocketFlags, SocketType, bind, connect, listen, socket_with,
};

use crate::end::EndError;
use crate::socket::TcpAddress;

/// A TCP port that listens, and its name with the port resolved.
pub(super) fn tcp(address: &TcpAddress) -> Result<(OwnedFd, String), EndError> {
    let found = address.resolve()?;
    let failed = |source: io::Error| EndError::Socket {
        step: "listen on",
        name: address.to_string(),
        remedy: match source.kind() {
            ErrorKind::AddrInUse => {
                "another program listens there: end it, or choose another port (0 takes any that is free)"
            }
            ErrorKind::AddrNotAvailable => {
                "this computer has no such address: write one that it has, like 127.0.0.1"
            }
            ErrorKind::PermissionDenied => "choose a port from 1024 up",
            _ => "check the address, or choose another one",
        },
        source,
    };
    let listener = TcpListener::bind(&found[..]).map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    let name = format!("tcp:{}", listener.local_addr().map_err(failed)?);
    Ok((listener.into(), name))
}

/// A Unix socket that listens without waiting, whose file goes with it.
#[derive(Debug)]
pub struct UnixSocket {
    /// Goes before the socket: as long as that listens, nobody takes the file for a stale one.
    _file: SocketFile,
    socket: OwnedFd,
}

impl UnixSocket {
    /// Listens at `path`, for the user who runs this program alone. A file that nobody listens on is
    /// replaced; it is removed when this is dropped.
    ///
    /// # Errors
    ///
    /// Somebody listens there, another kind of file is there, or the directory does not allow it.
    pub fn listen_privately(path: &Path) -> Result<Self, EndError> {
        let (socket, file) = unix(path, Some(Mode::RUSR | Mode::WUSR))?;
        Ok(Self { _file: file, socket })
    }
}

impl AsFd for UnixSocket {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}

/// A Unix socket that listens, and its file, with this mode or the one the system gives it.
pub(super) fn unix(path: &Path, mode: Option<Mode>) -> Result<(OwnedFd, SocketFile), EndError> {
    let failed = |source: io::Error| EndError::Socket {
        step: "listen on",
        name: format!("unix:{}", path.display()),
        remedy: match source.kind() {
            ErrorKind::AlreadyExists => "remove it or choose another path",
            ErrorKind::AddrInUse => "end the program that listens there, or choose another path",
            ErrorKind::InvalidInput | ErrorKind::InvalidFilename => {
                "choose a shorter path, of at most 107 octets"
            }
            _ => "choose a path in a directory that exists and that you may write",
        },
        source,
    };
    let bound = match listen_at(path, mode) {
        Err(error) if error.kind() == ErrorKind::AddrInUse => {
            remove_stale(path).and_then(|()| listen_at(path, mode))
        }
        other => other,
    };
    let listener = bound.map_err(failed)?;
    let file = SocketFile::at(path).map_err(failed)?;
    Ok((listener, file))
}

fn listen_at(path: &Path, mode: Option<Mode>) -> io::Result<OwnedFd> {
    /// So many may knock before anybody looks.
    const BACKLOG: i32 = 128;
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let socket = socket_with(AddressFamily::UNIX, SocketType::STREAM, flags, None)?;
    if let Some(mode) = mode {
        // On the socket, before it has a name: its file never has another mode.
        fchmod(&socket, mode)?;
    }
    bind(&socket, &SocketAddrUnix::new(path)?)?;
    listen(&socket, BACKLOG)?;
    Ok(socket)
}

/// Removes the file of a socket that nobody listens on any more, and nothing else.
fn remove_stale(path: &Path) -> io::Result<()> {
    /// Longer than anybody is between the name of a socket and its listening.
    const PATIENCE: std::time::Duration = std::time::Duration::from_millis(10);
    if !fs::symlink_metadata(path)?.file_type().is_socket() {
        return Err(io::Error::new(ErrorKind::AlreadyExists, "something that is no socket is there"));
    }
    for look in 0..2 {
        if look > 0 {
            std::thread::sleep(PATIENCE);
        }
        if is_live(path)? {
            return Err(io::Error::new(ErrorKind::AddrInUse, "somebody listens there already"));
        }
    }
    fs::remove_file(path)
}

/// Whether somebody has the socket. Never waits.
fn is_live(path: &Path) -> io::Result<bool> {
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let probe = socket_with(AddressFamily::UNIX, SocketType::STREAM, flags, None)?;
    match connect(probe, &SocketAddrUnix::new(path)?) {
        Err(Errno::CONNREFUSED) => Ok(false),
        // So many wait for him already, or it is another kind of socket.
        Ok(()) | Err(Errno::AGAIN | Errno::PROTOTYPE) => Ok(true),
        Err(error) => Err(error.into()),
    }
}

/// The file of a Unix socket, removed at the end if it is still ours.
#[derive(Debug)]
pub(super) struct SocketFile {
    path: PathBuf,
    /// Device and number. While the socket is open, no other file gets the same.
    identity: (u64, u64),
}

impl SocketFile {
    fn at(path: &Path) -> io::Result<Self> {
        // From wherever the process may be later.
        Ok(Self { path: std::path::absolute(path)?, identity: identity(path)? })
    }
}

impl Drop for SocketFile {
    fn drop(&mut self) {
        if identity(&self.path).is_ok_and(|identity| identity == self.identity) {
            // The file may be gone in this very moment; then all is well too.
            let _ = fs::remove_file(&self.path);
        }
    }
}

fn identity(path: &Path) -> io::Result<(u64, u64)> {
    fs::symlink_metadata(path).map(|found| (found.dev(), found.ino()))
}
