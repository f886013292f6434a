//! What came of a scenario.

use serde::Serialize;

use super::Scenario;
use super::bench::Bench;
use super::poller::Slave;

/// What came of a scenario.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outcome {
    /// What it is called.
    pub title: String,
    /// Every expectation holds, and everything was done.
    pub passed: bool,
    /// How long it lasted, in virtual time.
    pub seconds: f64,
    /// What became of each expectation, in the order of the file.
    pub expectations: Vec<Verdict>,
    /// What could not be done.
    pub troubles: Vec<String>,
    /// What was on each bus.
    pub segments: Vec<SegmentOutcome>,
}

/// What became of an expectation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Verdict {
    /// Where it stands in the file.
    pub line: usize,
    /// What was expected.
    pub expected: String,
    /// Whether it holds.
    pub holds: bool,
    /// What was found.
    pub found: String,
}

/// What was on a bus.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SegmentOutcome {
    /// Its name.
    pub name: String,
    /// Octets in both directions.
    pub octets: u64,
    /// A sum of these octets and of when they were: the same for the same scenario.
    pub sum: String,
    /// Cycles that the master has begun.
    pub cycles: u64,
    /// Those in the master's list.
    pub encoders: Vec<EncoderOutcome>,
}

/// What a master has to say of an encoder.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EncoderOutcome {
    /// Its name.
    pub name: String,
    /// Exchanges of data that succeeded.
    pub exchanges: u64,
    /// Requests that failed, retries not counted.
    pub failures: u64,
    /// Whether it exchanged data in the end.
    pub exchanging: bool,
    /// Why the last request failed that did.
    pub trouble: Option<String>,
}

impl From<&Slave> for EncoderOutcome {
    fn from(slave: &Slave) -> Self {
        Self {
            name: slave.plan.encoder.clone(),
            exchanges: slave.exchanges,
            failures: slave.failures,
            exchanging: slave.exchanging,
            trouble: slave.trouble.clone(),
        }
    }
}

#[expect(clippy::cast_precision_loss, reason = "for reading only")]
pub(super) fn of(
    scenario: &Scenario,
    bench: &Bench,
    expectations: Vec<Verdict>,
    troubles: Vec<String>,
) -> Outcome {
    let segments = bench.segments.iter().map(|segment| SegmentOutcome {
        name: segment.name.clone(),
        octets: segment.poller.line().octets(),
        sum: format!("{:016x}", segment.poller.line().sum()),
        cycles: segment.poller.cycles,
        encoders: segment.poller.slaves().iter().map(EncoderOutcome::from).collect(),
    });
    Outcome {
        title: scenario.title.clone(),
        passed: troubles.is_empty() && expectations.iter().all(|verdict| verdict.holds),
        seconds: bench.now().as_nanos() as f64 / 1e9,
        segments: segments.collect(),
        expectations,
        troubles,
    }
}
