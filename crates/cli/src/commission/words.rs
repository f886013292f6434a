//! What stations have said, in words.

use std::fmt::Write;

use ::master::light::StationKind;
use dissector::advice::{Difference, Finding};
use dissector::{Conversation, Field, Item, Profile};
use profibus_dp::wire::telegram::MAX_OCTETS;
use profibus_dp::wire::{DataTelegram, FunctionCode, Sap};

pub(crate) const SLAVE_DIAG: Sap = Sap::SLAVE_DIAG;
pub(crate) const GET_CFG: Sap = Sap::GET_CFG;

/// What a station is.
pub(crate) fn kind(kind: StationKind) -> &'static str {
    match kind {
        StationKind::Passive => "slave",
        StationKind::NotReady => "master, not ready for the token",
        StationKind::Ready => "master, ready for the token",
        StationKind::InRing => "master in the token ring",
    }
}

/// Octets as people write them.
pub(crate) fn hex(octets: &[u8]) -> String {
    dissector::hex::text(octets)
}

/// The values in the answer to a service.
pub(crate) fn fields(slave: u8, master: u8, service: Sap, octets: &[u8]) -> Vec<Field> {
    let answer = DataTelegram {
        da: master,
        sa: slave,
        fc: FunctionCode(0x08),
        dsap: Sap::CHK_CFG,
        ssap: service,
        data: octets,
    };
    let mut telegram = [0; MAX_OCTETS];
    let length = answer.emit(&mut telegram).unwrap_or(0);
    let mut fields = Vec::new();
    let mut conversation = Conversation::new(Profile::Auto);
    let mut take = |entry: dissector::Entry| {
        if let Item::Telegram(telegram) = entry.item {
            fields.extend(telegram.fields.into_iter().filter(|field| field.data_octets.is_some()));
        }
    };
    conversation.push(&telegram[..length], &mut take);
    conversation.finish(&mut take);
    fields
}

/// A value in a line; in front its octet, and its bit where it is one: `9.3`, `10-13`.
pub(crate) fn field(field: &Field) -> String {
    let place = field.data_octets.map_or_else(String::new, |[first, last]| match field.bits {
        Some([high, low]) if high == low && first == last => format!("{first}.{high}"),
        _ if first == last => first.to_string(),
        _ => format!("{first}-{last}"),
    });
    let line = format!("{place:>7}  {} = {}  {}", field.name, field.value, field.words);
    line.trim_end().to_owned()
}

/// Octets and their values, a line each.
pub(crate) fn text(octets: &[u8], fields: &[Field]) -> String {
    let mut text = hex(octets);
    for one in fields.iter().filter(|field| !is_silent(field)) {
        let _ = write!(text, "\n{}", field(one));
    }
    text
}

/// Bits that are 0 and say nothing would fill the screen.
pub(crate) fn is_silent(field: &Field) -> bool {
    field.words.is_empty() && field.value == dissector::Value::Bit(false)
}

/// What somebody should know of, and below it what to do.
pub(crate) fn finding(finding: &Finding) -> String {
    let level = finding.level.to_string();
    let mut text = format!("{level:<8} {} ({}): {}", finding.name, finding.place(), finding.text);
    if !finding.advice.is_empty() {
        let _ = write!(text, "\n         -> {}", finding.advice);
    }
    text
}

/// What did not fit at a start-up, in one sentence after the other.
pub(crate) fn differences(differences: &[Difference]) -> String {
    let one = |difference: &Difference| format!("{}; {}", difference.text, difference.advice);
    differences.iter().map(one).collect::<Vec<_>>().join(". ")
}
