//! The firmware's board in an emulator, for tests and for people without one.
//!
//! QEMU emulates a board with an STM32F405 and runs the very image that is flashed. Its first USART is the
//! bus: a Unix socket that any master of this project takes as `--port unix:PATH`, or through
//! [`bridge`] a pseudo terminal. Its second is the world link ([`link`]): it brings shaft, supply, end cap
//! and memory.
//!
//! [`Board`] is the board; its clock runs by itself, or by one latch for each message. [`Stepped`] gives it one
//! latch after the other, [`Live`] does so beside the clock, in a world that somebody steers.

#![forbid(unsafe_code)]

pub mod board;
pub mod bridge;
pub mod emulator;
pub mod link;
pub mod live;
pub mod stepped;

pub use board::Board;
pub use bridge::Bridge;
pub use emulator::{Emulator, EmulatorError, QEMU, Setup};
pub use live::{Beginning, Live};
pub use logic::world::{PowerOn, World};
pub use stepped::Stepped;
