//! `sch108bex scenario`: files that say who is on which bus, what happens and what must hold.

pub(crate) mod live;
mod play;

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use plant::scenario::{Fault, Faults, MOST_OCTETS, Scenario as Plan, position, schema};
use serde::Serialize;

use crate::Failure;
use crate::gsd::Offer;
use crate::output;

/// Check scenario files, play them in virtual time, and judge them
///
/// docs/scenarios.md has every key; examples/scenarios has files to begin with. `sch108bex run FILE` puts
/// one on real ports for your own master.
#[derive(Debug, Args)]
pub(crate) struct Scenario {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Say whether a file is a scenario, and what is wrong with it otherwise
    Check {
        /// The scenario
        file: PathBuf,
        /// Print the result in JSON
        #[arg(long)]
        json: bool,
    },
    /// Play a scenario with its built-in masters, and judge its expectations: exit status 0 if all hold, else 1
    Run(play::Play),
    /// The JSON schema of scenario files, for editors
    Schema,
}

impl Scenario {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        match &self.command {
            Command::Check { file, json } => check(file, *json),
            Command::Run(play) => play.run(),
            Command::Schema => {
                output::json(&schema());
                Ok(())
            }
        }
    }
}

/// A file that is a scenario, and its text.
#[derive(Debug)]
pub(crate) struct Loaded {
    pub(crate) plan: Plan,
    pub(crate) source: String,
}

/// Reads a scenario; paths in it are from its folder on.
pub(crate) fn load(file: &Path) -> Result<Loaded, Failure> {
    let (source, parsed) = read(file)?;
    match parsed {
        Ok(plan) => Ok(Loaded { plan, source }),
        Err(faults) => Err(Failure::Usage(wrong(file, &source, &faults))),
    }
}

fn wrong(file: &Path, source: &str, faults: &Faults) -> String {
    let name = file.display().to_string();
    let all: Vec<_> = faults.0.iter().map(|fault| fault.render(&name, source)).collect();
    all.join("\nerror: ")
}

/// The text of a file, and what it is as a scenario.
fn read(file: &Path) -> Result<(String, Result<Plan, Faults>), Failure> {
    let cannot = |error: std::io::Error| {
        let file = file.display();
        Failure::Usage(format!("{file} cannot be read: {error}; name a scenario file"))
    };
    let mut octets = Vec::new();
    // One more than there may be, and no more of a file that has no end.
    let most = MOST_OCTETS as u64 + 1;
    File::open(file).map_err(cannot)?.take(most).read_to_end(&mut octets).map_err(cannot)?;
    let folder = file.parent().unwrap_or(Path::new(""));
    let parsed = Plan::parse_octets(&octets, folder).and_then(|mut plan| {
        plan.resolve_paths(folder);
        plan.resolve_gsd(|path, variant| {
            let offer = Offer::from_gsd(path, variant)?;
            Ok((offer.ident_number, offer.configurations))
        })
        .map_err(|why| {
            let fault = Fault {
                span: None,
                message: why,
                hint: "write the path of your own GSD of the device".to_owned(),
            };
            Faults(vec![fault])
        })?;
        Ok(plan)
    });
    Ok((String::from_utf8_lossy(&octets).into_owned(), parsed))
}

/// What `check --json` prints.
#[derive(Debug, Serialize)]
struct Checked {
    valid: bool,
    faults: Vec<Found>,
}

#[derive(Debug, Serialize)]
struct Found {
    line: Option<usize>,
    column: Option<usize>,
    message: String,
    hint: String,
}

fn check(file: &Path, json: bool) -> Result<(), Failure> {
    let (source, parsed) = read(file)?;
    if json {
        let found = |fault: &Fault| {
            let place = fault.span.as_ref().map(|span| position(&source, span.start));
            let (message, hint) = (fault.message.clone(), fault.hint.clone());
            Found { line: place.map(|place| place.0), column: place.map(|place| place.1), message, hint }
        };
        let faults = parsed.as_ref().err().map_or(Vec::new(), |faults| faults.0.iter().map(found).collect());
        output::json(&Checked { valid: parsed.is_ok(), faults });
    }
    match parsed {
        Ok(plan) if !json => output::line(&summary(&plan)),
        Ok(_) => {}
        Err(faults) => return Err(Failure::Usage(wrong(file, &source, &faults))),
    }
    Ok(())
}

fn summary(plan: &Plan) -> String {
    let of = |count: usize, what: &str| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
    let title = if plan.title.is_empty() { "a scenario" } else { &plan.title };
    format!(
        "{title}: {}, {}, {}, {}, {} long",
        of(plan.segments.len(), "segment"),
        of(plan.encoders().count(), "encoder"),
        of(plan.events.len(), "event"),
        of(plan.expectations.len(), "expectation"),
        plant::scenario::show_time(plan.duration)
    )
}
