//! A joint of two muscles: its scenario read and checked, its run with the core in this process or on a board, its
//! trace, summary and page.

#![warn(clippy::disallowed_methods)]

mod faults;
mod from_config;
mod load;
pub mod page;
mod pair;
mod radii;
mod render;
mod rig;
mod run;
mod summary;
pub mod trace;
mod warnings;

pub use faults::{named, venting};
pub use from_config::to_scenario;
pub use load::{
    JointLoaded, angle_and_stiffness, course, joint, load, load_recorded, parse, parse_alone,
};
pub use radii::Off;
pub use render::{recorded, render};
pub use rig::{Inputs, Rig, Row, RunError};
pub use run::{Run, run, run_on};
pub use summary::{Accumulator, Figures, Summary, angle_text, pulses};
pub use trace::COLUMNS;
pub use warnings::{load_with_warnings, warnings};
