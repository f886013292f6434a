//! `soak`: see the library.

#![forbid(unsafe_code)]

use std::process::ExitCode;
use std::time::{Instant as Moment, SystemTime, UNIX_EPOCH};

use clap::Parser;
use profibus_dp::time::Duration;
use soak::{Options, Report, run};

/// Hours of bus time within minutes, with what must hold looked at throughout.
#[derive(Debug, Parser)]
struct Arguments {
    /// Hours on the bus
    #[arg(long, value_name = "H", default_value_t = 24.0)]
    hours: f64,
    /// Where chance begins; the same seed gives the same run. Without it any
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Encoders on the bus, 2 to 64
    #[arg(long, value_name = "N", default_value_t = 32)]
    encoders: usize,
    /// How many of them have a shadow that takes every latch
    #[arg(long, value_name = "N", default_value_t = 2)]
    shadows: usize,
    /// The share of bits that flip
    #[arg(long, value_name = "SHARE", default_value_t = 1e-5)]
    bit_errors: f64,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    if !(arguments.hours > 0.0 && arguments.hours <= 10_000.0) {
        eprintln!("--hours {}: write a number above 0, up to 10000", arguments.hours);
        return ExitCode::from(2);
    }
    if !(0.0..=0.01).contains(&arguments.bit_errors) {
        eprintln!("--bit-errors {}: write a share from 0 to 0.01", arguments.bit_errors);
        return ExitCode::from(2);
    }
    if !(2..=64).contains(&arguments.encoders) {
        eprintln!("--encoders {}: write a number from 2 to 64", arguments.encoders);
        return ExitCode::from(2);
    }
    let seed = arguments.seed.unwrap_or_else(any_seed);
    let mut options = Options::new(span(arguments.hours), seed);
    options.encoders = arguments.encoders;
    options.shadows = arguments.shadows;
    options.bit_errors = arguments.bit_errors;
    println!(
        "seed {seed}, {} h of bus time, {} encoders at {}",
        arguments.hours, options.encoders, options.rate
    );
    let begun = Moment::now();
    let outcome = run(&options, |span| {
        eprintln!(
            "{} h of bus time after {:.1} s",
            span.as_millis() / 3_600_000,
            begun.elapsed().as_secs_f64()
        );
    });
    let wall = begun.elapsed().as_secs_f64();
    match outcome {
        Ok(report) => {
            println!("{report}");
            println!("{}", speed(&report, wall));
            ExitCode::SUCCESS
        }
        Err(violation) => {
            eprintln!("seed {seed}: {violation}");
            eprintln!("the same again: cargo xtask soak --seed {seed} --hours {}", arguments.hours);
            ExitCode::FAILURE
        }
    }
}

#[expect(clippy::cast_precision_loss, reason = "for reading only")]
fn speed(report: &Report, wall: f64) -> String {
    let bus = report.span.as_millis() as f64 / 1e3;
    let (times, rate) = (bus / wall, report.exchanges as f64 / wall);
    format!("{bus:.0} s of bus time in {wall:.1} s: {times:.0} times real time, {rate:.0} exchanges a second")
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded before")]
fn span(hours: f64) -> Duration {
    Duration::from_millis((hours * 3_600_000.0) as u64)
}

/// The clock, for want of anything less predictable.
fn any_seed() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(1, |since| since.as_secs())
}
