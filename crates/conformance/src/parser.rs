//! Case files to cases. `cases/README.md` describes the format.

mod due;
mod line;
mod step;
mod words;

use crate::case::{Before, Case, Feature, Need, Profile, Start};
use crate::rig::Hand;
use words::{Parsed, split_word};

/// A file, and where in it what is wrong.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{file}:{line}: {what}")]
pub struct ParseError {
    /// The name of the file.
    pub file: String,
    /// The line, from 1.
    pub line: usize,
    /// What is wrong with it.
    pub what: String,
}

/// The cases of one file.
///
/// # Errors
///
/// The first line that cannot be read.
pub fn parse(file: &str, text: &str) -> Result<Vec<Case>, ParseError> {
    let mut head = Head::default();
    let mut cases = Vec::new();
    let mut body: Vec<(usize, String)> = Vec::new();
    for (at, line) in text.lines().enumerate() {
        let number = at + 1;
        let line = line.split(" ;").next().unwrap_or_default().trim();
        if line.is_empty() || line.starts_with(';') || line.starts_with('#') {
            continue;
        }
        let error = |what| ParseError { file: file.to_owned(), line: number, what };
        let (word, rest) = split_word(line);
        match word {
            "area" => rest.clone_into(&mut head.area),
            "profile" => head.profile = profile(rest).map_err(error)?,
            "case" => {
                finish(file, &mut cases, &mut body)?;
                cases.push(head.case(rest).map_err(error)?);
            }
            _ if cases.is_empty() => return Err(error("a case begins with `case NUMBER TITLE`".into())),
            _ => body.push((number, line.to_owned())),
        }
    }
    finish(file, &mut cases, &mut body)?;
    Ok(cases)
}

/// What holds for the cases that follow.
#[derive(Debug)]
struct Head {
    area: String,
    profile: Profile,
}

impl Default for Head {
    fn default() -> Self {
        Self { area: String::new(), profile: Profile::DpV0 }
    }
}

impl Head {
    fn case(&self, rest: &str) -> Parsed<Case> {
        let (id, title) = split_word(rest);
        if id.is_empty() || title.is_empty() {
            return Err("a case has a number and a title".into());
        }
        Ok(Case {
            id: id.to_owned(),
            title: title.to_owned(),
            area: self.area.clone(),
            rule: String::new(),
            disputed: Vec::new(),
            tags: Vec::new(),
            profile: self.profile,
            long: false,
            needs: Vec::new(),
            before: Before::default(),
            alive: true,
            steps: Vec::new(),
        })
    }
}

/// Gives the lines of a case to it: first what it is, then its steps.
fn finish(file: &str, cases: &mut [Case], body: &mut Vec<(usize, String)>) -> Result<(), ParseError> {
    let lines = std::mem::take(body);
    let Some(case) = cases.last_mut() else {
        return Ok(());
    };
    let mut steps = Vec::new();
    for (number, line) in lines {
        let known = attribute(case, &line).map_err(|what| ParseError {
            file: file.to_owned(),
            line: number,
            what,
        })?;
        if !known {
            steps.push((number, line));
        }
    }
    case.steps =
        step::steps(&steps).map_err(|(line, what)| ParseError { file: file.to_owned(), line, what })?;
    for point in step::disputed(&case.steps) {
        if !case.disputed.contains(&point) {
            case.disputed.push(point);
        }
    }
    for hand in step::hands(&case.steps) {
        let need = Need::Hand(hand);
        if !case.needs.contains(&need) {
            case.needs.push(need);
        }
    }
    if case.before.state == Start::At126 {
        case.needs.push(Need::Hand(Hand::Delivery));
    }
    Ok(())
}

/// Takes a line that says what a case is; `false`: it is none.
fn attribute(case: &mut Case, line: &str) -> Parsed<bool> {
    let (word, rest) = split_word(line);
    let list = |text: &str| -> Vec<String> { text.split_whitespace().map(str::to_owned).collect() };
    match word {
        "rule" => rest.clone_into(&mut case.rule),
        "disputed" => case.disputed = list(rest),
        "tags" => case.tags = list(rest),
        "long" => case.long = true,
        "silent" => case.alive = false,
        "before" => case.before = before(rest)?,
        "needs" => {
            for need in rest.split(',') {
                case.needs.push(self::need(need.trim())?);
            }
        }
        _ => return Ok(false),
    }
    Ok(true)
}

fn profile(text: &str) -> Parsed<Profile> {
    match text {
        "dp-v0" => Ok(Profile::DpV0),
        "encoder" => Ok(Profile::Encoder),
        _ => Err(format!("`{text}` is no profile: dp-v0 or encoder")),
    }
}

/// `dx class 1, watchdog, at 9600`
pub(crate) fn before(text: &str) -> Parsed<Before> {
    let mut before = Before::default();
    for (at, part) in text.split(',').map(str::trim).enumerate() {
        if at == 0 {
            let (state, mode) = split_word(part);
            before.state = match state {
                "power-on" => Start::PowerOn,
                "at-126" => Start::At126,
                "wprm" => Start::WaitPrm,
                "wcfg" => Start::WaitCfg,
                "dx" => Start::DataExchange,
                _ => return Err(format!("`{state}` is no state: power-on, at-126, wprm, wcfg or dx")),
            };
            before.mode = (!mode.is_empty()).then(|| mode.to_owned());
        } else if part == "watchdog" {
            before.watchdog = true;
        } else if part == "search" {
            before.search = true;
        } else if let Some(rate) = part.strip_prefix("at ") {
            before.rate = Some(words::rate(rate)?);
        } else {
            return Err(format!("`{part}`: a beginning goes on with watchdog, search or at RATE"));
        }
    }
    Ok(before)
}

fn need(text: &str) -> Parsed<Need> {
    let feature = |feature| Need::Feature(feature, true);
    Ok(match text {
        "power" => Need::Hand(Hand::Power),
        "delivery" => Need::Hand(Hand::Delivery),
        "switches" => Need::Hand(Hand::Switches),
        "shaft" => Need::Hand(Hand::Shaft),
        "world" => Need::Hand(Hand::World),
        "faults" => Need::Hand(Hand::Faults),
        "exact time" => Need::ExactTime,
        "line errors" => Need::LineErrors,
        "stream" => Need::Stream,
        "idle" => Need::Idle,
        "rates" => Need::Rates,
        "outputs" => Need::Outputs(true),
        "no outputs" => Need::Outputs(false),
        "inputs" => Need::Inputs(true),
        "no inputs" => Need::Inputs(false),
        "sync" => feature(Feature::Sync),
        "no sync" => Need::Feature(Feature::Sync, false),
        "freeze" => feature(Feature::Freeze),
        "no freeze" => Need::Feature(Feature::Freeze, false),
        "fail-safe" => feature(Feature::FailSafe),
        "no fail-safe" => Need::Feature(Feature::FailSafe, false),
        "set-slave-add" => feature(Feature::SetSlaveAdd),
        "no set-slave-add" => Need::Feature(Feature::SetSlaveAdd, false),
        "serial" => Need::Serial,
        "octet 8" => feature(Feature::AsicOctet8),
        _ => {
            if let Some(count) = text.strip_suffix(" outputs") {
                Need::OutputOctets(words::number(count)?)
            } else if let Some(count) = text.strip_suffix(" parameters") {
                Need::UserPrm(words::number(count)?)
            } else if let Some((n, m)) = text.strip_prefix("bits ").and_then(|bits| bits.split_once('x')) {
                Need::Bits(words::number(n)?, words::number(m)?)
            } else {
                return Err(format!("`{text}` is nothing that a case can need"));
            }
        }
    })
}
