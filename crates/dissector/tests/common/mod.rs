//! Conversations in hexadecimal text, and their fields.

#![allow(dead_code, reason = "each test file uses its part")]

use dissector::{Conversation, Dissected, Entry, Item, Profile, Value, hex};

/// Every entry of a conversation in hexadecimal text.
pub(crate) fn entries(text: &str, profile: Profile) -> Vec<Entry> {
    let mut entries = Vec::new();
    let mut conversation = Conversation::new(profile);
    conversation.push(&hex::octets(text).expect("hex"), &mut |entry| entries.push(entry));
    conversation.finish(&mut |entry| entries.push(entry));
    entries
}

#[track_caller]
pub(crate) fn telegrams(text: &str, profile: Profile) -> Vec<Dissected> {
    let telegram = |entry: Entry| match entry.item {
        Item::Telegram(telegram) => telegram,
        other => panic!("no telegram: {other:?}"),
    };
    entries(text, profile).into_iter().map(telegram).collect()
}

/// The last telegram of a conversation.
#[track_caller]
pub(crate) fn last(text: &str, profile: Profile) -> Dissected {
    telegrams(text, profile).pop().expect("a telegram")
}

pub(crate) fn summaries(text: &str) -> Vec<String> {
    telegrams(text, Profile::Auto).into_iter().map(|telegram| telegram.summary).collect()
}

/// Octets in the telegram, octets in the data, value and words of a field.
#[track_caller]
pub(crate) fn field(telegram: &Dissected, name: &str) -> ([usize; 2], Option<[usize; 2]>, Value, String) {
    let found: Vec<_> = telegram.fields.iter().filter(|field| field.name == name).collect();
    assert_eq!(found.len(), 1, "{name}: {:#?}", telegram.fields);
    (found[0].octets, found[0].data_octets, found[0].value.clone(), found[0].words.to_string())
}

#[track_caller]
pub(crate) fn number(telegram: &Dissected, name: &str) -> i64 {
    match field(telegram, name).2 {
        Value::Number(number) => number,
        Value::Bit(bit) => i64::from(bit),
        other => panic!("{name} is {other:?}"),
    }
}

pub(crate) const START_SCANCON: &str = "\
    68 1F 1F 68 8B 82 5D 3D 3E 88 01 14 0B 47 11 00 00 0A 00 00 20 00 02 00 00 00 00 00 00 00 00 00 00 00 01 12 16 E5 \
    68 08 08 68 8B 82 7D 3E 3E F1 D1 D1 99 16 E5 ";

/// An SD2 telegram with these octets between the delimiters.
pub(crate) fn framed(body: &str) -> String {
    let body = hex::octets(body).expect("hex");
    let length = u8::try_from(body.len()).expect("short");
    let sum = body.iter().fold(0_u8, |sum, octet| sum.wrapping_add(*octet));
    hex::text(&[&[0x68, length, length, 0x68][..], &body, &[sum, 0x16]].concat())
}
