//! The end cap: station address (manual 3.4) and bus termination (manual 3.3).
//!
//! | switches | effective address |
//! |---|---|
//! | 01h-7Dh (1-125) | that address; Set_Slave_Add changes nothing |
//! | 7Eh (126, at delivery) | the one set over the bus, else 126 |
//! | 00h, 7Fh-FFh | none: the device stays off the bus |

use core::fmt;
use core::str::FromStr;

/// The two hexadecimal rotary switches, X16 the high digit and X1 the low one (manual 3.4).
///
/// Written as two hexadecimal digits, X16 first: `2A` is address 42.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct RotarySwitches(pub u8);

/// The switches are written as two hexadecimal digits and nothing else.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RotarySwitchesError;

/// What the device answers to, from power-on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum EffectiveAddress {
    /// An address for data exchange: 1 to 125.
    Station(u8),
    /// 126: the device can be found, diagnosed and given an address, nothing else.
    Unset,
    /// No address: the device never joins the bus.
    OffBus,
}

/// The two switches of the termination resistors (manual 3.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct TerminationSwitches {
    /// Whether the one is on.
    pub first: bool,
    /// Whether the other is on.
    pub second: bool,
}

/// What the two termination switches make together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Termination {
    /// Both on: right for the first and the last device of a bus.
    On,
    /// Both off: right everywhere between.
    Off,
    /// One on, one off: wrong everywhere.
    Mismatch,
}

/// The address for giving addresses, 126.
pub const DEFAULT_ADDRESS: u8 = 126;

/// Addresses that data exchange is possible at (manual 3.4).
pub const STATION_ADDRESSES: core::ops::RangeInclusive<u8> = 1..=125;

impl RotarySwitches {
    /// As delivered: 7Eh, address 126.
    pub const DELIVERED: Self = Self(0x7E);

    /// The switches with these two digits, each 0 to 15; `None` above.
    pub const fn from_digits(x16: u8, x1: u8) -> Option<Self> {
        if x16 > 0xF || x1 > 0xF { None } else { Some(Self((x16 << 4) | x1)) }
    }

    /// Whether a Set_Slave_Add can change the address: only with the switches at 126.
    pub const fn address_changeable(self) -> bool {
        self.0 == DEFAULT_ADDRESS
    }
}

impl Default for RotarySwitches {
    fn default() -> Self {
        Self::DELIVERED
    }
}

/// Reading: switches 1-125 win; 126 means the stored address, else 126; 0 and 127-255 stay off
/// the bus. To be asked at power-on. A stored address outside 1-125 counts as none.
pub fn effective_address(switches: RotarySwitches, stored: Option<u8>) -> EffectiveAddress {
    match switches.0 {
        DEFAULT_ADDRESS => stored
            .filter(|address| STATION_ADDRESSES.contains(address))
            .map_or(EffectiveAddress::Unset, EffectiveAddress::Station),
        address if STATION_ADDRESSES.contains(&address) => EffectiveAddress::Station(address),
        _ => EffectiveAddress::OffBus,
    }
}

impl EffectiveAddress {
    /// The address that telegrams carry: 1 to 126; `None` off the bus.
    pub const fn octet(self) -> Option<u8> {
        match self {
            Self::Station(address) => Some(address),
            Self::Unset => Some(DEFAULT_ADDRESS),
            Self::OffBus => None,
        }
    }

    /// Whether data exchange is possible: at 1 to 125 only.
    pub const fn data_exchange_possible(self) -> bool {
        matches!(self, Self::Station(_))
    }
}

impl TerminationSwitches {
    /// Both off, as delivered.
    pub const OFF: Self = Self { first: false, second: false };
    /// Both on, for the two ends of the bus.
    pub const ON: Self = Self { first: true, second: true };

    /// What they make together.
    pub const fn termination(self) -> Termination {
        match (self.first, self.second) {
            (true, true) => Termination::On,
            (false, false) => Termination::Off,
            _ => Termination::Mismatch,
        }
    }
}

impl FromStr for RotarySwitches {
    type Err = RotarySwitchesError;

    fn from_str(text: &str) -> Result<Self, RotarySwitchesError> {
        let digit = |character: &u8| char::from(*character).to_digit(16);
        let [high, low] = text.as_bytes() else {
            return Err(RotarySwitchesError);
        };
        let digits = digit(high).zip(digit(low)).ok_or(RotarySwitchesError)?;
        let value = digits.0.wrapping_shl(4) | digits.1;
        u8::try_from(value).map(Self).map_err(|_| RotarySwitchesError)
    }
}

impl fmt::Display for RotarySwitches {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:02X}", self.0)
    }
}

impl fmt::Display for RotarySwitchesError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the rotary switches are two hexadecimal digits, X16 first, like 2A")
    }
}

impl core::error::Error for RotarySwitchesError {}

impl fmt::Display for EffectiveAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Station(address) => write!(f, "address {address}"),
            Self::Unset => f.write_str("address 126, no data exchange until one is set"),
            Self::OffBus => f.write_str("no address, off the bus"),
        }
    }
}

impl fmt::Display for Termination {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::On => "on",
            Self::Off => "off",
            Self::Mismatch => "one switch on, one off",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;

    // Manual 3.4: X16 at 2 and X1 at A is address 42.
    #[test]
    fn x16_is_the_high_digit() {
        let switches = RotarySwitches::from_digits(0x2, 0xA).unwrap();
        assert_eq!(switches, RotarySwitches(42));
        assert_eq!("2A".parse(), Ok(switches));
        assert_eq!("2a".parse(), Ok(switches));
        assert_eq!(switches.to_string(), "2A");
        assert_eq!(RotarySwitches(5).to_string(), "05");
        assert_eq!(RotarySwitches::from_digits(0x10, 0), None);
        assert_eq!(RotarySwitches::from_digits(0, 0x10), None);
        for text in ["", "2", "02A", "+2", "2G", "0x2A", "é"] {
            assert_eq!(text.parse::<RotarySwitches>(), Err(RotarySwitchesError), "{text}");
        }
    }

    #[test]
    fn every_position_of_the_switches() {
        use EffectiveAddress::{OffBus, Station, Unset};
        for value in 0..=u8::MAX {
            let switches = RotarySwitches(value);
            let (without, with) = match value {
                1..=125 => (Station(value), Station(value)),
                126 => (Unset, Station(7)),
                _ => (OffBus, OffBus),
            };
            assert_eq!(effective_address(switches, None), without);
            assert_eq!(effective_address(switches, Some(7)), with);
            assert_eq!(switches.address_changeable(), value == 126);
            assert_eq!(with.data_exchange_possible(), matches!(with, Station(_)));
        }
    }

    #[test]
    fn a_stored_address_out_of_range_counts_as_none() {
        for stored in [0, 126, 127, 255] {
            let address = effective_address(RotarySwitches::DELIVERED, Some(stored));
            assert_eq!(address, EffectiveAddress::Unset);
            assert_eq!(address.octet(), Some(126));
            assert!(!address.data_exchange_possible());
        }
        assert_eq!(EffectiveAddress::OffBus.octet(), None);
        assert_eq!(EffectiveAddress::Station(125).octet(), Some(125));
    }

    #[test]
    fn both_termination_switches_must_be_alike() {
        assert_eq!(TerminationSwitches::ON.termination(), Termination::On);
        assert_eq!(TerminationSwitches::OFF.termination(), Termination::Off);
        assert_eq!(TerminationSwitches::default(), TerminationSwitches::OFF);
        for (first, second) in [(true, false), (false, true)] {
            let switches = TerminationSwitches { first, second };
            assert_eq!(switches.termination(), Termination::Mismatch);
        }
    }
}
