//! What a USART's status and data registers say of a character.
//!
//! With nine data bits of which one is the parity, 8E1, the data register hands the parity bit out
//! as bit 8. It belongs to no octet.

/// What came.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Received {
    /// An octet.
    Octet(u8),
    /// A character with a parity, framing, noise or overrun error.
    Error,
    /// Nothing.
    Nothing,
}

/// PE, FE, NF, ORE: the same four bits in the older kind (SR) and the newer (ISR).
pub const ERRORS: u32 = 0x0F;
/// RXNE.
pub const FULL: u32 = 0x20;

/// Whether the data register has to be read: that takes an octet and, in the older kind, the errors
/// away. The character before an overrun is there still, but the one after it is lost.
#[inline(always)]
pub const fn is_due(status: u32) -> bool {
    status & (FULL | ERRORS) != 0
}

/// What a status that [is due](is_due) and the data read after it say.
#[inline(always)]
pub const fn received(status: u32, data: u32) -> Received {
    if status & ERRORS != 0 {
        return Received::Error;
    }
    // Bit 8 is the parity bit.
    let [octet, ..] = data.to_le_bytes();
    Received::Octet(octet)
}

/// The divider of the older kind with eight samples a bit: 16 times the mantissa, and eighths.
///
/// `None` where the rate cannot be had within 0.3 %, the most that PROFIBUS allows.
pub const fn divider_of_eight(hertz: u32, rate: u32) -> Option<u32> {
    let eighths = nearest(hertz, rate);
    // Less than one whole is none.
    if eighths < 8 || !is_close(hertz, rate, eighths) {
        return None;
    }
    Some(((eighths & !7) << 1) | (eighths & 7))
}

/// The divider of the newer kind with eight samples a bit: bits 4 to 15 as they are, and the lower
/// four halved.
///
/// `None` where the rate cannot be had within 0.3 %.
pub const fn divider_of_newer(hertz: u32, rate: u32) -> Option<u32> {
    let halves = nearest(hertz.wrapping_mul(2), rate);
    if halves < 16 || halves > 0xFFFF || !is_close(hertz.wrapping_mul(2), rate, halves) {
        return None;
    }
    Some((halves & !15) | ((halves & 15) >> 1))
}

const fn nearest(hertz: u32, rate: u32) -> u32 {
    match hertz.wrapping_add(rate / 2).checked_div(rate) {
        Some(count) => count,
        None => 0,
    }
}

/// Whether so many clocks a bit are within 0.3 % of the rate.
const fn is_close(hertz: u32, rate: u32, clocks: u32) -> bool {
    let made = (rate as u64).wrapping_mul(clocks as u64);
    made.abs_diff(hertz as u64).wrapping_mul(1000) <= (hertz as u64).wrapping_mul(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parity_bit_is_not_part_of_the_octet() {
        // 0x10 has one bit set, so even parity adds a one: the data register holds 0x110.
        assert_eq!(received(FULL, 0x110), Received::Octet(0x10));
        assert_eq!(received(FULL, 0x0E5 | 0x100), Received::Octet(0xE5));
        assert_eq!(received(FULL, 0x068), Received::Octet(0x68));
    }

    #[test]
    fn every_error_spoils_the_character() {
        // PE, FE, NF, ORE as the reference manual numbers them: bits 0 to 3.
        for bit in 0..4 {
            assert!(is_due(1 << bit));
            assert_eq!(received(FULL | 1 << bit, 0x10), Received::Error, "bit {bit}");
        }
        // IDLE, TC, TXE are none.
        assert!(!is_due(1 << 4 | 1 << 6 | 1 << 7));
        assert_eq!(received(FULL | 1 << 4 | 1 << 6 | 1 << 7, 0xDC), Received::Octet(0xDC));
    }

    // RM0090, the table of dividers for 84 MHz with eight samples: 9.6 kbit/s is 1093.75, 6 Mbit/s 1.75.
    #[test]
    fn the_dividers_are_those_of_the_reference_manual() {
        assert_eq!(divider_of_eight(84_000_000, 9_600), Some(1093 << 4 | 6));
        assert_eq!(divider_of_eight(84_000_000, 6_000_000), Some(1 << 4 | 6));
        assert_eq!(divider_of_eight(84_000_000, 1_500_000), Some(7 << 4));
        assert_eq!(divider_of_eight(84_000_000, 12_000_000), None, "less than one clock");
        // From the internal oscillator alone, 16 MHz.
        assert_eq!(divider_of_eight(16_000_000, 500_000), Some(4 << 4));
        assert_eq!(divider_of_eight(16_000_000, 1_500_000), None, "3 % off");
        assert_eq!(divider_of_eight(16_000_000, 0), None);
    }

    // RM0440: 14 clocks a bit for 12 Mbit/s from 168 MHz, 28 halves.
    #[test]
    fn the_newer_kind_reaches_12_mbit() {
        assert_eq!(divider_of_newer(168_000_000, 12_000_000), Some(0x16));
        assert_eq!(divider_of_newer(168_000_000, 6_000_000), Some(0x34));
        assert_eq!(divider_of_newer(168_000_000, 9_600), Some(0x88B4));
        assert_eq!(divider_of_newer(16_000_000, 12_000_000), None);
        assert_eq!(divider_of_newer(168_000_000, 0), None);
        for rate in [19_200, 45_450, 93_750, 187_500, 500_000, 1_500_000, 3_000_000] {
            assert!(divider_of_newer(168_000_000, rate).is_some(), "{rate}");
        }
    }
}
