//! `sch108bex-bench WORK [ROUNDS]`: what `cargo xtask bench` measures on the host.
//!
//! A work with rounds is run under valgrind, which counts; the others print one number.

mod demo_cycle;
mod device;
mod echo;
mod fleet;
mod late;
mod over_limit;
mod processes;
mod recorded;
mod telegrams;
mod tty;

use std::env;
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let printed = match words.as_slice() {
        ["echo", count] => count
            .parse()
            .map_err(|_| format!("{count} is no number of PTYs."))
            .and_then(|count| echo::serve(count).map(|()| String::new())),
        ["over-limit"] => over_limit::ratio().map(|ratio| format!("{ratio:.3}\n")),
        ["round-trip"] => processes::round_trip_ratio().map(|ratio| format!("{ratio:.3}\n")),
        ["demo-cycle"] => demo_cycle::measure().map(|cycle| format!("{:.3}\n", cycle.ours)),
        ["demo-cycle-ratio"] => {
            demo_cycle::measure().map(|cycle| format!("{:.3}\n", cycle.ours / cycle.theirs))
        }
        ["bus-125"] => fleet::times_real_time().map(|times| format!("{times:.1}\n")),
        ["cost-ratio"] => fleet::cost_ratio().map(|ratio| format!("{ratio:.3}\n")),
        ["encoder-memory"] => fleet::memory().map(|kib| format!("{kib:.2}\n")),
        ["late"] => late::late_answers().map(|late| format!("{late:.1}\n")),
        ["record-capture"] => recorded::cost_ratio().map(|ratio| format!("{ratio:.3}\n")),
        ["help"] => processes::help().map(|ms| format!("{ms:.2}\n")),
        ["start"] => processes::start_to_ready().map(|ms| format!("{ms:.2}\n")),
        ["ram"] => Ok(format!("{}\n", device::ram())),
        [work, rounds] => rounds
            .parse()
            .map_err(|_| format!("{rounds} is no number of rounds."))
            .and_then(|rounds| device::count(work, rounds).map(|()| String::new())),
        _ => Err("Run this by `cargo xtask bench`.".into()),
    };
    match printed {
        Ok(text) => {
            print!("{text}");
            ExitCode::SUCCESS
        }
        Err(text) => {
            eprintln!("{text}");
            ExitCode::FAILURE
        }
    }
}

/// The middle one.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
