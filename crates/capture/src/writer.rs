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

fn trouble(error: PcapError) -> io::Error {
    match error {
        PcapError::IoError(error) => error,
        other => io::Error::other(other.to_string()),
    }
}
