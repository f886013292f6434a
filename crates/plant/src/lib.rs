//! Encoders, their segments, shafts and worlds as one running thing.
//!
//! - [`Plant`] runs segments on threads of their own, and is the handle by which everybody else
//!   reaches them: commands in, [`Snapshot`]s and [`Report`]s out.
//! - [`control`] has the requests by which others steer a running plant, as values and as lines of
//!   JSON, and the socket that takes them.
//! - [`scenario`] reads files that say who is on which segment, what happens and what must hold, and plays
//!   them in virtual time.
//! - [`EncoderStation`] is one encoder in its world: the device of the crate `sch108bex`, a
//!   [`Shaft`] that turns it, a [`World`] around it and a [`Store`] that keeps its memory. It is a
//!   station for any segment, in real or virtual time.

#![forbid(unsafe_code)]

pub mod control;
pub mod encoder;
mod ground;
pub mod handle;
pub mod machine;
pub mod plant;
pub mod report;
pub mod sample;
pub mod scenario;
pub mod shaft;
pub mod snapshot;
pub mod store;
pub mod world;

pub use encoder::{EncoderSetup, EncoderStation, Rate};
pub use handle::Handle;
pub use machine::{Drum, Machine};
pub use plant::{MasterTap, Plant, PlantError, SegmentSetup};
pub use report::{Report, Reporter, What};
pub use sample::{DeviceSample, Sample, SampleTap};
pub use shaft::{Coupling, Shaft, ShaftError, ShaftFields, ShaftKind};
pub use snapshot::{DeviceSnapshot, PlantSnapshot, Snapshot};
pub use store::{Store, StoreError};
pub use world::World;
