//! A joint of two muscles: its scenario read and checked, its run with the core in this process, its trace, summary
//! and page.

#![warn(clippy::disallowed_methods)]

mod faults;
mod load;
pub mod page;
mod render;
mod rig;
mod run;
mod summary;
mod trace;

pub use faults::{named, venting};
pub use load::{JointLoaded, course, joint, load, parse};
pub use render::render;
pub use rig::{Inputs, Rig, Row, RunError};
pub use run::run;
pub use summary::{Accumulator, Summary, pulses};
pub use trace::COLUMNS;
