//! `sch108bex ctl`: steers a running `sch108bex run --control WHERE` from a shell.

mod commands;
mod connection;
mod order;
mod pairs;
mod show;

use clap::Args;
use plant::control::{ControlAddress, Envelope, Request};
use serde_json::{Map, Value};

use crate::Failure;
use crate::arguments::control_address;
use crate::output;
use commands::{About, Command};
use connection::Connection;

/// Steer encoders that run with --control WHERE
///
/// Prints what was asked for, and nothing else. The exit status is 0 when the request was done, 1 when
/// it was refused or nobody listens at WHERE, and 2 when it is none.
#[derive(Debug, Args)]
pub(crate) struct Ctl {
    /// What --control was given: the path of a socket, or tcp:127.0.0.1:PORT
    #[arg(value_parser = control_address(), value_name = "WHERE")]
    address: ControlAddress,
    /// Which encoder, by name or by number from 1; all for each of them
    #[arg(long, global = true, value_name = "NAME")]
    encoder: Option<String>,
    /// Which segment, for what is about the line or the cable; by name or by number from 1; all for each of them
    #[arg(long, global = true, value_name = "NAME")]
    segment: Option<String>,
    /// Print what comes as it came, in JSON
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    command: Command,
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
        let mut connection = Connection::open(&self.address)?;
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
        if self.encoder.is_some() || self.segment.is_some() {
            return Err(usage(
                "raw: name the encoder or segment in the request, and leave --encoder and --segment out",
            ));
        }
        // One request is one line; in JSON a line break is a blank.
        Ok(request.replace(['\n', '\r'], " "))
    }

    /// The request as a line.
    fn line(&self, command: &Command) -> Result<String, Failure> {
        let (name, fields) = command.request()?;
        let mut request = Map::new();
        request.insert("do".to_owned(), name.into());
        for (key, given, about) in
            [("encoder", &self.encoder, About::Encoder), ("segment", &self.segment, About::Segment)]
        {
            let Some(which) = given else { continue };
            if command.about() != about {
                return Err(usage(format!("--{key}: {name} is not about {}; leave it out", about.words())));
            }
            let which = which.parse::<u64>().map_or_else(|_| which.as_str().into(), Value::from);
            request.insert(key.to_owned(), which);
        }
        if let Value::Object(fields) = fields {
            request.extend(fields);
        }
        Ok(Value::Object(request).to_string())
    }
}

fn usage(error: impl std::fmt::Display) -> Failure {
    Failure::Usage(error.to_string())
}
