//! `diag`: the diagnosis in words, alarms and warnings first, and what to do.

use std::fmt::Write;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use clap::Args;
use dissector::advice::{Diagnosis, Finding};
use serde_json::json;

use super::place::Place;
use super::watch::Panel;
use super::{Light, failed, find, seconds, until_stopped, words};
use crate::arguments::whole;
use crate::{Failure, output};

/// The diagnosis in words: alarms and warnings first, what to do about each, then every octet
///
/// It changes nothing, and can be asked of a station that belongs to another master.
#[derive(Debug, Args)]
pub(crate) struct Diag {
    /// The station, 0 to 126; without it the only one that answers
    #[arg(value_parser = whole::<u8>(0..=126), allow_negative_numbers = true)]
    address: Option<u8>,
    #[command(flatten)]
    place: Place,
    /// Fetch it again and again, until Ctrl-C, and show what changes
    #[arg(long)]
    watch: bool,
    /// With --watch: how often, in milliseconds
    #[arg(long, value_name = "MS", default_value_t = 500, value_parser = whole::<u32>(10..=3_600_000), allow_negative_numbers = true)]
    every: u32,
    /// With --watch: for so many seconds
    #[arg(long, value_name = "N", value_parser = seconds, requires = "watch")]
    seconds: Option<f64>,
    /// With --watch: lines also on a terminal
    #[arg(long, requires = "watch")]
    plain: bool,
    /// One document; with --watch one for each change, in a line of its own
    #[arg(long)]
    json: bool,
}

impl Diag {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        self.place.check(self.address)?;
        self.place.with(|light| {
            let address = find::station(light, self.address, "its address behind `diag`")?;
            if self.watch { self.watch(light, address) } else { self.once(light, address) }
        })
    }

    fn once(&self, light: &mut Light, address: u8) -> Result<(), Failure> {
        let read = fetch(light, address)?;
        if self.json {
            output::json(&document(address, &read));
        } else {
            output::line(&lines(address, &read, None).join("\n"));
        }
        Ok(())
    }

    fn watch(&self, light: &mut Light, address: u8) -> Result<(), Failure> {
        let stop = until_stopped()?;
        let mut panel = if self.json { None } else { Panel::new(self.plain) };
        let begun = Instant::now();
        // The newest, and the one before its last change: marks stay until the next one.
        let (mut last, mut against): (Option<Diagnosis>, Option<Diagnosis>) = (None, None);
        while !stop.load(Ordering::Relaxed)
            && self.seconds.is_none_or(|seconds| begun.elapsed().as_secs_f64() < seconds)
        {
            let now = fetch(light, address)?;
            let changed = last.as_ref().is_none_or(|last| last.octets != now.octets);
            if changed {
                against = last.take();
            }
            match &mut panel {
                Some(panel) => panel.draw(&lines(address, &now, against.as_ref())),
                None if changed => self.tell(address, begun, against.as_ref(), &now),
                None => {}
            }
            last = Some(now);
            std::thread::sleep(Duration::from_millis(self.every.into()));
        }
        Ok(())
    }

    /// What has changed, in lines.
    fn tell(&self, address: u8, begun: Instant, before: Option<&Diagnosis>, now: &Diagnosis) {
        let at = begun.elapsed();
        if self.json {
            let mut document = document(address, now);
            document["ms"] = u64::try_from(at.as_millis()).unwrap_or(u64::MAX).into();
            output::json_line(&document);
            return;
        }
        let Some(before) = before else {
            output::line(&lines(address, now, None).join("\n"));
            return;
        };
        for change in changes(before, now) {
            output::line(&format!("{:9.3}  {change}", at.as_secs_f64()));
        }
    }
}

fn fetch(light: &mut Light, address: u8) -> Result<Diagnosis, Failure> {
    let octets = light.diagnosis(address).map_err(failed)?.octets;
    Diagnosis::read(octets)
        .ok_or_else(|| Failure::Failed(format!("station {address} has sent less than a diagnosis")))
}

fn document(address: u8, read: &Diagnosis) -> serde_json::Value {
    // Octets of telegrams are not asked for here: there is only the data.
    let fields = read.fields.iter().map(|field| {
        json!({"name": field.name, "value": field.value, "words": field.words, "octets": field.data_octets, "bits": field.bits})
    });
    json!({
        "address": address,
        "octets": read.octets,
        "summary": read.summary,
        "is_encoder": read.is_encoder,
        "findings": read.findings,
        "fields": fields.collect::<Vec<_>>(),
    })
}

/// Everything; what is other than in `before` has a mark in front.
fn lines(address: u8, read: &Diagnosis, before: Option<&Diagnosis>) -> Vec<String> {
    let mut text = format!("station {address}: {}\n\n", read.summary);
    for finding in &read.findings {
        let mark = if before.is_none_or(|before| has(before, finding)) { ' ' } else { '*' };
        let _ = writeln!(text, "{mark}{}", words::finding(finding));
    }
    for gone in before.into_iter().flat_map(|before| &before.findings).filter(|gone| !has(read, gone)) {
        let _ = writeln!(text, "*gone: {} {}", gone.level, gone.name);
    }
    let _ = writeln!(text, "\noctets {}", read.octets);
    for (at, field) in read.fields.iter().enumerate() {
        let same = before.is_none_or(|before| {
            before.fields.get(at).is_some_and(|other| other.name == field.name && other.value == field.value)
        });
        let _ = writeln!(text, "{}{}", if same { ' ' } else { '*' }, words::field(field));
    }
    text.lines().map(|line| line.trim_end().to_owned()).collect()
}

fn has(read: &Diagnosis, finding: &Finding) -> bool {
    read.findings.iter().any(|other| other.name == finding.name && other.bit == finding.bit)
}

/// What came, what went, and which values are others.
fn changes(before: &Diagnosis, now: &Diagnosis) -> Vec<String> {
    let mut changes = Vec::new();
    for finding in now.findings.iter().filter(|finding| !has(before, finding)) {
        changes.push(format!("came: {}", words::finding(finding)));
    }
    for finding in before.findings.iter().filter(|finding| !has(now, finding)) {
        changes.push(format!("went: {} {} ({})", finding.level, finding.name, finding.place()));
    }
    for field in &now.fields {
        let other = before.fields.iter().find(|other| other.name == field.name);
        if let Some(other) = other.filter(|other| other.value != field.value) {
            changes.push(format!("{} (was {})", words::field(field).trim_start(), other.value));
        }
    }
    if changes.is_empty() {
        changes.push(format!("octets {}", now.octets));
    }
    changes
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUIET: [u8; 16] = [0x02, 0x05, 0, 0xFF, 0x10, 0x8B, 10, 0, 0, 2, 0, 1, 0, 0, 0x80, 0];

    fn read(changes: &[(usize, u8)]) -> Diagnosis {
        let mut octets = QUIET;
        for (number, octet) in changes {
            octets[number - 1] = *octet;
        }
        Diagnosis::read(&octets).expect("six octets")
    }

    #[test]
    fn alarms_come_before_octets_and_what_is_new_is_marked() {
        let (before, now) = (read(&[]), read(&[(1, 0x0A), (2, 0x07), (8, 2)]));
        let text = lines(5, &now, Some(&before)).join("\n");
        let place = |words: &str| text.find(words).unwrap_or_else(|| panic!("no `{words}` in {text}"));
        assert!(place("*alarm    Supply Voltage Error (octet 8 bit 1)") < place("octets 0A 07"), "{text}");
        assert!(place("-> measure between VSUP and GND") < place("octets 0A 07"), "{text}");
        place("*      8  encoder.alarms = 2  alarm: supply voltage");
        place("\n     5-6  Ident_Number");
        assert!(!lines(5, &now, Some(&now)).join("\n").contains('*'));
        assert!(lines(5, &before, Some(&now)).join("\n").contains("*gone: alarm Supply Voltage Error"));
    }

    #[test]
    fn every_bit_and_octet_is_there() {
        let read = read(&[]);
        let mut covered = [0_u32; 17];
        for field in &read.fields {
            let [first, last] = field.data_octets.expect("places");
            for bits in &mut covered[first..=last] {
                *bits |= match field.bits {
                    Some([high, low]) if first == last => (low..=high).map(|bit| 1 << bit).sum(),
                    _ => 0xFF,
                };
            }
        }
        // Bits that nobody has given a meaning: 2.6, 2.2 is always 1, 3.0 to 3.6, 9.4 to 9.7.
        let named: Vec<_> = covered[1..].iter().map(|bits| bits & 0xFF).collect();
        assert_eq!(named[0], 0xFF);
        assert_eq!(named[1] | 0x44, 0xFF);
        assert_eq!(named[2] | 0x7F, 0xFF);
        assert_eq!(named[8] | 0xF0, 0xFF);
        assert!(
            named.iter().enumerate().all(|(at, bits)| [1, 2, 8].contains(&at) || *bits == 0xFF),
            "{named:02X?}"
        );
    }

    #[test]
    fn a_change_is_told_once() {
        let told = changes(&read(&[]), &read(&[(8, 2)]));
        assert!(told[0].starts_with("came: alarm    Supply Voltage Error"), "{told:?}");
        assert!(
            told.iter().any(|line| line.contains("encoder.alarms = 2") && line.contains("was 0")),
            "{told:?}"
        );
        let back = changes(&read(&[(8, 2)]), &read(&[]));
        assert_eq!(back[0], "went: alarm Supply Voltage Error (octet 8 bit 1)");
    }
}
