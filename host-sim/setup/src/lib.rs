//! A scenario read and checked: its plant, the configuration of the core, and the way back.
//!
//! ```text
//! text --document: types, ranges--> entries --load: defaults, geometry, rules, CSV--> Loaded
//! ```

#![warn(clippy::disallowed_methods)]

pub mod core_config;
pub mod from_config;
mod hardware;
mod load;
mod loaded;
mod presets;
mod render;
mod rules;
mod tree;
mod unlikely;
mod unrest;
mod warnings;

pub use hardware::{calibrated_otherwise, differences, hardware};
pub use load::{
    SET_POINT_COLUMNS, assemble, load, load_recorded, load_with_warnings, no_file, numbers_in,
    parse, parse_alone, parse_with_warnings, paths_in, profile_in, refuse_files, refuse_vessel,
    set_points_in,
};
pub use loaded::Loaded;
pub use render::{recorded, render};
pub use rules::{OBSERVABLE, highest_pa, set_points};
pub use unlikely::{contraction_held, late};
pub use unrest::{Unrest, unrest, valves_and_line};
pub use warnings::{unused_in_joint, warnings};
