//! The bench in a browser: an HTTP API, a live stream and the page on top of it.
//!
//! | module | what |
//! |---|---|
//! | [`server`] | starts and ends it: a thread of its own, a runtime on it, connections |
//! | `guard` | who may ask: hosts, other sites, the token; what every answer says to a browser |
//! | [`stage`] | the plant that is shown, and what is known of it |
//! | `scenarios`, `live` | scenarios that come with the program, played in step with real time |
//! | `recordings` | files of values and of what is on a bus |
//! | `publisher`, `wire` | twenty times a second: what there is to show, telegrams in words among it |
//! | `stream` | the same to whoever reads, and what slow readers miss |
//! | `api` | the endpoints, one file for each group; [`openapi`] describes them |
//! | `assets` | the page, embedded |
//!
//! It reaches the plant by its handle alone, and no client disturbs the bus: sizes, connections and streams are
//! bounded, and the segments wait for nobody.

#![forbid(unsafe_code)]

mod api;
mod assets;
mod connection;
mod guard;
mod live;
pub mod openapi;
mod problem;
mod publisher;
mod recordings;
mod scenarios;
pub mod server;
pub mod stage;
mod stream;
mod token;
mod view;
mod wire;

pub use server::{Server, Settings, StartError};
pub use stage::{Kind, Setup, Shown};
pub use token::Token;
