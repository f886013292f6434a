//! The device around its core: interrupts, clock, memory. No executor, no heap, no logger.
//!
//! | priority | what | touches |
//! |---|---|---|
//! | 0 | bus USART ([`bus`]) | the bus half |
//! | 1 | latch, demands, world link ([`shaft`], [`link`]) | the shaft half; the bus half in short locks |
//! | main loop | world, memory, lamp, watchdog ([`run`]) | both in locks |
#![no_std]
// On the path of an octet: in registers, not by way of calls.
#![allow(clippy::inline_always)]

pub mod bus;
pub mod cell;
pub mod clock;
pub mod link;
pub mod routines;
pub mod run;
pub mod shaft;

#[cfg(feature = "olimex_h405")]
pub mod f4;
#[cfg(feature = "olimex_h405")]
pub mod f4_clock;
#[cfg(feature = "olimex_h405")]
pub mod f4_end_cap;
#[cfg(feature = "nucleo_g474re")]
pub mod g4;
#[cfg(feature = "nucleo_g474re")]
pub mod g4_end_cap;
