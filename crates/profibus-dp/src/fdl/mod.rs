//! The data link layer of a passive station: octets to telegrams, address, FCB repetition,
//! T_SDR, and the search for the baud rate.

pub mod baud_search;
pub mod passive_station;
pub mod receiver;
pub mod station;

pub use baud_search::{BaudSearch, BaudSetting};
pub use passive_station::PassiveStation;
pub use receiver::{Collected, Gathered, Receiver, ReceiverMode};
pub use station::{Station, Window};
