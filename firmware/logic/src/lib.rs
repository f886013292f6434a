//! What the firmware decides, without a register.
//!
//! | module | what |
//! |---|---|
//! | [`world`] | the world link: shaft, supply, end cap and memory by way of a second USART |
#![no_std]
#![forbid(unsafe_code)]
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

pub mod world;
