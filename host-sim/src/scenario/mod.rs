//! Scenario files: keys and defaults, validation, and the print of `thermyo check`.
//!
//! ```text
//! text --document: types, ranges--> entries --load: defaults, geometry, rules, CSV--> Loaded
//! ```

#![warn(clippy::disallowed_methods)]

mod check;
pub mod core_config;
pub(crate) mod declare;
mod document;
mod fault_rules;
pub mod from_config;
mod geometry;
pub mod key;
mod load;
mod loaded;
mod number;
pub mod profile;
mod rules;
pub mod schema;
mod sense;
mod tables;
mod tree;
mod violation;

pub use check::render;
pub use document::Document;
pub use geometry::at_rest;
pub use load::{assemble, load, load_with_warnings, parse, parse_with_warnings};
pub use loaded::Loaded;
pub use number::{number, short, with_numbers};
pub use rules::{OBSERVABLE, highest_pa};
pub use sense::warnings;
pub use tables::*;
pub use violation::WrongCell;
