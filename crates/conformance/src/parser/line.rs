//! A `>` line: what is sent.

use super::words::{Parsed, atoms, number, octet, split_word, tokens};
use crate::telegram::{Atom, Body, Fc, Joint, Line, Piece, Service, Twist};

/// The pieces of a line, joined by ` + ` (at once), ` | ` (another read) or ` ~ ` (idle between).
pub(super) fn line(text: &str) -> Parsed<Line> {
    let mut pieces = Vec::new();
    let mut rest = text;
    loop {
        let next = [(" + ", Joint::None), (" | ", Joint::Read), (" ~ ", Joint::Idle)]
            .into_iter()
            .filter_map(|(mark, joint)| rest.find(mark).map(|at| (at, mark.len(), joint)))
            .min_by_key(|(at, ..)| *at);
        let Some((at, length, joint)) = next else {
            pieces.push(piece(rest, Joint::None)?);
            return Ok(Line { text: text.to_owned(), pieces });
        };
        pieces.push(piece(&rest[..at], joint)?);
        rest = &rest[at + length..];
    }
}

fn piece(text: &str, then: Joint) -> Parsed<Piece> {
    let text = text.trim();
    let (master, text) = match text.strip_prefix("M2:") {
        Some(rest) => (2, rest.trim()),
        None => (1, text),
    };
    let (word, rest) = split_word(text);
    let (body, twists) = if word == "raw" { (Body::Raw(atoms(rest)?), Vec::new()) } else { service(text)? };
    Ok(Piece { master, body, twists, then })
}

/// `NAME/FC(DATA) twists`
fn service(text: &str) -> Parsed<(Body, Vec<Twist>)> {
    let head_end = text.find(['(', ' ']).unwrap_or(text.len());
    let (head, rest) = text.split_at(head_end);
    let (name, mode) = head.split_once('/').map_or((head, None), |(name, mode)| (name, Some(mode)));
    let (data, rest) = match rest.strip_prefix('(') {
        Some(inside) => {
            let (data, rest) = inside.split_once(')').ok_or("a bracket is missing")?;
            (atoms(data)?, rest)
        }
        None => (Vec::new(), rest),
    };
    if name == "TOKEN" {
        return Ok((Body::Token(data), Vec::new()));
    }
    let (dsap, own_fc) = sap(name)?;
    let fc = match mode {
        None => own_fc,
        Some("retry") => Fc::Retry,
        Some("low") => Fc::NextLow,
        Some("retry-low") => Fc::RetryLow,
        Some("sda") => Fc::NextSda,
        Some(hex) => Fc::Is(octet(hex)?),
    };
    let mut service = Service { fc, dsap, data, to: None, from: None };
    if name == "SRD" {
        if service.data.is_empty() {
            return Err("SRD(SAP DATA): the SAP is missing".into());
        }
        service.dsap = Some(vec![service.data.remove(0)]);
    } else if name == "GC" {
        service.to = Some(vec![Atom::Octet(127, 1)]);
    }
    let twists = twists(rest, &mut service)?;
    Ok((Body::Service(service), twists))
}

/// The service access point and the function code of a service.
fn sap(name: &str) -> Parsed<(Option<Vec<Atom>>, Fc)> {
    let sap = |sap: u8, fc| Ok((Some(vec![Atom::Octet(sap, 1)]), fc));
    match name {
        "STAT" => Ok((None, Fc::Is(0x49))),
        "IDENT" => Ok((None, Fc::Is(0x4E))),
        "LSAP" => Ok((None, Fc::Is(0x4F))),
        "DX" | "SRD" => Ok((None, Fc::Next)),
        "DIAG" => sap(60, Fc::Next),
        "PRM" => sap(61, Fc::Next),
        "CFG" => sap(62, Fc::Next),
        "GCFG" => sap(59, Fc::Next),
        "RDI" => sap(56, Fc::Next),
        "RDO" => sap(57, Fc::Next),
        "SSA" => sap(55, Fc::Next),
        "GC" => sap(58, Fc::Is(0x46)),
        _ => Err(format!("`{name}` is no telegram")),
    }
}

/// `to N`, `bad sum`, `as SD3`, `damaged 3`, `slowly`, ...
fn twists(text: &str, service: &mut Service) -> Parsed<Vec<Twist>> {
    let words = tokens(text);
    let mut words = words.iter().copied();
    let mut twists = Vec::new();
    while let Some(word) = words.next() {
        if word == "slowly" {
            twists.push(Twist::Slowly);
            continue;
        }
        let value = words.next().ok_or_else(|| format!("`{word}` what?"))?;
        match (word, value) {
            ("to", value) => service.to = Some(atoms(value)?),
            ("from", value) => service.from = Some(atoms(value)?),
            ("bad", "sum") => twists.push(Twist::BadSum),
            ("bad", "end") => twists.push(Twist::BadEnd),
            ("bad", "repeat") => twists.push(Twist::BadRepeat),
            ("bad", "start") => twists.push(Twist::BadStart),
            ("as", "SD2") => twists.push(Twist::AsSd2),
            ("as", "SD3") => twists.push(Twist::AsSd3),
            ("damaged", at) => twists.push(Twist::Damaged(number(at)?)),
            ("cut", count) => twists.push(Twist::Cut(number(count)?)),
            ("split", after) => twists.push(Twist::Split(number(after)?)),
            ("gap", after) => {
                let bits = words.next().ok_or("gap AFTER BITS")?;
                twists.push(Twist::Gap(number(after)?, number(bits)?));
            }
            ("flip", at) => {
                let mask = words.next().ok_or("flip OCTET MASK")?;
                twists.push(Twist::Flipped(number(at)?, octet(mask)?));
            }
            _ => return Err(format!("`{word} {value}` means nothing")),
        }
    }
    Ok(twists)
}
