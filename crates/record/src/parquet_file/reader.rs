//! Parquet read again, a row group at a time.

use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::{ByteArray, DataType};
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader, RowGroupReader, SerializedFileReader};

use crate::row::Column;
use crate::table::{Seen, WORDS};

/// A row group with more rows is not ours.
const MOST_ROWS: usize = 1 << 22;

/// Gives each row of a file to `take`.
///
/// # Errors
///
/// What is wrong.
pub(crate) fn read(
    octets: Vec<u8>,
    columns: &[&'static Column],
    take: &mut dyn FnMut(&Seen<'_>),
) -> Result<(), String> {
    let broken = |error: ParquetError| format!("it is no whole Parquet file ({error})");
    let file = SerializedFileReader::new(bytes::Bytes::from(octets)).map_err(broken)?;
    let schema = file.metadata().file_metadata().schema_descr();
    let find = |name: &str| {
        let found = schema.columns().iter().position(|column| column.path().string() == name);
        found.ok_or_else(|| format!("it has no column {name}"))
    };
    let (time, state) = (find("time_ns")?, find("state")?);
    let words_at = WORDS.iter().map(|name| find(name)).collect::<Result<Vec<_>, _>>()?;
    let values_at = columns.iter().map(|column| find(column.name)).collect::<Result<Vec<_>, _>>()?;
    for number in 0..file.num_row_groups() {
        let group = file.get_row_group(number).map_err(broken)?;
        let group = &*group;
        let times = whole(group, time)?;
        let states = texts(group, state)?;
        let words = words_at.iter().map(|at| texts(group, *at)).collect::<Result<Vec<_>, _>>()?;
        let numbers = values_at.iter().map(|at| reals(group, *at)).collect::<Result<Vec<_>, _>>()?;
        let mut values = vec![f64::NAN; columns.len()];
        for (row, time) in times.iter().enumerate() {
            for (value, column) in values.iter_mut().zip(&numbers) {
                *value = column[row];
            }
            let mut seen =
                Seen { time_ns: time.and_then(|time| time.try_into().ok()).unwrap_or(0), ..Seen::default() };
            for (word, column) in seen.words.iter_mut().zip(&words) {
                *word = text(column[row].as_ref())?;
            }
            seen.is_off = text(states[row].as_ref())? == "off";
            seen.values = &values;
            take(&seen);
        }
    }
    Ok(())
}

fn text(octets: Option<&ByteArray>) -> Result<&str, String> {
    let Some(octets) = octets else { return Ok("") };
    std::str::from_utf8(octets.data()).map_err(|_| "a text in it is none".to_owned())
}

fn whole(group: &dyn RowGroupReader, at: usize) -> Result<Vec<Option<i64>>, String> {
    match column(group, at)? {
        ColumnReader::Int64ColumnReader(reader) => all(reader, group),
        _ => Err(kind()),
    }
}

fn reals(group: &dyn RowGroupReader, at: usize) -> Result<Vec<f64>, String> {
    match column(group, at)? {
        #[expect(clippy::cast_precision_loss, reason = "to be drawn only")]
        ColumnReader::Int64ColumnReader(reader) => {
            let values = all(reader, group)?;
            Ok(values.into_iter().map(|value| value.map_or(f64::NAN, |value| value as f64)).collect())
        }
        ColumnReader::DoubleColumnReader(reader) => {
            let values = all(reader, group)?;
            Ok(values.into_iter().map(|value| value.unwrap_or(f64::NAN)).collect())
        }
        _ => Err(kind()),
    }
}

fn texts(group: &dyn RowGroupReader, at: usize) -> Result<Vec<Option<ByteArray>>, String> {
    match column(group, at)? {
        ColumnReader::ByteArrayColumnReader(reader) => all(reader, group),
        _ => Err(kind()),
    }
}

fn kind() -> String {
    "a column is of another kind than --record writes".to_owned()
}

fn column(group: &dyn RowGroupReader, at: usize) -> Result<ColumnReader, String> {
    group.get_column_reader(at).map_err(|error| error.to_string())
}

/// All values of a column, with the gaps.
fn all<T: DataType>(
    mut reader: ColumnReaderImpl<T>,
    group: &dyn RowGroupReader,
) -> Result<Vec<Option<T::T>>, String> {
    let rows = usize::try_from(group.metadata().num_rows()).unwrap_or(usize::MAX);
    if rows > MOST_ROWS {
        return Err(format!("a row group has {rows} rows"));
    }
    let (mut levels, mut values, mut read) = (Vec::new(), Vec::new(), 0);
    while read < rows {
        let (records, _, _) = reader
            .read_records(rows - read, Some(&mut levels), None, &mut values)
            .map_err(|error| error.to_string())?;
        if records == 0 {
            return Err(format!("a column ends after {read} of {rows} rows"));
        }
        read += records;
    }
    if levels.is_empty() {
        return Ok(values.into_iter().map(Some).collect());
    }
    let mut values = values.into_iter();
    Ok(levels.iter().map(|level| if *level > 0 { values.next() } else { None }).collect())
}
