//! The DP layer: the MS0 state machine of a slave, its services, and what a device must bring.

pub mod application;
pub mod dp_slave;
pub mod event;
pub mod freeze_sync;
pub mod refusal;
mod services;
pub mod slave;
pub mod watchdog;

pub use application::{Application, ExtendedDiagnosis, PrmVerdict, Refused};
pub use dp_slave::{Configuration, DpSlave};
pub use event::{Cause, Event};
pub use refusal::{Refusal, Service};
pub use slave::{Session, Slave, State};
