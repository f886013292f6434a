//! Ports as users write them, and their ends: one place for all commands that open a bus.
//!
//! | written | for slaves ([`open_for_slaves`]) | for a master ([`open_for_master`]) |
//! |---|---|---|
//! | `pty` | a new pseudo terminal | refused: nobody is behind it |
//! | `tcp-listen:ADDRESS:PORT` | the master connects here | the slave connects here |
//! | `tcp-listen:PORT` | the same at 127.0.0.1 | the same at 127.0.0.1 |
//! | `tcp:ADDRESS:PORT` | the master listens there; tried for ever | the slave listens there; tried once, or for some time |
//! | `unix:PATH` | the master connects to this socket | the slave listens there; tried likewise |
//! | `/dev/...` | a serial device | a serial device, or the pseudo terminal of a slave |

mod open;

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

pub use open::{open_for_master, open_for_slaves};

use crate::socket::{AddressError, TcpAddress};

/// Where a segment's octets come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PortAddress {
    /// A new pseudo terminal.
    Pty,
    /// A TCP port that the far side connects to.
    TcpListen(TcpAddress),
    /// A TCP port where the far side listens.
    Tcp(TcpAddress),
    /// A Unix socket: slaves listen there, masters connect.
    Unix(PathBuf),
    /// A serial device, or a pseudo terminal that somebody else has made.
    Device(PathBuf),
}

/// Why a text is no [`PortAddress`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PortError {
    /// What follows `tcp:` or `tcp-listen:`.
    #[error(transparent)]
    Address(#[from] AddressError),
    /// `tcp:` with port 0.
    #[error("nobody listens on port 0; write the port where the other side listens")]
    PortZero,
    /// Nothing follows `unix:`.
    #[error("write the path of the socket, like unix:/tmp/bus")]
    NoPath,
    /// None of them.
    #[error("write pty, tcp-listen:ADDRESS:PORT, tcp:ADDRESS:PORT, unix:PATH or a device like /dev/ttyUSB0")]
    Unknown,
}

impl FromStr for PortAddress {
    type Err = PortError;

    fn from_str(text: &str) -> Result<Self, PortError> {
        match text.split_once(':') {
            _ if text == "pty" => Ok(Self::Pty),
            Some(("tcp-listen", rest)) => Ok(Self::TcpListen(listening(rest)?)),
            Some(("tcp", rest)) => match rest.parse::<TcpAddress>()? {
                found if found.port() == 0 => Err(PortError::PortZero),
                found => Ok(Self::Tcp(found)),
            },
            Some(("unix", "")) => Err(PortError::NoPath),
            Some(("unix", path)) => Ok(Self::Unix(path.into())),
            _ if text.starts_with('/') => Ok(Self::Device(text.into())),
            _ => Err(PortError::Unknown),
        }
    }
}

/// Where nobody says who may connect, only this computer may.
fn listening(rest: &str) -> Result<TcpAddress, AddressError> {
    let is_port = !rest.is_empty() && rest.bytes().all(|digit| digit.is_ascii_digit());
    if is_port { format!("127.0.0.1:{rest}").parse() } else { rest.parse() }
}

impl fmt::Display for PortAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Pty => f.write_str("pty"),
            Self::TcpListen(address) => write!(f, "tcp-listen:{address}"),
            Self::Tcp(address) => write!(f, "tcp:{address}"),
            Self::Unix(path) => write!(f, "unix:{}", path.display()),
            Self::Device(path) => write!(f, "{}", path.display()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ports_say_what_they_are() {
        let address = |text: &str| text.parse::<TcpAddress>().expect("an address");
        for (text, port) in [
            ("pty", PortAddress::Pty),
            ("tcp-listen:127.0.0.1:0", PortAddress::TcpListen(address("127.0.0.1:0"))),
            ("tcp:[::1]:4000", PortAddress::Tcp(address("[::1]:4000"))),
            ("unix:a:b", PortAddress::Unix("a:b".into())),
            ("/dev/ttyUSB0", PortAddress::Device("/dev/ttyUSB0".into())),
        ] {
            assert_eq!(text.parse(), Ok(port.clone()));
            assert_eq!(port.to_string(), text);
        }
    }

    #[test]
    fn without_an_address_only_this_computer_is_let_in() {
        let port: PortAddress = "tcp-listen:4000".parse().expect("a port");
        assert_eq!(port.to_string(), "tcp-listen:127.0.0.1:4000");
        assert!("tcp-listen:65536".parse::<PortAddress>().is_err());
        assert!("tcp:4000".parse::<PortAddress>().is_err(), "nobody connects to he knows not whom");
    }

    #[test]
    fn what_is_no_port_is_told_what_to_write() {
        for text in [
            "",
            "PTY",
            "ttyUSB0",
            "tcp",
            "tcp:",
            "tcp:127.0.0.1:0",
            "tcp-listen:",
            "tcp-listen::4000",
            "unix:",
            "udp:a:1",
        ] {
            let error = text.parse::<PortAddress>().expect_err(text).to_string();
            assert!(error.contains("write"), "{text}: {error}");
        }
    }
}
