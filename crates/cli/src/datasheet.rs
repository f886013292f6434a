//! `sch108bex datasheet`: the manual's technical data.

use std::fmt::Write;

use clap::Args;
use sch108bex::data_sheet::{DATA_SHEET, Row};
use serde::Serialize;

use crate::output;

/// The options of `datasheet`.
#[derive(Debug, Args)]
pub(crate) struct Datasheet {
    /// One document with all figures
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Document {
    title: &'static str,
    note: &'static str,
    figures: Vec<Figure>,
}

#[derive(Serialize)]
struct Figure {
    group: &'static str,
    name: &'static str,
    value: &'static str,
    section: &'static str,
}

const TITLE: &str = "SCH108BEX absolute encoder, technical data";
const NOTE: &str = "Figures of the device of metal, by its manual; section numbers are the manual's.";

impl Datasheet {
    pub(crate) fn run(&self) {
        if self.json {
            let figures = DATA_SHEET.iter().map(|&Row { group, name, value, section }| Figure {
                group: group.heading(),
                name,
                value,
                section,
            });
            output::json(&Document { title: TITLE, note: NOTE, figures: figures.collect() });
        } else {
            output::text(&table());
        }
    }
}

/// All figures, group by group.
fn table() -> String {
    let width = DATA_SHEET.iter().map(|row| row.name.len()).max().unwrap_or(0);
    let mut text = format!("{TITLE}\n{NOTE}\n");
    let mut group = None;
    for row in DATA_SHEET {
        if group.replace(row.group) != Some(row.group) {
            let _ = write!(text, "\n{}\n", row.group.heading());
        }
        let _ = writeln!(text, "  {:3}  {:width$}  {}", row.section, row.name, row.value);
    }
    text
}
