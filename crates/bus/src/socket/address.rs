//! Addresses of TCP ports as users write them: `ADDRESS:PORT`.

use std::fmt;
use std::net::{SocketAddr, ToSocketAddrs};
use std::str::FromStr;

use crate::end::EndError;

/// A host, by name or in numbers, and a port. There is no default for either.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TcpAddress {
    /// A name, an IPv4 address, or an IPv6 address without its brackets.
    host: String,
    port: u16,
}

/// Why a text is no [`TcpAddress`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum AddressError {
    /// The port, or the address before it, is missing.
    #[error("write an address and a port, like 127.0.0.1:4000 or [::1]:4000")]
    Incomplete,
    /// The port is no number of 16 bits.
    #[error("a port is a number from 0 to 65535, like 127.0.0.1:4000")]
    Port,
    /// An IPv6 address is not in brackets, or something else is.
    #[error("write an IPv6 address in brackets, like [::1]:4000")]
    Brackets,
}

impl TcpAddress {
    /// The port; 0 stands for any that is free.
    pub const fn port(&self) -> u16 {
        self.port
    }

    /// Its numbers. A name may have several, and asking for them may take some seconds.
    pub(crate) fn resolve(&self) -> Result<Vec<SocketAddr>, EndError> {
        let failed = |source| EndError::Socket {
            step: "find",
            name: self.to_string(),
            source,
            remedy: "check the name, or write the address in numbers, like 127.0.0.1",
        };
        let found: Vec<_> = (self.host.as_str(), self.port).to_socket_addrs().map_err(failed)?.collect();
        if found.is_empty() { Err(failed(std::io::ErrorKind::NotFound.into())) } else { Ok(found) }
    }
}

impl FromStr for TcpAddress {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let (host, port) = text.rsplit_once(':').ok_or(AddressError::Incomplete)?;
        let in_brackets = host.strip_prefix('[').and_then(|host| host.strip_suffix(']'));
        let host = match in_brackets {
            // A zone may follow: fe80::1%2.
            Some(inside) if inside.contains(':') => inside,
            Some(_) => return Err(AddressError::Brackets),
            None if host.contains([':', '[', ']']) => return Err(AddressError::Brackets),
            None => host,
        };
        if host.is_empty() || port.is_empty() {
            return Err(AddressError::Incomplete);
        }
        let digits = port.bytes().all(|digit| digit.is_ascii_digit());
        let port = port.parse().ok().filter(|_| digits).ok_or(AddressError::Port)?;
        Ok(Self { host: host.to_owned(), port })
    }
}

impl fmt::Display for TcpAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { host, port } = self;
        if host.contains(':') { write!(f, "[{host}]:{port}") } else { write!(f, "{host}:{port}") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_a_host_and_a_port() {
        for text in ["127.0.0.1:4000", "localhost:0", "[::1]:65535", "[fe80::1%2]:1", "plc-7.example:102"] {
            assert_eq!(text.parse::<TcpAddress>().expect(text).to_string(), text);
        }
    }

    #[test]
    fn neither_has_a_default() {
        use AddressError::{Brackets, Incomplete, Port};
        for (text, error) in [
            ("", Incomplete),
            ("4000", Incomplete),
            (":4000", Incomplete),
            ("127.0.0.1", Incomplete),
            ("127.0.0.1:", Incomplete),
            ("127.0.0.1:x", Port),
            ("127.0.0.1:+5", Port),
            ("127.0.0.1:-1", Port),
            ("127.0.0.1:65536", Port),
            ("127.0.0.1: 80", Port),
            ("::1:4000", Brackets),
            ("[::1:4000", Brackets),
            ("[localhost]:4000", Brackets),
            ("[]:4000", Brackets),
        ] {
            assert_eq!(text.parse::<TcpAddress>(), Err(error), "{text}");
        }
    }

    #[test]
    fn a_name_that_nobody_has_is_an_error_with_a_remedy() {
        let address: TcpAddress = "no-such-host.invalid:4000".parse().expect("an address");
        let error = address.resolve().expect_err("invalid is nobody's").to_string();
        assert!(error.starts_with("cannot find no-such-host.invalid:4000: "), "{error}");
        assert!(error.contains("check the name"), "{error}");
    }
}
