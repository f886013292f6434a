use super::*;
use proptest::prelude::*;

const RECORD: Record = Record {
    stored_address: Some(42),
    offset: -408_600,
    offset_scaling: OffsetScaling {
        measuring_units_per_revolution: 4096,
        total_measuring_range: 0x0800_0000,
        code_sequence: CodeSequence::CounterClockwise,
    },
    operating_time_ms: 0x0102_0304_0506,
    position_error: true,
    turn_base: -2,
    raw: Some(0x1234_5678),
    both_slots_damaged: false,
};

// By hand from the table above; the checksum by `zlib.crc32` of Python.
const OCTETS: [u8; 40] = [
    b'S', b'C', 1, 3, 0, 0, 0, 7, 42, 0, // 1-10
    1, 2, 3, 4, 5, 6, 0xFF, 0xF9, 0xC3, 0xE8, // 11-20
    0, 0, 0x10, 0, 8, 0, 0, 0, 0xFF, 0xFF, 0xFF, 0xFE, // 21-32
    0x12, 0x34, 0x56, 0x78, 0x0D, 0xD9, 0xA0, 0x2F, // 33-40
];

#[test]
fn the_octets_of_the_table_both_ways() {
    assert_eq!(RECORD.encode(7), OCTETS);
    assert_eq!(Record::decode(&OCTETS), Ok((RECORD, 7)));
}

// The check value of CRC-32 as every description of it has it.
#[test]
fn the_checksum_is_crc_32() {
    assert_eq!(crc_32(b"123456789".iter()), 0xCBF4_3926);
}

#[test]
fn what_was_never_written_is_absent_and_what_is_cut_has_a_wrong_size() {
    assert_eq!(Record::decode(&[]), Err(SlotFault::Absent));
    assert_eq!(Record::decode(&[0xFF; 40]), Err(SlotFault::Absent));
    assert_eq!(Record::decode(&[0xFF; 39]), Err(SlotFault::Size));
    assert_eq!(Record::decode(&OCTETS[..39]), Err(SlotFault::Size));
    assert_eq!(Record::decode(&[0; 40]), Err(SlotFault::Foreign));
}

/// The octets with another value in one place, and the checksum for it.
fn with(number: u8, value: u8) -> SlotContent {
    let mut octets = OCTETS;
    put(&mut octets, number, [value]);
    let checksum = crc_32(octets.iter().take(36));
    put(&mut octets, 37, checksum.to_be_bytes());
    Record::decode(&octets)
}

#[test]
fn values_that_are_never_written_are_refused() {
    assert!(with(9, 125).is_ok());
    assert_eq!(with(3, 2), Err(SlotFault::Version));
    for (number, value) in [(4, 4), (9, 126), (10, 1), (21, 1), (25, 0x81), (33, 0x80)] {
        assert_eq!(with(number, value), Err(SlotFault::Content), "octet {number}");
    }
    assert_eq!(with(23, 0), Err(SlotFault::Content), "0 measuring units");
    assert_eq!(with(25, 0), Err(SlotFault::Content), "range 0");
}

fn used(choice: Choice) -> (u32, Slot, Option<SlotFault>) {
    match choice {
        Choice::Use { sequence, slot, other_damaged, .. } => (sequence, slot, other_damaged),
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_newer_slot_counts() {
    let slot = |sequence| Ok((RECORD, sequence));
    assert_eq!(used(choose(slot(1), slot(2))), (2, Slot::B, None));
    assert_eq!(used(choose(slot(3), slot(2))), (3, Slot::A, None));
    assert_eq!(used(choose(slot(u32::MAX), slot(0))), (0, Slot::B, None));
    assert_eq!(used(choose(slot(0), slot(u32::MAX))), (0, Slot::A, None));
    assert_eq!(Slot::A.other(), Slot::B);
    assert_eq!(Slot::B.other(), Slot::A);
}

#[test]
fn one_damaged_slot_is_told_and_two_are_an_error() {
    let good = Ok((RECORD, 9));
    let bad = Err(SlotFault::Checksum);
    let absent = Err(SlotFault::Absent);
    let told = Some(SlotFault::Checksum);
    assert_eq!(used(choose(good, bad)), (9, Slot::A, told));
    assert_eq!(used(choose(bad, good)), (9, Slot::B, told));
    assert_eq!(used(choose(good, absent)), (9, Slot::A, None));
    assert_eq!(used(choose(absent, good)), (9, Slot::B, None));
    assert_eq!(choose(absent, absent), Choice::AsDelivered);
    for (a, b) in [(bad, bad), (bad, absent), (absent, bad)] {
        let lost = Choice::Lost { a: a.unwrap_err(), b: b.unwrap_err() };
        assert_eq!(choose(a, b), lost);
    }
}

fn records() -> impl Strategy<Value = Record> {
    let scaling = (1_u32..=65_536, 1_u32..=1 << 31, any::<bool>());
    let raw = prop::option::of(0_u32..1 << 31);
    let rest = (any::<i32>(), 0..=OPERATING_TIME_MAX_MS, any::<bool>(), any::<i32>(), raw);
    (prop::option::of(1_u8..=125), scaling, rest).prop_map(|(address, scaling, rest)| Record {
        stored_address: address,
        offset: rest.0,
        offset_scaling: OffsetScaling {
            measuring_units_per_revolution: scaling.0,
            total_measuring_range: scaling.1,
            code_sequence: CodeSequence::from_bit(scaling.2.into()),
        },
        operating_time_ms: rest.1,
        position_error: rest.2,
        turn_base: rest.3,
        raw: rest.4,
        both_slots_damaged: false,
    })
}

proptest! {
    #[test]
    fn decode_undoes_encode(record in records(), sequence: u32) {
        prop_assert_eq!(Record::decode(&record.encode(sequence)), Ok((record, sequence)));
    }

    #[test]
    fn one_to_three_wrong_bits_are_found(
        record in records(),
        bits in prop::collection::hash_set(0_usize..320, 1..=3),
    ) {
        let mut octets = record.encode(1);
        for bit in bits {
            octets[bit / 8] ^= 1 << (bit % 8);
        }
        prop_assert!(Record::decode(&octets).is_err());
    }

    #[test]
    fn any_octets_are_a_record_only_with_its_checksum(
        octets in prop::collection::vec(any::<u8>(), 0..80),
    ) {
        let decoded = Record::decode(&octets);
        prop_assert!(decoded.is_err() || decoded.unwrap().0.encode(decoded.unwrap().1)[..] == octets);
    }
}

#[test]
fn every_single_and_double_bit_is_found() {
    for first in 0..320_usize {
        for second in first..320 {
            let mut octets = OCTETS;
            octets[first / 8] ^= 1 << (first % 8);
            if second != first {
                octets[second / 8] ^= 1 << (second % 8);
            }
            assert!(Record::decode(&octets).is_err(), "{first} {second}");
        }
    }
}
