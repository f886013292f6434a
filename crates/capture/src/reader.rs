//! Packets out of a file, whatever is in it.

use std::fmt;
use std::io::{self, Read};

use pcap_file::pcapng::blocks::enhanced_packet::EnhancedPacketOption;
use pcap_file::pcapng::blocks::interface_description::{
    InterfaceDescriptionBlock, InterfaceDescriptionOption,
};
use pcap_file::pcapng::{Block, PcapNgParser};
use pcap_file::{Endianness, PcapError};

use crate::packet::{self, LinkType, Packet};

/// The first octets of every pcapng file.
pub const MAGIC: [u8; 4] = [0x0A, 0x0D, 0x0D, 0x0A];
/// The longest block that is taken; telegrams have 255 octets.
pub const LONGEST_BLOCK: u32 = 1024 * 1024;
/// More interfaces than any capture of a bus.
const MOST_INTERFACES: usize = 1000;
const CHUNK: usize = 64 * 1024;

/// Why a file cannot be read, or no further.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The system says so.
    #[error("cannot be read: {0}")]
    Io(#[from] io::Error),
    /// It does not begin as pcapng.
    #[error(
        "is no pcapng file: {why}; write one by `run --capture` or `capture`, or save as pcapng in Wireshark"
    )]
    NoCapture {
        /// What is wrong.
        why: String,
    },
    /// It was not written to its end: all before can be read.
    #[error(
        "ends within a block at octet {at} after {packets} packets: whatever wrote it was cut off; the packets \
         before are good"
    )]
    Cut {
        /// Where the block begins, from 0.
        at: u64,
        /// Packets before.
        packets: u64,
    },
    /// A block that cannot be.
    #[error("the block at octet {at}, after {packets} packets, cannot be: {why}")]
    Damaged {
        /// Where the block begins, from 0.
        at: u64,
        /// Packets before.
        packets: u64,
        /// What is wrong.
        why: String,
    },
    /// There are packets, but of other networks.
    #[error(
        "has no PROFIBUS in it: its {packets} packets have link type {link_type}, and PROFIBUS has 147 (USER0) or \
         257 (PROFIBUS_DL)"
    )]
    Foreign {
        /// The number of the first of them.
        link_type: u32,
        /// How many packets.
        packets: u64,
    },
}

/// Reads packets of PROFIBUS; others are counted.
pub struct Reader<R> {
    from: R,
    parser: PcapNgParser,
    buffer: Vec<u8>,
    /// Where the unread part of the buffer begins.
    next: usize,
    /// Octets of the file before the buffer.
    gone: u64,
    ended: bool,
    packets: u64,
    ours: u64,
    foreign: Option<u32>,
}

impl<R> fmt::Debug for Reader<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Reader").field("packets", &self.packets).finish_non_exhaustive()
    }
}

impl<R: Read> Reader<R> {
    /// Reads the beginning of a file.
    ///
    /// # Errors
    ///
    /// It is no pcapng file, or cannot be read.
    pub fn new(mut from: R) -> Result<Self, ReadError> {
        let no = |why: &str| ReadError::NoCapture { why: why.to_owned() };
        let mut buffer = Vec::new();
        let mut ended = false;
        let (parser, next) = loop {
            if !buffer.is_empty() && !MAGIC.starts_with(&buffer[..buffer.len().min(4)]) {
                return Err(no(if is_old_pcap(&buffer) {
                    "it is an old pcap file"
                } else {
                    "it does not begin with a section header"
                }));
            }
            if let Some(length) = declared(&buffer, first_endianness(&buffer))
                && length > LONGEST_BLOCK
            {
                return Err(no(&format!("its section header claims {length} octets")));
            }
            match PcapNgParser::new(&buffer) {
                Ok((rest, parser)) => break (parser, buffer.len() - rest.len()),
                Err(PcapError::IncompleteBuffer) if ended => {
                    return Err(no("it ends within its section header"));
                }
                Err(PcapError::IncompleteBuffer) => {}
                Err(error) => return Err(no(&error.to_string())),
            }
            ended = !fill(&mut from, &mut buffer)?;
        };
        Ok(Self { from, parser, buffer, next, gone: 0, ended, packets: 0, ours: 0, foreign: None })
    }

    /// The next packet of PROFIBUS; `None` at the end.
    ///
    /// # Errors
    ///
    /// The rest cannot be read; or, at the end, there were packets, but none of PROFIBUS.
    pub fn next_packet(&mut self) -> Result<Option<Packet>, ReadError> {
        loop {
            if self.next == self.buffer.len() && !self.more()? {
                return match self.foreign {
                    Some(link_type) if self.ours == 0 => {
                        Err(ReadError::Foreign { link_type, packets: self.packets })
                    }
                    _ => Ok(None),
                };
            }
            if let Some(packet) = self.block()? {
                self.ours += 1;
                return Ok(Some(packet));
            }
        }
    }

    /// Packets of other networks so far, and the link type of the first.
    pub fn foreign(&self) -> Option<(u64, u32)> {
        self.foreign.map(|link_type| (self.packets - self.ours, link_type))
    }

    /// The next block, and the packet in it if it is one of ours.
    fn block(&mut self) -> Result<Option<Packet>, ReadError> {
        let at = self.gone + self.next as u64;
        let packets = self.packets;
        let damaged = |why: String| ReadError::Damaged { at, packets, why };
        loop {
            let rest = &self.buffer[self.next..];
            if let Some(length) = declared(rest, self.parser.section().endianness)
                && length > LONGEST_BLOCK
            {
                return Err(damaged(format!(
                    "it claims {length} octets, and no block of a bus has more than {LONGEST_BLOCK}"
                )));
            }
            match self.parser.next_block(rest) {
                Ok((left, block)) => {
                    let (used, packet) = (rest.len() - left.len(), take(&block, self.parser.interfaces()));
                    if self.parser.interfaces().len() > MOST_INTERFACES {
                        return Err(damaged(format!("it is interface {MOST_INTERFACES} and more")));
                    }
                    self.next += used;
                    return match packet {
                        Taken::Nothing => Ok(None),
                        Taken::NoInterface => {
                            Err(damaged("its packet is of an interface that was not described before".into()))
                        }
                        Taken::Foreign(link_type) => {
                            self.packets += 1;
                            self.foreign.get_or_insert(link_type);
                            Ok(None)
                        }
                        Taken::Ours(packet) => {
                            self.packets += 1;
                            Ok(Some(packet))
                        }
                    };
                }
                Err(PcapError::IncompleteBuffer) => {
                    if !self.more()? {
                        return Err(ReadError::Cut { at, packets });
                    }
                }
                Err(error) => return Err(damaged(error.to_string())),
            }
        }
    }

    /// Reads on; whether there was more.
    fn more(&mut self) -> Result<bool, ReadError> {
        self.gone += self.next as u64;
        self.buffer.drain(..self.next);
        self.next = 0;
        if !self.ended {
            self.ended = !fill(&mut self.from, &mut self.buffer)?;
        }
        Ok(!self.ended)
    }
}

enum Taken {
    Nothing,
    NoInterface,
    Foreign(u32),
    Ours(Packet),
}

fn take(block: &Block<'_>, interfaces: &[InterfaceDescriptionBlock<'_>]) -> Taken {
    let (id, units, data, options) = match block {
        Block::EnhancedPacket(packet) => {
            (packet.interface_id, packet.timestamp.as_nanos(), &packet.data, packet.options.as_slice())
        }
        // It has neither a time nor anything to say.
        Block::SimplePacket(packet) => (0, 0, &packet.data, &[][..]),
        _ => return Taken::Nothing,
    };
    let Some(interface) = usize::try_from(id).ok().and_then(|id| interfaces.get(id)) else {
        return Taken::NoInterface;
    };
    let link_type = u32::from(interface.linktype);
    if LinkType::from_number(link_type).is_none() {
        return Taken::Foreign(link_type);
    }
    let mut packet = Packet { nanos: nanos(units, interface), octets: data.to_vec(), ..Packet::default() };
    for option in options {
        match option {
            EnhancedPacketOption::Comment(text) => packet.comments.push(text.clone().into_owned()),
            EnhancedPacketOption::Flags(flags) => {
                (packet.direction, packet.faults) = packet::from_flags(*flags);
            }
            EnhancedPacketOption::DropCount(count) => packet.missing = *count,
            _ => {}
        }
    }
    Taken::Ours(packet)
}

/// Nanoseconds of a time in the interface's units; microseconds unless it says otherwise.
fn nanos(units: u128, interface: &InterfaceDescriptionBlock<'_>) -> u64 {
    let resolution = interface.options.iter().find_map(|option| match option {
        InterfaceDescriptionOption::IfTsResol(resolution) => Some(*resolution),
        _ => None,
    });
    let resolution = resolution.unwrap_or(6);
    let power = u32::from(resolution & 0x7F);
    let a_second =
        if resolution & 0x80 == 0 { 10_u128.checked_pow(power) } else { 2_u128.checked_pow(power) };
    // So fine that all there is room for is no time at all.
    let nanos = a_second.map_or(0, |a_second| units.saturating_mul(1_000_000_000) / a_second);
    u64::try_from(nanos).unwrap_or(u64::MAX)
}

fn is_old_pcap(octets: &[u8]) -> bool {
    matches!(
        octets.get(..4),
        Some([0xD4 | 0x4D, 0xC3 | 0x3C, 0xB2, 0xA1] | [0xA1, 0xB2, 0xC3 | 0x3C, 0xD4 | 0x4D])
    )
}

/// A section header tells the order of octets in its third word.
fn first_endianness(octets: &[u8]) -> Endianness {
    if octets.get(8) == Some(&0x4D) { Endianness::Little } else { Endianness::Big }
}

/// The length that a block says it has. A section header may change the order of octets.
fn declared(block: &[u8], order: Endianness) -> Option<u32> {
    let length: [u8; 4] = block.get(4..8)?.try_into().ok()?;
    let order = match block.get(..4) {
        Some(magic) if magic == MAGIC => {
            block.get(8)?;
            first_endianness(block)
        }
        _ => order,
    };
    Some(match order {
        Endianness::Big => u32::from_be_bytes(length),
        Endianness::Little => u32::from_le_bytes(length),
    })
}

/// Whether there was anything more.
fn fill(from: &mut impl Read, buffer: &mut Vec<u8>) -> io::Result<bool> {
    let length = buffer.len();
    buffer.resize(length + CHUNK, 0);
    loop {
        match from.read(&mut buffer[length..]) {
            Ok(count) => {
                buffer.truncate(length + count);
                return Ok(count > 0);
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => {
                buffer.truncate(length);
                return Err(error);
            }
        }
    }
}
