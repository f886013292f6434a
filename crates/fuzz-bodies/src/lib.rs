//! What a fuzz target does with the octets it is given.
//!
//! Each body takes any octets and panics when something that must hold does not. The same bodies
//! run under libFuzzer (`fuzz/`) and, over random octets and over the corpora, as tests.

#![forbid(unsafe_code)]

pub mod control;
pub mod device;
pub mod gsd;
pub mod receiver;
pub mod scenario;
pub mod state;
mod tape;
mod telegrams;

/// A body.
pub type Body = fn(&[u8]);

/// All bodies by the names of their fuzz targets and corpora.
pub const BODIES: [(&str, Body); 6] = [
    ("control", control::control),
    ("device", device::device),
    ("gsd", gsd::gsd),
    ("receiver", receiver::receiver),
    ("scenario", scenario::scenario),
    ("state", state::state),
];
