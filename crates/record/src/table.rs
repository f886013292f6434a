//! Reads recordings again: what was recorded of each encoder, ready to be drawn.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use crate::row::{COLUMNS, Column, Kind};

/// Bigger files are none.
const MOST_OCTETS: u64 = 4 << 30;

/// What is wanted of a recording.
#[derive(Debug, Clone)]
pub struct Wanted<'a> {
    /// Columns of numbers.
    pub columns: &'a [&'static Column],
    /// The encoders; none: all.
    pub encoders: &'a [String],
    /// Rows of this time, in nanoseconds.
    pub times: std::ops::RangeInclusive<u64>,
}

/// A recording, as far as it is wanted.
#[derive(Debug, Default, PartialEq)]
pub struct Table {
    /// In the order in which they appear.
    pub curves: Vec<Curve>,
    /// Names of all encoders in the file.
    names: Vec<String>,
}

/// What was recorded of one encoder, or of a segment, which has marks only.
#[derive(Debug, Default, Clone, PartialEq)]
pub struct Curve {
    /// Whose.
    pub encoder: String,
    /// When, in nanoseconds.
    pub times: Vec<u64>,
    /// The wanted columns, each as long as the times; NaN where there is nothing.
    pub values: Vec<Vec<f64>>,
    /// The unit of the machine.
    pub unit: Option<String>,
    /// When something was wrong.
    pub bands: Vec<Band>,
    /// What happened.
    pub marks: Vec<Mark>,
}

/// How bad it was.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grade {
    /// A warning.
    Warning,
    /// An alarm.
    Alarm,
    /// No power.
    Off,
}

/// A span in which something was wrong.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Band {
    /// How bad.
    pub grade: Grade,
    /// What.
    pub words: String,
    /// From this sample's time, in nanoseconds.
    pub from: u64,
    /// To this one's.
    pub to: u64,
}

/// Something that happened.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mark {
    /// In nanoseconds.
    pub at: u64,
    /// In one word.
    pub kind: String,
    /// In a sentence.
    pub text: String,
}

/// Why a file gives no table.
#[derive(Debug, thiserror::Error)]
pub enum TableError {
    /// It cannot be read.
    #[error("{file} cannot be read: {why}; name a file that --record has written")]
    Unreadable {
        /// The file.
        file: String,
        /// What the system said.
        why: String,
    },
    /// It is something else, or damaged.
    #[error("{file} is no recording: {why}; name a file that --record has written")]
    Wrong {
        /// The file.
        file: String,
        /// What is wrong.
        why: String,
    },
    /// Nobody of this name is in it.
    #[error("{file} has no encoder {asked:?}; it has {there}")]
    NoEncoder {
        /// The file.
        file: String,
        /// The name.
        asked: String,
        /// Those there are.
        there: String,
    },
}

/// The columns of words that are looked at in each row.
pub(crate) const WORDS: [&str; 6] = ["encoder", "event", "text", "machine_unit", "alarms", "warnings"];

/// One row, as both formats give it.
#[derive(Debug, Default)]
pub(crate) struct Seen<'a> {
    pub(crate) time_ns: u64,
    /// As [`WORDS`]; empty: nothing.
    pub(crate) words: [&'a str; WORDS.len()],
    pub(crate) is_off: bool,
    /// The wanted columns.
    pub(crate) values: &'a [f64],
}

impl Table {
    /// Reads a recording of either format, one that is still being written too.
    ///
    /// # Errors
    ///
    /// It is none, or has no such encoder.
    pub fn read(path: &Path, wanted: &Wanted<'_>) -> Result<Self, TableError> {
        let file = path.display().to_string();
        let octets = read(path)
            .map_err(|error| TableError::Unreadable { file: file.clone(), why: error.to_string() })?;
        let mut table = Self::default();
        let mut take = |seen: &Seen<'_>| table.take(seen, wanted);
        let read = if octets.starts_with(b"PAR1") {
            #[cfg(feature = "parquet")]
            {
                crate::parquet_file::reader::read(octets, wanted.columns, &mut take)
            }
            #[cfg(not(feature = "parquet"))]
            Err(crate::FormatError::NoParquet.to_string())
        } else {
            crate::comma::read(&octets, wanted.columns, &mut take)
        };
        read.map_err(|why| TableError::Wrong { file: file.clone(), why })?;
        for asked in wanted.encoders {
            if !table.names.contains(asked) {
                let there = table.names.iter().map(|name| format!("{name:?}")).collect::<Vec<_>>();
                let there = if there.is_empty() { "none".to_owned() } else { there.join(", ") };
                return Err(TableError::NoEncoder { file, asked: asked.clone(), there });
            }
        }
        Ok(table)
    }

    /// How many samples there are.
    pub fn samples(&self) -> usize {
        self.curves.iter().map(|curve| curve.times.len()).sum()
    }

    fn take(&mut self, seen: &Seen<'_>, wanted: &Wanted<'_>) {
        let [encoder, event, text, unit, alarms, warnings] = seen.words;
        let is_sample = event.is_empty();
        if is_sample && !self.names.iter().any(|name| name == encoder) {
            self.names.push(encoder.to_owned());
        }
        let chosen = wanted.encoders.is_empty() || wanted.encoders.iter().any(|name| name == encoder);
        if !chosen || !wanted.times.contains(&seen.time_ns) {
            return;
        }
        let curve = self.curve(encoder, wanted.columns.len());
        if !is_sample {
            let (kind, text) = (event.to_owned(), text.to_owned());
            curve.marks.push(Mark { at: seen.time_ns, kind, text });
            return;
        }
        curve.times.push(seen.time_ns);
        for (values, value) in curve.values.iter_mut().zip(seen.values) {
            values.push(*value);
        }
        if curve.unit.is_none() && !unit.is_empty() {
            curve.unit = Some(unit.to_owned());
        }
        for (grade, words) in [
            (Grade::Off, if seen.is_off { "off" } else { "" }),
            (Grade::Alarm, alarms),
            (Grade::Warning, warnings),
        ] {
            curve.band(grade, words, seen.time_ns);
        }
    }

    fn curve(&mut self, encoder: &str, columns: usize) -> &mut Curve {
        let at = self.curves.iter().position(|curve| curve.encoder == encoder).unwrap_or_else(|| {
            let values = vec![Vec::new(); columns];
            self.curves.push(Curve { encoder: encoder.to_owned(), values, ..Curve::default() });
            self.curves.len() - 1
        });
        &mut self.curves[at]
    }
}

impl Curve {
    /// A band goes on while its words stay the same, up to and with the sample where they are gone.
    fn band(&mut self, grade: Grade, words: &str, at: u64) {
        let before = self.times.len().checked_sub(2).and_then(|index| self.times.get(index)).copied();
        let open = self.bands.iter_mut().rev().find(|band| band.grade == grade);
        if let Some(band) = open
            && before == Some(band.to)
            && band.words == words
        {
            band.to = at;
            return;
        }
        if !words.is_empty() {
            self.bands.push(Band { grade, words: words.to_owned(), from: at, to: at });
        }
    }
}

/// The octets of a regular file.
fn read(path: &Path) -> io::Result<Vec<u8>> {
    let file = File::open(path)?;
    let metadata = file.metadata()?;
    if !metadata.is_file() || metadata.len() > MOST_OCTETS {
        return Err(io::Error::other("it is no regular file of at most 4 GiB"));
    }
    let mut octets = Vec::new();
    file.take(MOST_OCTETS).read_to_end(&mut octets)?;
    Ok(octets)
}

/// The names of all columns of numbers.
pub fn numbers() -> impl Iterator<Item = &'static Column> {
    COLUMNS.iter().filter(|column| column.kind != Kind::Text)
}
