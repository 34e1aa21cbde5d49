//! Scenario files: schema, defaults, validation.
mod model;
pub use model::*;
