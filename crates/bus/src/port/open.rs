//! Opening the end that a [`PortAddress`] names.

use std::io::ErrorKind;
use std::time::{Duration as Time, Instant as Moment};

use profibus_dp::fdl::BaudSetting;
use profibus_dp::time::{Baudrate, Duration};

use crate::end::{End, EndError};
use crate::port::PortAddress;
use crate::pty::PtyEnd;
use crate::serial::SerialEnd;
use crate::socket::SocketEnd;

/// How long to leave a port alone that nobody was behind.
const PAUSE: Time = Time::from_millis(20);

/// Opens a port for the slaves of a [`Segment`](crate::Segment).
///
/// `baud` says at which rate a serial device listens: a fixed one, which its driver must have, or one
/// after the other, of which it must have one. The other ends take the master's or have none.
///
/// # Errors
///
/// The port cannot be had. That no master is there yet is no error.
pub fn open_for_slaves(address: &PortAddress, baud: BaudSetting) -> Result<Box<dyn End>, EndError> {
    Ok(match address {
        PortAddress::Pty => Box::new(PtyEnd::open()?),
        PortAddress::TcpListen(address) => Box::new(SocketEnd::listen_tcp(address)?),
        PortAddress::Tcp(address) => Box::new(SocketEnd::connect_tcp(address)?),
        PortAddress::Unix(path) => Box::new(SocketEnd::listen_unix(path)?),
        PortAddress::Device(path) => Box::new(SerialEnd::open(path, baud)?),
    })
}

/// Opens a port for a master, whose slaves are at its far side.
///
/// A device gets `rate`, even parity and one stop bit; on a pseudo terminal, whose kernel keeps no
/// parity, 8N1 does. Sockets have no rate.
///
/// [`Event::Came`](crate::Event::Came) says that somebody can be there: at once where the master has
/// connected or opened a device, later where it listens. Octets written before it are dropped.
/// After [`Event::Left`](crate::Event::Left) a connection that the master has made stays lost.
///
/// While nobody is behind a socket, or a device is not there, it is tried again for `patience`
/// (zero: tried once).
///
/// # Errors
///
/// The port cannot be had, or nobody was there in time.
pub fn open_for_master(
    address: &PortAddress,
    rate: Baudrate,
    patience: Duration,
) -> Result<Box<dyn End>, EndError> {
    let until = Moment::now().checked_add(patience.into());
    loop {
        match try_for_master(address, rate) {
            Err(error) if is_absence(&error) && until.is_none_or(|until| Moment::now() < until) => {
                std::thread::sleep(PAUSE);
            }
            result => return result,
        }
    }
}

fn try_for_master(address: &PortAddress, rate: Baudrate) -> Result<Box<dyn End>, EndError> {
    Ok(match address {
        PortAddress::Pty => {
            return Err(EndError::Unfit {
                name: address.to_string(),
                why: "nobody is behind a new pseudo terminal; write the path that the slave's program \
                      printed, like /dev/pts/4",
            });
        }
        PortAddress::TcpListen(address) => Box::new(SocketEnd::listen_tcp(address)?),
        PortAddress::Tcp(address) => Box::new(SocketEnd::dial_tcp(address)?),
        PortAddress::Unix(path) => Box::new(SocketEnd::dial_unix(path)?),
        PortAddress::Device(path) => Box::new(SerialEnd::open_for_master(path, rate)?),
    })
}

/// Whether it may help to wait for somebody to come.
fn is_absence(error: &EndError) -> bool {
    let (EndError::Socket { source, .. } | EndError::Device { source, .. }) = error else {
        return false;
    };
    matches!(
        source.kind(),
        ErrorKind::ConnectionRefused | ErrorKind::NotFound | ErrorKind::TimedOut | ErrorKind::HostUnreachable
    )
}
