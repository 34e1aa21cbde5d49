//! Scenario files: keys and defaults, validation, and the print of `thermyo check`.
//!
//! ```text
//! text --document: types, ranges--> entries --load: defaults, geometry, rules, CSV--> Loaded
//! ```

mod check;
pub mod core_config;
pub(crate) mod declare;
mod document;
mod fault_rules;
pub mod from_config;
mod geometry;
mod load;
mod number;
pub mod profile;
mod rules;
pub mod schema;
mod tables;
mod violation;

pub use check::render;
pub use document::Document;
pub use load::{Loaded, WrongCell, assemble, load, parse};
pub use number::{number, with_numbers};
pub use rules::OBSERVABLE;
pub use tables::*;
