//! The program as its users see it: command line, standard output, state file and bus.
//!
//! What goes over the bus is written here octet by octet, and what is expected comes from the manual or
//! by hand: nothing of the program's own telegram code is used.

mod bad_octets;
mod captures;
mod command_line;
mod commands;
mod commissioning;
mod contract;
mod ctl;
mod damaged_state;
mod demo;
mod driver;
mod forgetful;
mod http;
mod kill;
mod master;
mod outputs;
mod pages;
mod pyprofibus;
mod readme;
mod recordings;
mod refusals;
mod scenario;
mod serial;
mod shown;
mod state;
mod timing;
#[path = "../tools/mod.rs"]
mod tools;
mod wireshark;
mod words;
