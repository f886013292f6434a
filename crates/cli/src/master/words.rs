//! What stations have said, in words.

use std::fmt::Write;

use ::master::light::StationKind;
use dissector::{Conversation, Field, Item, Profile, Value};
use profibus_dp::wire::telegram::MAX_OCTETS;
use profibus_dp::wire::{DataTelegram, FunctionCode, Sap};

pub(super) const SLAVE_DIAG: Sap = Sap::SLAVE_DIAG;
pub(super) const GET_CFG: Sap = Sap::GET_CFG;

/// What a station is.
pub(super) fn kind(kind: StationKind) -> &'static str {
    match kind {
        StationKind::Passive => "slave",
        StationKind::NotReady => "master, not ready for the token",
        StationKind::Ready => "master, ready for the token",
        StationKind::InRing => "master in the token ring",
    }
}

/// Octets as people write them.
pub(super) fn hex(octets: &[u8]) -> String {
    octets.iter().map(|octet| format!("{octet:02X}")).collect::<Vec<_>>().join(" ")
}

/// The values in the answer to a service.
pub(super) fn fields(slave: u8, master: u8, service: Sap, octets: &[u8]) -> Vec<Field> {
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

/// Octets and their values, a line each; in front the octet of the service's data.
pub(super) fn text(octets: &[u8], fields: &[Field]) -> String {
    let mut text = hex(octets);
    // Bits that are 0 and say nothing would fill the screen.
    let silent = |field: &&Field| field.words.is_empty() && field.value == Value::Bit(false);
    for field in fields.iter().filter(|field| !silent(field)) {
        let place = field.data_octets.map_or_else(String::new, |[first, last]| {
            if first == last { first.to_string() } else { format!("{first}-{last}") }
        });
        let line = format!("{place:>7}  {} = {}  {}", field.name, field.value, field.words);
        let _ = write!(text, "\n{}", line.trim_end());
    }
    text
}
