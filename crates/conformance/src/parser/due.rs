//! A `<` line: what is due.

use super::words::{Parsed, number, patterns, split_word};
use crate::case::{DataDue, DiagDue, Due, Kind};

/// Alternatives, joined by ` or `.
pub(super) fn due(text: &str) -> Parsed<Vec<Due>> {
    text.split(" or ").map(str::trim).map(one).collect()
}

fn one(text: &str) -> Parsed<Due> {
    let mut rest = text;
    let (mut min_tsdr, mut label, mut disputed, mut stream) = (None, None, None, None);
    if let Some(after) = rest.strip_prefix('@') {
        let (bits, after) = split_word(after);
        (min_tsdr, rest) = (Some(number(bits)?), after);
    }
    if let Some((before, name)) = rest.split_once(" -> ") {
        (label, rest) = (Some(name.trim().to_owned()), before.trim());
    }
    for (mark, value) in [(" in a stream", true), (" on a line", false)] {
        if let Some(before) = rest.strip_suffix(mark) {
            (stream, rest) = (Some(value), before);
        }
    }
    if let Some((before, point)) = rest.split_once(" (8.") {
        let point = point.strip_suffix(')').ok_or("(8.N): a bracket is missing")?;
        (disputed, rest) = (Some(format!("8.{point}")), before.trim());
    }
    Ok(Due { text: text.to_owned(), kind: kind(rest)?, min_tsdr, label, disputed, stream })
}

fn kind(text: &str) -> Parsed<Kind> {
    let (word, rest) = split_word(text);
    Ok(match word {
        "E5" => Kind::Ack,
        "OK" => Kind::Ok,
        "RS" => Kind::Negative(0x03),
        "RR" => Kind::Negative(0x02),
        "NR" => Kind::Negative(0x09),
        "silence" => Kind::Silence,
        "late" => Kind::Late,
        "again" => Kind::Again,
        "ident" => Kind::Ident,
        "raw" => Kind::Raw(patterns(rest)?),
        "diag" => Kind::Diag(diag(rest, false)?),
        "diag!" => Kind::Diag(diag(rest, true)?),
        "data" => Kind::Data { priority: None, data: data(rest)? },
        "DL" => Kind::Data { priority: Some(0x08), data: data(rest)? },
        "DH" => Kind::Data { priority: Some(0x0A), data: data(rest)? },
        _ => return Err(format!("`{text}` is nothing that can be due")),
    })
}

fn data(text: &str) -> Parsed<DataDue> {
    if text.is_empty() {
        Ok(DataDue::Any)
    } else if let Some(label) = text.strip_prefix("!=") {
        Ok(DataDue::Label(label.trim().to_owned(), false))
    } else if let Some(label) = text.strip_prefix('=') {
        Ok(DataDue::Label(label.trim().to_owned(), true))
    } else if text == "nothing" {
        Ok(DataDue::Octets(Vec::new()))
    } else {
        Ok(DataDue::Octets(patterns(text)?))
    }
}

/// `02 05 00 FF, length 16, octet 7 = 0A, octet 20 = 00 20`
fn diag(text: &str, exact: bool) -> Parsed<DiagDue> {
    let mut parts = text.split(',').map(str::trim);
    let head = patterns(parts.next().unwrap_or_default())?;
    let mut due = DiagDue { head, exact, length: None, octets: Vec::new() };
    if due.head.len() > 4 {
        return Err("a diagnosis begins with octets 1 to 4; later ones are `octet N = ...`".into());
    }
    for part in parts {
        let (word, rest) = split_word(part);
        match word {
            "length" => due.length = Some(number(rest)?),
            "octet" => {
                let (at, octets) = rest.split_once('=').ok_or("octet N = OCTETS")?;
                due.octets.push((number(at)?, patterns(octets)?));
            }
            _ => return Err(format!("`{part}`: length N or octet N = OCTETS")),
        }
    }
    Ok(due)
}
