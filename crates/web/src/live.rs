//! A scenario that runs in step with real time, on a thread of its own: the demonstration, or one that is played.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration as Time, Instant as Moment};

use plant::control::Subscriptions;
use plant::scenario::{
    Bench, MasterRefusal, MasterRequest, Outcome, Progress, RunError, Scenario, Verdict, play,
};
use plant::{Handle, Report};
use profibus_dp::time::{Duration, Instant};
use serde::Serialize;
use serde_json::Value;

/// How far it goes at once, in real time.
const STEP: Time = Time::from_millis(10);
/// A computer that is busier than that falls behind for good, and does not race after it.
const MOST_BEHIND: Time = Time::from_millis(250);
/// An answer of a master comes within this time.
const PATIENCE: Time = Time::from_secs(5);

/// How often as fast as real time something can be played.
pub(crate) const FACTORS: std::ops::RangeInclusive<f64> = 0.01..=1_000.0;

/// A scenario on its way. It ends when this is dropped.
#[derive(Debug)]
pub(crate) struct Live {
    pub(crate) handle: Handle,
    pub(crate) subscriptions: Subscriptions,
    pub(crate) factor: f64,
    asks: Mutex<Sender<Ask>>,
    state: Arc<Mutex<Playing>>,
    ended: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// Something to ask of a master, and where the answer goes.
type Ask = (MasterRequest, Sender<Result<Value, MasterRefusal>>);

/// How far it is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Playing {
    scenario: String,
    state: State,
    at_s: f64,
    seconds: f64,
    expectations: Vec<Expected>,
    /// What could not be done.
    troubles: Vec<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum State {
    Playing,
    Passed,
    Failed,
    Stopped,
}

/// What must hold.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Expected {
    line: usize,
    text: String,
    state: Judged,
    why: Option<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Judged {
    Waiting,
    Held,
    Failed,
}

impl Live {
    /// Begins to play. State files of it are not used: a page shall write nowhere.
    pub(crate) fn start(
        name: &str,
        mut plan: Scenario,
        source: String,
        factor: f64,
    ) -> Result<Self, RunError> {
        for encoder in plan.segments.iter_mut().flat_map(|segment| &mut segment.encoders) {
            encoder.state = None;
        }
        let bench = Bench::new(&plan)?;
        let (handle, subscriptions) = (bench.handle().clone(), Subscriptions::new());
        let state = Arc::new(Mutex::new(Playing {
            scenario: name.to_owned(),
            state: State::Playing,
            at_s: 0.0,
            seconds: seconds(plan.duration.as_nanos()),
            expectations: Vec::new(),
            troubles: Vec::new(),
        }));
        let (asks, asked) = mpsc::channel();
        let ended = Arc::new(AtomicBool::new(false));
        let mut watch = Watch {
            factor,
            begun: Moment::now(),
            asked,
            subscriptions: subscriptions.clone(),
            state: Arc::clone(&state),
            ended: Arc::clone(&ended),
        };
        let thread = std::thread::Builder::new().name("web bench".to_owned()).spawn(move || {
            let outcome = play(bench, &plan, &source, &mut watch);
            watch.end(outcome);
        });
        let thread =
            thread.map_err(|source| bus::EndError::Broken { name: name.to_owned(), step: "play", source })?;
        let asks = Mutex::new(asks);
        Ok(Self { handle, subscriptions, factor, asks, state, ended, thread: Some(thread) })
    }

    /// How far it is.
    pub(crate) fn state(&self) -> Playing {
        lock(&self.state).clone()
    }

    /// Has a master do something, and waits until it is done; `None`: it does not run any more.
    pub(crate) fn ask(&self, request: MasterRequest) -> Option<Result<Value, MasterRefusal>> {
        let (to, answer) = mpsc::channel();
        lock(&self.asks).send((request, to)).ok()?;
        answer.recv_timeout(PATIENCE).ok()
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            let _ = thread.join();
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Each change is whole by itself, so a panic elsewhere does not matter.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[expect(clippy::cast_precision_loss, reason = "for reading only")]
pub(crate) fn seconds(nanos: u64) -> f64 {
    nanos as f64 / 1e9
}

/// Looks on, and takes care of the time.
struct Watch {
    factor: f64,
    /// When it would have begun if it had never fallen behind.
    begun: Moment,
    asked: Receiver<Ask>,
    subscriptions: Subscriptions,
    state: Arc<Mutex<Playing>>,
    ended: Arc<AtomicBool>,
}

impl Watch {
    fn end(&mut self, outcome: Result<Outcome, RunError>) {
        let mut state = lock(&self.state);
        match outcome {
            Ok(outcome) => {
                state.state = match (outcome.passed, self.ended.load(Ordering::Relaxed)) {
                    (_, true) => State::Stopped,
                    (true, false) => State::Passed,
                    (false, false) => State::Failed,
                };
                state.troubles = outcome.troubles;
            }
            Err(error) => {
                state.state = State::Failed;
                state.troubles.push(error.to_string());
            }
        }
    }

    fn verdict_at(&mut self, verdict: &Verdict) {
        let mut state = lock(&self.state);
        let all = state.expectations.iter_mut();
        for expected in all.filter(|expected| expected.line == verdict.line) {
            expected.text.clone_from(&verdict.expected);
            expected.state = if verdict.holds { Judged::Held } else { Judged::Failed };
            expected.why = Some(verdict.found.clone());
        }
    }
}

impl Progress for Watch {
    fn longest_step(&self) -> Duration {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive and bounded")]
        let nanos = (STEP.as_secs_f64() * self.factor * 1e9) as u64;
        Duration::from_nanos(nanos.max(1_000))
    }

    fn expects(&mut self, expectations: &[Verdict]) {
        let expected = expectations.iter().map(|verdict| Expected {
            line: verdict.line,
            text: verdict.expected.clone(),
            state: Judged::Waiting,
            why: None,
        });
        lock(&self.state).expectations = expected.collect();
    }

    /// Waits for real time to come so far, and serves whoever asks meanwhile.
    fn between(&mut self, bench: &mut Bench) {
        while !self.ended.load(Ordering::Relaxed) {
            let at = seconds(bench.now().as_nanos());
            lock(&self.state).at_s = at;
            let due = Time::from_secs_f64(at / self.factor);
            let behind = self.begun.elapsed().saturating_sub(due);
            if behind > MOST_BEHIND {
                self.begun += behind;
            }
            let left = due.saturating_sub(self.begun.elapsed());
            match self.asked.recv_timeout(left.min(STEP)) {
                Ok((request, to)) => {
                    // Whoever has asked may be gone.
                    let _ = to.send(bench.ask(&request));
                }
                Err(RecvTimeoutError::Timeout) if left > STEP => {}
                Err(RecvTimeoutError::Timeout) => return,
                Err(RecvTimeoutError::Disconnected) => {
                    std::thread::park_timeout(left.min(STEP));
                    return;
                }
            }
        }
    }

    fn step(&mut self, _: Instant) -> ControlFlow<()> {
        if self.ended.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn report(&mut self, report: &Report) {
        self.subscriptions.publish(report);
    }

    fn verdict(&mut self, verdict: &Verdict) {
        self.verdict_at(verdict);
    }
}
