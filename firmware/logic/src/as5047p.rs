//! The AS5047P, a magnetic sensor of 14 bits on SPI: its frames of 16 bits.
//!
//! | bit | command | answer |
//! |---|---|---|
//! | 15 | even parity of the rest | even parity of the rest |
//! | 14 | 1: read | EF: the frame before was wrong |
//! | 13-0 | address | data |
//!
//! An answer comes with the frame after its command. A latch takes two frames: the one asks for the
//! angle and brings the error register asked for at the latch before; the other brings the angle
//! and asks for the error register.

use sch108bex::sensor::ShaftReading;

/// Singleturn bits.
pub const BITS: u8 = 14;
/// Reads ANGLECOM (3FFFh), the angle with dynamic error compensation.
pub const READ_ANGLE: u16 = 0xFFFF;
/// Reads ERRFL (0001h), which clears it.
pub const READ_ERRORS: u16 = 0x4001;

const ERROR_FLAG: u16 = 0x4000;
const DATA: u16 = 0x3FFF;

/// The data of an answer; `None` where its parity is wrong or its error flag is set.
const fn data(answer: u16) -> Option<u16> {
    if answer.count_ones().is_multiple_of(2) && answer & ERROR_FLAG == 0 { Some(answer & DATA) } else { None }
}

/// What both answers of a latch say: any fault of the sensor or of the wire is one.
pub const fn reading(errors: u16, angle: u16) -> ShaftReading {
    match (data(errors), data(angle)) {
        (Some(0), Some(angle)) => ShaftReading::Singleturn(angle),
        _ => ShaftReading::Fault,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // The data sheet: a command is address and read bit with even parity.
    #[test]
    fn the_commands_have_even_parity() {
        assert_eq!(READ_ANGLE & DATA, 0x3FFF);
        assert_eq!(READ_ERRORS & DATA, 0x0001);
        for command in [READ_ANGLE, READ_ERRORS] {
            assert_eq!(command & 0x4000, 0x4000, "read");
            assert_eq!(command.count_ones() % 2, 0);
        }
    }

    #[test]
    fn an_angle_is_taken_only_without_a_fault() {
        // 2000h has one bit: parity 1. 0003h has two: parity 0.
        assert_eq!(reading(0, 0xA000), ShaftReading::Singleturn(0x2000));
        assert_eq!(reading(0, 0x0003), ShaftReading::Singleturn(3));
        assert_eq!(reading(0, 0), ShaftReading::Singleturn(0));
        assert_eq!(reading(0, 0x2000), ShaftReading::Fault, "parity");
        assert_eq!(reading(0, 0x4000 | 0x2000), ShaftReading::Fault, "EF");
        assert_eq!(reading(0, 0xFFFF), ShaftReading::Fault, "no sensor: the line stays high");
        // FRERR, INVCOMM, PARERR in the error register, each with its parity bit.
        for errors in [0x8001, 0x8002, 0x8004] {
            assert_eq!(reading(errors, 0x0003), ShaftReading::Fault, "{errors:04X}");
        }
        assert_eq!(reading(0x0001, 0x0003), ShaftReading::Fault, "parity of the error register");
    }
}
