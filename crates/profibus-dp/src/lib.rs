#![doc = include_str!("../README.md")]
#![no_std]
#![forbid(unsafe_code)]
// On the path of a cyclic telegram: what one step finds stays in registers for the next.
#![allow(clippy::inline_always)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable,
        clippy::todo,
        clippy::indexing_slicing,
        clippy::arithmetic_side_effects
    )
)]

#[cfg(test)]
extern crate std;

pub mod dp;
pub mod fdl;
pub mod time;
pub mod wire;

pub use dp::{Application, DpSlave};
pub use fdl::{Station, Window};
