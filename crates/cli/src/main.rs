//! `sch108bex`: virtual SCH108BEX encoders on a bus that a PROFIBUS master can open.
//!
//! One file for each command. Standard output is for results, standard error for everything else;
//! the exit status is 0 if all went well, 1 if not, and 2 if the command line was wrong.

#![forbid(unsafe_code)]

mod arguments;
mod capture_command;
mod commission;
mod conformance;
mod ctl;
mod datasheet;
mod decode;
mod demo;
mod gsd;
mod http;
mod master;
mod output;
mod pages;
mod plot;
mod recording;
mod replay;
mod run;
mod samples;
mod scaling;
mod scenario;
mod search;
mod thinning;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// The SCH108BEX absolute encoder as software.
///
/// Without a command it shows the main job: a virtual encoder that a master finds, gives an address,
/// parameterizes and reads. Not affiliated with Scancon, the maker of the SCH108BEX.
#[derive(Debug, Parser)]
#[command(name = "sch108bex", version, args_conflicts_with_subcommands = true)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    demo: demo::Options,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Show a start-up, a turning shaft, a preset, a warning and a refusal, then end
    Demo(demo::Options),
    /// Put virtual encoders on a bus for your own master: a pseudo terminal, TCP, a Unix socket or a serial device
    Run(Box<run::Run>),
    Scan(commission::scan::Scan),
    Diag(commission::diag::Diag),
    Monitor(Box<commission::monitor::Monitor>),
    Preset(Box<commission::preset::Preset>),
    SetAddress(commission::address::SetAddress),
    /// Be a master: find stations, ask them, give them an address, exchange data with one
    Master(Box<master::Master>),
    Conformance(Box<conformance::Conformance>),
    /// Listen to a bus without sending, and keep what is on it as pcapng
    Capture(capture_command::Capture),
    Plot(plot::Plot),
    /// Send a capture's requests to a slave again, and compare its answers
    Replay(replay::Replay),
    /// Telegrams in words: from arguments, a file, a capture or standard input
    Decode(decode::Decode),
    /// What measuring units and a range mean: words, octets, the jump at the overflow
    Scaling(scaling::Scaling),
    /// The device's GSD, ours and not the maker's
    Gsd(gsd::Gsd),
    /// The manual's technical data
    Datasheet(datasheet::Datasheet),
    /// Scenarios: files that say who is on which bus, what happens and what must hold
    Scenario(scenario::Scenario),
    /// Steer encoders that run with --control: shaft, world, power, faults, snapshot, events
    Ctl(ctl::Ctl),
    /// The script that lets a shell complete commands and options
    Completions(pages::Completions),
    /// Man pages, or all commands on one page
    Man(pages::Man),
}

/// Why a command did not do what it was asked to.
#[derive(Debug, thiserror::Error)]
enum Failure {
    /// The command line asks for something that cannot be: status 2.
    #[error("{0}")]
    Usage(String),
    /// Something went wrong: status 1.
    #[error("{0}")]
    Failed(String),
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    // What those print is told on the way; of the others it is what they were asked for.
    let tells = matches!(cli.command, None | Some(Command::Demo(_) | Command::Run(_)));
    let result = match cli.command {
        None => demo::demo(&cli.demo),
        Some(Command::Demo(options)) => demo::demo(&options),
        Some(Command::Run(run)) => run.run(),
        Some(Command::Scan(scan)) => scan.run(),
        Some(Command::Diag(diag)) => diag.run(),
        Some(Command::Monitor(monitor)) => monitor.run(),
        Some(Command::Preset(preset)) => preset.run(),
        Some(Command::SetAddress(change)) => change.run(),
        Some(Command::Master(master)) => master.run(),
        Some(Command::Conformance(conformance)) => conformance.run(),
        Some(Command::Capture(capture)) => capture.run(),
        Some(Command::Plot(plot)) => plot.run(),
        Some(Command::Replay(replay)) => replay.run(),
        Some(Command::Decode(decode)) => decode.run(),
        Some(Command::Scaling(scaling)) => scaling.run(),
        Some(Command::Gsd(gsd)) => gsd.run(),
        Some(Command::Datasheet(datasheet)) => {
            datasheet.run();
            Ok(())
        }
        Some(Command::Scenario(scenario)) => scenario.run(),
        Some(Command::Ctl(ctl)) => ctl.ctl(),
        Some(Command::Completions(completions)) => {
            completions.run();
            Ok(())
        }
        Some(Command::Man(man)) => man.run(),
    };
    let lost = output::lost().filter(|_| !tells);
    let result = result.and_then(|()| lost.map_or(Ok(()), |lost| Err(Failure::Failed(lost))));
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            output::aside(&format!("error: {failure}"));
            ExitCode::from(match failure {
                Failure::Usage(_) => 2,
                Failure::Failed(_) => 1,
            })
        }
    }
}
