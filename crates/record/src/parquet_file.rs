//! Recordings as Parquet.
//!
//! A Parquet file can be read by its footer only, which is at the end. So that a program that is killed leaves a
//! file all the same, every row group is written together with a footer for all there is so far, in one call,
//! and the next one is written over that footer.

pub(crate) mod reader;

use std::fs::File;
use std::io::{self, Write};
use std::os::unix::fs::FileExt;
use std::sync::Arc;
use std::time::{Duration, Instant};

use parquet::basic::{Compression, ConvertedType, Encoding, LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::{FileMetaData, ParquetMetaData, ParquetMetaDataWriter};
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{ColumnPath, Type};

use crate::format::Rows;
use crate::row::{COLUMNS, Column, Kind, Row, Value};

/// A row group has at most so many rows.
const MOST_ROWS: usize = 65_536;
/// The first minute is written every second, what follows whenever a sixtieth of the time has passed: the
/// footer grows with each row group.
const LEAST_PAUSE: Duration = Duration::from_secs(1);
const MOST_PAUSE: Duration = Duration::from_secs(30);

/// A file of row groups.
pub(crate) struct ParquetFile {
    file: File,
    writer: SerializedFileWriter<Vec<u8>>,
    /// Where the footer is, or will be.
    end: u64,
    columns: Vec<Cells>,
    rows: usize,
    all_rows: i64,
    begun: Instant,
    written: Instant,
    is_virtual: bool,
}

/// What waits of one column.
struct Cells {
    values: Values,
    /// For each row: 1 where there is a value.
    there: Vec<i16>,
    is_optional: bool,
}

enum Values {
    Whole(Vec<i64>),
    Real(Vec<f64>),
    Text(Vec<ByteArray>),
}

/// Columns that every row has.
fn is_optional(column: &Column) -> bool {
    !matches!(column.name, "time_ns" | "encoder")
}

impl ParquetFile {
    pub(crate) fn new(file: File, is_virtual: bool) -> io::Result<Self> {
        if !file.metadata()?.is_file() {
            return Err(io::Error::other("Parquet is for regular files; write .csv instead"));
        }
        let mut properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_statistics_enabled(EnabledStatistics::Chunk)
            .set_offset_index_disabled(true)
            .set_created_by(concat!("sch108bex ", env!("CARGO_PKG_VERSION")).to_owned());
        for column in COLUMNS.iter().filter(|column| column.kind == Kind::Whole) {
            let path = ColumnPath::from(column.name);
            properties = properties
                .set_column_dictionary_enabled(path.clone(), false)
                .set_column_encoding(path, Encoding::DELTA_BINARY_PACKED);
        }
        let schema = Arc::new(schema().map_err(broken)?);
        let writer =
            SerializedFileWriter::new(Vec::new(), schema, Arc::new(properties.build())).map_err(broken)?;
        let now = Instant::now();
        let mut this = Self {
            file,
            writer,
            end: 0,
            columns: COLUMNS.iter().map(Cells::new).collect(),
            rows: 0,
            all_rows: 0,
            begun: now,
            written: now,
            is_virtual,
        };
        this.put_with_footer()?;
        Ok(this)
    }

    /// What waits becomes a row group.
    fn close_group(&mut self) -> io::Result<()> {
        if self.rows > 0 {
            let mut group = self.writer.next_row_group().map_err(broken)?;
            for cells in &mut self.columns {
                let mut column =
                    group.next_column().map_err(broken)?.ok_or_else(|| io::Error::other("a column less"))?;
                match &cells.values {
                    Values::Whole(values) => cells.put(column.typed::<Int64Type>(), values),
                    Values::Real(values) => cells.put(column.typed::<DoubleType>(), values),
                    Values::Text(values) => cells.put(column.typed::<ByteArrayType>(), values),
                }
                .and_then(|()| column.close())
                .map_err(broken)?;
                cells.clear();
            }
            group.close().map_err(broken)?;
            self.all_rows += i64::try_from(std::mem::take(&mut self.rows)).unwrap_or_default();
            self.put_with_footer()?;
        }
        self.written = Instant::now();
        Ok(())
    }

    /// What the writer has made so far goes to the file, and a footer after it.
    fn put_with_footer(&mut self) -> io::Result<()> {
        self.writer.flush()?;
        let mut octets = std::mem::take(self.writer.inner_mut());
        let length = octets.len();
        let schema = self.writer.schema_descr().clone();
        let created_by = Some(self.writer.properties().created_by().to_owned());
        let file = FileMetaData::new(2, self.all_rows, created_by, None, Arc::new(schema), None);
        let all = ParquetMetaData::new(file, self.writer.flushed_row_groups().to_vec());
        ParquetMetaDataWriter::new(&mut octets, &all).finish().map_err(broken)?;
        self.file.write_all_at(&octets, self.end)?;
        self.end += length as u64;
        Ok(())
    }

    fn pause(&self) -> Duration {
        (self.begun.elapsed() / 60).clamp(LEAST_PAUSE, MOST_PAUSE)
    }
}

impl Rows for ParquetFile {
    fn write(&mut self, row: &Row) -> io::Result<()> {
        for (cells, column) in self.columns.iter_mut().zip(COLUMNS) {
            cells.push(column.of(row));
        }
        self.rows += 1;
        if self.rows == MOST_ROWS { self.close_group() } else { Ok(()) }
    }

    fn settle(&mut self) -> io::Result<()> {
        if !self.is_virtual && self.written.elapsed() >= self.pause() {
            return self.close_group();
        }
        Ok(())
    }

    fn finish(&mut self) -> io::Result<()> {
        self.close_group()?;
        self.file.flush()
    }
}

impl Cells {
    fn new(column: &Column) -> Self {
        let values = match column.kind {
            Kind::Whole => Values::Whole(Vec::new()),
            Kind::Real => Values::Real(Vec::new()),
            Kind::Text => Values::Text(Vec::new()),
        };
        Self { values, there: Vec::new(), is_optional: is_optional(column) }
    }

    fn push(&mut self, value: Value<'_>) {
        self.there.push(i16::from(value != Value::Null));
        match (&mut self.values, value) {
            (Values::Whole(values), Value::Whole(value)) => values.push(value),
            (Values::Real(values), Value::Real(value)) => values.push(value),
            (Values::Text(values), Value::Text(text)) => {
                // The same again is the usual, and costs no copy.
                let again = values.last().filter(|last| last.data() == text.as_bytes()).cloned();
                values.push(again.unwrap_or_else(|| ByteArray::from(text.as_bytes().to_vec())));
            }
            (_, _) => {}
        }
    }

    fn put<T: DataType>(
        &self,
        column: &mut parquet::column::writer::ColumnWriterImpl<'_, T>,
        values: &[T::T],
    ) -> Result<(), ParquetError> {
        column.write_batch(values, self.is_optional.then_some(&*self.there), None).map(drop)
    }

    fn clear(&mut self) {
        self.there.clear();
        match &mut self.values {
            Values::Whole(values) => values.clear(),
            Values::Real(values) => values.clear(),
            Values::Text(values) => values.clear(),
        }
    }
}

fn schema() -> Result<Type, ParquetError> {
    let field = |column: &Column| {
        let builder = match column.kind {
            Kind::Whole => Type::primitive_type_builder(column.name, Physical::INT64),
            Kind::Real => Type::primitive_type_builder(column.name, Physical::DOUBLE),
            Kind::Text => Type::primitive_type_builder(column.name, Physical::BYTE_ARRAY)
                .with_logical_type(Some(LogicalType::String))
                .with_converted_type(ConvertedType::UTF8),
        };
        let needed = if is_optional(column) { Repetition::OPTIONAL } else { Repetition::REQUIRED };
        builder.with_repetition(needed).build().map(Arc::new)
    };
    let fields = COLUMNS.iter().map(field).collect::<Result<_, _>>()?;
    Type::group_type_builder("recording").with_fields(fields).build()
}

fn broken(error: ParquetError) -> io::Error {
    match error {
        ParquetError::External(error) => io::Error::other(error),
        error => io::Error::other(error.to_string()),
    }
}
