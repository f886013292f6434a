//! `sch108bex gsd`: the device's GSD; and what `run --gsd` makes of a user's own.

use std::path::{Path, PathBuf};

use clap::Args;
use engineering::gsd;
use sch108bex::configuration::Configurations;
use sch108bex::specification::{PLACEHOLDER_IDENT, Variant};
use serde::Serialize;

use crate::{Failure, arguments, output};

/// The options of `gsd`.
#[derive(Debug, Args)]
pub(crate) struct Gsd {
    /// Singleturn x multiturn bits, 2x0 to 16x15
    #[arg(long, value_name = "NxM", default_value = "16x15")]
    bits: Variant,
    /// The ident number in the file; the default is a placeholder, the maker's is not public
    #[arg(long, value_name = "0xHHHH", value_parser = arguments::ident_number)]
    ident: Option<u16>,
    /// Write it there instead of on standard output; a file that is there is replaced
    #[arg(long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// One document that holds the file's name and text
    #[arg(long, conflicts_with = "output")]
    json: bool,
}

#[derive(Serialize)]
struct Document {
    file_name: String,
    bits: String,
    ident_number: String,
    /// Said in each document, as in each file.
    note: &'static str,
    text: String,
}

impl Gsd {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let ident = self.ident.unwrap_or(PLACEHOLDER_IDENT);
        let text = gsd::text(self.bits, ident);
        if self.json {
            output::json(&Document {
                file_name: gsd::file_name(self.bits),
                bits: self.bits.to_string(),
                ident_number: format!("0x{ident:04X}"),
                note: "GSD of the software SCH108BEX, not the maker's",
                text,
            });
            return Ok(());
        }
        let Some(path) = &self.output else {
            output::text(&text);
            return Ok(());
        };
        std::fs::write(path, text).map_err(|error| {
            let path = path.display();
            Failure::Failed(format!("--output {path}: cannot be written: {error}; write another path"))
        })
    }
}

/// What an encoder offers to masters.
#[derive(Debug)]
pub(crate) struct Offer {
    pub(crate) ident_number: u16,
    pub(crate) configurations: Configurations,
    /// What the user should know of it.
    pub(crate) notes: Vec<String>,
}

impl Offer {
    /// From the command line: an ident number, a GSD file, or neither.
    pub(crate) fn new(ident: Option<u16>, gsd: Option<&Path>, variant: Variant) -> Result<Self, Failure> {
        if let Some(path) = gsd {
            return Self::from_gsd(path, variant)
                .map_err(|why| Failure::Failed(format!("--gsd {}: {why}", path.display())));
        }
        let configurations = Configurations::default();
        let notes = if ident.is_some() {
            Vec::new()
        } else {
            vec![format!(
                "ident number {PLACEHOLDER_IDENT:04X} is a placeholder, the maker's is not public; \
                 --ident or --gsd takes the one of your project"
            )]
        };
        Ok(Self { ident_number: ident.unwrap_or(PLACEHOLDER_IDENT), configurations, notes })
    }

    /// From a GSD file.
    pub(crate) fn from_gsd(path: &Path, variant: Variant) -> Result<Self, String> {
        let text = gsd_reader::read_text(path).map_err(|error| error.to_string())?;
        let file = gsd_reader::read(path, &text).map_err(|error| error.to_string())?;
        let gsd::Judgement { ident_number, configurations, notes } = gsd::judge(&file, &text, variant)?;
        Ok(Self { ident_number, configurations, notes })
    }
}
