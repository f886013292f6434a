//! The non-volatile record: any octets in both slots, and a write that is cut.

use sch108bex::nonvolatile::{Choice, Record, SLOT_OCTETS, Slot, SlotFault, choose};
use sch108bex::specification::Variant;

use crate::tape::Tape;

/// The first octet says whether the check sums are made right, and where the next write is cut; then
/// the octets of both slots.
///
/// # Panics
///
/// When a record is read that would not be written so, when what is damaged counts, or when a cut loses
/// the record before.
pub fn state(octets: &[u8]) {
    let mut tape = Tape::new(octets);
    let choices = tape.octet();
    let cut = usize::from(tape.octet()) % (SLOT_OCTETS + 1);
    let raw = tape.slice(2 * SLOT_OCTETS);
    let (a, b) = raw.split_at(raw.len().min(SLOT_OCTETS));
    let (a, b) = (summed(a, choices & 1 != 0), summed(b, choices & 2 != 0));
    for slot in [&a, &b] {
        decodes_only_what_is_written(slot);
    }
    let before = choose(Record::decode(&a), Record::decode(&b));
    check(&before, &a, &b);
    let Choice::Use { record, sequence, slot, .. } = before else { return };
    // The next record goes to the other slot, and is cut there.
    let next = Record { offset: !record.offset, ..record }.encode(sequence.wrapping_add(1));
    let target = if slot == Slot::A { &b } else { &a };
    let mut torn = if target.len() == SLOT_OCTETS { target.clone() } else { vec![0xFF; SLOT_OCTETS] };
    torn[..cut].copy_from_slice(&next[..cut]);
    let (left, right) = if slot == Slot::A { (&a, &torn) } else { (&torn, &b) };
    let after = choose(Record::decode(left), Record::decode(right));
    let Choice::Use { record: found, .. } = after else { panic!("nothing is left: {after:?}") };
    let due = if torn == next { !record.offset } else { record.offset };
    assert_eq!(found.offset, due, "cut at {cut}");
}

/// The octets with the check sum that makes them count, or as they are.
fn summed(octets: &[u8], sum: bool) -> Vec<u8> {
    let mut octets = octets.to_vec();
    if sum && octets.len() == SLOT_OCTETS {
        octets[..3].copy_from_slice(b"SC\x01");
        let sum = crc_32(&octets[..36]).to_be_bytes();
        octets[36..].copy_from_slice(&sum);
    }
    octets
}

/// By the book, and not the product's.
fn crc_32(octets: &[u8]) -> u32 {
    !octets.iter().fold(u32::MAX, |mut crc, octet| {
        crc ^= u32::from(*octet);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 };
        }
        crc
    })
}

fn decodes_only_what_is_written(octets: &[u8]) {
    match Record::decode(octets) {
        Ok((record, sequence)) => {
            assert_eq!(record.encode(sequence)[..], *octets);
            assert!(record.stored_address.is_none_or(|address| (1..=125).contains(&address)));
            assert!(record.raw.is_none_or(|raw| raw < Variant::FULL.total()));
            assert!(!record.both_slots_damaged);
        }
        Err(fault) => assert!(!fault.to_string().is_empty()),
    }
}

fn check(choice: &Choice, a: &[u8], b: &[u8]) {
    let (one, two) = (Record::decode(a), Record::decode(b));
    match choice {
        Choice::Use { record, sequence, slot, other_damaged } => {
            let (this, other) = if *slot == Slot::A { (one, two) } else { (two, one) };
            assert_eq!(this, Ok((*record, *sequence)));
            assert_eq!(other.err().filter(|fault| *fault != SlotFault::Absent), *other_damaged);
        }
        Choice::AsDelivered => assert!([one, two].iter().all(|slot| *slot == Err(SlotFault::Absent))),
        Choice::Lost { .. } => assert!(one.is_err() && two.is_err()),
    }
}
