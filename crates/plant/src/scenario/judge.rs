//! Judging what must hold.

use profibus_dp::time::Instant;
use serde_json::Value;

use super::bench::Bench;
use super::expect::{Check, Expectation, Flag, What};
use super::outcome::Verdict;
use super::poller::Poller;
use super::quantity::{Travel, show_time};
use super::run::Progress;
use super::{Scenario, position};
use crate::control::{Applied, EventLine, Request, Which};
use crate::report::Report;
use crate::snapshot::{DeviceSnapshot, Snapshot, alarms, state, warnings};

/// Judges a scenario while it is played.
#[derive(Debug)]
pub(super) struct Judge<'a> {
    expectations: &'a [Expectation],
    lines: Vec<usize>,
    /// For what the master sees: how many cycles had begun.
    cycles: Vec<Option<u64>>,
    /// For events: the first that fits.
    seen: Vec<Option<Seen>>,
    verdicts: Vec<Option<Verdict>>,
}

/// An event that fits, or what came closest to it.
#[derive(Debug, Clone)]
struct Seen {
    at: Instant,
    text: String,
}

impl<'a> Judge<'a> {
    pub(super) fn new(scenario: &'a Scenario, source: &str) -> Self {
        let expectations = &scenario.expectations[..];
        let count = expectations.len();
        Self {
            expectations,
            lines: expectations.iter().map(|expectation| position(source, expectation.octet).0).collect(),
            cycles: vec![None; count],
            seen: vec![None; count],
            verdicts: vec![None; count],
        }
    }

    /// What became of all of them.
    pub(super) fn verdicts(self) -> Vec<Verdict> {
        self.verdicts.into_iter().flatten().collect()
    }

    /// From now on a master has to see something.
    pub(super) fn begin(&mut self, at: usize, bench: &Bench) {
        if let What::Sees { encoder, .. } = &self.expectations[at].what {
            self.cycles[at] = bench.poller_of(encoder).map(|poller| poller.cycles);
        }
    }

    /// Something has happened.
    pub(super) fn note(&mut self, report: &Report) {
        let mut line = None;
        for (expectation, seen) in self.expectations.iter().zip(&mut self.seen) {
            let What::Event { kind, encoder, fields, after, before, .. } = &expectation.what else {
                continue;
            };
            let in_time = report.at >= *after && before.is_none_or(|before| report.at <= before);
            let by_whom = encoder.as_deref().is_none_or(|encoder| encoder == &*report.who);
            if seen.is_some() || !in_time || !by_whom {
                continue;
            }
            let line = line.get_or_insert_with(|| EventLine::from(report));
            if line.kind == Some(kind)
                && fields.iter().all(|(key, due)| line.fields.get(key).is_some_and(|is| same(is, due)))
            {
                *seen = Some(Seen { at: report.at, text: format!("{}: {}", report.who, line.text) });
            }
        }
    }

    /// Looks at an encoder now.
    pub(super) fn state(&mut self, at: usize, bench: &Bench) -> &Verdict {
        let verdict = self.look(at, bench);
        self.verdicts[at].insert(verdict)
    }

    /// All that will be judged, as if it were now.
    pub(super) fn expected(&self, bench: &Bench) -> Vec<Verdict> {
        (0..self.expectations.len()).map(|at| self.look(at, bench)).collect()
    }

    fn look(&self, at: usize, bench: &Bench) -> Verdict {
        let expectation = &self.expectations[at];
        let What::State { at: moment, encoder, checks } = &expectation.what else {
            return self.last(at, bench);
        };
        let results: Vec<_> = checks.iter().map(|check| judge(check, encoder, bench)).collect();
        let due: Vec<_> = results.iter().map(|result| result.due.as_str()).collect();
        let found: Vec<_> = results.iter().map(|result| result.found.as_str()).collect();
        Verdict {
            line: self.lines[at],
            expected: named(expectation, || format!("at {} {encoder}: {}", seconds(*moment), due.join(", "))),
            holds: results.iter().all(|result| result.holds),
            found: found.join(", "),
        }
    }

    /// What can be told only now.
    pub(super) fn end(&mut self, bench: &Bench, progress: &mut dyn Progress) {
        for at in 0..self.expectations.len() {
            if self.verdicts[at].is_none() {
                let verdict = self.last(at, bench);
                progress.verdict(&verdict);
                self.verdicts[at] = Some(verdict);
            }
        }
    }

    fn last(&self, at: usize, bench: &Bench) -> Verdict {
        let (expectation, line) = (&self.expectations[at], self.lines[at]);
        match &expectation.what {
            What::State { .. } => Verdict::nothing(line),
            What::Event { kind, encoder, after, before, seen: due, .. } => {
                let seen = self.seen[at].as_ref();
                let who = encoder.as_deref().map_or(String::new(), |encoder| format!(" of {encoder}"));
                let comes = if *due { "comes" } else { "does not come" };
                Verdict {
                    line,
                    expected: named(expectation, || {
                        format!("{kind}{who} {comes}{}", between(*after, *before))
                    }),
                    holds: seen.is_some() == *due,
                    found: match seen {
                        Some(Seen { at, text }) => format!("at {} {text}", seconds(*at)),
                        None => "it did not come".to_owned(),
                    },
                }
            }
            What::Sees { encoder, flag, after, before, cycles } => {
                let begun = self.cycles[at].unwrap_or(0);
                let sight = bench.poller_of(encoder).and_then(|poller| sight(poller, encoder, *flag, *after));
                let within = cycles.map_or(String::new(), |cycles| format!(" within {}", counted(cycles)));
                let took = |(_, cycle): (Instant, u64)| cycle.saturating_sub(begun);
                let in_time = |(at, cycle): (Instant, u64)| {
                    before.is_none_or(|before| at <= before)
                        && cycles.is_none_or(|cycles| took((at, cycle)) <= cycles)
                };
                Verdict {
                    line,
                    expected: named(expectation, || {
                        format!(
                            "the master sees {} of {encoder}{within}{}",
                            flag_name(*flag),
                            between(*after, *before)
                        )
                    }),
                    holds: sight.is_some_and(in_time),
                    found: match sight {
                        Some(sight) => format!("at {}, within {}", seconds(sight.0), counted(took(sight))),
                        None => "it has not seen it".to_owned(),
                    },
                }
            }
        }
    }
}

impl Verdict {
    /// Its time has not come.
    fn nothing(line: usize) -> Self {
        Self {
            line,
            expected: "an encoder is looked at".to_owned(),
            holds: false,
            found: "its time has not come".to_owned(),
        }
    }
}

fn counted(cycles: u64) -> String {
    if cycles == 1 { "1 cycle".to_owned() } else { format!("{cycles} cycles") }
}

fn named(expectation: &Expectation, usual: impl Fn() -> String) -> String {
    expectation.name.clone().unwrap_or_else(usual)
}

fn seconds(at: Instant) -> String {
    show_time(at.since(Instant::ZERO))
}

fn between(after: Instant, before: Option<Instant>) -> String {
    match (after, before) {
        (Instant::ZERO, None) => String::new(),
        (after, None) => format!(" from {} on", seconds(after)),
        (after, Some(before)) => format!(" from {} to {}", seconds(after), seconds(before)),
    }
}

/// Numbers are the same however they are written.
fn same(is: &Value, due: &Value) -> bool {
    is == due || is.as_f64().is_some_and(|is| due.as_f64() == Some(is))
}

fn flag_name(flag: Flag) -> String {
    match flag {
        Flag::Alarm(set) => alarms(set),
        Flag::Warning(set) => warnings(set),
    }
    .join(", ")
}

/// When and in which cycle the master had a diagnosis with this in it.
fn sight(poller: &Poller, encoder: &str, flag: Flag, after: Instant) -> Option<(Instant, u64)> {
    let sightings = poller.slave(encoder)?.seen.iter();
    let found = sightings.filter(|sighting| sighting.at >= after).find(|sighting| match flag {
        Flag::Alarm(set) => sighting.alarms.contains(set),
        Flag::Warning(set) => sighting.warnings.contains(set),
    });
    found.map(|sighting| (sighting.at, sighting.cycle))
}

/// What a check demands and what was found.
struct Checked {
    due: String,
    found: String,
    holds: bool,
}

fn judge(check: &Check, encoder: &str, bench: &Bench) -> Checked {
    match check {
        Check::Exchanging(_) | Check::Inputs(_) | Check::Diagnosis { .. } => of_master(check, encoder, bench),
        _ => of_device(check, encoder, bench),
    }
}

fn snapshot(encoder: &str, bench: &Bench) -> Option<Snapshot> {
    let request = Request::Snapshot { encoder: Some(Which::Name(encoder.to_owned())) };
    match bench.handle().apply(&request) {
        Ok(Some(Applied::Encoder(snapshot))) => Some(*snapshot),
        _ => None,
    }
}

fn of_device(check: &Check, encoder: &str, bench: &Bench) -> Checked {
    let device = snapshot(encoder, bench).and_then(|snapshot| snapshot.device);
    let found = device.as_ref().map(|device| of_powered(check, device));
    let off = || "it is off".to_owned();
    let list = |names: Vec<String>| if names.is_empty() { "none".to_owned() } else { names.join(" and ") };
    let due = match check {
        Check::Position(due, within) => format!("position {due}{}", more_or_less(*within)),
        Check::Travel(due, within, _) => {
            let within = if *within > 0.0 {
                format!(" +- {}", Travel { value: *within, unit: due.unit })
            } else {
                String::new()
            };
            format!("position {due}{within}")
        }
        Check::Velocity(due, within) => format!("velocity {due}{}", more_or_less(*within)),
        Check::Acceleration(due, within) => format!("acceleration {due}{}", more_or_less(*within)),
        Check::Offset(due, within) => format!("offset {due}{}", more_or_less(*within)),
        Check::State(due) => format!("state {due}"),
        Check::Address(due) => format!("address {}", due.map_or("none".to_owned(), |due| due.to_string())),
        Check::Alarms(due) => format!("alarms {}", list(alarms(*due))),
        Check::Warnings(due) => format!("warnings {}", list(warnings(*due))),
        _ => String::new(),
    };
    match found {
        Some((found, holds)) => Checked { due, found, holds },
        None => {
            Checked { due, found: off(), holds: matches!(check, Check::State("off") | Check::Address(None)) }
        }
    }
}

/// What is found of a device under power, and whether it is what it has to be.
fn of_powered(check: &Check, device: &DeviceSnapshot) -> (String, bool) {
    let scaling = &device.scaling;
    let position = f64::from(device.position);
    let range = f64::from(scaling.total_measuring_range());
    let near = |is: i32, due: f64, within: f64| (f64::from(is) - due).abs() <= within;
    let list = |names: Vec<String>| if names.is_empty() { "none".to_owned() } else { names.join(" and ") };
    match check {
        Check::Position(due, within) => {
            (format!("position {position}"), around(position - due, range) <= *within)
        }
        Check::Travel(due, within, scale) => {
            let per_revolution = f64::from(scaling.measuring_units_per_revolution());
            let [is, next] = scale.travel(position, per_revolution, range, *due);
            // Whoever writes 2 mm means 2 mm, whatever the binary fractions make of it.
            let allowed = within + (next.value - is.value).abs() * 1e-6;
            (format!("position {is}"), (is.value - due.value).abs() <= allowed)
        }
        Check::Velocity(due, within) => {
            (format!("velocity {}", device.velocity), near(device.velocity, *due, *within))
        }
        Check::Acceleration(due, within) => {
            (format!("acceleration {}", device.acceleration), near(device.acceleration, *due, *within))
        }
        Check::Offset(due, within) => {
            (format!("offset {}", device.offset), near(device.offset, *due, *within))
        }
        Check::State(due) => (format!("state {}", state(device.state)), state(device.state) == *due),
        Check::Address(due) => {
            let text = device.address.map_or("none".to_owned(), |address| address.to_string());
            (format!("address {text}"), device.address == *due)
        }
        Check::Alarms(due) => (format!("alarms {}", list(alarms(device.alarms))), device.alarms == *due),
        Check::Warnings(due) => {
            (format!("warnings {}", list(warnings(device.warnings))), device.warnings == *due)
        }
        _ => (String::new(), false),
    }
}

/// How far apart two positions are that follow each other in a ring.
fn around(difference: f64, range: f64) -> f64 {
    let distance = difference.rem_euclid(range);
    distance.min(range - distance)
}

fn more_or_less(within: f64) -> String {
    if within > 0.0 { format!(" +- {within}") } else { String::new() }
}

fn of_master(check: &Check, encoder: &str, bench: &Bench) -> Checked {
    let slave = bench.poller_of(encoder).and_then(|poller| poller.slave(encoder));
    let hex = |octets: &[u8]| {
        let digits: Vec<_> = octets.iter().map(|octet| format!("{octet:02X}")).collect();
        if digits.is_empty() { "nothing".to_owned() } else { digits.join(" ") }
    };
    match check {
        Check::Exchanging(due) => {
            let is = slave.is_some_and(|slave| slave.exchanging);
            let why = slave.and_then(|slave| slave.trouble.as_deref()).filter(|_| !is);
            let says = |is: bool| {
                if is { "data exchange with the master" } else { "no data exchange with the master" }
            };
            let found = why.map_or(says(is).to_owned(), |why| format!("{} ({why})", says(is)));
            Checked { due: says(*due).to_owned(), found, holds: is == *due }
        }
        Check::Inputs(due) => {
            let is = slave.map_or(&[][..], |slave| &slave.inputs);
            Checked {
                due: format!("inputs {}", hex(due)),
                found: format!("inputs {}", hex(is)),
                holds: is.starts_with(due),
            }
        }
        Check::Diagnosis { octet, bit, is: due } => {
            let octets = slave.map_or(&[][..], |slave| &slave.diagnosis);
            let is = octets.get(octet - 1).map(|octet| octet >> bit & 1 == 1);
            let says = |is: bool| format!("diagnosis octet {octet} bit {bit} {}", u8::from(is));
            Checked {
                due: says(*due),
                found: is.map_or_else(|| format!("a diagnosis of {} octets", octets.len()), says),
                holds: is == Some(*due),
            }
        }
        _ => Checked { due: String::new(), found: String::new(), holds: false },
    }
}
