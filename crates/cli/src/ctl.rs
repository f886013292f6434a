//! `sch108bex ctl`: steers a running `sch108bex run --control PATH` from a shell.

mod connection;
mod show;

use std::path::PathBuf;

use clap::{Args, Subcommand};
use plant::control::{Envelope, Request};
use serde_json::{Map, Value, json};

use crate::Failure;
use crate::arguments::{decimal, whole};
use crate::output;
use connection::Connection;

/// Steer encoders that run with --control PATH
///
/// Prints what was asked for, and nothing else. The exit status is 0 when the request was done, 1 when
/// it was refused or nobody listens at PATH, and 2 when it is none.
#[derive(Debug, Args)]
pub(crate) struct Ctl {
    /// The socket: what `run --control` was given
    path: PathBuf,
    /// Which encoder, by name or by number from 1; all for each of them
    #[arg(long, global = true, value_name = "NAME")]
    encoder: Option<String>,
    /// Print what comes as it came, in JSON
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    command: Command,
}

/// What can be asked for.
#[derive(Debug, Subcommand)]
enum Command {
    /// Another movement of the shaft: still@RAW, constant:RPM[@RAW] or another kind (see docs/shafts.md);
    /// @here goes on from where it is
    Shaft {
        #[arg(allow_hyphen_values = true)]
        shaft: String,
    },
    /// Another supply voltage: alarm outside 9 to 30 V, off below 6 V
    Supply {
        #[arg(value_parser = decimal, allow_negative_numbers = true)]
        volts: f64,
    },
    /// Another temperature inside: warning above 65 degrees Celsius
    Temperature {
        #[arg(value_parser = decimal, allow_negative_numbers = true)]
        celsius: f64,
    },
    /// The light of the LED
    Light {
        #[arg(value_parser = ["ok", "low"])]
        state: String,
    },
    /// The battery that keeps the turn count
    Battery {
        #[arg(value_parser = ["ok", "low", "empty"])]
        state: String,
    },
    /// The rotary switches, two hexadecimal digits, X16 first; they count at the next power-on
    Switches {
        #[arg(allow_hyphen_values = true)]
        switches: String,
    },
    /// The power, without warning
    Power {
        #[arg(value_parser = ["off", "on", "cycle"])]
        state: String,
    },
    /// A fault of the sensor, a position error, or the turn count lost at the next power-on
    Sensor {
        #[arg(value_parser = ["once", "held", "position_error", "turns_lost", "off"])]
        fault: String,
    },
    /// A fault of the non-volatile memory: of its writes, of a slot now, of both at the next power-on
    Memory {
        #[arg(value_parser = ["writes_fail", "damage_a", "damage_b", "lost_at_power_on", "off"])]
        fault: String,
    },
    /// The operating time that is stored, while the power is off
    OperatingTime {
        #[arg(value_parser = decimal, allow_negative_numbers = true)]
        hours: f64,
    },
    /// Take it off the bus; it keeps its power
    Leave,
    /// Put it on the bus again
    Join,
    /// What goes wrong on the line by chance, like seed=7 lost_replies=0.01; off for a quiet line
    Line {
        /// seed, late_by_us, and as shares from 0 to 1 bit_errors, character_errors, lost_requests,
        /// lost_replies, doubled_requests, doubled_replies, late_replies
        #[arg(required = true, value_name = "off|NAME=VALUE")]
        values: Vec<String>,
    },
    /// Nobody hears the next requests
    LoseRequests {
        #[arg(default_value_t = 1, value_parser = whole::<u32>(1..=1_000), allow_negative_numbers = true)]
        count: u32,
    },
    /// The master does not hear the next replies
    LoseReplies {
        #[arg(default_value_t = 1, value_parser = whole::<u32>(1..=1_000), allow_negative_numbers = true)]
        count: u32,
    },
    /// The next requests are heard twice
    DoubleRequests {
        #[arg(default_value_t = 1, value_parser = whole::<u32>(1..=1_000), allow_negative_numbers = true)]
        count: u32,
    },
    /// The next replies come twice
    DoubleReplies {
        #[arg(default_value_t = 1, value_parser = whole::<u32>(1..=1_000), allow_negative_numbers = true)]
        count: u32,
    },
    /// The next replies come late
    DelayReplies {
        /// How late, in microseconds
        #[arg(value_parser = whole::<u64>(0..=10_000_000), allow_negative_numbers = true)]
        by_us: u64,
        #[arg(default_value_t = 1, value_parser = whole::<u32>(1..=1_000), allow_negative_numbers = true)]
        count: u32,
    },
    /// Bits of an octet of the next request flip, unseen by the parity
    DamageRequest {
        /// Which octet of the telegram, from 1
        #[arg(value_parser = whole::<u32>(1..=255), allow_negative_numbers = true)]
        octet: u32,
        /// Which bits, two hexadecimal digits
        #[arg(default_value = "01")]
        mask: String,
    },
    /// Bits of an octet of the next reply flip
    DamageReply {
        /// Which octet of the telegram, from 1
        #[arg(value_parser = whole::<u32>(1..=255), allow_negative_numbers = true)]
        octet: u32,
        /// Which bits, two hexadecimal digits
        #[arg(default_value = "01")]
        mask: String,
    },
    /// A character of the next request has a wrong parity
    CharacterError {
        /// Which octet of the telegram, from 1
        #[arg(value_parser = whole::<u32>(1..=255), allow_negative_numbers = true)]
        octet: u32,
    },
    /// Everything as it is now, or one encoder
    Snapshot,
    /// What happens from now on, until Ctrl-C
    Events,
    /// What can be asked for in JSON
    Requests,
    /// A request in JSON as it is
    Raw {
        /// Such as '{"do":"help"}'
        request: String,
    },
    /// End the program in order
    Shutdown,
    #[command(external_subcommand)]
    Unknown(Vec<String>),
}

impl Ctl {
    /// Asks, and prints what comes.
    pub(crate) fn ctl(&self) -> Result<(), Failure> {
        let line = match &self.command {
            Command::Raw { request } => self.raw(request)?,
            command => self.line(command)?,
        };
        // What is wrong whatever runs there is told without asking.
        let Envelope { request, .. } = Envelope::parse(line.as_bytes()).map_err(usage)?;
        request.check().map_err(usage)?;
        let mut connection = Connection::open(&self.path)?;
        let (line, reply) = connection.ask(&line)?;
        if let Some(error) = reply.get("error").and_then(Value::as_str) {
            return Err(Failure::Failed(error.to_owned()));
        }
        if matches!(request, Request::Subscribe {}) {
            return connection.follow(self.json);
        }
        if self.json {
            output::line(&line);
        } else {
            show::reply(&reply);
        }
        Ok(())
    }

    fn raw(&self, request: &str) -> Result<String, Failure> {
        if self.encoder.is_some() {
            return Err(usage("raw: name the encoder in the request, and leave --encoder out"));
        }
        // One request is one line; in JSON a line break is a blank.
        Ok(request.replace(['\n', '\r'], " "))
    }

    /// The request as a line.
    fn line(&self, command: &Command) -> Result<String, Failure> {
        let (name, fields) = command.request()?;
        let mut request = Map::new();
        request.insert("do".to_owned(), name.into());
        if let Some(encoder) = &self.encoder {
            if !command.is_about_an_encoder() {
                return Err(usage(format!("--encoder: {name} is not about an encoder; leave it out")));
            }
            let encoder = encoder.parse::<u64>().map_or_else(|_| encoder.as_str().into(), Value::from);
            request.insert("encoder".to_owned(), encoder);
        }
        if let Value::Object(fields) = fields {
            request.extend(fields);
        }
        Ok(Value::Object(request).to_string())
    }
}

impl Command {
    fn is_about_an_encoder(&self) -> bool {
        matches!(
            self,
            Self::Shaft { .. }
                | Self::Supply { .. }
                | Self::Temperature { .. }
                | Self::Light { .. }
                | Self::Battery { .. }
                | Self::Switches { .. }
                | Self::Power { .. }
                | Self::Sensor { .. }
                | Self::Memory { .. }
                | Self::OperatingTime { .. }
                | Self::Leave
                | Self::Join
                | Self::Snapshot
        )
    }

    /// What `do` has, and the other fields.
    fn request(&self) -> Result<(&'static str, Value), Failure> {
        Ok(match self {
            Self::Shaft { shaft } => ("shaft", json!({ "shaft": shaft })),
            Self::Supply { volts } => ("supply", json!({ "volts": volts })),
            Self::Temperature { celsius } => ("temperature", json!({ "celsius": celsius })),
            Self::Light { state } => ("light", json!({ "state": state })),
            Self::Battery { state } => ("battery", json!({ "state": state })),
            Self::Switches { switches } => ("switches", json!({ "switches": switches })),
            Self::Power { state } => ("power", json!({ "state": state })),
            Self::Sensor { fault } => ("sensor", json!({ "fault": fault })),
            Self::Memory { fault } => ("memory", json!({ "fault": fault })),
            Self::OperatingTime { hours } => ("operating_time", json!({ "hours": hours })),
            Self::Leave => ("leave", Value::Null),
            Self::Join => ("join", Value::Null),
            Self::Line { values } => ("line", noise(values)?),
            Self::LoseRequests { count } => ("lose_requests", json!({ "count": count })),
            Self::LoseReplies { count } => ("lose_replies", json!({ "count": count })),
            Self::DoubleRequests { count } => ("double_requests", json!({ "count": count })),
            Self::DoubleReplies { count } => ("double_replies", json!({ "count": count })),
            Self::DelayReplies { by_us, count } => {
                ("delay_replies", json!({ "by_us": by_us, "count": count }))
            }
            Self::DamageRequest { octet, mask } => {
                ("damage_request", json!({ "octet": octet, "mask": mask }))
            }
            Self::DamageReply { octet, mask } => ("damage_reply", json!({ "octet": octet, "mask": mask })),
            Self::CharacterError { octet } => ("character_error", json!({ "octet": octet })),
            Self::Snapshot => ("snapshot", Value::Null),
            Self::Events => ("subscribe", Value::Null),
            Self::Shutdown => ("shutdown", Value::Null),
            Self::Requests | Self::Raw { .. } => ("help", Value::Null),
            Self::Unknown(words) => {
                let word = words.first().map(String::as_str).unwrap_or_default();
                return Err(usage(format!(
                    "there is no command {word:?}; `sch108bex ctl --help` lists those that there are"
                )));
            }
        })
    }
}

/// `off`, or values with names.
fn noise(values: &[String]) -> Result<Value, Failure> {
    let wrong = |text: String| usage(format!("{text}; write for example seed=7 lost_replies=0.01, or off"));
    if values == ["off"] {
        return Ok(Value::Null);
    }
    let mut fields = Map::new();
    for value in values {
        let (name, number) =
            value.split_once('=').ok_or_else(|| wrong(format!("{value:?} is no NAME=VALUE")))?;
        let parsed = number.parse::<serde_json::Number>();
        let number = parsed.map_err(|_| wrong(format!("{value:?}: the value is no number")))?;
        if ["do", "id"].contains(&name) || fields.insert(name.to_owned(), number.into()).is_some() {
            return Err(wrong(format!("{value:?}: {name} cannot be given here, or not twice")));
        }
    }
    Ok(Value::Object(fields))
}

fn usage(error: impl std::fmt::Display) -> Failure {
    Failure::Usage(error.to_string())
}
