//! Where requests are taken, as users write it: a path, or `tcp:127.0.0.1:PORT`.

use std::ffi::OsString;
use std::fmt;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::str::FromStr;

use bus::{AddressError, TcpAddress};

/// Where a [`Server`](super::Server) takes requests.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ControlAddress {
    /// A Unix socket at this path, for the user who runs the program alone.
    Path(PathBuf),
    /// A TCP port of this computer, for every user of it; port 0 takes one that is free.
    Tcp(SocketAddr),
}

/// Why a text is no [`ControlAddress`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ControlAddressError {
    /// Nothing is there.
    #[error("write the path of a socket, or tcp:127.0.0.1:PORT")]
    Empty,
    /// What follows `tcp:` is no address.
    #[error(transparent)]
    Address(#[from] AddressError),
    /// Others could reach it.
    #[error(
        "{host} is no address that only this computer reaches, and whoever reaches the port steers the encoders, for \
         nothing protects it: write tcp:127.0.0.1:{port}, and come from elsewhere through a tunnel such as ssh -L"
    )]
    NotOurs {
        /// What was written.
        host: String,
        /// The port beside it.
        port: u16,
    },
}

impl FromStr for ControlAddress {
    type Err = ControlAddressError;

    fn from_str(text: &str) -> Result<Self, ControlAddressError> {
        let Some(address) = text.strip_prefix("tcp:") else {
            let path = text.strip_prefix("unix:").unwrap_or(text);
            return if path.is_empty() {
                Err(ControlAddressError::Empty)
            } else {
                Ok(Self::Path(path.into()))
            };
        };
        let port = address.parse::<TcpAddress>()?.port();
        let host = address.rsplit_once(':').map_or(address, |(host, _)| host);
        // A name could be anybody's; this one is not, whatever a file of hosts says.
        let numbers = if host == "localhost" { "127.0.0.1" } else { host };
        let found = format!("{numbers}:{port}").parse().ok();
        found
            .filter(|found: &SocketAddr| found.ip().is_loopback())
            .map(Self::Tcp)
            .ok_or_else(|| ControlAddressError::NotOurs { host: host.to_owned(), port })
    }
}

impl TryFrom<OsString> for ControlAddress {
    type Error = ControlAddressError;

    /// Paths may have any octets.
    fn try_from(text: OsString) -> Result<Self, ControlAddressError> {
        match text.to_str() {
            Some(text) => text.parse(),
            None => Ok(Self::Path(text.into())),
        }
    }
}

impl fmt::Display for ControlAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Path(path) => path.display().fmt(f),
            Self::Tcp(address) => write!(f, "tcp:{address}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::ffi::OsStringExt;

    use super::*;

    #[test]
    fn addresses_of_this_computer_alone_are_taken() {
        for (text, address) in [
            ("tcp:127.0.0.1:0", "127.0.0.1:0"),
            ("tcp:127.8.9.10:4000", "127.8.9.10:4000"),
            ("tcp:[::1]:4000", "[::1]:4000"),
            ("tcp:localhost:4000", "127.0.0.1:4000"),
        ] {
            let found: ControlAddress = text.parse().expect(text);
            assert_eq!(found, ControlAddress::Tcp(address.parse().expect("numbers")), "{text}");
        }
        for text in [
            "tcp:0.0.0.0:4000",
            "tcp:[::]:4000",
            "tcp:192.168.0.7:4000",
            "tcp:[::ffff:192.168.0.7]:4000",
            "tcp:plc-7.example:4000",
            "tcp:128.0.0.1:4000",
        ] {
            let error = text.parse::<ControlAddress>().expect_err(text).to_string();
            assert!(error.contains("write tcp:127.0.0.1:4000"), "{text}: {error}");
        }
        for text in ["tcp:", "tcp:4000", "tcp:127.0.0.1", "tcp:127.0.0.1:70000", "tcp:::1:4000"] {
            assert!(matches!(text.parse::<ControlAddress>(), Err(ControlAddressError::Address(_))), "{text}");
        }
    }

    #[test]
    fn everything_else_is_a_path() {
        for (text, path) in [("/tmp/control", "/tmp/control"), ("unix:control", "control"), ("tcp", "tcp")] {
            assert_eq!(text.parse(), Ok(ControlAddress::Path(path.into())), "{text}");
        }
        assert_eq!("".parse::<ControlAddress>(), Err(ControlAddressError::Empty));
        let octets = OsString::from_vec(vec![b'/', 0xFF]);
        assert_eq!(ControlAddress::try_from(octets.clone()), Ok(ControlAddress::Path(octets.into())));
    }
}
