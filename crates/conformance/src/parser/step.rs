//! The steps of a case.

use std::collections::BTreeSet;

use super::due::due;
use super::line::line;
use super::words::{Parsed, atoms, number, octet, rate, span, split_word, tenths};
use crate::case::Step;
use crate::rig::{Action, Battery, Hand};

type At<T> = Result<T, (usize, String)>;

/// Steps from lines with their numbers.
pub(super) fn steps(lines: &[(usize, String)]) -> At<Vec<Step>> {
    let mut steps = Vec::new();
    let mut at = 0;
    while let Some((number, line)) = lines.get(at) {
        let fault = |what: String| (*number, what);
        let (word, rest) = split_word(line);
        match word {
            ">" => {
                let (_, answer) = lines.get(at + 1).ok_or((*number, "what is due? `< ...`".to_owned()))?;
                let answer = answer.strip_prefix("< ").ok_or((*number, "what is due? `< ...`".to_owned()))?;
                let line = self::line(rest).map_err(fault)?;
                let due = due(answer).map_err(|what| (number + 1, what))?;
                steps.push(Step::Exchange { line, due });
                at += 1;
            }
            "repeat" | "for" => {
                let end = end_of(lines, at).ok_or((*number, "`end` is missing".to_owned()))?;
                let body = &lines[at + 1..end];
                if word == "repeat" {
                    let times = number_before_colon(rest).map_err(fault)?;
                    steps.push(Step::Repeat(times, self::steps(body)?));
                } else {
                    steps.extend(unrolled(rest, body).map_err(fault)??);
                }
                at = end;
            }
            _ => steps.push(simple(word, rest).map_err(fault)?),
        }
        at += 1;
    }
    Ok(steps)
}

/// What controls steps take.
pub(super) fn hands(steps: &[Step]) -> BTreeSet<Hand> {
    let mut hands = BTreeSet::new();
    for step in steps {
        match step {
            Step::Act(action) => {
                hands.insert(action.hand());
            }
            Step::Repeat(_, body) => hands.extend(self::hands(body)),
            _ => {}
        }
    }
    hands
}

/// The disputed points that alternatives name.
pub(super) fn disputed(steps: &[Step]) -> BTreeSet<String> {
    let mut points = BTreeSet::new();
    for step in steps {
        match step {
            Step::Exchange { due, .. } => points.extend(due.iter().filter_map(|due| due.disputed.clone())),
            Step::Repeat(_, body) => points.extend(disputed(body)),
            _ => {}
        }
    }
    points
}

fn end_of(lines: &[(usize, String)], from: usize) -> Option<usize> {
    let mut depth = 0_usize;
    for (at, (_, line)) in lines.iter().enumerate().skip(from) {
        match split_word(line).0 {
            "repeat" | "for" => depth += 1,
            "end" => {
                depth -= 1;
                if depth == 0 {
                    return Some(at);
                }
            }
            _ => {}
        }
    }
    None
}

fn number_before_colon(text: &str) -> Parsed<u32> {
    number(text.strip_suffix(':').ok_or("a colon is missing")?)
}

/// `x in A | B | C:`, `x in hex 00-36:`, `x in 1-12:`; the body once for each, with `$x` replaced.
fn unrolled(text: &str, body: &[(usize, String)]) -> Parsed<At<Vec<Step>>> {
    let text = text.strip_suffix(':').ok_or("a colon is missing")?;
    let (name, values) = text.split_once(" in ").ok_or("for NAME in VALUES:")?;
    let mark = format!("${}", name.trim());
    let mut all = Vec::new();
    for value in values.split(" | ").map(str::trim) {
        for value in range(value)? {
            let lines: Vec<_> = body.iter().map(|(at, line)| (*at, line.replace(&mark, &value))).collect();
            match steps(&lines) {
                Ok(steps) => all.extend(steps),
                fault => return Ok(fault),
            }
        }
    }
    Ok(Ok(all))
}

/// `hex 00-36` and `1-12` are ranges; anything else is itself.
fn range(text: &str) -> Parsed<Vec<String>> {
    if let Some(range) = text.strip_prefix("hex ") {
        let (from, to) = range.split_once('-').ok_or("hex FROM-TO")?;
        return Ok((octet(from)?..=octet(to)?).map(|value| format!("{value:02X}")).collect());
    }
    if let Some((from, to)) = text.split_once('-')
        && let (Ok(from), Ok(to)) = (number::<u32>(from), number::<u32>(to))
    {
        return Ok((from..=to).map(|value| value.to_string()).collect());
    }
    Ok(vec![text.to_owned()])
}

fn simple(word: &str, rest: &str) -> Parsed<Step> {
    Ok(match word {
        "+" => Step::Foreign(line(rest)?),
        "wait" => Step::Wait(span(rest)?),
        "to" => Step::To(super::before(rest)?),
        "rate" => Step::Rate(rate(rest)?),
        "address" => Step::Address(atoms(rest)?),
        "first" => Step::FirstFcb(if rest == "M2" { 2 } else { 1 }),
        "random" => Step::Random(number(rest)?),
        "note" => Step::Note(rest.to_owned()),
        "power" if rest == "off" => Step::Act(Action::PowerOff),
        "power" if rest == "on" => Step::Act(Action::PowerOn),
        "switches" => Step::Act(Action::Switches(octet(rest)?)),
        "shaft" => Step::Act(Action::Shaft(number(rest)?)),
        "turn" => Step::Act(Action::Turn(number(rest)?)),
        "supply" => Step::Act(Action::Supply(tenths(rest)?)),
        "temperature" => Step::Act(Action::Temperature(
            i16::try_from(tenths(rest)?).map_err(|_| format!("`{rest}` is no temperature"))?,
        )),
        "light" => Step::Act(Action::Light(rest == "ok")),
        "battery" => Step::Act(Action::Battery(match rest {
            "ok" => Battery::Ok,
            "low" => Battery::Low,
            "empty" => Battery::Empty,
            _ => return Err(format!("`{rest}`: ok, low or empty")),
        })),
        "position" if rest == "error" => Step::Act(Action::PositionError),
        "operating" => Step::Act(Action::OperatingTime(
            u64::try_from(tenths(rest.trim_start_matches("time").trim().trim_end_matches('h').trim())?)
                .map_err(|_| format!("`{rest}`: no time"))?,
        )),
        _ => return Err(format!("`{word} {rest}` is no step")),
    })
}
