//! The kinds of files, and what both have in common.

use std::fs::File;
use std::io;
use std::path::Path;

use crate::comma::CommaFile;
use crate::row::Row;

/// A kind of file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Lines of text, which can be read while they are written.
    Csv,
    /// Columns, a tenth of the size.
    Parquet,
}

/// Why a file is none for recordings.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FormatError {
    /// Its name does not say.
    #[error("{0} does not say what to write: end it with .parquet or .csv")]
    Unknown(String),
    /// It was built without.
    #[error(
        "this program was built without Parquet: end the name with .csv, or build it with `--features parquet`"
    )]
    NoParquet,
}

impl Format {
    /// What the name of a file asks for.
    ///
    /// # Errors
    ///
    /// Nothing that there is.
    pub fn of(path: &Path) -> Result<Self, FormatError> {
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
        match ending.as_deref() {
            Some("csv") => Ok(Self::Csv),
            Some("parquet") if cfg!(feature = "parquet") => Ok(Self::Parquet),
            Some("parquet") => Err(FormatError::NoParquet),
            _ => Err(FormatError::Unknown(path.display().to_string())),
        }
    }
}

/// A file that grows.
pub(crate) trait Rows: Send {
    /// One more row, at the end.
    fn write(&mut self, row: &Row) -> io::Result<()>;
    /// From time to time: what was written is to be in the file soon.
    fn settle(&mut self) -> io::Result<()>;
    /// All is in the file, and it is whole.
    fn finish(&mut self) -> io::Result<()>;
}

/// A new file, in place of one that is there.
///
/// `is_virtual`: what is in the file depends on the rows only, not on when they came.
pub(crate) fn create(path: &Path, format: Format, is_virtual: bool) -> io::Result<Box<dyn Rows>> {
    let file = File::create(path)?;
    match format {
        Format::Csv => Ok(Box::new(CommaFile::new(file)?)),
        #[cfg(feature = "parquet")]
        Format::Parquet => Ok(Box::new(crate::parquet_file::ParquetFile::new(file, is_virtual)?)),
        #[cfg(not(feature = "parquet"))]
        Format::Parquet => {
            let _ = is_virtual;
            Err(io::Error::other(FormatError::NoParquet.to_string()))
        }
    }
}
