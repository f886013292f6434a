//! The preset (manual 4.3.2) and the offset value that it leaves (manual 4.2.14).
//!
//! | output octets 1-4, bit | meaning |
//! |---|---|
//! | 31 | preset the position when this bit goes to 1 |
//! | 0-30 | preset value, 0 to total measuring range - 1 |

use core::num::NonZeroU32;

use crate::refusal::PresetRefusal;
use crate::scaling::Scaling;

/// Output octets 1-4, bit 31: preset the position.
pub const PRESET_BIT: u32 = 0x8000_0000;

/// Reading: the offset value is `value - (floor(dir(raw) * MUR / 2^n) mod TMR)`, signed and not
/// reduced, so below TMR in size.
///
/// # Errors
///
/// Reading "Preset": a value above TMR - 1 is ignored; it changes nothing and raises no alarm.
pub fn offset_for(value: u32, scaling: &Scaling, raw: u32) -> Result<i32, PresetRefusal> {
    let limit = scaling.total_measuring_range().wrapping_sub(1);
    if value > limit {
        return Err(PresetRefusal { value, limit });
    }
    // Both are below 2^31, so the difference is exact.
    let position = scaling.position_without_offset(raw);
    Ok(value.cast_signed().wrapping_sub(position.cast_signed()))
}

/// Reading: an offset is kept when scaling or direction change, and used modulo the new range: the
/// offset as a latch adds it, 0 to TMR - 1.
pub fn reduced(offset: i32, range: NonZeroU32) -> u32 {
    let size = offset.unsigned_abs() % range;
    if offset < 0 && size != 0 { range.get().wrapping_sub(size) } else { size }
}

/// The position with the offset, 0 to TMR - 1, from the position without and the reduced offset.
#[inline]
pub const fn shifted(position: u32, reduced: u32, range: NonZeroU32) -> u32 {
    // Both are below 2^31, so the sum does not overflow.
    let sum = position.wrapping_add(reduced);
    if sum < range.get() { sum } else { sum.wrapping_sub(range.get()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameterization::CodeSequence;
    use crate::specification::Variant;
    use proptest::prelude::*;

    #[test]
    fn the_offset_is_preset_minus_position() {
        let scaling = Scaling::physical(Variant::FULL, CodeSequence::Clockwise);
        assert_eq!(offset_for(0, &scaling, 1000), Ok(-1000));
        assert_eq!(offset_for(5000, &scaling, 1000), Ok(4000));
        assert_eq!(offset_for(0x7FFF_FFFF, &scaling, 0), Ok(i32::MAX));
        assert_eq!(offset_for(0, &scaling, 0x7FFF_FFFF), Ok(-i32::MAX));
    }

    #[test]
    fn the_highest_preset_is_the_range_minus_1() {
        let variant = Variant::new(4, 0).unwrap();
        let scaling = Scaling::physical(variant, CodeSequence::Clockwise);
        assert_eq!(offset_for(15, &scaling, 3), Ok(12));
        assert_eq!(offset_for(16, &scaling, 3), Err(PresetRefusal { value: 16, limit: 15 }));
    }

    #[test]
    fn a_multiple_of_the_range_shifts_nothing() {
        let range = NonZeroU32::new(1000).unwrap();
        for (offset, expected) in [(0, 0), (-3000, 0), (3000, 0), (-1, 999), (i32::MIN, 352)] {
            assert_eq!(reduced(offset, range), expected, "{offset}");
        }
        assert_eq!(reduced(i32::MIN, NonZeroU32::new(1 << 31).unwrap()), 0);
    }

    proptest! {
        #[test]
        fn shifting_is_adding_modulo_the_range(
            offset in any::<i32>(),
            (range, position) in (1_u32..=1 << 31).prop_flat_map(|range| (Just(range), 0..range)),
        ) {
            let modulus = NonZeroU32::new(range).unwrap();
            let reduced = reduced(offset, modulus);
            prop_assert!(reduced < range);
            let expected = (i64::from(position) + i64::from(offset)).rem_euclid(i64::from(range));
            prop_assert_eq!(i64::from(shifted(position, reduced, modulus)), expected);
        }
    }
}
