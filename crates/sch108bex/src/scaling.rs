//! From physical counts to scaled positions (manual 4.1.1 to 4.1.3), in exact integers.

use core::num::NonZeroU32;

use crate::functionality::Functionality;
use crate::parameterization::{CodeSequence, Parameters};
use crate::specification::Variant;

/// The scaling in force, with all that a latch needs worked out before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Scaling {
    /// `MUR * 2^(31-n)`, so that one multiplication by twice the counts has the result, floored,
    /// in its upper 32 bits. MUR is at most 2^n, so this is at most 2^31, and twice the counts is
    /// below 2^32.
    factor: u32,
    /// TMR.
    range: NonZeroU32,
    /// `2^(n+m) - 1`.
    mask: u32,
    measuring_units: u32,
    variant: Variant,
    code_sequence: CodeSequence,
    on: bool,
}

impl Scaling {
    /// No scaling: the physical steps, 2^n a revolution and 2^(n+m) in all.
    pub const fn physical(variant: Variant, code_sequence: CodeSequence) -> Self {
        let units = variant.steps_per_revolution();
        Self::with(variant, code_sequence, false, units, variant.total())
    }

    /// Reading: class 1 has the code sequence only, no scaling; the others have what the
    /// parameters say.
    ///
    /// Values outside their range, which [`Parameters::parse`] refuses, count as the nearest in
    /// range.
    pub fn in_force(variant: Variant, functionality: Functionality, parameters: &Parameters) -> Self {
        if functionality == Functionality::Class1 || !parameters.scaling {
            return Self::physical(variant, parameters.code_sequence);
        }
        let units = parameters.measuring_units_per_revolution;
        let range = parameters.total_measuring_range;
        // Not clamp: that panics where its bounds are the wrong way round.
        Self::with(
            variant,
            parameters.code_sequence,
            true,
            units.min(variant.steps_per_revolution()).max(1),
            range.min(variant.total()).max(1),
        )
    }

    const fn with(
        variant: Variant,
        code_sequence: CodeSequence,
        on: bool,
        measuring_units: u32,
        range: u32,
    ) -> Self {
        let shift = 31_u32.wrapping_sub(variant.singleturn_bits() as u32);
        Self {
            factor: measuring_units.wrapping_shl(shift),
            range: match NonZeroU32::new(range) {
                Some(range) => range,
                None => NonZeroU32::MIN,
            },
            mask: variant.total().wrapping_sub(1),
            measuring_units,
            variant,
            code_sequence,
            on,
        }
    }

    /// The variant that it is for.
    pub const fn variant(&self) -> Variant {
        self.variant
    }

    /// The direction in force (octet 9 bit 0 of the diagnosis).
    pub const fn code_sequence(&self) -> CodeSequence {
        self.code_sequence
    }

    /// Whether scaling is in force (octet 9 bit 3 of the diagnosis).
    pub const fn is_on(&self) -> bool {
        self.on
    }

    /// Steps per revolution in force, 1 to 2^n; 2^n while scaling is off (octets 40-43 of the
    /// diagnosis, manual 4.2.16).
    #[doc(alias = "MUR")]
    pub const fn measuring_units_per_revolution(&self) -> u32 {
        self.measuring_units
    }

    /// Steps of the whole range in force, 1 to 2^(n+m); 2^(n+m) while scaling is off (octets
    /// 44-47 of the diagnosis, manual 4.2.17).
    #[doc(alias = "TMR")]
    pub const fn total_measuring_range(&self) -> u32 {
        self.range.get()
    }

    /// The total measuring range as a divisor.
    pub const fn modulus(&self) -> NonZeroU32 {
        self.range
    }

    /// Reading: the position is `(floor(dir(raw) * MUR / 2^n) + offset) mod TMR` in exact
    /// integers, where `dir(raw)` is `raw` clockwise and `(2^(n+m) - raw) mod 2^(n+m)`
    /// counter-clockwise.
    ///
    /// This is the part before the offset, 0 to TMR - 1. Of `raw` only the lower `n + m` bits
    /// count.
    #[inline]
    pub fn position_without_offset(&self, raw: u32) -> u32 {
        let directed = match self.code_sequence {
            CodeSequence::Clockwise => raw,
            CodeSequence::CounterClockwise => raw.wrapping_neg(),
        } & self.mask;
        let product = u64::from(directed << 1).wrapping_mul(u64::from(self.factor));
        let scaled = (product >> 32) as u32;
        // Most often there is nothing to divide.
        if scaled < self.range.get() { scaled } else { scaled % self.range }
    }

    /// Physical counts in the direction in force, no range applied: negated where the code
    /// sequence is counter-clockwise.
    pub const fn directed(&self, physical: i64) -> i64 {
        match self.code_sequence {
            CodeSequence::Clockwise => physical,
            CodeSequence::CounterClockwise => physical.wrapping_neg(),
        }
    }

    /// Scaled steps from the physical zero point, no range applied: floored, negative ones too.
    /// Exact for every number of counts.
    pub const fn unwrapped(&self, physical: i64) -> i64 {
        let directed = self.directed(physical);
        // `directed * factor / 2^31` in two halves, so that 32 bits are multiplied by 32: of the
        // upper one nothing is left over, of the lower one the rest is dropped, which is to floor.
        let factor = self.factor as i64;
        let upper = (directed >> 32).wrapping_mul(factor) << 1;
        let lower = (directed & 0xFFFF_FFFF).cast_unsigned().wrapping_mul(self.factor as u64) >> 31;
        upper.wrapping_add_unsigned(lower)
    }

    /// Reading: it is a plain modulo also where the physical range overflows. There the position
    /// jumps back by so many steps: `(2^m * MUR) mod TMR`; 0 means that it does not jump.
    pub fn overflow_residual(&self) -> u32 {
        let steps = self.measuring_units.wrapping_shl(u32::from(self.variant.multiturn_bits()));
        steps % self.range
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    pub(crate) fn variants() -> impl Strategy<Value = Variant> {
        (2_u8..=16, 0_u8..=15).prop_map(|(n, m)| Variant::new(n, m).unwrap())
    }

    /// Any scaling that Set_Prm may ask for, small and largest values more often than others.
    fn scalings() -> impl Strategy<Value = Scaling> {
        variants().prop_flat_map(|variant| {
            let units = variant.steps_per_revolution();
            let range = variant.total();
            (
                prop_oneof![1..=units, Just(units), Just(1)],
                prop_oneof![1..=range, 1..=range.min(5000), Just(range)],
                any::<bool>(),
            )
                .prop_map(move |(units, range, turned)| {
                    let parameters = Parameters {
                        scaling: true,
                        measuring_units_per_revolution: units,
                        total_measuring_range: range,
                        code_sequence: CodeSequence::from_bit(u8::from(turned)),
                        ..Parameters::default_for(variant)
                    };
                    Scaling::in_force(variant, Functionality::Class2, &parameters)
                })
        })
    }

    /// The formula as it is written, in numbers that cannot overflow.
    fn by_the_book(scaling: &Scaling, raw: u32) -> u32 {
        let total = u128::from(scaling.variant().total());
        let raw = u128::from(raw) % total;
        let directed = match scaling.code_sequence() {
            CodeSequence::Clockwise => raw,
            CodeSequence::CounterClockwise => (total - raw) % total,
        };
        let steps = u128::from(scaling.variant().steps_per_revolution());
        let scaled = directed * u128::from(scaling.measuring_units_per_revolution()) / steps;
        (scaled % u128::from(scaling.total_measuring_range())).try_into().unwrap()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        #[test]
        fn the_position_is_the_formula(scaling in scalings(), raw in any::<u32>()) {
            prop_assert_eq!(scaling.position_without_offset(raw), by_the_book(&scaling, raw));
        }

        #[test]
        fn the_ends_of_the_range_are_the_formula(scaling in scalings(), near in -3_i32..3) {
            let raw = near.cast_unsigned();
            prop_assert_eq!(scaling.position_without_offset(raw), by_the_book(&scaling, raw));
        }

        #[test]
        fn unwrapped_is_floored_and_exact(scaling in scalings(), physical in any::<i64>()) {
            let directed = match scaling.code_sequence() {
                CodeSequence::Clockwise => i128::from(physical),
                CodeSequence::CounterClockwise => -i128::from(physical),
            };
            prop_assume!(i64::try_from(directed).is_ok());
            let product = directed * i128::from(scaling.measuring_units_per_revolution());
            let floored = product.div_euclid(scaling.variant().steps_per_revolution().into());
            prop_assert_eq!(i128::from(scaling.unwrapped(physical)), floored);
        }

        #[test]
        fn the_residual_is_the_jump(scaling in scalings()) {
            let turns = u128::from(scaling.variant().revolutions());
            let steps = turns * u128::from(scaling.measuring_units_per_revolution());
            let residual = steps % u128::from(scaling.total_measuring_range());
            prop_assert_eq!(u128::from(scaling.overflow_residual()), residual);
        }
    }

    // SICK ATM60, examples B1 and B2: floor, then modulo.
    #[test]
    fn floor_comes_before_modulo() {
        let variant = Variant::new(13, 13).unwrap();
        for (units, range, position) in [(4096, 16_777_216, 16_777_215), (2730, 22_364_160, 22_364_159)] {
            let parameters = Parameters {
                scaling: true,
                measuring_units_per_revolution: units,
                total_measuring_range: range,
                ..Parameters::default_for(variant)
            };
            let scaling = Scaling::in_force(variant, Functionality::Scancon2, &parameters);
            assert_eq!(scaling.position_without_offset(67_108_863), position);
            assert!(scaling.is_on());
        }
    }

    #[test]
    fn class_1_and_scaling_off_have_the_physical_steps() {
        let parameters = Parameters {
            scaling: true,
            measuring_units_per_revolution: 100,
            total_measuring_range: 5000,
            code_sequence: CodeSequence::CounterClockwise,
            ..Parameters::default_for(Variant::FULL)
        };
        let off = Parameters { scaling: false, ..parameters };
        let physical = Scaling::physical(Variant::FULL, CodeSequence::CounterClockwise);
        assert_eq!(Scaling::in_force(Variant::FULL, Functionality::Class1, &parameters), physical);
        assert_eq!(Scaling::in_force(Variant::FULL, Functionality::Class2, &off), physical);
        assert_eq!(physical.position_without_offset(1), 0x7FFF_FFFF);
        assert_eq!(physical.measuring_units_per_revolution(), 65_536);
        assert_eq!(physical.total_measuring_range(), 0x8000_0000);
    }
}
