//! `--http`: the bench in a browser, beside whatever runs.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};

use clap::Args;
use web::{Server, Settings, Setup, Shown, Token};

use crate::{Failure, output};

/// Where the bench is if nothing else is asked for.
const USUAL: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 8108);

/// Whether there is a bench in a browser, and for whom.
#[derive(Debug, Args)]
pub(crate) struct Browser {
    /// Show the bench in a browser, and serve its API (docs/http.md); prints `http: ` and its address. Port 0
    /// takes one that is free
    #[arg(long, value_name = "ADDRESS:PORT", num_args = 0..=1, default_missing_value = "127.0.0.1:8108", value_parser = address)]
    http: Option<SocketAddr>,
    /// Let other computers in: whoever has the token that stands in the address can do everything
    #[arg(long, requires = "http")]
    http_open: bool,
    /// The token, 16 to 128 letters and digits, in place of one that is made up at every start
    #[arg(long, requires = "http_open", value_name = "TOKEN", value_parser = Token::parse)]
    http_token: Option<Token>,
}

fn address(text: &str) -> Result<SocketAddr, String> {
    let port = text.strip_prefix(':').unwrap_or(text);
    if let Ok(port) = port.parse() {
        return Ok(SocketAddr::new(USUAL.ip(), port));
    }
    let named = text.strip_prefix("localhost:").map(|port| format!("127.0.0.1:{port}"));
    named
        .as_deref()
        .unwrap_or(text)
        .parse()
        .map_err(|_| format!("write an address and a port like {USUAL}, a port, or nothing for {USUAL}"))
}

impl Browser {
    /// Whether it is asked for.
    pub(crate) fn is_wanted(&self) -> bool {
        self.http.is_some()
    }

    /// Serves it, where it is asked for, and prints where it is.
    pub(crate) fn serve(
        &self,
        shown: Shown,
        on_shutdown: impl Fn() + Send + Sync + 'static,
    ) -> Result<Option<Server>, Failure> {
        let Some(address) = self.http else {
            return Ok(None);
        };
        let local = address.ip().is_loopback();
        if !local && !self.http_open {
            return Err(Failure::Usage(format!(
                "--http {address}: other computers could reach it; add --http-open if they may, or leave the \
                 address out"
            )));
        }
        let token = match (&self.http_token, self.http_open) {
            (Some(token), _) => Some(token.clone()),
            (None, false) => None,
            (None, true) => Some(
                Token::random()
                    .map_err(|error| Failure::Failed(format!("--http-open: no token: {error}")))?,
            ),
        };
        let settings = Settings { address, token };
        let server = Server::start(&settings, Setup { shown, on_shutdown: Box::new(on_shutdown) })
            .map_err(|error| Failure::Failed(format!("--http: {error}")))?;
        output::line(&format!("http: {}", url(server.address(), settings.token.as_ref())));
        Ok(Some(server))
    }
}

/// What the user opens.
fn url(address: SocketAddr, token: Option<&Token>) -> String {
    let token = token.map_or(String::new(), |token| format!("?token={}", token.text()));
    format!("http://{address}/{token}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_whole_or_a_port() {
        let at = |text: &str| address(text).expect("an address").to_string();
        assert_eq!(at("0"), "127.0.0.1:0");
        assert_eq!(at(":9000"), "127.0.0.1:9000");
        assert_eq!(at("localhost:9000"), "127.0.0.1:9000");
        assert_eq!(at("0.0.0.0:80"), "0.0.0.0:80");
        assert_eq!(at("[::1]:80"), "[::1]:80");
        for bad in ["", "127.0.0.1", "65536", "example.com:80"] {
            assert!(address(bad).is_err(), "{bad}");
        }
    }
}
