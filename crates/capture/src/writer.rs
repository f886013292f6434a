//! Packets to a file.

use std::borrow::Cow;
use std::io::{self, Write};
use std::time::Duration;

use pcap_file::pcapng::PcapNgWriter;
use pcap_file::pcapng::blocks::enhanced_packet::{EnhancedPacketBlock, EnhancedPacketOption};
use pcap_file::pcapng::blocks::interface_description::{
    InterfaceDescriptionBlock, InterfaceDescriptionOption,
};
use pcap_file::{DataLink, PcapError};

use crate::packet::{self, LinkType, Packet};

/// Times are counted in units of 10^-9 s.
const NANOSECONDS: u8 = 9;

/// Writes packets as pcapng.
#[derive(Debug)]
pub struct Writer<W: Write> {
    pcapng: Pcapng<W>,
}

struct Pcapng<W: Write>(PcapNgWriter<W>);

impl<W: Write> std::fmt::Debug for Pcapng<W> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("PcapNgWriter")
    }
}

impl<W: Write> Writer<W> {
    /// Begins a file about the bus called `name`.
    ///
    /// # Errors
    ///
    /// It cannot be written.
    pub fn new(to: W, link_type: LinkType, name: &str) -> io::Result<Self> {
        let mut pcapng = PcapNgWriter::new(to).map_err(trouble)?;
        let interface = InterfaceDescriptionBlock {
            linktype: DataLink::from(link_type.number()),
            snaplen: 0,
            options: vec![
                InterfaceDescriptionOption::IfName(Cow::Borrowed(name)),
                InterfaceDescriptionOption::IfTsResol(NANOSECONDS),
            ],
        };
        pcapng.write_pcapng_block(interface).map_err(trouble)?;
        Ok(Self { pcapng: Pcapng(pcapng) })
    }

    /// Adds a packet.
    ///
    /// # Errors
    ///
    /// It cannot be written.
    pub fn write(&mut self, packet: &Packet) -> io::Result<()> {
        if packet.comments.is_empty() && packet.missing == 0 {
            return self.write_usual(packet);
        }
        self.write_block(packet)
    }

    /// A packet of which nothing is said. Each telegram is one, so its block is put together here
    /// without a list of options on the heap.
    fn write_usual(&mut self, packet: &Packet) -> io::Result<()> {
        let flags = packet::flags(packet);
        let Some(octets) = usual_block(packet, flags) else {
            return self.write_block(packet);
        };
        self.pcapng.0.get_mut().write_all(&octets.0[..octets.1])
    }

    fn write_block(&mut self, packet: &Packet) -> io::Result<()> {
        let mut options = Vec::new();
        for comment in &packet.comments {
            options.push(EnhancedPacketOption::Comment(Cow::Borrowed(comment.as_str())));
        }
        match packet::flags(packet) {
            0 => {}
            flags => options.push(EnhancedPacketOption::Flags(flags)),
        }
        if packet.missing > 0 {
            options.push(EnhancedPacketOption::DropCount(packet.missing));
        }
        let block = EnhancedPacketBlock {
            interface_id: 0,
            timestamp: Duration::from_nanos(packet.nanos),
            original_len: u32::try_from(packet.octets.len()).unwrap_or(u32::MAX),
            data: Cow::Borrowed(&packet.octets),
            options,
        };
        self.pcapng.0.write_pcapng_block(block).map(drop).map_err(trouble)
    }

    /// Hands on what is kept back.
    ///
    /// # Errors
    ///
    /// It cannot be written.
    pub fn flush(&mut self) -> io::Result<()> {
        self.pcapng.0.get_mut().flush()
    }

    /// What was written to.
    pub fn into_inner(self) -> W {
        self.pcapng.0.into_inner()
    }
}

/// An Enhanced Packet Block with flags and no more, and its length; `None` for what is longer than a telegram, or
/// has no flags. Octets are in the order of this computer, as those of the section's header.
fn usual_block(packet: &Packet, flags: u32) -> Option<([u8; 320], usize)> {
    const TYPE: u32 = 6;
    const FIXED: usize = 28;
    const END: usize = 16;
    let count = u32::try_from(packet.octets.len()).ok()?;
    let padded = packet.octets.len().next_multiple_of(4);
    let length = FIXED + padded + END;
    if flags == 0 || length > 320 {
        return None;
    }
    let total = u32::try_from(length).ok()?;
    let high = u32::try_from(packet.nanos >> 32).ok()?;
    let low = u32::try_from(packet.nanos & u64::from(u32::MAX)).ok()?;
    let mut block = [0; 320];
    // Type, length, interface, time, octets that are kept and that there were.
    for (place, word) in block.chunks_exact_mut(4).zip([TYPE, total, 0, high, low, count, count]) {
        place.copy_from_slice(&word.to_ne_bytes());
    }
    block[FIXED..][..packet.octets.len()].copy_from_slice(&packet.octets);
    let end = &mut block[FIXED + padded..length];
    // Option 2 with four octets, the end of options, the length again.
    end[..2].copy_from_slice(&2_u16.to_ne_bytes());
    end[2..4].copy_from_slice(&4_u16.to_ne_bytes());
    end[4..8].copy_from_slice(&flags.to_ne_bytes());
    end[12..].copy_from_slice(&total.to_ne_bytes());
    Some((block, length))
}

fn trouble(error: PcapError) -> io::Error {
    match error {
        PcapError::IoError(error) => error,
        other => io::Error::other(other.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::packet::{Direction, Faults};

    // The block of a telegram is the library's, octet for octet, whatever its length.
    #[test]
    fn the_usual_block_is_that_of_the_library() {
        for length in [0, 1, 2, 3, 4, 5, 6, 21, 255, 256, 276, 277, 600] {
            for direction in [None, Some(Direction::Request), Some(Direction::Reply)] {
                for check_sum in [false, true] {
                    let packet = Packet {
                        nanos: 0x0102_0304_0506_0708,
                        direction,
                        octets: (1..=255).cycle().take(length).collect(),
                        faults: Faults { check_sum, ..Faults::default() },
                        ..Packet::default()
                    };
                    let [mut ours, mut theirs] =
                        [0; 2].map(|_| Writer::new(Vec::new(), LinkType::User0, "bus").unwrap());
                    ours.write(&packet).unwrap();
                    theirs.write_block(&packet).unwrap();
                    assert_eq!(ours.into_inner(), theirs.into_inner(), "{length} {direction:?}");
                }
            }
        }
    }
}
