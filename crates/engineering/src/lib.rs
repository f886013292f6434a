//! What somebody who plans with an SCH108BEX needs besides the device.
//!
//! - [`gsd`] writes the GSD of a variant, and judges the GSD that a user has.
//! - [`scaling`] works out what measuring units and a total range mean: residual, words, octets.

#![forbid(unsafe_code)]

pub mod gsd;
pub mod scaling;
