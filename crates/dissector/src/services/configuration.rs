//! Chk_Cfg and Get_Cfg: identifier octets one by one.

use profibus_dp::wire::chk_cfg::Lengths;

use crate::field::{Data, Value};

/// Each identifier as a field; what they make in all.
pub(crate) fn identifiers(data: &mut Data<'_>) -> (String, Option<(usize, String)>) {
    let mut at = 1;
    while let Some(identifier) = data.octet(at) {
        let (following, words) = match identifier & 0x30 {
            0x00 => special(data, at, identifier),
            _ => (0, general(identifier)),
        };
        let last = (at + following).min(data.octets.len());
        let value = Value::Octets(crate::hex::text(&data.octets[at - 1..last]));
        data.add([at, last], None, "Identifier", value, words.into());
        at += 1 + following;
    }
    let words = lengths_in_words(data.octets);
    match Lengths::of(data.octets) {
        Some(_) if !data.octets.is_empty() => (words, None),
        Some(_) => (words, Some((data.place(0), "no identifier at all".to_owned()))),
        None => {
            let wrong =
                "the identifiers are malformed, or have more than 244 octets in a direction".to_owned();
            (words, Some((data.place(data.octets.len()), wrong)))
        }
    }
}

/// "4 in, 4 out"
pub(crate) fn lengths_in_words(octets: &[u8]) -> String {
    Lengths::of(octets).map_or_else(
        || "no valid configuration".to_owned(),
        |Lengths { inputs, outputs }| format!("{inputs} in, {outputs} out"),
    )
}

fn general(identifier: u8) -> String {
    let direction = ["", "in", "out", "in and out"][usize::from(identifier >> 4 & 3)];
    units(identifier, identifier & 0x0F, direction)
}

fn units(octet: u8, less_one: u8, direction: &str) -> String {
    let count = u16::from(less_one) + 1;
    let unit = if octet & 0x40 == 0 { "octet" } else { "word" };
    let consistent = if octet & 0x80 == 0 { format!("each {unit}") } else { "the whole".to_owned() };
    let plural = if count == 1 { "" } else { "s" };
    format!("{count} {unit}{plural} {direction}, consistent over {consistent}")
}

/// How many octets belong to a special identifier besides itself, and words for it.
fn special(data: &Data<'_>, at: usize, identifier: u8) -> (usize, String) {
    let mut following = 0;
    let mut words = Vec::new();
    for (bit, direction) in [(0x80, "out"), (0x40, "in")] {
        if identifier & bit != 0 {
            following += 1;
            if let Some(length) = data.octet(at + following) {
                words.push(units(length, length & 0x3F, direction));
            }
        }
    }
    if words.is_empty() && identifier & 0xC0 == 0 {
        words.push("free place".to_owned());
    }
    match identifier & 0x0F {
        0 => {}
        15 => words.push("maker's octets not compared".to_owned()),
        makers => {
            following += usize::from(makers);
            words.push(format!("{makers} octets of the maker"));
        }
    }
    (following, words.join("; "))
}
