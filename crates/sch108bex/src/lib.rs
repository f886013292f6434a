//! The SCH108BEX absolute encoder as software, octet for octet as its manual tells it.
//!
//! No operating system, no allocation, no clock of its own, no panic: every entry point takes
//! `now` and values, and reports what happened as typed [`event::Event`]s. The files are named
//! after the sections of the manual:
//!
//! | module | manual | what |
//! |---|---|---|
//! | [`end_cap`] | 3.3, 3.4 | rotary switches, station address, termination |
//! | [`functionality`] | 4, 4.3 | class 1, class 2, Scancon 2.0 and their configurations |
//! | [`configuration`] | 4.3 | the identifier octets that choose among them |
//! | [`parameterization`] | 4.1 | the encoder's part of Set_Prm |
//! | [`diagnostics`] | 4.2 | the encoder's part of Slave_Diag |
//! | [`scaling`] | 4.1.1-4.1.3 | from physical counts to scaled positions |
//! | [`data_exchange`] | 4.3 | the input octets |
//! | [`preset`] | 4.2.14, 4.3.2 | the preset and its offset |
//! | [`motion`] | 4.1.5, 4.3.3 | velocity and acceleration |
//! | [`sensor`] | 4.2.2, 4.2.4-4.2.6 | the shaft as the disc reads it, latch by latch |
//! | [`health`] | 4.2.2, 4.2.9, 4.2.13 | alarms, warnings, operating time |
//! | [`nonvolatile`], [`write_policy`] | 3.4, 4.2.14 | what survives a loss of power, and when it is written |
//! | [`specification`], [`data_sheet`] | 5, 6 | the figures |
//! | [`sensor_half`] | | everything from the shaft to the input image, as one piece |
//! | [`encoder`] | | the bus half: the encoder as the application of a DP slave |
//! | [`device`] | | both halves and the memory: the whole, from power-on to power-off |
//! | [`halves`] | | the two halves by themselves, for firmware |
//! | [`refusal`], [`event`] | | why something was refused, and what happened |
#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing,
        clippy::arithmetic_side_effects,
        clippy::unreachable,
        clippy::todo
    )
)]

#[cfg(test)]
extern crate std;

pub mod configuration;
pub mod data_exchange;
pub mod data_sheet;
pub mod device;
pub mod diagnostics;
pub mod encoder;
pub mod end_cap;
pub mod event;
pub mod functionality;
pub mod halves;
pub mod health;
pub mod motion;
pub mod nonvolatile;
pub mod parameterization;
pub mod preset;
pub mod refusal;
pub mod scaling;
pub mod sensor;
pub mod sensor_half;
pub mod specification;
pub mod write_policy;

pub use device::{Device, NonvolatileWrite, PowerOn};
pub use encoder::Identity;
