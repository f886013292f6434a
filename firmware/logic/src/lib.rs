//! What the firmware decides, without a register.
//!
//! | module | what |
//! |---|---|
//! | [`usart`] | characters: parity bit, errors, dividers |
//! | [`as5047p`] | the frames of the magnetic sensor |
//! | [`turns`] | the turn count that a battery keeps |
//! | [`memory`] | records in a 24-series memory, page by page |
//! | [`analog`] | voltages, temperature, switches |
//! | [`world`] | the world link: shaft, supply, end cap and memory by way of a second USART |
#![no_std]
#![forbid(unsafe_code)]
// In an interrupt.
#![allow(clippy::inline_always)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable,
        clippy::indexing_slicing,
        clippy::arithmetic_side_effects
    )
)]

#[cfg(test)]
extern crate std;

pub mod analog;
pub mod as5047p;
pub mod memory;
pub mod turns;
pub mod usart;
pub mod world;
