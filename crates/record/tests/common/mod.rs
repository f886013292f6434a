//! Plays scenarios, records them, and reads what was recorded.
#![allow(dead_code, reason = "each test file uses a part of it")]

use std::collections::HashMap;
use std::ops::RangeInclusive;
use std::path::PathBuf;

use plant::scenario::{Bench, Progress, Scenario, play};
use plant::{Handle, Report};
use profibus_dp::time::{Duration, Instant};
use record::{Column, Recorder, Settings, Table, TableError, Wanted};

/// What can be written.
pub(crate) const FORMATS: &[&str] = if cfg!(feature = "parquet") { &["csv", "parquet"] } else { &["csv"] };

/// A row of a CSV file by its columns.
pub(crate) type Fields = HashMap<String, String>;

/// A recording of a scenario.
pub(crate) struct Recorded {
    folder: tempfile::TempDir,
    name: String,
    pub(crate) octets: Vec<u8>,
    /// What was on each bus.
    pub(crate) sums: Vec<String>,
}

impl Recorded {
    pub(crate) fn path(&self) -> PathBuf {
        self.folder.path().join(&self.name)
    }
}

/// Every 10 ms.
pub(crate) fn played(source: &str, format: &str) -> Recorded {
    played_every(source, format, 10_000)
}

pub(crate) fn played_every(source: &str, format: &str, micros: u64) -> Recorded {
    played_with(source, format, micros, 100)
}

pub(crate) fn played_with(source: &str, format: &str, micros: u64, step_millis: u64) -> Recorded {
    let folder = tempfile::tempdir().expect("a folder");
    let name = format!("recording.{format}");
    let path = folder.path().join(&name);
    let scenario = Scenario::parse(source).unwrap_or_else(|faults| panic!("{}", faults.render("it", source)));
    let settings = Settings { every: Duration::from_micros(micros), is_virtual: true };
    let bench = Bench::new(&scenario).expect("a bench");
    let handle = bench.handle().clone();
    let mut recorder = Recorder::start(&path, settings, |trouble| panic!("{trouble}")).expect("a recorder");
    recorder.attach(&handle).expect("it runs");
    let step = Duration::from_millis(step_millis);
    let mut watch = Watch { recorder, handle, step };
    let outcome = play(bench, &scenario, source, &mut watch).expect("it is played");
    assert!(outcome.troubles.is_empty(), "{:?}", outcome.troubles);
    let report = watch.recorder.finish();
    assert!(report.error.is_none() && report.missing == 0, "{report:?}");
    let octets = std::fs::read(&path).expect("the file");
    let sums = outcome.segments.into_iter().map(|segment| segment.sum).collect();
    Recorded { folder, name, octets, sums }
}

struct Watch {
    recorder: Recorder,
    handle: Handle,
    step: Duration,
}

impl Progress for Watch {
    fn longest_step(&self) -> Duration {
        self.step
    }

    fn stepped(&mut self, to: Instant) {
        self.recorder.step(&self.handle, to).expect("it runs");
    }

    fn report(&mut self, report: &Report) {
        self.recorder.events().report(report);
    }
}

/// The rows of a CSV file.
pub(crate) fn rows(recorded: &Recorded) -> Vec<Fields> {
    let mut lines = csv::Reader::from_reader(&*recorded.octets);
    let names = lines.headers().expect("names").clone();
    let row = |row: Result<csv::StringRecord, _>| {
        let row = row.expect("a row");
        names.iter().zip(&row).map(|(name, field)| (name.to_owned(), field.to_owned())).collect()
    };
    lines.records().map(row).collect()
}

/// These columns of all encoders.
pub(crate) fn table(recorded: &Recorded, columns: &[&str]) -> Table {
    chosen(recorded, columns, &[], 0..=u64::MAX).expect("a table")
}

pub(crate) fn chosen(
    recorded: &Recorded,
    columns: &[&str],
    encoders: &[String],
    times: RangeInclusive<u64>,
) -> Result<Table, TableError> {
    let columns: Vec<_> = columns.iter().map(|name| Column::named(name).expect("a column")).collect();
    Table::read(&recorded.path(), &Wanted { columns: &columns, encoders, times })
}

/// The wanted columns of an encoder.
pub(crate) fn values(table: &Table, encoder: &str) -> Vec<Vec<f64>> {
    let curve = table.curves.iter().find(|curve| curve.encoder == encoder);
    curve.expect("the encoder").values.clone()
}
