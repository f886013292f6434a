//! A telegram with its time.

use std::fmt;
use std::str::FromStr;

use dissector::splitter::{Why, Wrong};
use profibus_dp::wire::telegram::Fault;

/// How a capture names PROFIBUS telegrams: the number of its link type.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LinkType {
    /// 147, free for anybody: what Wireshark hands to a dissector of the user's.
    #[default]
    User0,
    /// 257, registered for PROFIBUS telegrams, from the start delimiter to the end delimiter.
    ProfibusDl,
}

impl LinkType {
    /// Its number.
    pub const fn number(self) -> u32 {
        match self {
            Self::User0 => 147,
            Self::ProfibusDl => 257,
        }
    }

    /// The link type with this number.
    pub const fn from_number(number: u32) -> Option<Self> {
        match number {
            147 => Some(Self::User0),
            257 => Some(Self::ProfibusDl),
            _ => None,
        }
    }
}

impl FromStr for LinkType {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, &'static str> {
        text.parse().ok().and_then(Self::from_number).ok_or("write 147 (USER0) or 257 (PROFIBUS_DL)")
    }
}

impl fmt::Display for LinkType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.number())
    }
}

/// Who has sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// A master; in the file "inbound".
    Request,
    /// A slave; in the file "outbound".
    Reply,
}

/// A telegram, what was no telegram, or without octets something that happened.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Packet {
    /// Nanoseconds since 1970-01-01, or since the start where time is virtual.
    pub nanos: u64,
    /// Who has sent it, where that is known.
    pub direction: Option<Direction>,
    /// All octets, delimiters included.
    pub octets: Vec<u8>,
    /// What is wrong with the octets, as a capture's flags know it.
    pub faults: Faults,
    /// How many packets before this one are missing.
    pub missing: u64,
    /// What there is to say, a sentence each.
    pub comments: Vec<String>,
}

/// Faults of a packet that a capture has a flag for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Faults {
    /// A character with a wrong parity or stop bit.
    pub character: bool,
    /// A wrong start delimiter, or garbage.
    pub start: bool,
    /// Fewer octets than announced.
    pub too_short: bool,
    /// A wrong check sum.
    pub check_sum: bool,
}

const INBOUND: u32 = 0b01;
const OUTBOUND: u32 = 0b10;
/// A bit of the flags, and the field that it is.
type Flag = (u32, fn(&mut Faults) -> &mut bool);

const FLAGS: [Flag; 4] = [
    (1 << 31, |faults| &mut faults.character),
    (1 << 29, |faults| &mut faults.start),
    (1 << 26, |faults| &mut faults.too_short),
    (1 << 24, |faults| &mut faults.check_sum),
];

impl Faults {
    pub(crate) fn of(wrong: Wrong) -> Self {
        let mut faults = Self::default();
        match wrong.why {
            Why::Fault(Fault::CheckSum(..)) => faults.check_sum = true,
            Why::TooShort { .. } => faults.too_short = true,
            Why::Fault(_) => faults.start = true,
        }
        faults
    }
}

/// The flags of a packet in a file.
pub(crate) fn flags(packet: &Packet) -> u32 {
    let direction = match packet.direction {
        None => 0,
        Some(Direction::Request) => INBOUND,
        Some(Direction::Reply) => OUTBOUND,
    };
    let mut faults = packet.faults;
    let set = FLAGS.iter().filter(|(_, field)| *field(&mut faults)).map(|(bit, _)| bit);
    set.fold(direction, |flags, bit| flags | bit)
}

/// The other way round.
pub(crate) fn from_flags(flags: u32) -> (Option<Direction>, Faults) {
    let direction = match flags & 0b11 {
        INBOUND => Some(Direction::Request),
        OUTBOUND => Some(Direction::Reply),
        _ => None,
    };
    let mut faults = Faults::default();
    for (bit, field) in FLAGS {
        *field(&mut faults) = flags & bit != 0;
    }
    (direction, faults)
}
