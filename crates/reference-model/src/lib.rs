//! A DP-V0 slave written to be read, not to be fast.
//!
//! It shares no code with the slave of this project but the segment's interface and its types of
//! time: it has its own receiver, frame count memory, tables and states, straight from the
//! standard's rules. Random dialogues compare the two; and each line of it can be made wrong to
//! see whether the slave checks notice (`mutants.txt`).

#![forbid(unsafe_code)]

extern crate self as reference_model;

mod device;
mod slave;

pub use device::Device;
pub use slave::{Setting, Slave, State};
