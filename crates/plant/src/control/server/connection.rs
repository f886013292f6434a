//! One client of the control socket.

use std::io::{self, BufRead, BufReader, Write};
use std::sync::{Arc, Mutex, PoisonError};

use serde::Serialize;

use crate::control::envelope::{Envelope, Reply};
use crate::control::event::EventLine;
use crate::control::request::Request;
use crate::control::server::stream::Stream;
use crate::control::server::{MOST_OCTETS, Shared};
use crate::control::subscriptions::{Item, Subscription};

/// What replies and events take turns at.
type Writer = Arc<Mutex<Stream>>;

/// What a client has sent.
enum Line {
    Whole,
    TooLong,
    End,
}

/// Serves a client until it goes.
pub(super) fn serve(shared: &Shared, client: Stream) {
    let Ok(writer) = client.try_clone() else {
        return;
    };
    let writer = Arc::new(Mutex::new(writer));
    let mut reader = BufReader::new(client);
    let mut line = Vec::new();
    let mut subscription = None;
    if reader.get_ref().is_open_to_browsers()
        && let Some(refusal) = stranger(&mut reader)
    {
        if tell(&writer, &Reply::refused(None, refusal.to_owned())).is_ok() {
            reader.get_mut().hang_up();
        }
        return;
    }
    loop {
        let told = match read_line(&mut reader, &mut line, shared) {
            Ok(Line::Whole) if line.trim_ascii().is_empty() => Ok(()),
            Ok(Line::Whole) => obey(shared, &line, &writer, &mut subscription),
            Ok(Line::TooLong) => {
                let error =
                    format!("a line has {MOST_OCTETS} octets at most; this one was skipped to its end");
                tell(&writer, &Reply::refused(None, error))
            }
            Ok(Line::End) | Err(_) => break,
        };
        if told.is_err() {
            break;
        }
    }
    if let Some(subscription) = subscription {
        subscription.close();
    }
}

/// What somebody is told whose first octets are no request. No browser begins with a JSON object, whatever page
/// made it send something: its first octets are its own, an HTTP method or those of TLS.
fn stranger(reader: &mut impl BufRead) -> Option<&'static str> {
    loop {
        let octets = reader.fill_buf().ok()?;
        let blank = octets.iter().take_while(|octet| octet.is_ascii_whitespace()).count();
        if octets.is_empty() || octets.get(blank) == Some(&b'{') {
            return None;
        }
        if blank < octets.len() {
            let looks_like_http = octets.windows(6).any(|part| part == b" HTTP/");
            return Some(if looks_like_http { NO_WEB_SERVER } else { NO_REQUEST });
        }
        reader.consume(blank);
    }
}

const NO_WEB_SERVER: &str = "this is HTTP, and here is no web server: this port takes requests as lines of JSON, such as \
                             {\"do\":\"help\"}; the connection is closed, and nothing of it was done";

const NO_REQUEST: &str = "the first line here is a JSON object, such as {\"do\":\"help\"}; the connection is closed, \
                          and nothing of it was done";

/// Reads up to the end of a line, or to the end of everything.
fn read_line(reader: &mut impl BufRead, line: &mut Vec<u8>, shared: &Shared) -> io::Result<Line> {
    line.clear();
    shared.turns.take();
    let mut skipped = 0;
    loop {
        let octets = reader.fill_buf()?;
        if octets.is_empty() {
            return Ok(match (line.is_empty(), skipped) {
                (_, 1..) => Line::TooLong,
                (true, _) => Line::End,
                (false, _) => Line::Whole,
            });
        }
        let end = octets.iter().position(|&octet| octet == b'\n');
        let count = end.unwrap_or(octets.len());
        if skipped == 0 && line.len() + count <= MOST_OCTETS {
            line.extend_from_slice(&octets[..count]);
        } else {
            if skipped / MOST_OCTETS != (skipped + count) / MOST_OCTETS {
                shared.turns.take();
            }
            skipped += count.max(1);
        }
        reader.consume(count + usize::from(end.is_some()));
        if end.is_some() {
            return Ok(if skipped > 0 { Line::TooLong } else { Line::Whole });
        }
    }
}

/// Does what a line asks for, and replies.
fn obey(
    shared: &Shared,
    line: &[u8],
    writer: &Writer,
    subscription: &mut Option<Subscription>,
) -> io::Result<()> {
    let Envelope { id, request } = match Envelope::parse(line) {
        Ok(envelope) => envelope,
        Err(refused) => return tell(writer, &Reply::refused(refused.id, refused.error)),
    };
    match request {
        Request::Subscribe {} => {
            let fresh = subscription.is_none().then(|| shared.subscriptions.subscribe());
            tell(writer, &Reply::done(id, None))?;
            if let Some(fresh) = fresh {
                pass_on(&fresh, writer)?;
                *subscription = Some(fresh);
            }
            Ok(())
        }
        Request::Unsubscribe {} => {
            if let Some(subscription) = subscription.take() {
                subscription.close();
            }
            tell(writer, &Reply::done(id, None))
        }
        Request::Shutdown {} => {
            let told = tell(writer, &Reply::done(id, None));
            (shared.on_shutdown)();
            told
        }
        request => match shared.steered.steer(&request) {
            Ok(result) => tell(writer, &Reply::done(id, result)),
            Err(error) => tell(writer, &Reply::refused(id, error.to_string())),
        },
    }
}

/// Writes what happens, on a thread of its own, until the subscription is closed.
fn pass_on(subscription: &Subscription, writer: &Writer) -> io::Result<()> {
    let (subscription, writer) = (subscription.clone(), Arc::clone(writer));
    let write = move || {
        while let Some(item) = subscription.next() {
            let line = match item {
                Item::Report(report) => EventLine::from(&*report),
                Item::Dropped(count) => EventLine::dropped(count),
            };
            if tell_unless(&writer, &line, || subscription.is_closed()).is_err() {
                subscription.close();
            }
        }
    };
    std::thread::Builder::new().name("control events".to_owned()).spawn(write).map(drop)
}

fn tell(writer: &Writer, message: &impl Serialize) -> io::Result<()> {
    tell_unless(writer, message, || false)
}

/// Writes a line, unless by the time it is its turn `too_late` says so.
fn tell_unless(writer: &Writer, message: &impl Serialize, too_late: impl Fn() -> bool) -> io::Result<()> {
    let mut line = serde_json::to_vec(message)?;
    line.push(b'\n');
    let mut writer = writer.lock().unwrap_or_else(PoisonError::into_inner);
    if too_late() { Ok(()) } else { writer.write_all(&line) }
}
