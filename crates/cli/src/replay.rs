//! `sch108bex replay`: a capture's requests, sent again.

mod line;

use std::collections::VecDeque;
use std::fs::File;
use std::path::PathBuf;
use std::time::{Duration, Instant as Moment};

use bus::{PortAddress, open_for_master};
use capture::{Direction, Packet, Reader};
use clap::{Args, ValueEnum};
use dissector::{Conversation, Item, Profile, Service};
use profibus_dp::time::Baudrate;
use serde::Serialize;

use crate::arguments::{Baud, whole};
use crate::{Failure, output};
use line::Line;

/// A request that was not answered in the capture is waited for so long.
const SILENCE: Duration = Duration::from_millis(30);
/// A port where nobody listens yet is tried for so long.
const PATIENCE: profibus_dp::time::Duration = profibus_dp::time::Duration::from_millis(2_000);

/// Send a capture's requests to a slave again
///
/// As a test every answer is compared with that of the capture: status 1 if one differs.
#[derive(Debug, Args)]
pub(crate) struct Replay {
    /// A capture that `run --capture`, `capture` or Wireshark has written as pcapng
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Where the slave is: a serial device or pseudo terminal, tcp:ADDRESS:PORT or unix:PATH
    #[arg(long, value_name = "PORT")]
    port: PortAddress,
    /// master: only send, and count the answers; test: compare them
    #[arg(long = "as", value_enum, default_value_t = Role::Master, value_name = "master|test")]
    role: Role,
    /// So many times as fast as it was
    #[arg(long, default_value_t = 1.0, value_parser = speed, value_name = "FACTOR")]
    speed: f64,
    /// As a test: inputs that Data_Exchange and RD_Inp bring may be others
    #[arg(long)]
    ignore_inputs: bool,
    /// The rate of a serial device
    #[arg(long, default_value = "500000", value_name = "RATE", allow_hyphen_values = true)]
    baud: Baud,
    /// How long an answer may take, in milliseconds
    #[arg(long, default_value_t = 1000, value_parser = whole::<u64>(1..=60_000), allow_hyphen_values = true, value_name = "MS")]
    patience: u64,
    /// One document for each difference and one for the result, each in a line
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Role {
    /// Only send, and count the answers
    Master,
    /// Compare the answers
    Test,
}

fn speed(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(speed) if (0.001..=1_000_000.0).contains(&speed) => Ok(speed),
        _ => Err("write a factor from 0.001 to 1000000, like 2 for twice as fast".to_owned()),
    }
}

/// A request of the capture, and what came back.
#[derive(Debug)]
struct Exchange {
    /// Its packet, from 1.
    number: u64,
    nanos: u64,
    request: Vec<u8>,
    answer: Option<Vec<u8>>,
    service: Option<Service>,
    summary: String,
}

/// An answer that is another one.
#[derive(Debug, Serialize)]
struct Difference<'a> {
    packet: u64,
    request: &'a str,
    captured: String,
    got: String,
    /// From 1.
    octets: Vec<usize>,
}

#[derive(Debug, Default, Serialize)]
struct Outcome {
    requests: u64,
    answers: u64,
    differences: u64,
}

impl Replay {
    /// Sends all requests, and judges the answers where it is asked to.
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let exchanges = self.exchanges()?;
        let Baud::Fixed(rate) = self.baud else {
            return Err(Failure::Usage("--baud: write a rate; a master chooses it".to_owned()));
        };
        let outcome = self.replay(&exchanges, rate)?;
        if self.json {
            output::json_line(&outcome);
        } else {
            let Outcome { requests, answers, differences } = outcome;
            let differ = match self.role {
                Role::Master => String::new(),
                Role::Test => format!(", {differences} differ"),
            };
            output::line(&format!("{requests} requests, {answers} answers{differ}"));
        }
        match outcome.differences {
            0 => Ok(()),
            count => Err(Failure::Failed(format!("{count} answers are not those of the capture"))),
        }
    }

    fn replay(&self, exchanges: &[Exchange], rate: Baudrate) -> Result<Outcome, Failure> {
        let failed = |error: bus::EndError| Failure::Failed(error.to_string());
        let mut line = Line::new(open_for_master(&self.port, rate, PATIENCE).map_err(failed)?);
        line.come().map_err(failed)?;
        let first = exchanges.first().map_or(0, |exchange| exchange.nanos);
        let begin = Moment::now();
        let mut outcome = Outcome::default();
        for exchange in exchanges {
            let due = Duration::from_nanos(exchange.nanos.saturating_sub(first)).div_f64(self.speed);
            line.idle_until(begin + due).map_err(failed)?;
            line.send(&exchange.request).map_err(failed)?;
            outcome.requests += 1;
            let answered = exchange.answer.is_some();
            let patience = if answered { Duration::from_millis(self.patience) } else { SILENCE };
            let expects = answered || may_be_answered(&exchange.request);
            let got = if expects { line.listen(patience).map_err(failed)? } else { Vec::new() };
            outcome.answers += u64::from(!got.is_empty());
            if self.role == Role::Test {
                outcome.differences += u64::from(self.judge(exchange, &got));
            }
        }
        Ok(outcome)
    }

    /// Tells what differs; whether anything does.
    fn judge(&self, exchange: &Exchange, got: &[u8]) -> bool {
        let captured = exchange.answer.as_deref().unwrap_or_default();
        let inputs = matches!(exchange.service, Some(Service::DataExchange | Service::RdInp));
        let mut octets = differing(captured, got);
        if self.ignore_inputs && inputs && captured.len() == got.len() {
            // Of an SD2 the data and the check sum; the head, with its function code, is the same.
            let data = if captured.first() == Some(&0x68) { 8..captured.len() } else { 0..0 };
            octets.retain(|octet| !data.contains(octet));
        }
        if octets.is_empty() {
            return false;
        }
        let difference = Difference {
            packet: exchange.number,
            request: &exchange.summary,
            captured: dissector::hex::text(captured),
            got: dissector::hex::text(got),
            octets,
        };
        if self.json {
            output::json_line(&difference);
        } else {
            output::line(&in_words(&difference));
        }
        true
    }

    /// The capture, as requests with their answers.
    fn exchanges(&self) -> Result<Vec<Exchange>, Failure> {
        let name = self.file.display();
        let failed = |why: String| Failure::Failed(format!("{name} {why}"));
        let file = File::open(&self.file).map_err(|error| failed(format!("cannot be read: {error}")))?;
        let mut reader = Reader::new(file).map_err(|error| failed(error.to_string()))?;
        let mut exchanges = VecDeque::new();
        let mut conversation = Conversation::new(Profile::Auto);
        let mut number = 0;
        loop {
            match reader.next_packet() {
                Ok(Some(packet)) => {
                    number += 1;
                    sort(number, packet, &mut conversation, &mut exchanges);
                }
                Ok(None) => break,
                Err(error @ capture::ReadError::Cut { .. }) => {
                    output::aside(&format!("warning: {name} {error}"));
                    break;
                }
                Err(error) => return Err(failed(error.to_string())),
            }
        }
        if exchanges.is_empty() {
            return Err(failed("has no request in it".to_owned()));
        }
        Ok(exchanges.into())
    }
}

/// Puts a packet where it belongs.
fn sort(number: u64, packet: Packet, conversation: &mut Conversation, into: &mut VecDeque<Exchange>) {
    let Packet { nanos, octets, direction, .. } = packet;
    if octets.is_empty() {
        return;
    }
    let mut told = None;
    let mut take = |entry: dissector::Entry| {
        if let Item::Telegram(telegram) = entry.item {
            told = Some((telegram.direction, telegram.service, telegram.summary));
        }
    };
    conversation.push(&octets, &mut take);
    conversation.finish(&mut take);
    let (service, summary, is_reply) = match told {
        Some((who, service, summary)) => (service, summary, who == dissector::Direction::Response),
        None => (None, "no telegram".to_owned(), direction == Some(Direction::Reply)),
    };
    if is_reply {
        if let Some(last) = into.back_mut()
            && last.answer.is_none()
        {
            last.answer = Some(octets);
        }
        return;
    }
    into.push_back(Exchange { number, nanos, request: octets, answer: None, service, summary });
}

/// Tokens and requests without acknowledgement are not waited for.
fn may_be_answered(request: &[u8]) -> bool {
    let fc = match request {
        [0x10 | 0xA2, _, _, fc, ..] | [0x68, _, _, _, _, _, fc, ..] => *fc,
        _ => return false,
    };
    !matches!(fc & 0x0F, 0x0 | 0x4 | 0x6 | 0x7)
}

/// The octets, from 1, at which they are not the same.
fn differing(one: &[u8], other: &[u8]) -> Vec<usize> {
    (0..one.len().max(other.len())).filter(|&at| one.get(at) != other.get(at)).map(|at| at + 1).collect()
}

fn in_words(difference: &Difference<'_>) -> String {
    let Difference { packet, request, captured, got, octets } = difference;
    let what = match (captured.is_empty(), got.is_empty()) {
        (true, _) => format!("answered, and in the capture it was not\n  got      {got}"),
        (_, true) => format!("not answered\n  captured {captured}"),
        _ => {
            let plural = if octets.len() == 1 { "octet" } else { "octets" };
            let numbers: Vec<_> = octets.iter().map(ToString::to_string).collect();
            format!("{plural} {} differ\n  captured {captured}\n  got      {got}", numbers.join(", "))
        }
    };
    format!("packet {packet}: {request}: {what}")
}
