//! Time as the bus counts it.
//!
//! The core owns no clock: every entry point takes `now`. Times on the bus are counted in bit
//! times ([`BitTimes`]) and become nanoseconds by the [`Baudrate`].

use core::fmt;
use core::ops::{Add, AddAssign, Sub};

/// A point in time: nanoseconds since an epoch that the host chooses, power-on or earlier.
///
/// Counts for 584 years; additions past its end stay at the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Instant(u64);

/// A span of time in nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Duration(u64);

impl Instant {
    /// The epoch.
    pub const ZERO: Self = Self(0);
    /// The latest instant there is: "never".
    pub const MAX: Self = Self(u64::MAX);

    /// `nanos` nanoseconds after the epoch.
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// `micros` microseconds after the epoch.
    pub const fn from_micros(micros: u64) -> Self {
        Self(micros.saturating_mul(1_000))
    }

    /// `millis` milliseconds after the epoch.
    pub const fn from_millis(millis: u64) -> Self {
        Self(millis.saturating_mul(1_000_000))
    }

    /// Nanoseconds since the epoch.
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// The time from `earlier` to `self`; zero where `earlier` is the later one.
    pub const fn since(self, earlier: Self) -> Duration {
        Duration(self.0.saturating_sub(earlier.0))
    }
}

impl Duration {
    /// No time at all.
    pub const ZERO: Self = Self(0);

    /// A span of `nanos` nanoseconds.
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// A span of `micros` microseconds.
    pub const fn from_micros(micros: u64) -> Self {
        Self(micros.saturating_mul(1_000))
    }

    /// A span of `millis` milliseconds.
    pub const fn from_millis(millis: u64) -> Self {
        Self(millis.saturating_mul(1_000_000))
    }

    /// A span of `secs` seconds.
    pub const fn from_secs(secs: u64) -> Self {
        Self(secs.saturating_mul(1_000_000_000))
    }

    /// The span in nanoseconds.
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// The whole milliseconds in the span.
    pub const fn as_millis(self) -> u64 {
        self.0 / 1_000_000
    }

    /// How many whole `period`s are in the span; 0 where they are of no length.
    #[inline]
    #[expect(clippy::cast_possible_truncation, reason = "whether anything is cut off is looked at")]
    pub const fn whole(self, period: Self) -> u64 {
        let (span, length) = (self.0 as u32, period.0 as u32);
        if self.0 != span as u64 || period.0 != length as u64 {
            return self.whole_of_long(period);
        }
        // Up to 4 s: one instruction of a Cortex-M4, and not the 70 of 64 bits.
        match span.checked_div(length) {
            Some(whole) => whole as u64,
            None => 0,
        }
    }

    // Not inlined, or both divisions are done and one result is taken.
    #[cold]
    #[inline(never)]
    const fn whole_of_long(self, period: Self) -> u64 {
        match self.0.checked_div(period.0) {
            Some(whole) => whole,
            None => 0,
        }
    }

    /// `self` taken `times` times; stays at the longest span there is.
    #[must_use]
    pub const fn times(self, times: u64) -> Self {
        Self(self.0.saturating_mul(times))
    }
}

impl Add<Duration> for Instant {
    type Output = Self;

    // Wrapping: an overflow is 584 years away, and a saturating addition costs a
    // Cortex-M4 six instructions in every reply.
    fn add(self, span: Duration) -> Self {
        Self(self.0.wrapping_add(span.0))
    }
}

impl AddAssign<Duration> for Instant {
    fn add_assign(&mut self, span: Duration) {
        *self = *self + span;
    }
}

impl Sub<Duration> for Instant {
    type Output = Self;

    fn sub(self, span: Duration) -> Self {
        Self(self.0.saturating_sub(span.0))
    }
}

impl Add for Duration {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self(self.0.saturating_add(other.0))
    }
}

impl From<Duration> for core::time::Duration {
    fn from(span: Duration) -> Self {
        Self::from_nanos(span.0)
    }
}

impl From<core::time::Duration> for Duration {
    fn from(span: core::time::Duration) -> Self {
        Self(u64::try_from(span.as_nanos()).unwrap_or(u64::MAX))
    }
}

/// A number of bit times (Tbit), the unit in which PROFIBUS states its bus times.
#[doc(alias = "Tbit")]
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct BitTimes(pub u32);

impl BitTimes {
    /// One character: start bit, eight data bits, even parity, stop bit.
    pub const CHARACTER: Self = Self(11);
    /// Tsyn: the idle time before every request.
    #[doc(alias = "Tsyn")]
    pub const SYN: Self = Self(33);
    /// min T_SDR after power-on, and the least that a master can set.
    #[doc(alias = "min Tsdr")]
    pub const MIN_TSDR: Self = Self(11);
}

/// The ten rates of PROFIBUS on RS-485, slowest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Baudrate {
    /// 9.6 kbit/s
    B9600,
    /// 19.2 kbit/s
    B19200,
    /// 45.45 kbit/s
    B45450,
    /// 93.75 kbit/s
    B93750,
    /// 187.5 kbit/s
    B187500,
    /// 500 kbit/s
    B500000,
    /// 1.5 Mbit/s
    B1500000,
    /// 3 Mbit/s
    B3000000,
    /// 6 Mbit/s
    B6000000,
    /// 12 Mbit/s
    B12000000,
}

impl Baudrate {
    /// All ten, slowest first.
    pub const ALL: [Self; 10] = [
        Self::B9600,
        Self::B19200,
        Self::B45450,
        Self::B93750,
        Self::B187500,
        Self::B500000,
        Self::B1500000,
        Self::B3000000,
        Self::B6000000,
        Self::B12000000,
    ];

    /// The rate in bits per second.
    pub const fn bits_per_second(self) -> u32 {
        match self {
            Self::B9600 => 9_600,
            Self::B19200 => 19_200,
            Self::B45450 => 45_450,
            Self::B93750 => 93_750,
            Self::B187500 => 187_500,
            Self::B500000 => 500_000,
            Self::B1500000 => 1_500_000,
            Self::B3000000 => 3_000_000,
            Self::B6000000 => 6_000_000,
            Self::B12000000 => 12_000_000,
        }
    }

    /// The rate with exactly so many bits per second; `None` for any other number.
    pub fn from_bits_per_second(bits: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|rate| rate.bits_per_second() == bits)
    }

    /// max T_SDR: the latest start of a slave's answer at this rate.
    #[doc(alias = "max Tsdr")]
    pub const fn max_tsdr(self) -> BitTimes {
        BitTimes(match self {
            Self::B9600 | Self::B19200 | Self::B45450 | Self::B93750 | Self::B187500 => 60,
            Self::B500000 => 100,
            Self::B1500000 => 150,
            Self::B3000000 => 250,
            Self::B6000000 => 450,
            Self::B12000000 => 800,
        })
    }

    /// How long `bits` bit times take at this rate, rounded up to whole nanoseconds.
    pub const fn duration(self, bits: BitTimes) -> Duration {
        // 2^32 bit times are 2^62 of these.
        let nanos = (bits.0 as u64).wrapping_mul(1_000_000_000);
        Duration(nanos.div_ceil(self.bits_per_second() as u64))
    }

    /// The next lower rate; from the lowest back to the highest: the order of the search.
    #[must_use]
    pub const fn next_lower(self) -> Self {
        match self {
            Self::B9600 => Self::B12000000,
            Self::B19200 => Self::B9600,
            Self::B45450 => Self::B19200,
            Self::B93750 => Self::B45450,
            Self::B187500 => Self::B93750,
            Self::B500000 => Self::B187500,
            Self::B1500000 => Self::B500000,
            Self::B3000000 => Self::B1500000,
            Self::B6000000 => Self::B3000000,
            Self::B12000000 => Self::B6000000,
        }
    }
}

impl fmt::Display for Baudrate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::B9600 => "9.6 kbit/s",
            Self::B19200 => "19.2 kbit/s",
            Self::B45450 => "45.45 kbit/s",
            Self::B93750 => "93.75 kbit/s",
            Self::B187500 => "187.5 kbit/s",
            Self::B500000 => "500 kbit/s",
            Self::B1500000 => "1.5 Mbit/s",
            Self::B3000000 => "3 Mbit/s",
            Self::B6000000 => "6 Mbit/s",
            Self::B12000000 => "12 Mbit/s",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // The microseconds are those of the bus time table of the DP slave reference, section 5.1.
    #[expect(clippy::cast_precision_loss, reason = "compared with five digits")]
    #[test]
    fn bus_times_are_those_of_the_table() {
        let micros = |rate: Baudrate, bits| rate.duration(BitTimes(bits)).as_nanos() as f64 / 1e3;
        assert!((micros(Baudrate::B9600, 1) - 104.2).abs() < 0.05);
        assert!((micros(Baudrate::B45450, 60) - 1320.13).abs() < 0.01);
        assert!((micros(Baudrate::B500000, 100) - 200.0).abs() < 0.001);
        assert!((micros(Baudrate::B1500000, 11) - 7.333).abs() < 0.001);
        assert!((micros(Baudrate::B12000000, 800) - 66.67).abs() < 0.01);
    }

    #[test]
    fn the_search_visits_every_rate_from_the_top() {
        let mut rate = Baudrate::B12000000;
        for expected in Baudrate::ALL.into_iter().rev() {
            assert_eq!(rate, expected);
            rate = rate.next_lower();
        }
        assert_eq!(rate, Baudrate::B12000000);
    }

    #[test]
    fn whole_periods_are_counted_in_short_and_long_spans() {
        let second = 1_000_000_000;
        for (span, period, whole) in [
            (0, 5, 0),
            (4, 5, 0),
            (u64::from(u32::MAX), 500_000, 8_589),
            (1 << 32, 500_000, 8_589),
            (600 * second, 500_000, 1_200_000),
            (600 * second, 10 * second, 60),
            (3, 10 * second, 0),
            (u64::MAX, 1, u64::MAX),
            (7, 0, 0),
            (u64::MAX, 0, 0),
        ] {
            assert_eq!(
                Duration::from_nanos(span).whole(Duration::from_nanos(period)),
                whole,
                "{span} / {period}"
            );
        }
    }

    #[test]
    fn only_the_ten_rates_have_a_name() {
        assert_eq!(Baudrate::from_bits_per_second(45_450), Some(Baudrate::B45450));
        assert_eq!(Baudrate::from_bits_per_second(115_200), None);
    }
}
