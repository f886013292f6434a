//! A pcapng file as the input of `decode`.

use std::io::Read;

use capture::{ReadError, Reader};
use dissector::Conversation;

use super::Printer;
use crate::Failure;

/// Reads to the end, in constant memory.
pub(super) fn stream(
    input: &mut dyn Read,
    name: &str,
    conversation: &mut Conversation,
    printer: &mut Printer<'_>,
) -> Result<(), Failure> {
    let failed = |error: ReadError| Failure::Failed(format!("{name} {error}"));
    let mut reader = Reader::new(input).map_err(failed)?;
    while !printer.closed {
        let packet = match reader.next_packet() {
            Ok(Some(packet)) => packet,
            Ok(None) => break,
            Err(error) => {
                // What came before is on the screen already.
                conversation.finish(&mut |entry| printer.print(&entry));
                return Err(failed(error));
            }
        };
        printer.begin_packet(packet.nanos, packet.comments);
        conversation.push(&packet.octets, &mut |entry| printer.print(&entry));
        conversation.finish(&mut |entry| printer.print(&entry));
        printer.end_packet();
    }
    if let Some((packets, link_type)) = reader.foreign() {
        crate::output::aside(&format!(
            "note: {packets} packets of link type {link_type}, which is not PROFIBUS, were left out"
        ));
    }
    Ok(())
}
