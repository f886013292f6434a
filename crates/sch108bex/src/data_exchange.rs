//! The input octets of Data_Exchange (manual 4.3).
//!
//! | octet | name | sent in |
//! |---|---|---|
//! | 1-4 | position, unsigned | all |
//! | 5-8 | velocity, signed | Scancon 2.0 |
//! | 9-12 | acceleration, signed | Scancon 2.0 |
//!
//! The output octets are in [`crate::preset`].

/// The input octets as the next answer has them, big endian, and their sums for the frame check.
///
/// A latch prepares it; an answer only copies it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct InputImage {
    /// Input octets 1-12; class 1 and class 2 send the first four.
    pub octets: [u8; 12],
    /// The sum of octets 1-4, carries dropped.
    pub sum_4: u8,
    /// The sum of octets 1-12, carries dropped.
    pub sum_12: u8,
}

impl InputImage {
    /// The image of these values.
    pub fn new(position: u32, velocity: i32, acceleration: i32) -> Self {
        let mut image = Self::default();
        image.set_motion(velocity, acceleration);
        image.set_position(position);
        image
    }

    /// Octets 1-4, in scaled steps.
    #[inline]
    pub fn set_position(&mut self, position: u32) {
        let [a, b, c, d, ..] = &mut self.octets;
        [*a, *b, *c, *d] = position.to_be_bytes();
        let sum = sum(pairs(position));
        let motion = self.sum_12.wrapping_sub(self.sum_4);
        self.sum_4 = sum;
        self.sum_12 = sum.wrapping_add(motion);
    }

    /// Octets 5-12, in the unit of the time base.
    pub fn set_motion(&mut self, velocity: i32, acceleration: i32) {
        let [_, _, _, _, v3, v2, v1, v0, a3, a2, a1, a0] = &mut self.octets;
        [*v3, *v2, *v1, *v0] = velocity.to_be_bytes();
        [*a3, *a2, *a1, *a0] = acceleration.to_be_bytes();
        let motion = pairs(velocity.cast_unsigned()).wrapping_add(pairs(acceleration.cast_unsigned()));
        self.sum_12 = self.sum_4.wrapping_add(sum(motion));
    }

    /// Octets 1-4 as a number.
    pub const fn position(&self) -> u32 {
        let [a, b, c, d, ..] = self.octets;
        u32::from_be_bytes([a, b, c, d])
    }

    /// Octets 5-8 as a number.
    pub const fn velocity(&self) -> i32 {
        let [_, _, _, _, a, b, c, d, ..] = self.octets;
        i32::from_be_bytes([a, b, c, d])
    }

    /// Octets 9-12 as a number.
    pub const fn acceleration(&self) -> i32 {
        let [.., a, b, c, d] = self.octets;
        i32::from_be_bytes([a, b, c, d])
    }
}

/// Octets 2 and 4 plus octets 1 and 3 of a number, side by side.
#[inline]
const fn pairs(number: u32) -> u32 {
    (number & 0x00FF_00FF).wrapping_add((number >> 8) & 0x00FF_00FF)
}

/// The sum of both sides, carries dropped.
#[inline]
const fn sum(pairs: u32) -> u8 {
    let [.., sum] = pairs.wrapping_add(pairs >> 16).to_be_bytes();
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    // Manual 4.3.3: big endian, velocity and acceleration signed.
    #[test]
    fn the_octets_are_big_endian_and_signed() {
        let image = InputImage::new(40_960, -20_480, 1_000);
        let octets = [0, 0, 0xA0, 0, 0xFF, 0xFF, 0xB0, 0, 0, 0, 0x03, 0xE8];
        assert_eq!(image.octets, octets);
        assert_eq!((image.position(), image.velocity()), (40_960, -20_480));
        assert_eq!(image.acceleration(), 1_000);
    }

    proptest! {
        #[test]
        fn the_sums_are_those_of_the_octets(
            values in prop::collection::vec((any::<u32>(), any::<i32>(), any::<i32>(), any::<bool>()), 1..20),
        ) {
            let mut image = InputImage::default();
            for (position, velocity, acceleration, moved) in values {
                if moved {
                    image.set_motion(velocity, acceleration);
                }
                image.set_position(position);
                let sum = |octets: &[u8]| octets.iter().fold(0, |sum: u8, o| sum.wrapping_add(*o));
                prop_assert_eq!(image.sum_4, sum(&image.octets[..4]));
                prop_assert_eq!(image.sum_12, sum(&image.octets));
            }
        }
    }
}
