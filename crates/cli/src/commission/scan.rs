//! `scan`: who is on the bus, and what it is.

use std::fmt::Write;
use std::path::PathBuf;

use ::master::light::StationKind;
use clap::Args;
use dissector::advice::{Diagnosis, Level};
use profibus_dp::wire::StandardDiagnosis;
use sch108bex::diagnostics::Diagnostics;
use serde::Serialize;

use super::find::{NOBODY, each_station};
use super::names::Names;
use super::place::Place;
use super::{Light, words};
use crate::{Failure, output};

/// Who is on the bus: every address from 0 to 126, what answers there, and how it is
///
/// Each station is told as soon as it is found. Slaves are asked for their diagnosis, which changes nothing.
/// Status: 1 if nobody answers.
#[derive(Debug, Args)]
pub(crate) struct Scan {
    #[command(flatten)]
    place: Place,
    /// GSD files, or folders of them: the names of devices by their ident numbers
    #[arg(long, value_name = "FILE", num_args = 1..)]
    gsd: Vec<PathBuf>,
    /// One document at the end
    #[arg(long)]
    json: bool,
}

/// A station as it was found.
#[derive(Debug, Serialize)]
struct Found {
    address: u8,
    station: &'static str,
    /// Four hexadecimal digits.
    #[serde(skip_serializing_if = "Option::is_none")]
    ident_number: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    /// Singleturn x multiturn bits, of an encoder.
    #[serde(skip_serializing_if = "Option::is_none")]
    bits: Option<String>,
    /// The master that owns it.
    #[serde(skip_serializing_if = "Option::is_none")]
    owner: Option<u8>,
    /// The gravest that its diagnosis has to tell.
    #[serde(skip_serializing_if = "Option::is_none")]
    level: Option<Level>,
    #[serde(skip_serializing_if = "Option::is_none")]
    diagnosis: Option<String>,
}

impl Scan {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let names = Names::read(&self.gsd)?;
        let found = self.place.with(|light| self.scan(light, &names))?;
        if self.json {
            output::json(&found);
        }
        if found.is_empty() {
            return Err(Failure::Failed(NOBODY.to_owned()));
        }
        if !self.json {
            output::line(&sum(&found));
        }
        Ok(())
    }

    fn scan(&self, light: &mut Light, names: &Names) -> Result<Vec<Found>, Failure> {
        let mut stations = Vec::new();
        each_station(light, |light, address, kind| {
            let found = Found::ask(light, address, kind, names);
            if !self.json {
                output::line(&found.line());
            }
            stations.push(found);
            Ok(())
        })?;
        Ok(stations)
    }
}

impl Found {
    /// A slave that does not give its diagnosis is told all the same.
    fn ask(light: &mut Light, address: u8, kind: StationKind, names: &Names) -> Self {
        let mut found = Self {
            address,
            station: words::kind(kind),
            ident_number: None,
            name: None,
            bits: None,
            owner: None,
            level: None,
            diagnosis: None,
        };
        if kind != StationKind::Passive {
            return found;
        }
        let octets = match light.diagnosis(address) {
            Ok(diagnosis) => diagnosis.octets.to_vec(),
            Err(error) => {
                found.diagnosis = Some(format!("no diagnosis: {error}"));
                return found;
            }
        };
        if let (Some(standard), Some(read)) = (StandardDiagnosis::parse(&octets), Diagnosis::read(&octets)) {
            found.ident_number = Some(format!("{:04X}", standard.ident_number));
            found.name = names.get(standard.ident_number).map(str::to_owned);
            found.owner = standard.master_add;
            found.level = read.level();
            let encoder = octets.get(6..).and_then(Diagnostics::parse).filter(|_| read.is_encoder);
            found.bits = encoder.map(|encoder| bits(&encoder));
            found.diagnosis = Some(read.summary);
        }
        found
    }

    /// One line: address, what it is, how it is, what to do next.
    fn line(&self) -> String {
        let mut line = format!("{:3}  {}", self.address, self.station);
        if let Some(ident) = &self.ident_number {
            let _ = write!(line, "  {ident}h  {}", self.name.as_deref().unwrap_or("no GSD file names it"));
        }
        if let Some(bits) = &self.bits {
            let _ = write!(line, ", encoder of {bits} bits");
        }
        if let Some(diagnosis) = &self.diagnosis {
            let _ = write!(line, "\n     {diagnosis}");
        }
        match self.address {
            126 => {
                line.push_str("\n     as delivered: `set-address 126 N` gives it an address from 1 to 125");
            }
            _ if matches!(self.level, Some(Level::Alarm | Level::Warning)) => {
                let _ = write!(line, "\n     `diag {}` says what to do", self.address);
            }
            _ => {}
        }
        line
    }
}

/// Singleturn x multiturn bits; numbers that are no powers of two are told as they are.
fn bits(encoder: &Diagnostics) -> String {
    let (steps, turns) = (encoder.singleturn_resolution, u32::from(encoder.revolutions));
    if steps.is_power_of_two() && turns.is_power_of_two() {
        format!("{}x{}", steps.trailing_zeros(), turns.trailing_zeros())
    } else {
        format!("{steps} steps x {turns} turns,")
    }
}

fn sum(found: &[Found]) -> String {
    let slaves = found.iter().filter(|found| found.station == "slave").count();
    let masters = found.len() - slaves;
    let several = |count: usize, what: &str| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
    format!("{}, {} besides this one", several(slaves, "slave"), several(masters, "master"))
}
