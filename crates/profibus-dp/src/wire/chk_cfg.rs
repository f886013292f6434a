//! Chk_Cfg (SAP 62) and Get_Cfg (SAP 59): identifier octets.
//!
//! General format (bits 5, 4 not 00): bit 7 consistency over all, bit 6 words instead of octets,
//! bits 5..4 01 input, 10 output, 11 both; bits 3..0 number of units - 1.
//!
//! Special format (bits 5, 4 = 00): bits 7..6 how many length octets follow (01 inputs, 10
//! outputs, 11 outputs then inputs), bits 3..0 number of the maker's octets behind them
//! (15: none). Length octet: bit 7 consistency, bit 6 words, bits 5..0 number of units - 1.

/// The number of octets exchanged, seen from the master.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Lengths {
    /// Slave to master, 0 to 244.
    pub inputs: u8,
    /// Master to slave, 0 to 244.
    pub outputs: u8,
}

/// The most input or output octets that a configuration may have.
pub const MAX_LENGTH: u8 = 244;

impl Lengths {
    /// Adds up what identifier octets ask for.
    ///
    /// `None` where the octets are malformed (length or maker's octets missing) or either
    /// direction has more than 244 octets.
    pub fn of(mut identifiers: &[u8]) -> Option<Self> {
        let (mut inputs, mut outputs) = (0u16, 0u16);
        while let Some((&identifier, mut rest)) = identifiers.split_first() {
            let units = u16::from(identifier & 0x0F).wrapping_add(1);
            let octets = if identifier & 0x40 == 0 { units } else { units.wrapping_mul(2) };
            match identifier & 0x30 {
                0x10 => inputs = inputs.checked_add(octets)?,
                0x20 => outputs = outputs.checked_add(octets)?,
                0x30 => {
                    inputs = inputs.checked_add(octets)?;
                    outputs = outputs.checked_add(octets)?;
                }
                _ => {
                    if identifier & 0x80 != 0 {
                        outputs = outputs.checked_add(take_length(&mut rest)?)?;
                    }
                    if identifier & 0x40 != 0 {
                        inputs = inputs.checked_add(take_length(&mut rest)?)?;
                    }
                    let makers = usize::from(identifier & 0x0F);
                    if makers != 15 {
                        rest = rest.get(makers..)?;
                    }
                }
            }
            identifiers = rest;
        }
        let bounded = |octets| u8::try_from(octets).ok().filter(|&octets| octets <= MAX_LENGTH);
        Some(Self { inputs: bounded(inputs)?, outputs: bounded(outputs)? })
    }
}

fn take_length(rest: &mut &[u8]) -> Option<u16> {
    let (&length, behind) = rest.split_first()?;
    *rest = behind;
    let units = u16::from(length & 0x3F).wrapping_add(1);
    Some(if length & 0x40 == 0 { units } else { units.wrapping_mul(2) })
}

#[cfg(test)]
mod tests {
    use super::*;

    // DP slave reference, section 6.4.
    #[test]
    fn the_examples_of_the_reference_add_up() {
        let lengths = |octets: &[u8]| Lengths::of(octets).map(|sum| (sum.inputs, sum.outputs));
        assert_eq!(lengths(&[0x10]), Some((1, 0)));
        assert_eq!(lengths(&[0x20]), Some((0, 1)));
        assert_eq!(lengths(&[0xD0]), Some((2, 0)));
        assert_eq!(lengths(&[0xD1]), Some((4, 0)));
        assert_eq!(lengths(&[0xD3]), Some((8, 0)));
        assert_eq!(lengths(&[0xF1]), Some((4, 4)));
        assert_eq!(lengths(&[0xF1, 0xD1, 0xD1]), Some((12, 4)));
        assert_eq!(lengths(&[0x93]), Some((4, 0)));
        assert_eq!(lengths(&[0xC3, 0xCF, 0xC7, 1, 2, 3]), Some((16, 32)));
        assert_eq!(lengths(&[0x00]), Some((0, 0)));
        assert_eq!(lengths(&[0x0F, 0x10]), Some((1, 0)));
    }

    #[test]
    fn malformed_and_oversized_configurations_are_none() {
        assert_eq!(Lengths::of(&[0xC3, 0xCF]), None);
        assert_eq!(Lengths::of(&[0x42, 0x00, 1]), None);
        assert_eq!(Lengths::of(&[0xDF; 8]), None);
        assert_eq!(Lengths::of(&[0xDF; 7]), Some(Lengths { inputs: 224, outputs: 0 }));
    }
}
