//! Scenario files: keys and defaults, validation, and the print of `thermyo check`.
//!
//! ```text
//! text --document: types, ranges--> entries --load: defaults, geometry, rules, CSV--> Loaded
//! ```

#![warn(clippy::disallowed_methods)]

mod declare;
pub mod document;
pub mod fault_rules;
pub mod geometry;
pub mod joint;
pub mod key;
mod number;
pub mod preset;
pub mod profile;
pub mod schema;
mod tables;
pub mod violation;

pub use document::Document;
pub use geometry::at_rest;

pub use number::{number, short, with_numbers};

pub use tables::*;
pub use violation::WrongCell;
