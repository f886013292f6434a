//! `sch108bex scenario run`: a scenario in virtual time.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration as Time, Instant as Moment};

use clap::Args;
use plant::Report;
use plant::control::{ControlAddress, Subscriptions};
use plant::scenario::{Bench, Outcome, Progress, Verdict, play};
use profibus_dp::time::{Duration, Instant};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

use super::{Loaded, load};
use crate::Failure;
use crate::arguments::control_address;
use crate::output;
use crate::recording::Capture;
use crate::run::{failed, serve_control};
use crate::samples::{self, Recording};

#[derive(Debug, Args)]
pub(crate) struct Play {
    /// The scenario
    file: PathBuf,
    /// As fast as it goes
    #[arg(long = "virtual", conflicts_with = "speed")]
    unpaced: bool,
    /// So many times as fast as real time
    #[arg(long, default_value = "1", value_parser = speed, value_name = "F", allow_negative_numbers = true)]
    speed: f64,
    /// Print every event, too
    #[arg(long, conflicts_with = "json")]
    events: bool,
    /// Print the result in JSON
    #[arg(long)]
    json: bool,
    /// Take requests here while it is played, as `run --control` does. Not with --virtual: nobody is as fast
    #[arg(long, value_parser = control_address(), value_name = "PATH|tcp:127.0.0.1:PORT")]
    control: Option<ControlAddress>,
    #[command(flatten)]
    capture: Capture,
    #[command(flatten)]
    record: samples::Options,
}

fn speed(text: &str) -> Result<f64, String> {
    let speed = text.parse().ok().filter(|speed| (0.001..=1e6).contains(speed));
    speed.ok_or_else(|| "write a factor from 0.001 to 1000000, like 10; or --virtual".to_owned())
}

impl Play {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let Loaded { plan, source } = load(&self.file)?;
        if self.unpaced && self.control.is_some() {
            let text = "--control is for a scenario that takes time, and --virtual takes none: leave one of them out, or \
                        write --speed 10";
            return Err(Failure::Usage(text.to_owned()));
        }
        let (ended, subscriptions) = (end_on_signals()?, Subscriptions::new());
        let bench = Bench::new(&plan).map_err(failed)?;
        let segments: Vec<_> = plan.segments.iter().map(|segment| (&*segment.name, &*segment.name)).collect();
        let captures = self.capture.start(bench.handle(), &segments, true)?;
        let recording = self.record.start_virtual(bench.handle())?;
        let end = Arc::clone(&ended);
        let control =
            serve_control(self.control.as_ref(), bench.handle().clone(), subscriptions.clone(), move || {
                end.store(true, Ordering::Relaxed);
            })?;
        if let Some(control) = &control {
            // Standard output is for the result.
            output::aside(&format!("control: {}", control.address()));
        }
        let mut watch = Watch {
            events: self.events,
            verdicts: !self.json,
            speed: (!self.unpaced).then_some(self.speed),
            begun: Moment::now(),
            ended,
            subscriptions,
            recording,
        };
        let outcome = play(bench, &plan, &source, &mut watch).map_err(failed)?;
        drop(control);
        captures.end().and(samples::end(watch.recording))?;
        if self.json {
            output::json(&outcome);
        } else {
            summary(&outcome);
        }
        if outcome.passed {
            return Ok(());
        }
        let file = self.file.display();
        let broken = outcome.expectations.iter().filter(|verdict| !verdict.holds).count();
        let troubles = outcome.troubles.join("; ");
        Err(Failure::Failed(match (broken, troubles.as_str()) {
            (0, troubles) => format!("{file}: {troubles}"),
            (_, "") => format!("{file}: {broken} of {} expectations do not hold", outcome.expectations.len()),
            (_, troubles) => {
                format!(
                    "{file}: {broken} of {} expectations do not hold; {troubles}",
                    outcome.expectations.len()
                )
            }
        }))
    }
}

/// Looks on, and takes care of the time.
struct Watch {
    events: bool,
    verdicts: bool,
    speed: Option<f64>,
    begun: Moment,
    ended: Arc<AtomicBool>,
    subscriptions: Subscriptions,
    recording: Option<Recording>,
}

impl Progress for Watch {
    fn longest_step(&self) -> Duration {
        let step = match self.speed {
            // Twenty milliseconds of real time, so that Ctrl-C is not waited for.
            Some(speed) => Duration::from_nanos(nanos(20e6 * speed).max(1_000)),
            None => Duration::from_secs(1),
        };
        // What is recorded waits for the end of its step, in memory.
        if self.recording.is_some() { step.min(Duration::from_millis(100)) } else { step }
    }

    fn stepped(&mut self, to: Instant) {
        self.recording.iter().for_each(|recording| recording.step(to));
    }

    fn step(&mut self, to: Instant) -> ControlFlow<()> {
        if let Some(speed) = self.speed {
            #[expect(clippy::cast_precision_loss, reason = "below 2^53 ns for 104 days")]
            let due = Time::from_nanos(nanos(to.as_nanos() as f64 / speed));
            std::thread::sleep(due.saturating_sub(self.begun.elapsed()));
        }
        if self.ended.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn report(&mut self, report: &Report) {
        self.subscriptions.publish(report);
        self.recording.iter().for_each(|recording| recording.report(report));
        if self.events {
            #[expect(clippy::cast_precision_loss, reason = "for reading only")]
            let seconds = report.at.as_nanos() as f64 / 1e9;
            output::line(&format!("{seconds:11.6}  {}: {}", report.who, report.what));
        }
    }

    fn verdict(&mut self, verdict: &Verdict) {
        if self.verdicts {
            let Verdict { line, expected, holds, found } = verdict;
            let word = if *holds { "ok  " } else { "FAIL" };
            output::line(&format!("{word} line {line}: {expected}; found: {found}"));
        }
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive and bounded")]
fn nanos(nanos: f64) -> u64 {
    nanos.round() as u64
}

fn end_on_signals() -> Result<Arc<AtomicBool>, Failure> {
    let ended = Arc::new(AtomicBool::new(false));
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP])
        .map_err(|error| Failure::Failed(format!("cannot take note of Ctrl-C: {error}")))?;
    let end = Arc::clone(&ended);
    std::thread::spawn(move || {
        signals.forever().next();
        end.store(true, Ordering::Relaxed);
    });
    Ok(ended)
}

fn summary(outcome: &Outcome) {
    let holding = outcome.expectations.iter().filter(|verdict| verdict.holds).count();
    for segment in &outcome.segments {
        output::line(&format!(
            "{}: {} octets in {} cycles, sum {}",
            segment.name, segment.octets, segment.cycles, segment.sum
        ));
        for encoder in &segment.encoders {
            let trouble =
                encoder.trouble.as_deref().map_or(String::new(), |text| format!("; the last: {text}"));
            output::line(&format!(
                "  {}: {} exchanges, {} failures{trouble}",
                encoder.name, encoder.exchanges, encoder.failures
            ));
        }
    }
    let title = if outcome.title.is_empty() { "The scenario" } else { &outcome.title };
    let all = outcome.expectations.len();
    output::line(&format!("{title}: {} s, {holding} of {all} expectations hold", outcome.seconds));
}
