//! `sch108bex plot`: a recording as a picture.

use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use record::plot::{Look, WIDTHS, png, svg};
use record::{Column, Kind, Table, TableError, Wanted, numbers};

use crate::Failure;
use crate::arguments;
use crate::output;

/// Draw a recording as SVG or PNG
///
/// One panel for each column, with a common time axis; alarms, warnings and times without power are bands, events
/// are lines with words. docs/recording.md has the columns, and how to make recordings.
#[derive(Debug, Args)]
pub(crate) struct Plot {
    /// The recording, .parquet or .csv
    file: PathBuf,
    /// Only this encoder; may be given many times
    #[arg(long = "encoder", value_name = "NAME")]
    encoders: Vec<String>,
    /// From this second on
    #[arg(long, default_value = "0", value_parser = seconds, value_name = "S", allow_negative_numbers = true)]
    from: u64,
    /// To this second
    #[arg(long, value_parser = seconds, value_name = "S", allow_negative_numbers = true)]
    to: Option<u64>,
    /// The picture, .svg or .png; beside the recording if left out
    #[arg(long, short, value_name = "FILE")]
    output: Option<PathBuf>,
    /// One panel each: columns of numbers, with commas between
    #[arg(long, value_delimiter = ',', value_parser = column, default_value = "position,velocity,acceleration",
        value_name = "COLUMN,...")]
    columns: Vec<&'static Column>,
    /// The position of the machine in its units, in place of that in steps
    #[arg(long)]
    machine: bool,
    /// Stands above the picture; the name of the recording if left out
    #[arg(long, value_name = "TEXT")]
    title: Option<String>,
    /// On a dark ground
    #[arg(long)]
    dark: bool,
    /// How wide the picture is, in pixels; a PNG has twice as many
    #[arg(long, default_value = "1000", value_parser = width, value_name = "PIXELS", allow_negative_numbers = true)]
    width: u32,
}

fn width(text: &str) -> Result<u32, String> {
    arguments::whole(u64::from(*WIDTHS.start())..=u64::from(*WIDTHS.end()))(text)
}

fn seconds(text: &str) -> Result<u64, String> {
    let seconds = text.parse().ok().filter(|seconds| (0.0..=1e9).contains(seconds));
    let seconds: f64 = seconds.ok_or("write seconds from 0 to 1000000000, like 2.5")?;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded")]
    Ok((seconds * 1e9).round() as u64)
}

fn column(text: &str) -> Result<&'static Column, String> {
    let found = Column::named(text.trim()).filter(|column| column.kind != Kind::Text);
    found.ok_or_else(|| {
        let there: Vec<_> =
            numbers().filter(|column| column.name != "time_ns").map(|column| column.name).collect();
        format!("there is no column of numbers {text:?}; there are {}", there.join(", "))
    })
}

impl Plot {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let output = self.output.clone().unwrap_or_else(|| self.file.with_extension("svg"));
        let is_png = match output.extension().and_then(|ending| ending.to_str()) {
            Some("svg") => false,
            Some("png") => true,
            _ => {
                let name = output.display();
                return Err(Failure::Usage(format!("--output {name}: end the name with .svg or .png")));
            }
        };
        let mut columns = self.columns.clone();
        if self.machine {
            let position = |column: &&'static Column| column.name == "position";
            let machine = Column::named("machine_position");
            columns
                .iter_mut()
                .filter(|column| position(column))
                .zip(machine)
                .for_each(|(at, with)| *at = with);
        }
        let wanted = Wanted {
            columns: &columns,
            encoders: &self.encoders,
            times: self.from..=self.to.unwrap_or(u64::MAX),
        };
        let table = self.read(&wanted)?;
        if table.samples() == 0 {
            let file = self.file.display();
            return Err(Failure::Failed(format!(
                "{file} has no samples in this time; leave out --from and --to, or record for longer"
            )));
        }
        let name = self.file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let look = Look {
            title: self.title.as_deref().unwrap_or(&name),
            columns: &columns,
            dark: self.dark,
            width: self.width,
        };
        let octets =
            if is_png { png(&table, &look).map_err(Failure::Failed)? } else { svg(&table, &look).into() };
        fs::write(&output, octets)
            .map_err(|error| Failure::Failed(format!("{} cannot be written: {error}", output.display())))?;
        let (samples, encoders) =
            (table.samples(), table.curves.iter().filter(|one| !one.times.is_empty()).count());
        let shown = output.display();
        output::line(&format!(
            "{shown}: {samples} samples of {encoders} encoder{}",
            if encoders == 1 { "" } else { "s" }
        ));
        Ok(())
    }

    /// A file that is just being written may be between two states for a moment.
    fn read(&self, wanted: &Wanted<'_>) -> Result<Table, Failure> {
        const TRIES: u32 = 3;
        for _ in 1..TRIES {
            match Table::read(&self.file, wanted) {
                Err(TableError::Wrong { .. }) => std::thread::sleep(Duration::from_millis(50)),
                Err(error) => return Err(Failure::Usage(error.to_string())),
                Ok(table) => return Ok(table),
            }
        }
        Table::read(&self.file, wanted).map_err(|error| Failure::Usage(error.to_string()))
    }
}
