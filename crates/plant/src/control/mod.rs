//! How others steer a running plant: requests and events, as values and as lines of JSON.
//!
//! - [`Request`] is what can be asked for, [`Envelope::parse`] reads it from a line, and
//!   [`Handle::apply`](crate::Handle::apply) does it.
//! - [`Reply`] is what came of it.
//! - [`Subscriptions`] carry what happens to whoever wants to know; [`EventLine`] is a line of it.
//! - [`Server`] takes requests on a Unix socket, or on a TCP port of this computer.

mod apply;
mod check;
mod commands;
mod envelope;
mod event;
mod request;
mod server;
mod shafts;
mod subscriptions;
mod surroundings;
mod target;
mod values;

pub use crate::shaft::{ShaftFields, ShaftKind};
pub use apply::{Applied, Steer};
pub use check::ControlError;
pub use commands::{COMMANDS, CommandHelp};
pub use envelope::{Envelope, RefusedLine, Reply};
pub use event::{EVENT_KINDS, EventLine, event_kind};
pub use request::Request;
pub use server::{ControlAddress, ControlAddressError, MOST_CONNECTIONS, MOST_OCTETS, Server, Turns};
pub(crate) use shafts::Couplings;
pub use subscriptions::{Item, Subscription, Subscriptions};
pub(crate) use surroundings::judge;
pub use target::Which;
pub use values::{BatteryState, Light, MemoryFault, Power, SensorFault, ShaftSpec};
