//! GSD files: ours, made here, and the one of a user's project, judged here.
//!
//! A GSD is what an engineering tool knows of a slave. Ours is not the maker's, and says so in each
//! place that a tool shows.

mod judgement;
mod template;

pub use judgement::{Judgement, judge};
pub use template::{KEPT, file_name, text};
