//! Chance that is the same on every computer: whole numbers, and no function of a library.

/// Bits of a character on the line: start, eight of data, parity, stop.
const CHARACTER_BITS: usize = 11;

/// 2^64.
const ALL: f64 = 18_446_744_073_709_551_616.0;

/// A stream of numbers that look like chance (SplitMix64), the same for the same seed for ever.
#[derive(Debug, Clone)]
pub(super) struct Chance(u64);

/// So many of 2^64 numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Share(u64);

/// Which bits of a character flip: for each bit the share of characters in which it or one before
/// it is the first to flip.
#[derive(Debug, Clone)]
pub(super) struct Flips {
    first_by: [Share; CHARACTER_BITS],
    each: Share,
}

impl Chance {
    /// One of many streams of a seed.
    pub(super) fn new(seed: u64, stream: u64) -> Self {
        let mut start = Self(seed);
        Self((0..stream).fold(seed, |_, _| start.next()))
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ (mixed >> 31)
    }

    /// Whether it happens this time. Draws one number, whatever the share.
    pub(super) fn takes(&mut self, share: Share) -> bool {
        share.has(self.next())
    }

    /// Whether so many characters pass as they are. If so, chance goes on after them; if not, it stays
    /// before them.
    pub(super) fn passes(&mut self, count: usize, flips: &Flips, errors: Share) -> bool {
        let mut ahead = self.clone();
        let any_flip = flips.first_by[CHARACTER_BITS - 1];
        for _ in 0..count {
            let (number, error) = (ahead.next(), ahead.takes(errors));
            if any_flip.has(number) || error {
                return false;
            }
        }
        *self = ahead;
        true
    }

    /// The bits of a character that flip, the start bit lowest. One number as long as none does.
    pub(super) fn flips(&mut self, flips: &Flips) -> u16 {
        let number = self.next();
        let Some(first) = flips.first_by.iter().position(|share| share.has(number)) else {
            return 0;
        };
        (first + 1..CHARACTER_BITS)
            .fold(1 << first, |flipped, bit| flipped | u16::from(self.takes(flips.each)) << bit)
    }
}

impl Share {
    /// From a probability of 0 to 1.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "meant: 1 is all of them")]
    pub(super) fn new(share: f64) -> Self {
        Self((share * ALL) as u64)
    }

    /// Whether it never happens.
    pub(super) const fn is_none(self) -> bool {
        self.0 == 0
    }

    fn has(self, number: u64) -> bool {
        number < self.0 || self.0 == u64::MAX
    }
}

impl Flips {
    /// Each bit flips with this probability.
    pub(super) fn new(share: f64) -> Self {
        let mut none_yet = 1.0;
        let first_by = std::array::from_fn(|_| {
            none_yet *= 1.0 - share;
            Share::new(1.0 - none_yet)
        });
        Self { first_by, each: Share::new(share) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // The reference values that the author of SplitMix64 gives for the seed 1234567.
    #[test]
    fn the_numbers_are_those_of_splitmix64() {
        let mut chance = Chance(1_234_567);
        let numbers = [(); 3].map(|()| chance.next());
        assert_eq!(
            numbers,
            [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423]
        );
    }

    #[test]
    fn shares_are_taken_about_as_often_as_they_say() {
        for (share, due) in [(0.0, 0..=0), (0.1, 9_000..=11_000), (1.0, 100_000..=100_000)] {
            let mut chance = Chance::new(7, 1);
            let taken = (0..100_000).filter(|_| chance.takes(Share::new(share))).count();
            assert!(due.contains(&taken), "{share}: {taken}");
        }
    }

    #[test]
    fn each_of_the_eleven_bits_flips_about_as_often_as_it_should() {
        let mut chance = Chance::new(7, 1);
        let flips = Flips::new(0.1);
        let mut counts = [0; CHARACTER_BITS];
        for _ in 0..100_000 {
            let flipped = chance.flips(&flips);
            for (bit, count) in counts.iter_mut().enumerate() {
                *count += (flipped >> bit) & 1;
            }
        }
        assert!(counts.iter().all(|count| (9_000..=11_000).contains(count)), "{counts:?}");
        let all = Flips::new(1.0);
        assert_eq!(chance.flips(&all), 0x7FF);
        assert_eq!(chance.flips(&Flips::new(0.0)), 0);
    }
}
