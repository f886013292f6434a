//! The API over loopback: a real server, a real socket, octets as a client sends them.

#![allow(missing_docs, reason = "tests")]

mod bench;
mod client;
mod described;
mod guard;
mod limits;
mod plain;
mod recordings;
mod slow;
