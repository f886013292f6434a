//! PROFIBUS segments on the host.
//!
//! A segment owns stations, a clock and an end:
//!
//! - [`Segment`] runs in real time on one thread, over an [`End`] that somebody else opens: a
//!   pseudo terminal ([`PtyEnd`]), a serial device ([`SerialEnd`]), a TCP or Unix socket
//!   ([`SocketEnd`]) or memory ([`memory::pair`]). [`port`] opens them by the names users write.
//! - [`VirtualSegment`] runs the same stations as fast as the computer can, with bus times kept
//!   exactly.
//!
//! It parses every telegram once and hands it to the station it is for. Stations are anything that
//! implements [`Station`](profibus_dp::Station); this crate knows no device.

#![forbid(unsafe_code)]

mod brisk;
pub mod cable;
pub mod clock;
mod collision;
pub mod control;
pub mod end;
pub mod faults;
mod line;
pub mod link;
pub mod memory;
mod overheard;
pub mod port;
pub mod pty;
pub mod segment;
pub mod serial;
pub mod socket;
mod stations;
pub mod termination;
pub mod virtual_segment;
mod wake;
pub mod wire_tap;

pub use cable::Cable;
pub use clock::{VirtualClock, WallClock};
pub use control::{Commands, Control};
pub use end::{End, EndError, Event, Note, Waker, Written};
pub use faults::{FaultCounters, Faults, Noise, NoiseError, ReplyFault, RequestFault};
pub use link::{Link, LinkError};
pub use memory::MemoryEnd;
pub use port::{PortAddress, PortError, open_for_master, open_for_slaves};
pub use pty::PtyEnd;
pub use segment::{Counters, Handler, LateReplies, News, RateListener, Segment, Settings};
pub use serial::{Delay, Latency, Rates, SerialEnd};
pub use socket::{AddressError, SocketEnd, TcpAddress, UnixSocket};
pub use virtual_segment::{Answer, Reply, VirtualSegment};
pub use wire_tap::{Sight, WireTap};
