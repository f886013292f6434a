//! A hand at the controls of a device behind a port: `sch108bex run --control PATH`, JSON lines on a
//! Unix socket.

use std::collections::BTreeSet;
use std::fmt;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration as Time;

use serde_json::{Value, json};

use crate::rig::{Action, Battery, Hand};

/// Longer than anything takes that is asked for.
const PATIENCE: Time = Time::from_secs(10);

/// The controls of a device behind a port.
pub trait Control: fmt::Debug {
    /// Whether there is this control.
    fn has(&self, hand: Hand) -> bool;

    /// Moves a control.
    ///
    /// # Errors
    ///
    /// Why it was not done.
    fn act(&mut self, action: &Action) -> Result<(), String>;

    /// Makes the device as delivered, with its power just come on.
    ///
    /// # Errors
    ///
    /// Why it was not done.
    fn deliver(&mut self) -> Result<(), String>;

    /// Whether characters can be damaged on their way.
    fn damages_characters(&self) -> bool;

    /// Damages a character of the next request, counted from 1.
    ///
    /// # Errors
    ///
    /// Why it was not done.
    fn damage_character(&mut self, octet: usize) -> Result<(), String>;
}

/// The control socket of a running `sch108bex run --control PATH`.
#[derive(Debug)]
pub struct ControlSocket {
    stream: BufReader<UnixStream>,
    encoder: Value,
    /// The requests that it takes: an emulated board takes fewer than `run` does.
    offered: BTreeSet<String>,
}

impl ControlSocket {
    /// Connects to the socket at `path`; `encoder` is the one of several that is tested, its name or its number from 1.
    ///
    /// # Errors
    ///
    /// Nobody is there, or it does not answer.
    pub fn connect(path: &Path, encoder: Option<&str>) -> Result<Self, String> {
        let stream = UnixStream::connect(path).map_err(|error| error.to_string())?;
        let limit = |stream: &UnixStream| {
            stream.set_read_timeout(Some(PATIENCE))?;
            stream.set_write_timeout(Some(PATIENCE))
        };
        limit(&stream).map_err(|error| error.to_string())?;
        let encoder =
            encoder.map_or(Value::Null, |name| name.parse::<u64>().map_or_else(|_| name.into(), Value::from));
        let mut socket = Self { stream: BufReader::new(stream), encoder, offered: BTreeSet::new() };
        let help = socket.answer(&json!({"do": "help"}))?;
        let names = help["commands"].as_array().into_iter().flatten();
        socket.offered = names.filter_map(|one| one["name"].as_str().map(str::to_owned)).collect();
        Ok(socket)
    }

    fn ask(&mut self, mut request: Value) -> Result<(), String> {
        if !self.encoder.is_null() && request.get("octet").is_none() {
            request["encoder"] = self.encoder.clone();
        }
        self.answer(&request).map(drop)
    }

    fn answer(&mut self, request: &Value) -> Result<Value, String> {
        let broken = |error: std::io::Error| format!("{request}: {error}");
        self.stream.get_mut().write_all(format!("{request}\n").as_bytes()).map_err(broken)?;
        let mut line = String::new();
        self.stream.read_line(&mut line).map_err(broken)?;
        let reply: Value =
            serde_json::from_str(&line).map_err(|_| format!("{request}: no reply that can be read"))?;
        if reply["ok"] == Value::Bool(true) {
            Ok(reply)
        } else {
            Err(format!("{request}: {}", reply["error"].as_str().unwrap_or("refused")))
        }
    }
}

impl Control for ControlSocket {
    fn has(&self, hand: Hand) -> bool {
        let needed: &[&str] = match hand {
            Hand::Power => &["power"],
            Hand::Delivery => &["power", "memory"],
            Hand::Switches => &["switches"],
            Hand::Shaft => &["shaft"],
            Hand::World => &["supply", "temperature", "light", "battery"],
            Hand::Faults => &["sensor"],
            Hand::OperatingTime => &["power", "operating_time"],
        };
        needed.iter().all(|name| self.offered.contains(*name))
    }

    fn act(&mut self, action: &Action) -> Result<(), String> {
        let request = match *action {
            Action::PowerOff => json!({"do": "power", "state": "off"}),
            Action::PowerOn => json!({"do": "power", "state": "on"}),
            Action::Switches(switches) => json!({"do": "switches", "switches": format!("{switches:02X}")}),
            Action::Shaft(raw) => json!({"do": "shaft", "shaft": format!("still@{raw}")}),
            Action::Turn(rpm) => json!({"do": "shaft", "shaft": format!("constant:{rpm}@here")}),
            Action::Supply(tenths) => json!({"do": "supply", "volts": f64::from(tenths) / 10.0}),
            Action::Temperature(tenths) => {
                json!({"do": "temperature", "celsius": f64::from(tenths) / 10.0})
            }
            Action::Light(ok) => json!({"do": "light", "state": if ok { "ok" } else { "low" }}),
            Action::Battery(battery) => {
                let state = match battery {
                    Battery::Ok => "ok",
                    Battery::Low => "low",
                    Battery::Empty => "empty",
                };
                json!({"do": "battery", "state": state})
            }
            Action::PositionError => json!({"do": "sensor", "fault": "position_error"}),
            Action::OperatingTime(tenths) => {
                self.act(&Action::PowerOff)?;
                #[expect(clippy::cast_precision_loss, reason = "far below 2^52 tenths of an hour")]
                let hours = tenths as f64 / 10.0;
                self.ask(json!({"do": "operating_time", "hours": hours}))?;
                json!({"do": "power", "state": "on"})
            }
        };
        self.ask(request)
    }

    fn deliver(&mut self) -> Result<(), String> {
        // Both records are lost, which is a position error; the next power-on clears that.
        self.ask(json!({"do": "memory", "fault": "lost_at_power_on"}))?;
        self.ask(json!({"do": "power", "state": "cycle"}))?;
        self.ask(json!({"do": "memory", "fault": "off"}))?;
        self.ask(json!({"do": "power", "state": "cycle"}))
    }

    fn damages_characters(&self) -> bool {
        self.offered.contains("character_error")
    }

    fn damage_character(&mut self, octet: usize) -> Result<(), String> {
        self.ask(json!({"do": "character_error", "octet": octet}))
    }
}
