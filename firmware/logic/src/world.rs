//! The world link: where there is no shaft, no end cap and no memory, a host plays them over a
//! second USART.
//!
//! Frame: A5h, kind, payload, check octet; kind, payload and check octet add up to 0 modulo 256.
//! Numbers are little endian.
//!
//! | kind | direction | payload | what |
//! |---|---|---|---|
//! | `M` | to the device | slot (0, 1), 40 octets | what a slot of the non-volatile memory holds |
//! | `P` | to the device | see [`PowerOn`], 6 octets | power comes; latch 0 is the next `L` |
//! | `L` | to the device | see [`World`], 15 octets | the world at the next latch |
//! | `T` | to the device | a number, 1 octet | so many further latches (0 is none) with the world as it was |
//! | `C` | to the device | none | the power is cut |
//! | `H` | both ways | a number, 1 octet | is anybody there? The answer has the same number |
//! | `N` | from the device | slot, 40 octets | a record was written |
//! | `A` | from the device | kind, lamp and state, latches (4), 6 octets | that frame is dealt with |

use sch108bex::end_cap::TerminationSwitches;
use sch108bex::health::{Battery, Measurement};
use sch108bex::nonvolatile::{SLOT_OCTETS, Slot};
use sch108bex::sensor::ShaftReading;
use sch108bex::specification::Variant;

/// What a frame begins with.
pub const BEGIN: u8 = 0xA5;

/// Octets of the longest payload.
const MOST: usize = SLOT_OCTETS + 1;

/// What a host tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Message {
    /// `M`: what a slot of the non-volatile memory holds.
    Memory(Slot, [u8; SLOT_OCTETS]),
    /// `P`: power comes.
    PowerOn(PowerOn),
    /// `L`: the world, at the next latch in lock-step, else as of now.
    Latch(World),
    /// `T`: so many latches more with the world as it was.
    More(u8),
    /// `C`: the power is cut.
    Cut,
    /// `H`: is anybody there?
    Hello(u8),
}

/// What holds when power comes.
///
/// | octet | holds |
/// |---|---|
/// | 1 | bit 0 lock-step, bit 1 memory as delivered, bit 2 replies wait min T_SDR |
/// | 2 | rotary switches |
/// | 3 | baud rate, 0 (9.6 kbit/s) to 9 (12 Mbit/s); bit 7: search, beginning with it |
/// | 4 | battery: 0 good, 1 low, 2 empty |
/// | 5 | singleturn bits, 2 to 16 |
/// | 6 | multiturn bits, 0 to 15 |
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PowerOn {
    /// Latches are the clock: one `L` is one latch. Else the device counts time itself, and an
    /// `L` is the world from then on.
    pub lock_step: bool,
    /// Both slots are emptied before.
    pub as_delivered: bool,
    /// Replies wait for min T_SDR; else they go at once.
    pub paced: bool,
    /// The two rotary switches.
    pub switches: u8,
    /// Index of the rate, slowest first.
    pub rate: u8,
    /// Whether the rate is to be searched.
    pub search: bool,
    /// The battery.
    pub battery: Battery,
    /// Singleturn and multiturn bits.
    pub variant: Variant,
}

/// The world as a latch sees it.
///
/// | octet | holds |
/// |---|---|
/// | 1-8 | shaft in physical counts, turns included, signed, clockwise positive |
/// | 9-12 | supply in millivolts, signed |
/// | 13-14 | temperature in tenths of a degree, signed |
/// | 15 | bit 0 light low, bit 1 the sensor reports a fault, bits 2 and 3 the termination switches, bits 4-5 battery |
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct World {
    /// What the sensor delivers.
    pub shaft: ShaftReading,
    /// Supply, temperature, light, battery.
    pub measurement: Measurement,
    /// The two switches of the termination resistors.
    pub termination: TerminationSwitches,
}

/// Collects the octets of frames from a host.
#[derive(Debug, Clone)]
pub struct Reader {
    place: Place,
    kind: u8,
    sum: u8,
    payload: [u8; MOST],
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    Begin,
    Kind,
    Payload { got: u8, due: u8 },
    Check,
}

impl Reader {
    /// Has heard nothing yet.
    pub const fn new() -> Self {
        Self { place: Place::Begin, kind: 0, sum: 0, payload: [0; MOST] }
    }

    /// Takes one octet; the message that it completes. Frames that are wrong in any way do not
    /// exist, and get no answer.
    pub fn take(&mut self, octet: u8) -> Option<Message> {
        self.sum = self.sum.wrapping_add(octet);
        self.place = match self.place {
            Place::Begin if octet == BEGIN => Place::Kind,
            Place::Begin => Place::Begin,
            Place::Kind => {
                (self.kind, self.sum) = (octet, octet);
                match octet {
                    b'M' => Place::Payload { got: 0, due: 41 },
                    b'P' => Place::Payload { got: 0, due: 6 },
                    b'L' => Place::Payload { got: 0, due: 15 },
                    b'C' => Place::Check,
                    b'H' | b'T' => Place::Payload { got: 0, due: 1 },
                    BEGIN => Place::Kind,
                    _ => Place::Begin,
                }
            }
            Place::Payload { got, due } => {
                if let Some(place) = self.payload.get_mut(usize::from(got)) {
                    *place = octet;
                }
                let got = got.wrapping_add(1);
                if got == due { Place::Check } else { Place::Payload { got, due } }
            }
            Place::Check => {
                self.place = Place::Begin;
                return if self.sum == 0 { self.message() } else { None };
            }
        };
        None
    }

    fn message(&self) -> Option<Message> {
        let payload = &self.payload;
        Some(match self.kind {
            b'M' => {
                let (&slot, octets) = payload.split_first()?;
                Message::Memory(slot_of(slot)?, *octets.first_chunk()?)
            }
            b'P' => Message::PowerOn(PowerOn::parse(*payload.first_chunk()?)?),
            b'L' => Message::Latch(World::parse(payload.first_chunk()?)?),
            b'H' => Message::Hello(*payload.first()?),
            b'T' => Message::More(*payload.first()?),
            _ => Message::Cut,
        })
    }
}

impl Default for Reader {
    fn default() -> Self {
        Self::new()
    }
}

impl PowerOn {
    fn parse([flags, switches, rate, battery, n, m]: [u8; 6]) -> Option<Self> {
        Some(Self {
            lock_step: flags & 1 != 0,
            as_delivered: flags & 2 != 0,
            paced: flags & 4 != 0,
            switches,
            rate: Some(rate & 0x7F).filter(|&rate| rate < 10)?,
            search: rate & 0x80 != 0,
            battery: battery_of(battery)?,
            variant: Variant::new(n, m).ok()?,
        })
    }
}

impl World {
    fn parse(&[p0, p1, p2, p3, p4, p5, p6, p7, s0, s1, s2, s3, t0, t1, flags]: &[u8; 15]) -> Option<Self> {
        let counts = i64::from_le_bytes([p0, p1, p2, p3, p4, p5, p6, p7]);
        Some(Self {
            shaft: if flags & 2 == 0 { ShaftReading::Full(counts) } else { ShaftReading::Fault },
            measurement: Measurement {
                supply_mv: i32::from_le_bytes([s0, s1, s2, s3]),
                temperature_tenths: i16::from_le_bytes([t0, t1]),
                light_ok: flags & 1 == 0,
                battery: battery_of((flags >> 4) & 3)?,
            },
            termination: TerminationSwitches { first: flags & 4 != 0, second: flags & 8 != 0 },
        })
    }
}

/// The octets of a frame to the host, to be sent one after the other.
pub fn frame<'a>(kind: u8, payload: impl IntoIterator<Item = &'a u8>, mut send: impl FnMut(u8)) {
    send(BEGIN);
    send(kind);
    let mut sum = kind;
    for &octet in payload {
        sum = sum.wrapping_add(octet);
        send(octet);
    }
    send(sum.wrapping_neg());
}

/// The number of a slot in a frame.
pub const fn slot_number(slot: Slot) -> u8 {
    match slot {
        Slot::A => 0,
        Slot::B => 1,
    }
}

const fn slot_of(number: u8) -> Option<Slot> {
    match number {
        0 => Some(Slot::A),
        1 => Some(Slot::B),
        _ => None,
    }
}

const fn battery_of(number: u8) -> Option<Battery> {
    match number {
        0 => Some(Battery::Ok),
        1 => Some(Battery::Low),
        2 => Some(Battery::Empty),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    fn heard(octets: &[u8]) -> Vec<Message> {
        let mut reader = Reader::new();
        octets.iter().filter_map(|octet| reader.take(*octet)).collect()
    }

    fn framed(kind: u8, payload: &[u8]) -> Vec<u8> {
        let mut octets = Vec::new();
        frame(kind, payload, |octet| octets.push(octet));
        octets
    }

    // By hand: 43h and BDh are 100h.
    #[test]
    fn a_frame_adds_up_to_nothing() {
        assert_eq!(framed(b'C', &[]), [0xA5, 0x43, 0xBD]);
        assert_eq!(framed(b'A', &[0x50, 0, 1, 2, 0, 0]), [0xA5, 0x41, 0x50, 0, 1, 2, 0, 0, 0x6C]);
    }

    #[test]
    fn each_kind_is_read() {
        assert_eq!(heard(&framed(b'C', &[])), [Message::Cut]);
        assert_eq!(heard(&framed(b'H', &[7])), [Message::Hello(7)]);
        assert_eq!(heard(&framed(b'T', &[200])), [Message::More(200)]);
        let mut memory = [9; 41];
        memory[0] = 1;
        assert_eq!(heard(&framed(b'M', &memory)), [Message::Memory(Slot::B, [9; 40])]);
        let on = PowerOn {
            lock_step: true,
            as_delivered: false,
            paced: true,
            switches: 0x2A,
            rate: 9,
            search: true,
            battery: Battery::Empty,
            variant: Variant::new(14, 12).expect("there is one"),
        };
        assert_eq!(heard(&framed(b'P', &[0b101, 0x2A, 0x89, 2, 14, 12])), [Message::PowerOn(on)]);
        // -2 counts, 8000 mV, -10.0 degrees; light low, one switch on, battery low.
        let latch = [0xFE, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x40, 0x1F, 0, 0, 0x9C, 0xFF, 0b1_0101];
        let world = World {
            shaft: ShaftReading::Full(-2),
            measurement: Measurement {
                supply_mv: 8_000,
                temperature_tenths: -100,
                light_ok: false,
                battery: Battery::Low,
            },
            termination: TerminationSwitches { first: true, second: false },
        };
        assert_eq!(heard(&framed(b'L', &latch)), [Message::Latch(world)]);
        let mut fault = latch;
        fault[14] |= 2;
        assert_eq!(
            heard(&framed(b'L', &fault)),
            [Message::Latch(World { shaft: ShaftReading::Fault, ..world })]
        );
    }

    #[test]
    fn what_is_wrong_does_not_exist_and_what_follows_is_heard() {
        let good = framed(b'H', &[7]);
        for place in 1..good.len() {
            for bit in 0..8 {
                let mut wrong = good.clone();
                wrong[place] ^= 1 << bit;
                assert!(!heard(&wrong).contains(&Message::Hello(7)), "{wrong:02X?}");
            }
        }
        let mut octets = std::vec![0x00, 0xA5, 0xA5, b'Q'];
        octets.extend(&good);
        assert_eq!(heard(&octets), [Message::Hello(7)]);
        for payload in [[0, 1, 10, 0, 16, 15], [0, 1, 5, 3, 16, 15], [0, 1, 5, 0, 17, 15], [0, 1, 5, 0, 1, 0]]
        {
            assert_eq!(heard(&framed(b'P', &payload)), [], "{payload:?}");
        }
        assert_eq!(heard(&framed(b'M', &[2; 41])), [], "no such slot");
    }
}
