//! The identifier octets by which Chk_Cfg chooses a functionality (manual 4, 4.3).
//!
//! | functionality | identifiers | input, output octets |
//! |---|---|---|
//! | class 1 | D1 | 4, 0 |
//! | class 2 | F1 | 4, 4 |
//! | Scancon 2.0 | F1 D1 D1 or F1 D3 | 12, 4 |
//!
//! The maker's own octets for Scancon 2.0 are not public, so a user's GSD may bring others.

use core::fmt;

use profibus_dp::wire::chk_cfg::Lengths;

use crate::functionality::Functionality;

/// The most identifier octets of one configuration.
pub const MOST_OCTETS: usize = 8;
/// The most configurations that a device offers.
const MOST: usize = 6;

/// The identifier octets of one configuration, 1 to 8.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Identifiers {
    length: u8,
    octets: [u8; MOST_OCTETS],
}

/// The configurations that a device offers, and what they choose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Configurations {
    offered: [Option<(Functionality, Identifiers)>; MOST],
}

/// Why a configuration cannot be offered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OfferError {
    /// It has no octets or more than eight.
    Octets(usize),
    /// It asks for other numbers of octets than the functionality has.
    Lengths {
        /// What it asks for; `None` if it is malformed.
        asked: Option<Lengths>,
        /// What would be right.
        functionality: Functionality,
    },
    /// The same octets choose another functionality already.
    Ambiguous(Functionality),
    /// There are six already.
    TooMany,
}

impl Identifiers {
    /// These octets; `None` if there are none or more than eight.
    pub fn new(octets: &[u8]) -> Option<Self> {
        let mut identifiers = Self { length: u8::try_from(octets.len()).ok()?, octets: [0; MOST_OCTETS] };
        if octets.is_empty() || octets.len() > MOST_OCTETS {
            return None;
        }
        for (place, octet) in identifiers.octets.iter_mut().zip(octets) {
            *place = *octet;
        }
        Some(identifiers)
    }

    /// The octets.
    pub fn as_slice(&self) -> &[u8] {
        self.octets.get(..usize::from(self.length)).unwrap_or(&self.octets)
    }
}

/// A configuration of the table above: worked out when this is compiled.
const fn listed(functionality: Functionality, number: usize) -> Option<(Functionality, Identifiers)> {
    let octets = match (number, functionality.configurations()) {
        (0, [octets, ..]) | (1, [_, octets, ..]) => *octets,
        _ => return None,
    };
    let (length, octets) = match *octets {
        [a] => (1, [a, 0, 0, 0, 0, 0, 0, 0]),
        [a, b] => (2, [a, b, 0, 0, 0, 0, 0, 0]),
        [a, b, c] => (3, [a, b, c, 0, 0, 0, 0, 0]),
        _ => return None,
    };
    Some((functionality, Identifiers { length, octets }))
}

impl Default for Configurations {
    fn default() -> Self {
        Self::DELIVERED
    }
}

impl Configurations {
    /// Reading: those of the table above.
    pub(crate) const DELIVERED: Self = Self {
        offered: [
            listed(Functionality::Class1, 0),
            listed(Functionality::Class2, 0),
            listed(Functionality::Scancon2, 0),
            listed(Functionality::Scancon2, 1),
            None,
            None,
        ],
    };

    /// Offers these octets, and none of those before, for a functionality. Further ones for the
    /// same are [`offer`](Self::offer)ed.
    ///
    /// # Errors
    ///
    /// As with [`offer`](Self::offer); then nothing has changed.
    pub fn replace(&mut self, functionality: Functionality, octets: &[u8]) -> Result<(), OfferError> {
        let mut changed = *self;
        for place in &mut changed.offered {
            if place.is_some_and(|(other, _)| other == functionality) {
                *place = None;
            }
        }
        changed.offer(functionality, octets)?;
        *self = changed;
        Ok(())
    }

    /// Offers these octets for a functionality, too.
    ///
    /// # Errors
    ///
    /// [`OfferError`]
    pub fn offer(&mut self, functionality: Functionality, octets: &[u8]) -> Result<(), OfferError> {
        let identifiers = Identifiers::new(octets).ok_or(OfferError::Octets(octets.len()))?;
        let asked = Lengths::of(octets);
        if asked != Some(functionality.lengths()) {
            return Err(OfferError::Lengths { asked, functionality });
        }
        if let Some((other, _)) = self.find(octets) {
            return if other == functionality { Ok(()) } else { Err(OfferError::Ambiguous(other)) };
        }
        let free = self.offered.iter_mut().find(|place| place.is_none()).ok_or(OfferError::TooMany)?;
        *free = Some((functionality, identifiers));
        Ok(())
    }

    /// Reading: Chk_Cfg decides. What these octets choose; `None` if nothing.
    pub fn find(&self, octets: &[u8]) -> Option<(Functionality, Identifiers)> {
        self.offered.iter().flatten().find(|(_, own)| own.as_slice() == octets).copied()
    }

    /// The configuration that Get_Cfg names for a functionality.
    pub fn first(&self, functionality: Functionality) -> &[u8] {
        let own = self.offered.iter().flatten().find(|(other, _)| *other == functionality);
        own.map_or(functionality.configuration(), |(_, identifiers)| identifiers.as_slice())
    }
}

impl fmt::Debug for Identifiers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:02X?}", self.as_slice())
    }
}

impl fmt::Display for OfferError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Octets(count) => {
                write!(f, "{count} identifier octets, but there must be 1 to {MOST_OCTETS}")
            }
            Self::Lengths { asked: None, .. } => f.write_str("the identifier octets are malformed"),
            Self::Lengths { asked: Some(asked), functionality } => {
                let due = functionality.lengths();
                write!(
                    f,
                    "{} input and {} output octets, but {functionality} has {} and {} (manual 4.3)",
                    asked.inputs, asked.outputs, due.inputs, due.outputs
                )
            }
            Self::Ambiguous(other) => write!(f, "the same identifier octets choose {other} already"),
            Self::TooMany => write!(f, "more than {MOST} configurations"),
        }
    }
}

impl core::error::Error for OfferError {}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;

    #[test]
    fn all_of_the_table_are_offered_and_nothing_else() {
        let mut offered = Configurations { offered: [None; MOST] };
        for functionality in Functionality::ALL {
            for octets in functionality.configurations() {
                offered.offer(functionality, octets).expect("it fits");
            }
        }
        assert_eq!(Configurations::default(), offered);
    }

    #[test]
    fn the_four_of_the_table_are_offered() {
        let offered = Configurations::default();
        let chosen = |octets: &[u8]| offered.find(octets).map(|(functionality, _)| functionality);
        assert_eq!(chosen(&[0xD1]), Some(Functionality::Class1));
        assert_eq!(chosen(&[0xF1]), Some(Functionality::Class2));
        assert_eq!(chosen(&[0xF1, 0xD1, 0xD1]), Some(Functionality::Scancon2));
        assert_eq!(chosen(&[0xF1, 0xD3]), Some(Functionality::Scancon2));
        assert_eq!(offered.offered.iter().flatten().count(), 4);
        for octets in [&[0xF0][..], &[0xF1, 0xD1], &[0xD1, 0xF1], &[], &[0xF1, 0xD1, 0xD1, 0x00]] {
            assert_eq!(chosen(octets), None, "{octets:02X?}");
        }
        assert_eq!(offered.first(Functionality::Scancon2), [0xF1, 0xD1, 0xD1]);
    }

    // F1 DB: 4 octets both ways, then 12 words in; E1 D5: 4 out, 12 in.
    #[test]
    fn a_gsd_may_bring_others() {
        let mut offered = Configurations::default();
        assert_eq!(offered.replace(Functionality::Scancon2, &[0xE1, 0xD5]), Ok(()));
        assert_eq!(offered.find(&[0xF1, 0xD3]), None);
        assert_eq!(offered.first(Functionality::Scancon2), [0xE1, 0xD5]);
        assert_eq!(offered.first(Functionality::Class1), [0xD1]);
        assert_eq!(offered.offer(Functionality::Scancon2, &[0xF1, 0xD3]), Ok(()));
        assert!(offered.find(&[0xF1, 0xD3]).is_some());
    }

    #[test]
    fn what_cannot_be_offered_says_why_and_changes_nothing() {
        let mut offered = Configurations::default();
        let before = offered;
        assert_eq!(offered.replace(Functionality::Class1, &[]), Err(OfferError::Octets(0)));
        assert_eq!(offered.replace(Functionality::Class1, &[0x10; 9]), Err(OfferError::Octets(9)));
        let error = offered.replace(Functionality::Class2, &[0xD1]).expect_err("no outputs");
        assert_eq!(error.to_string(), "4 input and 0 output octets, but class 2 has 4 and 4 (manual 4.3)");
        assert!(matches!(
            offered.replace(Functionality::Class2, &[0x40]),
            Err(OfferError::Lengths { asked: None, .. })
        ));
        assert_eq!(offered, before);
        // Eight inputs of a word each way make no difference to the lengths.
        for octets in [&[0x93][..], &[0x91, 0x91], &[0x90; 4]] {
            let _ = offered.offer(Functionality::Class1, octets);
        }
        assert_eq!(offered.offer(Functionality::Class1, &[0x51, 0x00]), Err(OfferError::TooMany));
    }
}
