//! Playing a scenario in virtual time.

use std::ops::ControlFlow;

use bus::EndError;
use profibus_dp::time::{Duration, Instant};

use super::bench::Bench;
use super::expect::What;
use super::judge::Judge;
use super::outcome::{Outcome, Verdict};
use super::{Scenario, outcome};
use crate::control::ControlError;
use crate::report::Report;
use crate::store::StoreError;

/// Why a scenario could not be played.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// A state file cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A segment broke.
    #[error(transparent)]
    End(#[from] EndError),
    /// What an encoder is to begin with cannot be done.
    #[error(transparent)]
    Start(#[from] ControlError),
}

/// Whoever looks on while a scenario is played.
pub trait Progress {
    /// [`step`](Self::step) is called at least this often, in virtual time. What happens does not depend on it.
    fn longest_step(&self) -> Duration {
        Duration::from_secs(1)
    }

    /// What will be judged, before anything is: each as if it were judged now.
    fn expects(&mut self, expectations: &[Verdict]) {
        let _ = expectations;
    }

    /// It stands between two steps: masters can be asked for things now.
    fn between(&mut self, bench: &mut Bench) {
        let _ = bench;
    }

    /// It is about to go on to this moment; `Break` ends it here.
    fn step(&mut self, to: Instant) -> ControlFlow<()> {
        let _ = to;
        ControlFlow::Continue(())
    }

    /// It has come to this moment; everything that happened before was reported.
    fn stepped(&mut self, to: Instant) {
        let _ = to;
    }

    /// Something has happened.
    fn report(&mut self, report: &Report) {
        let _ = report;
    }

    /// Something was judged.
    fn verdict(&mut self, verdict: &Verdict) {
        let _ = verdict;
    }
}

impl Progress for () {}

/// What is due at a moment, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Due {
    Judge(usize),
    Begin(usize),
    Event(usize),
}

fn agenda(scenario: &Scenario) -> Vec<(Instant, Due)> {
    let expectations = scenario.expectations.iter().enumerate().filter_map(|(at, expectation)| {
        Some(match &expectation.what {
            What::State { at: moment, .. } => (*moment, Due::Judge(at)),
            What::Sees { after, .. } => (*after, Due::Begin(at)),
            What::Event { .. } => return None,
        })
    });
    let events = scenario.events.iter().enumerate().map(|(at, event)| (event.at, Due::Event(at)));
    let mut agenda: Vec<_> = expectations.chain(events).collect();
    agenda.sort_by_key(|(moment, due)| (*moment, *due));
    agenda
}

/// Plays a scenario. `source` is its text, for the lines in the outcome.
///
/// # Errors
///
/// A state file that cannot be used.
pub fn run(scenario: &Scenario, source: &str, progress: &mut dyn Progress) -> Result<Outcome, RunError> {
    play(Bench::new(scenario)?, scenario, source, progress)
}

/// The same on a bench that somebody has a hand on, so that it is steered and listened to from outside as well.
///
/// # Errors
///
/// A segment that broke.
pub fn play(
    mut bench: Bench,
    scenario: &Scenario,
    source: &str,
    progress: &mut dyn Progress,
) -> Result<Outcome, RunError> {
    let mut judge = Judge::new(scenario, source);
    progress.expects(&judge.expected(&bench));
    let mut troubles = Vec::new();
    let mut ended = ControlFlow::Continue(());
    for (moment, due) in agenda(scenario) {
        ended = go_on(&mut bench, moment, &mut judge, progress)?;
        if ended.is_break() {
            break;
        }
        match due {
            Due::Judge(at) => progress.verdict(judge.state(at, &bench)),
            Due::Begin(at) => judge.begin(at, &bench),
            Due::Event(at) => {
                let event = &scenario.events[at];
                if let Err(error) = bench.act(&event.act) {
                    let line = super::position(source, event.octet).0;
                    troubles.push(format!("line {line}: the event was not done: {error}"));
                }
            }
        }
    }
    if ended.is_continue() {
        ended = go_on(&mut bench, Instant::ZERO + scenario.duration, &mut judge, progress)?;
    }
    bench.shut_down();
    for report in bench.take_reports() {
        progress.report(&report);
        judge.note(&report);
    }
    if ended.is_break() {
        troubles.push("it was ended before its time".to_owned());
    }
    judge.end(&bench, progress);
    Ok(outcome::of(scenario, &bench, judge.verdicts(), troubles))
}

/// On to a moment, in steps.
fn go_on(
    bench: &mut Bench,
    until: Instant,
    judge: &mut Judge<'_>,
    progress: &mut dyn Progress,
) -> Result<ControlFlow<()>, EndError> {
    loop {
        progress.between(bench);
        let now = bench.now();
        let to = until.min(now + progress.longest_step());
        if progress.step(to).is_break() {
            return Ok(ControlFlow::Break(()));
        }
        bench.advance_to(to)?;
        for report in bench.take_reports() {
            progress.report(&report);
            judge.note(&report);
        }
        progress.stepped(to);
        if to >= until {
            return Ok(ControlFlow::Continue(()));
        }
    }
}
