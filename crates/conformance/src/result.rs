//! What became of a case.

/// Passed, failed or left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The slave keeps the rule.
    Pass,
    /// It does not.
    Fail,
    /// It was not tried.
    Skip,
}

impl Outcome {
    /// `pass`, `fail`, `skip`
    pub const fn word(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Fail => "fail",
            Self::Skip => "skip",
        }
    }
}

/// One thing that was done in a case.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Record {
    /// What was done, as the case has it.
    pub what: String,
    /// The octets sent, in hex; empty where nothing was.
    pub sent: String,
    /// The octets that came; empty where none did.
    pub came: String,
    /// What was due.
    pub due: String,
    /// Nanoseconds from the end of the request to the start of the reply, where known exactly.
    pub delay_ns: Option<u64>,
    /// Why it was wrong.
    pub fault: Option<String>,
}

/// What became of one case.
#[derive(Debug, Clone, PartialEq)]
pub struct CaseResult {
    /// Its number.
    pub id: String,
    /// The rule.
    pub title: String,
    /// What it is about.
    pub area: String,
    /// Where the rule is from.
    pub rule: String,
    /// Passed, failed or left out.
    pub outcome: Outcome,
    /// Why it failed or was left out; for one that passed, which disputed alternative was seen.
    pub reason: String,
    /// What was done after the beginning was reached.
    pub records: Vec<Record>,
    /// Seconds that it took.
    pub seconds: f64,
}
