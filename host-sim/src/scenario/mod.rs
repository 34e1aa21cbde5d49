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
mod load;
mod number;
pub mod profile;
mod rules;
pub mod schema;
mod sense;
mod tables;
mod violation;

pub use check::render;
pub use document::Document;
pub use geometry::at_rest;
pub use load::{
    Loaded, WrongCell, assemble, load, load_with_warnings, parse, parse_alone, parse_with_warnings,
};
pub use number::{number, with_numbers};
pub use rules::{OBSERVABLE, highest_pa};
pub use sense::warnings;
pub use tables::*;
