//! PROFIBUS DP masters.
//!
//! - [`LightMaster`] asks one thing at a time and takes one answer: for tests, for load, for odd
//!   telegrams, in virtual time as well as in real time. It is alone on its bus: it has no token.
//! - [`Line`] is what it needs of a bus; [`bus::VirtualSegment`] is one, and [`Wire`] makes one of any
//!   [`bus::End`].
//! - [`Commissioner`] brings a slave into data exchange and keeps it there, on profirust: token, start-up,
//!   cycle, diagnosis.
//!
//! This crate knows no device.

#![forbid(unsafe_code)]

pub mod commissioning;
pub mod error;
pub mod gsd;
pub mod light;
pub mod line;
pub mod parameters;
pub mod request;
pub mod wire;

pub use commissioning::{Commissioner, MasterSettings, SlaveSettings};
pub use error::Error;
pub use gsd::{Gsd, GsdError};
pub use light::{Diagnosis, Inputs, LightMaster, Settings};
pub use line::{Heard, Line};
pub use parameters::{Parameters, Watchdog};
pub use request::{Priority, Request, Service};
pub use wire::Wire;
