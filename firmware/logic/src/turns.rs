//! The turn count in registers that a battery keeps: written at every latch, checked at start.
//!
//! | register | holds |
//! |---|---|
//! | 0, 2 | position with turns, of `n + m` bits |
//! | 1, 3 | the same, inverted, and with [`MARK`] laid over it |
//!
//! Two copies, one written after the other: a cut in one leaves the other, a latch older at most.

use sch108bex::health::Battery;
use sch108bex::nonvolatile::{Choice, Record};

/// Registers that are used.
pub const WORDS: usize = 4;
/// Neither all zeros nor all ones is a copy, and none of another kind.
const MARK: u32 = 0x5C10_8BE0;

/// Below so many millivolts the battery is low.
pub const BATTERY_LOW_MV: i32 = 2_600;
/// Below so many millivolts it keeps nothing that can be relied upon.
pub const BATTERY_EMPTY_MV: i32 = 1_900;

/// The registers for a position.
pub const fn keep(raw: u32) -> [u32; WORDS] {
    let check = !raw ^ MARK;
    [raw, check, raw, check]
}

/// The position that the registers kept; `None` where the battery lost it.
pub fn kept(words: [u32; WORDS]) -> Option<u32> {
    let [a, check_a, b, check_b] = words;
    [(a, check_a), (b, check_b)].into_iter().find(|&(raw, check)| check == !raw ^ MARK).map(|(raw, _)| raw)
}

/// How the battery is by its voltage.
pub const fn battery(millivolts: i32) -> Battery {
    if millivolts < BATTERY_EMPTY_MV {
        Battery::Empty
    } else if millivolts < BATTERY_LOW_MV {
        Battery::Low
    } else {
        Battery::Ok
    }
}

/// What the device starts with: the record with the position that was kept, and the battery.
///
/// Where nothing was kept the turn count is lost, whatever the voltage now: a battery that was
/// changed kept nothing. A device as delivered has no turn count that could be lost.
pub fn start(stored: Choice, kept: Option<u32>, battery: Battery) -> (Choice, Battery) {
    match (stored, kept) {
        (Choice::Use { record, sequence, slot, other_damaged }, Some(raw)) => {
            let record = Record { raw: Some(raw), ..record };
            (Choice::Use { record, sequence, slot, other_damaged }, battery)
        }
        (Choice::Use { .. }, None) => (stored, Battery::Empty),
        (Choice::AsDelivered | Choice::Lost { .. }, _) if battery == Battery::Empty => (stored, Battery::Low),
        (Choice::AsDelivered | Choice::Lost { .. }, _) => (stored, battery),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sch108bex::nonvolatile::Slot;
    use sch108bex::specification::Variant;

    #[test]
    fn what_was_kept_is_found_and_nothing_else() {
        for raw in [0, 1, 0x1234_5678, 0x1FFF_FFFF, u32::MAX] {
            let words = keep(raw);
            assert_eq!(kept(words), Some(raw));
            for word in 0..WORDS {
                for bit in 0..32 {
                    let mut changed = words;
                    changed[word] ^= 1 << bit;
                    assert_eq!(kept(changed), Some(raw), "one copy is left");
                    changed[(word + 2) % WORDS] ^= 2;
                    assert_eq!(kept(changed), None, "{changed:08X?}");
                }
            }
        }
        assert_eq!(kept([0; WORDS]), None, "an empty battery");
        assert_eq!(kept([u32::MAX; WORDS]), None);
    }

    #[test]
    fn a_cut_between_two_registers_leaves_the_one_or_the_other_position() {
        let (before, after) = (keep(1000), keep(1001));
        for written in 0..=WORDS {
            let mut words = before;
            words[..written].copy_from_slice(&after[..written]);
            let found = kept(words).expect("one copy is whole");
            assert!((1000..=1001).contains(&found));
            assert_eq!(found == 1001, written >= 2, "{written} written");
        }
    }

    #[test]
    fn without_what_was_kept_the_turn_count_is_lost() {
        let record = Record { raw: Some(5), ..Record::as_delivered(Variant::FULL) };
        let stored = Choice::Use { record, sequence: 7, slot: Slot::A, other_damaged: None };
        let (choice, battery) = start(stored, Some(99), Battery::Low);
        assert_eq!(battery, Battery::Low);
        let Choice::Use { record, sequence: 7, slot: Slot::A, other_damaged: None } = choice else {
            panic!("{choice:?}")
        };
        assert_eq!(record.raw, Some(99));
        assert_eq!(start(stored, None, Battery::Ok), (stored, Battery::Empty), "a new battery kept nothing");
        assert_eq!(start(Choice::AsDelivered, None, Battery::Ok), (Choice::AsDelivered, Battery::Ok));
        assert_eq!(start(Choice::AsDelivered, None, Battery::Empty), (Choice::AsDelivered, Battery::Low));
    }

    #[test]
    fn the_battery_is_judged_by_its_voltage() {
        let expected = [(3_000, Battery::Ok), (2_600, Battery::Ok), (2_599, Battery::Low)];
        for (millivolts, expected) in
            expected.into_iter().chain([(1_900, Battery::Low), (1_899, Battery::Empty)])
        {
            assert_eq!(battery(millivolts), expected, "{millivolts}");
        }
    }
}
