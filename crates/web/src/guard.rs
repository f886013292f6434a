//! Who may ask, and what every answer says to a browser.
//!
//! | whose request | what happens |
//! |---|---|
//! | a page of another site sends one | its `Origin` or `Sec-Fetch-Site` gives it away: 403 |
//! | a name of another site leads to this computer (DNS rebinding) | its `Host` is none of ours: 403 |
//! | somebody on another computer | nobody listens there, unless it is opened; then without the token: 401 |

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::problem::Problem;
use crate::token::Token;

/// Nothing but the page's own files, no frames around it, no plug-ins.
const POLICY: &str = "default-src 'self'; img-src 'self' data:; object-src 'none'; base-uri 'none'; \
                      form-action 'self'; frame-ancestors 'none'";

const HEADERS: [(HeaderName, &str); 5] = [
    (header::CONTENT_SECURITY_POLICY, POLICY),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::X_FRAME_OPTIONS, "DENY"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
];

/// What lets requests in.
#[derive(Debug)]
pub(crate) struct Guard {
    address: SocketAddr,
    token: Option<Token>,
}

impl Guard {
    pub(crate) fn new(address: SocketAddr, token: Option<Token>) -> Self {
        Self { address, token }
    }

    /// The cookie's name: cookies of all ports of a computer are in one place.
    fn cookie(&self) -> String {
        format!("sch108bex_{}", self.address.port())
    }

    /// Refuses what is not meant for this server, or not by whom it should be.
    fn check(&self, request: &Request) -> Result<(), Problem> {
        let headers = request.headers();
        let host = self.check_host(headers)?;
        check_site(headers, &host, request.uri().path())
    }

    fn check_host(&self, headers: &HeaderMap) -> Result<String, Problem> {
        let mut hosts = headers.get_all(header::HOST).iter();
        let host = hosts.next().and_then(|host| host.to_str().ok()).unwrap_or_default();
        let ours = hosts.next().is_none() && self.is_ours(host);
        if ours {
            return Ok(host.to_ascii_lowercase());
        }
        let port = self.address.port();
        Err(forbidden(format!(
            "the host {:?} is not this server; open http://127.0.0.1:{port}/ or http://localhost:{port}/",
            crate::assets::shortened(host)
        )))
    }

    /// Where everybody who asks has the token, a name cannot be used against him: his browser keeps the token for the
    /// name that he has opened.
    fn is_ours(&self, host: &str) -> bool {
        let (name, port) = match host.rsplit_once(':') {
            Some((name, port)) if !port.contains(']') => (name, port.parse().ok()),
            _ => (host, Some(80)),
        };
        let named = name.trim_start_matches('[').trim_end_matches(']');
        let address: Option<IpAddr> = named.parse().ok();
        let loopback =
            name.eq_ignore_ascii_case("localhost") || address.is_some_and(|address| address.is_loopback());
        if self.token.is_some() {
            return !name.is_empty();
        }
        loopback && port == Some(self.address.port())
    }

    /// Whether the token is there, or none is needed.
    fn knows(&self, headers: &HeaderMap) -> bool {
        let Some(token) = &self.token else {
            return true;
        };
        let text =
            |name| headers.get_all(name).into_iter().filter_map(|value: &HeaderValue| value.to_str().ok());
        let bearer = text(header::AUTHORIZATION).any(|value| {
            value.split_once(' ').is_some_and(|(scheme, given)| {
                scheme.eq_ignore_ascii_case("bearer") && token.is(given.trim())
            })
        });
        let cookie = self.cookie();
        bearer
            || text(header::COOKIE).flat_map(|value| value.split(';')).any(|pair| {
                pair.trim().split_once('=').is_some_and(|(name, given)| name == cookie && token.is(given))
            })
    }

    /// `?token=` of the first visit becomes a cookie, and goes out of the address.
    fn first_visit(&self, request: &Request) -> Option<Response> {
        let token = self.token.as_ref()?;
        let query = request.uri().query()?;
        let given = query.split('&').find_map(|pair| pair.strip_prefix("token="))?;
        if !token.is(given) || request.method() != axum::http::Method::GET {
            return None;
        }
        let cookie = format!("{}={given}; Path=/; HttpOnly; SameSite=Strict", self.cookie());
        let to = request.uri().path().to_owned();
        let to = if to.starts_with("//") { "/".to_owned() } else { to };
        Some((StatusCode::SEE_OTHER, [(header::SET_COOKIE, cookie), (header::LOCATION, to)]).into_response())
    }
}

fn forbidden(detail: impl Into<String>) -> Problem {
    Problem::new(StatusCode::FORBIDDEN, detail)
}

/// A page of another site must not ask; to be opened from a link there is fine.
fn check_site(headers: &HeaderMap, host: &str, path: &str) -> Result<(), Problem> {
    let text = |name: &str| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
    let strange = text("origin").is_some_and(|origin| {
        let name = origin.strip_prefix("http://");
        !name.is_some_and(|name| name.eq_ignore_ascii_case(host))
    });
    let fetched = text("sec-fetch-site").is_some_and(|site| !matches!(site, "same-origin" | "none"));
    let visit = text("sec-fetch-mode") == Some("navigate") && !path.starts_with("/api/");
    if strange || (fetched && !visit) {
        return Err(forbidden(
            "a page of another site asks, and only this server's own page may; open that, or use a client \
             without the headers Origin and Sec-Fetch-Site",
        ));
    }
    Ok(())
}

/// In front of everything.
pub(crate) async fn guard(State(guard): State<Arc<Guard>>, request: Request<Body>, next: Next) -> Response {
    let mut response = match guard.check(&request) {
        Err(problem) => problem.into_response(),
        Ok(()) if guard.knows(request.headers()) => next.run(request).await,
        Ok(()) => guard.first_visit(&request).unwrap_or_else(|| {
            let problem = Problem::new(
                StatusCode::UNAUTHORIZED,
                "the token is missing or wrong; open the address that the program has printed, with ?token=..., \
                 or send the header Authorization: Bearer TOKEN",
            );
            ([(header::WWW_AUTHENTICATE, "Bearer")], problem).into_response()
        }),
    };
    let headers = response.headers_mut();
    for (name, value) in HEADERS {
        headers.insert(name, HeaderValue::from_static(value));
    }
    headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    response
}
