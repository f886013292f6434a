//! Movements from a file.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek};
use std::path::Path;

use super::ShaftError;
use super::pieces::rounded_up;

/// More octets than this are refused.
const MOST_OCTETS: u64 = 64 << 20;

/// Reads points of time in nanoseconds and position: seconds, and units. Times count from the first.
///
/// - CSV: two columns with a comma between. Further columns, empty lines and lines that begin with `#` mean
///   nothing, nor does a first line of names.
/// - Parquet: the first two columns of numbers; a time whose name ends in `_ns` is in nanoseconds.
///
/// # Errors
///
/// The file and the line or row, and what is wrong there.
pub(super) fn read(path: &Path) -> Result<Vec<(u64, f64)>, ShaftError> {
    let wrong = |what: String| ShaftError::File { file: path.display().to_string(), what };
    let mut file = File::open(path).map_err(|error| wrong(error.to_string()))?;
    if !file.metadata().is_ok_and(|metadata| metadata.is_file() && metadata.len() <= MOST_OCTETS) {
        return Err(wrong("it is no regular file of at most 64 MiB".to_owned()));
    }
    let mut magic = [0; 4];
    let is_parquet = file.read_exact(&mut magic).is_ok() && &magic == b"PAR1";
    file.rewind().map_err(|error| wrong(error.to_string()))?;
    if is_parquet {
        return columnar(file).map_err(wrong);
    }
    parse(BufReader::new(file.take(MOST_OCTETS))).map_err(wrong)
}

/// Points as they are gathered, each checked against the one before.
#[derive(Default)]
struct Points {
    points: Vec<(u64, f64)>,
    first: Option<f64>,
}

impl Points {
    fn push(&mut self, seconds: f64, position: f64) -> Result<(), &'static str> {
        let seconds = seconds - *self.first.get_or_insert(seconds);
        if !(0.0..=1e9).contains(&seconds) || position.is_nan() || position.abs() > 1e9 {
            return Err("times and positions are at most 1e9, and times go up");
        }
        let nanos = rounded_up(seconds);
        if self.points.last().is_some_and(|(before, _)| *before >= nanos) {
            return Err("each time is later than the one before");
        }
        self.points.push((nanos, position));
        Ok(())
    }

    fn whole(self) -> Result<Vec<(u64, f64)>, String> {
        if self.points.is_empty() { Err("it has no points".to_owned()) } else { Ok(self.points) }
    }
}

#[cfg(not(feature = "parquet"))]
fn columnar(_: File) -> Result<Vec<(u64, f64)>, String> {
    Err("this program was built without Parquet; write the points as CSV".to_owned())
}

#[cfg(feature = "parquet")]
fn columnar(file: File) -> Result<Vec<(u64, f64)>, String> {
    use parquet::file::reader::{FileReader, SerializedFileReader};

    let reader = SerializedFileReader::new(file).map_err(|error| error.to_string())?;
    let mut points = Points::default();
    for (row, read) in reader.get_row_iter(None).map_err(|error| error.to_string())?.enumerate() {
        let row = row + 1;
        let read = read.map_err(|error| format!("row {row}: {error}"))?;
        if row > MOST_ROWS {
            return Err(format!("it has more than {MOST_ROWS} rows"));
        }
        let mut numbers = read.get_column_iter().filter_map(|(name, field)| Some((name, number(field)?)));
        let (Some((name, time)), Some((_, position))) = (numbers.next(), numbers.next()) else {
            return Err(format!(
                "row {row}: write a column of seconds and a column of positions, both of numbers"
            ));
        };
        let seconds = if name.ends_with("_ns") { time / 1e9 } else { time };
        points.push(seconds, position).map_err(|what| format!("row {row}: {what}"))?;
    }
    points.whole()
}

/// More rows than this are refused: a compressed file may hold any number.
#[cfg(feature = "parquet")]
const MOST_ROWS: usize = 10_000_000;

#[cfg(feature = "parquet")]
#[expect(clippy::cast_precision_loss, reason = "times and positions below 2^53 are exact")]
fn number(field: &parquet::record::Field) -> Option<f64> {
    use parquet::record::Field;

    Some(match *field {
        Field::Byte(number) => f64::from(number),
        Field::Short(number) => f64::from(number),
        Field::Int(number) => f64::from(number),
        Field::Long(number) => number as f64,
        Field::UByte(number) => f64::from(number),
        Field::UShort(number) => f64::from(number),
        Field::UInt(number) => f64::from(number),
        Field::ULong(number) => number as f64,
        Field::Float(number) => f64::from(number),
        Field::Double(number) => number,
        _ => return None,
    })
}

fn parse(lines: impl BufRead) -> Result<Vec<(u64, f64)>, String> {
    let mut points = Points::default();
    let mut names_allowed = true;
    for (number, line) in lines.lines().enumerate() {
        let number = number + 1;
        let line = line.map_err(|error| format!("line {number}: {error}"))?;
        let line = line.trim_start_matches('\u{FEFF}').trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let is_first = std::mem::take(&mut names_allowed);
        let Some((seconds, position)) = columns(line) else {
            if is_first {
                continue;
            }
            return Err(format!(
                "line {number}: write seconds and position with a comma between, like 0.5,3.2"
            ));
        };
        points.push(seconds, position).map_err(|what| format!("line {number}: {what}"))?;
    }
    points.whole()
}

fn columns(line: &str) -> Option<(f64, f64)> {
    let mut columns = line.split(',').map(|column| column.trim().trim_matches('"').parse::<f64>());
    match (columns.next(), columns.next()) {
        (Some(Ok(seconds)), Some(Ok(position))) if seconds.is_finite() && position.is_finite() => {
            Some((seconds, position))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_comments_and_further_columns_mean_nothing() {
        let text = "time,position,speed\n# measured\n10,1.5,0\n\n10.5,2.5,0\r\n";
        assert_eq!(parse(text.as_bytes()), Ok(vec![(0, 1.5), (500_000_000, 2.5)]));
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        for (text, line) in
            [("0,1\nx,2\n", "line 2"), ("0,1\n1,2\n1,3\n", "line 3"), ("0,nan\n1\n", "line 2")]
        {
            let error = parse(text.as_bytes()).unwrap_err();
            assert!(error.starts_with(line), "{error}");
        }
        assert!(parse("time,position\n".as_bytes()).is_err());
    }

    /// A file with a column of words in front, as tables of measurements have them.
    #[cfg(feature = "parquet")]
    fn parquet_file(path: &Path, time: &str, times: &[i64], positions: &[f64]) {
        use std::sync::Arc;

        use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
        use parquet::file::properties::WriterProperties;
        use parquet::file::writer::SerializedFileWriter;
        use parquet::schema::parser::parse_message_type;

        let schema = format!(
            "message points {{ REQUIRED BYTE_ARRAY who (UTF8); REQUIRED INT64 {time}; REQUIRED DOUBLE metres; }}"
        );
        let schema = Arc::new(parse_message_type(&schema).unwrap());
        let file = File::create(path).unwrap();
        let mut writer =
            SerializedFileWriter::new(file, schema, Arc::new(WriterProperties::default())).unwrap();
        let mut group = writer.next_row_group().unwrap();
        let words = vec![ByteArray::from("crane"); times.len()];
        let mut column = group.next_column().unwrap().unwrap();
        column.typed::<ByteArrayType>().write_batch(&words, None, None).unwrap();
        column.close().unwrap();
        let mut column = group.next_column().unwrap().unwrap();
        column.typed::<Int64Type>().write_batch(times, None, None).unwrap();
        column.close().unwrap();
        let mut column = group.next_column().unwrap().unwrap();
        column.typed::<DoubleType>().write_batch(positions, None, None).unwrap();
        column.close().unwrap();
        group.close().unwrap();
        writer.close().unwrap();
    }

    #[cfg(feature = "parquet")]
    #[test]
    fn parquet_has_the_points_in_its_first_columns_of_numbers() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trip.parquet");
        parquet_file(&path, "seconds", &[10, 12], &[1.5, -2.5]);
        assert_eq!(read(&path).unwrap(), [(0, 1.5), (2_000_000_000, -2.5)]);
        parquet_file(&path, "time_ns", &[1_000_000, 3_000_000], &[0.0, 7.0]);
        assert_eq!(read(&path).unwrap(), [(0, 0.0), (2_000_000, 7.0)]);
    }

    #[cfg(feature = "parquet")]
    #[test]
    fn what_is_wrong_in_parquet_is_told_with_its_row() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trip.parquet");
        parquet_file(&path, "seconds", &[10, 12, 12], &[0.0, 1.0, 2.0]);
        let error = read(&path).unwrap_err().to_string();
        assert!(error.contains("trip.parquet: row 3: each time is later"), "{error}");
        std::fs::write(&path, b"PAR1 and then something else").unwrap();
        let error = read(&path).unwrap_err().to_string();
        assert!(error.contains("trip.parquet: "), "{error}");
        parquet_file(&path, "seconds", &[], &[]);
        assert!(read(&path).unwrap_err().to_string().contains("no points"));
    }
}
