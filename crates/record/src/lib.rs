//! What encoders showed over time.
//!
//! - [`Recorder`] keeps samples and events of a running plant in a file, Parquet or CSV. A thread of its own
//!   writes; a bus never waits for it.
//! - [`Table`] reads such a file again.
//! - [`plot`] draws it.
//! - [`Ring`] has the last minutes in memory, for curves that go on.
//!
//! docs/recording.md has every column.

#![forbid(unsafe_code)]

mod comma;
mod format;
#[cfg(feature = "parquet")]
mod parquet_file;
pub mod plot;
mod recorder;
mod ring;
mod row;
mod store;
mod table;

pub use format::{Format, FormatError};
pub use recorder::{Recorder, Report, Settings};
pub use ring::Ring;
pub use row::{COLUMNS, Column, Kind, Row, Value, What};
pub use store::EventTap;
pub use table::{Band, Curve, Grade, Mark, Table, TableError, Wanted, numbers};
