//! What reads and plays the conversations.

pub(crate) mod bench;
pub(crate) mod driver;
pub(crate) mod format_tests;
mod judge;
pub(crate) mod parser;
pub(crate) mod script;
mod values;
pub(crate) mod variants;
