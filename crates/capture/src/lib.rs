//! What was on a PROFIBUS, kept as pcapng.
//!
//! | module | what |
//! |---|---|
//! | [`packet`] | a telegram with its time, its direction and what there is to say about it |
//! | [`assembler`] | telegrams out of octets that come in pieces |
//! | [`recorder`] | takes what a segment's tap sees, and writes it on a thread of its own, or gives it to whoever shows it |
//! | [`writer`] | packets to a file |
//! | [`reader`] | packets out of a file, whatever is in it |
//!
//! Every telegram is one packet. What is no telegram but happened (a reply that was not sent, a master that
//! left) is a packet without octets, whose comment says what. Times have a resolution of 1 ns.

#![forbid(unsafe_code)]

pub mod assembler;
pub mod packet;
pub mod reader;
pub mod recorder;
pub mod writer;

pub use assembler::Assembler;
pub use packet::{Direction, LinkType, Packet};
pub use reader::{ReadError, Reader};
pub use recorder::{Listener, Recorder, Report, Settings, Tap};
pub use writer::Writer;
