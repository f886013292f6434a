//! Some of the ten rates.

use std::fmt;

use profibus_dp::time::Baudrate;

/// A set of rates. Prints them in bits per second, slowest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Rates(u16);

impl Rates {
    /// Whether no rate is in it.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether `rate` is in it.
    pub const fn contains(self, rate: Baudrate) -> bool {
        self.0 & bit(rate) != 0
    }

    /// The rates that are in it, slowest first.
    pub fn iter(self) -> impl DoubleEndedIterator<Item = Baudrate> {
        Baudrate::ALL.into_iter().filter(move |rate| self.contains(*rate))
    }

    /// The rates that are not in it.
    #[must_use]
    pub fn others(self) -> Self {
        Baudrate::ALL.into_iter().filter(|rate| !self.contains(*rate)).collect()
    }
}

const fn bit(rate: Baudrate) -> u16 {
    1 << rate as u16
}

impl FromIterator<Baudrate> for Rates {
    fn from_iter<T: IntoIterator<Item = Baudrate>>(rates: T) -> Self {
        Self(rates.into_iter().fold(0, |set, rate| set | bit(rate)))
    }
}

impl fmt::Display for Rates {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (at, rate) in self.iter().enumerate() {
            let comma = if at == 0 { "" } else { ", " };
            write!(f, "{comma}{}", rate.bits_per_second())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_in_it_or_not() {
        let some: Rates = [Baudrate::B12000000, Baudrate::B9600].into_iter().collect();
        assert_eq!(some.to_string(), "9600, 12000000");
        assert!(some.contains(Baudrate::B9600) && !some.contains(Baudrate::B19200) && !some.is_empty());
        assert_eq!(some.others().iter().count(), 8);
        assert_eq!(some.iter().next_back(), Some(Baudrate::B12000000));
        assert!(Rates::default().is_empty());
    }
}
