//! Power that goes at every octet of every write, whatever was in the memory before: what was
//! confirmed last is there (manual 3.4, 4.2.2, 4.2.13, 4.2.14).

#![allow(clippy::pedantic)] // Test code: casts and names are plain enough here.

mod e2prom;
mod life;

use std::collections::HashMap;

use e2prom::{E2prom, Torn};
use life::{Deed, Kept, Life, RAW, Written};
use profibus_dp::Station;
use sch108bex::diagnostics::Alarms;
use sch108bex::nonvolatile::{Choice, Record, SLOT_OCTETS, Slot};
use sch108bex::specification::Variant;

/// The most operating time that a cut may cost.
const SIX_MINUTES_MS: u64 = 360_000;

const DEEDS: [Deed; 6] = [
    Deed::Address(17),
    Deed::Preset(123_456),
    Deed::Alarm,
    Deed::Run(13),
    Deed::SupplyFalls,
    Deed::OrderlyEnd,
];

/// What lies in the memory, and what a device must find there.
type Content = (E2prom, Kept);

/// Calls `check` with every memory that a cut in a life may leave, with what must be found there
/// and the milliseconds under power until the cut. Says what the life leaves where nothing is cut.
fn cut_everywhere(
    (mut memory, mut confirmed): Content,
    deed: Deed,
    mut check: impl FnMut(E2prom, Kept, u64, &str),
) -> Content {
    for (number, (write, after)) in Life::begin(&memory, confirmed).doing(deed).iter().enumerate() {
        let whole = memory.written(write);
        for done in 0..=SLOT_OCTETS {
            for torn in Torn::ALL {
                let left = memory.cut(write, done, torn);
                let due = if left == whole { *after } else { confirmed };
                let place = format!("{deed:?}, write {number}, {done} octets done, {torn:?}");
                check(left, due, after.powered_ms, &place);
            }
        }
        (memory, confirmed) = (whole, *after);
    }
    (memory, confirmed)
}

/// The device finds it, and says so. What it shows as its time under power is returned.
fn found(memory: &E2prom, due: Kept, powered_ms: u64, place: &str) -> u64 {
    let stored = memory.choice();
    if let Choice::Use { record, .. } = stored {
        assert_eq!(record.position_error, due.alarm, "alarm: {place}");
    }
    let life = Life::begin(memory, due);
    let device = &life.device;
    assert_eq!(device.sensor().alarms(), Alarms::empty(), "{place}");
    assert_eq!(device.encoder().stored_address(), due.address, "address: {place}");
    assert_eq!(device.address(), Some(due.address.unwrap_or(126)), "address: {place}");
    let due = due.after_power_on();
    assert_eq!(device.sensor().offset(), due.offset, "offset: {place}");
    let physical = RAW - (due.turn_base << 16);
    assert_eq!(life.position(), physical + i64::from(due.offset), "position: {place}");
    let shown_ms = match stored {
        Choice::Use { record, .. } => record.operating_time_ms,
        _ => 0,
    };
    assert!(shown_ms <= powered_ms && shown_ms + SIX_MINUTES_MS >= powered_ms, "{shown_ms} ms: {place}");
    shown_ms
}

/// A file of a host: both slots as delivered.
fn new_file() -> E2prom {
    let slot = Record::as_delivered(Variant::FULL).encode(0);
    E2prom([slot, slot].concat().try_into().unwrap())
}

/// Everything that may lie in a memory before a life, by its name.
fn earlier_contents() -> Vec<(&'static str, Content)> {
    let delivered = Kept::AS_DELIVERED;
    let mut memory = E2prom::BLANK;
    let mut writes: Vec<Written> = Vec::new();
    let mut kept = delivered;
    for deed in [Deed::Preset(5_000), Deed::OrderlyEnd] {
        let life = Life::begin(&memory, kept).doing(deed);
        memory = life.iter().fold(memory, |memory, (write, _)| memory.written(write));
        kept = life.last().unwrap().1;
        writes.extend(life);
    }
    let [.., (older, before), (newer, now)] = writes[..] else { panic!("two writes") };
    let damaged = |slot: Slot, damage: fn(&mut [u8])| {
        let mut memory = memory;
        damage(memory.slot_mut(slot));
        memory
    };
    let bit: fn(&mut [u8]) = |slot| slot[17] ^= 0x10;
    let zeros: fn(&mut [u8]) = |slot| slot.fill(0);
    let torn: fn(&mut [u8]) = |slot| slot[20..].fill(0xFF);
    vec![
        ("blank", (E2prom::BLANK, delivered)),
        ("new file", (new_file(), delivered)),
        ("two good", (memory, now)),
        ("newer: one bit", (damaged(newer.slot, bit), before)),
        ("older: one bit", (damaged(older.slot, bit), now)),
        ("newer: zeros", (damaged(newer.slot, zeros), before)),
        ("older: zeros", (damaged(older.slot, zeros), now)),
        ("newer: torn", (damaged(newer.slot, torn), before)),
        ("older: torn", (damaged(older.slot, torn), now)),
    ]
}

#[test]
fn a_cut_at_any_octet_of_any_write_leaves_what_was_confirmed() {
    for (name, content) in earlier_contents() {
        for deed in DEEDS {
            let mut cuts = 0;
            cut_everywhere(content, deed, |left, due, powered_ms, place| {
                found(&left, due, powered_ms, &format!("{name}: {place}"));
                cuts += 1;
            });
            assert!(cuts >= 164, "{name}: {deed:?} writes something");
        }
    }
}

// What one cut leaves is what the next life begins with, and is cut in turn.
#[test]
fn a_cut_after_a_cut_leaves_what_was_confirmed() {
    let mut torn = HashMap::new();
    for (_, content) in earlier_contents() {
        for deed in DEEDS {
            cut_everywhere(content, deed, |left, due, powered_ms, place| {
                let shown_ms = found(&left, due, powered_ms, place);
                torn.insert(left, Kept { powered_ms: shown_ms, ..due });
            });
        }
    }
    let torn: Vec<Content> = torn.into_iter().collect();
    assert!(torn.len() > 1_000, "{}", torn.len());
    for (at, content) in torn.iter().enumerate() {
        // All deeds, each with its share of the contents.
        let deed = DEEDS[at % DEEDS.len()];
        let after = cut_everywhere(*content, deed, |left, due, powered_ms, place| {
            found(&left, due, powered_ms, &format!("after a cut: {place}"));
        });
        found(&after.0, after.1, after.1.powered_ms, "nothing cut");
    }
}

// A memory that nothing was ever confirmed in: the state at delivery, without an alarm.
#[test]
fn a_cut_in_the_very_first_write_leaves_the_state_at_delivery() {
    let mut seen = 0;
    let writes = Life::begin(&E2prom::BLANK, Kept::AS_DELIVERED).doing(Deed::Preset(1));
    for done in 0..SLOT_OCTETS {
        let left = E2prom::BLANK.cut(&writes[0].0, done, Torn::Garbage);
        let life = Life::begin(&left, Kept::AS_DELIVERED);
        assert_eq!(life.device.sensor().alarms(), Alarms::empty(), "{done} octets");
        assert_eq!((life.device.address(), life.device.sensor().offset()), (Some(126), 0));
        seen += usize::from(matches!(left.choice(), Choice::Lost { .. }));
    }
    assert!(seen > 30, "the slot holds something that is no record: {seen}");
}

// So a slot that is damaged later never has a blank one beside it, but for a moment.
#[test]
fn a_blank_memory_gets_both_its_slots_written_at_once() {
    for deed in DEEDS {
        let writes = Life::begin(&E2prom::BLANK, Kept::AS_DELIVERED).doing(deed);
        let [(first, kept), (second, same), ..] = writes[..] else { panic!("{deed:?}: two writes") };
        assert_ne!(first.slot, second.slot, "{deed:?}");
        assert_eq!(kept, same, "{deed:?}: at the same moment");
    }
}

// Damage is not a cut: with a record lost in both slots the alarm comes, whatever is cut then.
#[test]
fn with_both_slots_damaged_the_alarm_comes_after_any_cut() {
    let mut memory = new_file();
    for slot in [Slot::A, Slot::B] {
        memory.slot_mut(slot)[9] ^= 1;
    }
    let writes = Life::begin(&memory, Kept::AS_DELIVERED).doing(Deed::Run(1));
    for done in 0..SLOT_OCTETS {
        let left = memory.cut(&writes[0].0, done, Torn::Garbage);
        let life = Life::begin(&left, Kept::AS_DELIVERED);
        assert_eq!(life.device.sensor().alarms(), Alarms::POSITION_ERROR, "{done} octets");
    }
    // Confirmed, it is an alarm that the next power-on clears.
    let kept = Kept { alarm: true, ..Kept::AS_DELIVERED };
    found(&memory.written(&writes[0].0), kept, 60_000, "whole");
}
