//! The reference vectors, each a test of its own name: `vectors::E001` and so on.
//!
//! The vectors are in `data/encoder-vectors.json`. Each category has a handler that computes what
//! is expected through the public modules, set up as a device would be. A vector fails also if it
//! has no handler, or if the handler leaves one of its inputs or expectations unread. The
//! command line is that of any Rust test: names to filter by, `--exact`, `--skip`, `--list`.

#[path = "vectors/bench.rs"]
mod bench;
#[path = "vectors/bus.rs"]
mod bus;
#[path = "vectors/frame.rs"]
mod frame;
#[path = "vectors/shaft.rs"]
mod shaft;
#[path = "vectors/vector.rs"]
mod vector;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;

use serde_json::Value;

use crate::vector::Vector;

const VECTORS: &str = include_str!("data/encoder-vectors.json");

/// What a vector's category is computed by.
fn handler(category: &str) -> Option<fn(&Vector)> {
    Some(match category {
        "position" | "scaling" => shaft::position,
        "preset" => shaft::preset,
        "velocity" => shaft::velocity,
        "overflow" => shaft::overflow,
        "set_prm" => bus::set_prm,
        "prm_check" => bus::prm_check,
        "chk_cfg" => bus::chk_cfg,
        "mode" => bus::mode,
        "data_exchange" => bus::data_exchange,
        "diagnostics" => bus::diagnostics,
        "address" => bus::address,
        "timing" => bus::timing,
        _ => return None,
    })
}

/// The part of the command line of a Rust test that makes sense here.
#[derive(Default)]
struct Arguments {
    filters: Vec<String>,
    skip: Vec<String>,
    exact: bool,
    list: bool,
    ignored: bool,
}

impl Arguments {
    fn parse() -> Self {
        let mut parsed = Self::default();
        let mut arguments = std::env::args().skip(1);
        while let Some(argument) = arguments.next() {
            match argument.as_str() {
                "--list" => parsed.list = true,
                "--exact" => parsed.exact = true,
                "--ignored" => parsed.ignored = true,
                "--skip" => parsed.skip.extend(arguments.next()),
                "--format" | "--test-threads" | "--color" | "--logfile" | "-Z" => {
                    arguments.next();
                }
                other if other.starts_with('-') => {}
                filter => parsed.filters.push(filter.to_owned()),
            }
        }
        parsed
    }

    fn wants(&self, name: &str) -> bool {
        let matches = |filter: &String| {
            if self.exact { name == filter } else { name.contains(filter.as_str()) }
        };
        let wanted = self.filters.is_empty() || self.filters.iter().any(matches);
        wanted && !self.skip.iter().any(matches) && !self.ignored
    }
}

/// Why the vector fails, line by line.
fn run(vector: &Value) -> Vec<String> {
    let category = vector["category"].as_str().unwrap_or_default();
    let Some(handler) = handler(category) else {
        return vec![format!("no handler for category {category:?}")];
    };
    let vector = Vector::new(vector);
    let outcome = catch_unwind(AssertUnwindSafe(|| handler(&vector)));
    let mut faults = vector.faults();
    if let Err(panic) = outcome {
        let message = panic.downcast_ref::<String>().map_or("", String::as_str);
        faults.push(format!("the handler panicked: {message}"));
    }
    faults
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let document: Value = serde_json::from_str(VECTORS).expect("the vectors are JSON");
    let all = document["vectors"].as_array().expect("a list of vectors");
    let name = |vector: &Value| format!("vectors::{}", vector["id"].as_str().unwrap_or("?"));
    let chosen: Vec<&Value> = all.iter().filter(|v| arguments.wants(&name(v))).collect();
    if arguments.list {
        for vector in chosen {
            println!("{}: test", name(vector));
        }
        return ExitCode::SUCCESS;
    }
    println!("\nrunning {} tests", chosen.len());
    let mut failed = 0;
    for vector in &chosen {
        let faults = run(vector);
        println!("test {} ... {}", name(vector), if faults.is_empty() { "ok" } else { "FAILED" });
        for fault in &faults {
            println!("    {}: {fault}", vector["title"].as_str().unwrap_or_default());
        }
        failed += usize::from(!faults.is_empty());
    }
    println!(
        "\ntest result: {}. {} passed; {failed} failed; 0 ignored; 0 measured; {} filtered out\n",
        if failed == 0 { "ok" } else { "FAILED" },
        chosen.len() - failed,
        all.len() - chosen.len(),
    );
    if failed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
