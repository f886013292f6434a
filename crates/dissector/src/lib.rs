//! PROFIBUS DP-V0 telegrams in words.
//!
//! | module | what |
//! |---|---|
//! | [`hex`] | octets out of text, with comments |
//! | [`splitter`] | telegrams out of a stream of octets, with what is none said and skipped |
//! | [`field`] | a value with the octets that it stands in, its name and its meaning |
//! | [`dissected`] | a telegram as fields |
//! | [`advice`] | what a diagnosis or a refusal means for the machine, and what to do about it |
//! | [`conversation`] | a sequence: which request an answer belongs to, what each station agreed |
//!
//! Octets count from 1. Nothing is assumed that the telegrams do not say: an answer without its request
//! stays an answer of unknown service. Whatever comes in, memory stays bounded and nothing panics.
//!
//! ```
//! use dissector::{Conversation, Item, Profile};
//!
//! let mut conversation = Conversation::new(Profile::Auto);
//! let mut lines = Vec::new();
//! conversation.push(&[0x10, 0x0B, 0x02, 0x49, 0x56, 0x16], &mut |entry| {
//!     if let Item::Telegram(telegram) = entry.item {
//!         lines.push(telegram.summary);
//!     }
//! });
//! assert_eq!(lines, ["2 -> 11  FDL_Status request"]);
//! ```

#![forbid(unsafe_code)]

pub mod advice;
pub mod conversation;
pub mod dissected;
mod encoder;
pub mod field;
pub mod hex;
mod names;
mod services;
pub mod splitter;

pub use conversation::{Conversation, Entry, Item, Profile};
pub use dissected::{Dissected, Remark};
pub use field::{Field, Value};
pub use names::{Direction, Format, Service};
