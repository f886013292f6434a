//! Recordings as CSV: a first line of names, then a line for each row; what is null is empty.

use std::fs::File;
use std::io::{self, BufWriter};

use crate::format::Rows;
use crate::row::{COLUMNS, Column, Row, Value};
use crate::table::{Seen, WORDS};

/// A file of lines.
pub(crate) struct CommaFile {
    lines: csv::Writer<BufWriter<File>>,
    /// For numbers, used again and again.
    field: String,
}

impl CommaFile {
    pub(crate) fn new(file: File) -> io::Result<Self> {
        let mut lines = csv::Writer::from_writer(BufWriter::new(file));
        lines.write_record(COLUMNS.iter().map(|column| column.name))?;
        lines.flush()?;
        Ok(Self { lines, field: String::new() })
    }
}

impl Rows for CommaFile {
    fn write(&mut self, row: &Row) -> io::Result<()> {
        use std::fmt::Write as _;
        for column in COLUMNS {
            self.field.clear();
            let written = match column.of(row) {
                Value::Null => Ok(()),
                Value::Whole(value) => write!(self.field, "{value}"),
                Value::Real(value) => write!(self.field, "{value}"),
                Value::Text(text) => {
                    self.lines.write_field(text.as_bytes())?;
                    continue;
                }
            };
            written.map_err(io::Error::other)?;
            self.lines.write_field(&self.field)?;
        }
        Ok(self.lines.write_record(None::<&[u8]>)?)
    }

    fn settle(&mut self) -> io::Result<()> {
        self.lines.flush()
    }

    fn finish(&mut self) -> io::Result<()> {
        self.lines.flush()
    }
}

/// Gives each row of a file to `take`; a last line without its end is still being written.
///
/// # Errors
///
/// What is wrong, and in which line.
pub(crate) fn read(
    octets: &[u8],
    columns: &[&'static Column],
    take: &mut dyn FnMut(&Seen<'_>),
) -> Result<(), String> {
    let whole = octets.iter().rposition(|octet| *octet == b'\n').map_or(0, |end| end + 1);
    let mut lines = csv::ReaderBuilder::new().from_reader(&octets[..whole]);
    let names = lines.headers().map_err(short)?.clone();
    let find = |name: &str| {
        let found = names.iter().position(|there| there == name);
        found.ok_or_else(|| format!("it has no column {name}"))
    };
    let (time, state) = (find("time_ns")?, find("state")?);
    let mut words_at = [0; WORDS.len()];
    for (at, name) in words_at.iter_mut().zip(WORDS) {
        *at = find(name)?;
    }
    let values_at = columns.iter().map(|column| find(column.name)).collect::<Result<Vec<_>, _>>()?;
    let mut line = csv::StringRecord::new();
    let mut values = vec![f64::NAN; columns.len()];
    while lines.read_record(&mut line).map_err(short)? {
        let number = line.position().map_or(0, csv::Position::line);
        let field = |at: usize| line.get(at).unwrap_or_default();
        let wrong = |name: &str, at: usize| format!("line {number}: {:?} is no {name}", field(at));
        let time_ns = field(time).parse().map_err(|_| wrong("time_ns", time))?;
        for ((value, at), column) in values.iter_mut().zip(&values_at).zip(columns) {
            *value = match field(*at) {
                "" => f64::NAN,
                text => text.parse().map_err(|_| wrong(column.name, *at))?,
            };
        }
        let words = words_at.map(field);
        take(&Seen { time_ns, words, is_off: field(state) == "off", values: &values });
    }
    Ok(())
}

#[expect(clippy::needless_pass_by_value, reason = "for map_err")]
fn short(error: csv::Error) -> String {
    match error.kind() {
        csv::ErrorKind::UnequalLengths { pos: Some(pos), expected_len, len } => {
            format!("line {} has {len} fields, and {expected_len} are due", pos.line())
        }
        csv::ErrorKind::Utf8 { .. } => "it is neither Parquet nor text".to_owned(),
        _ => error.to_string(),
    }
}
