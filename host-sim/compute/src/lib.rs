//! f64 functions that give the same bits on every machine, and parallel jobs.

#![warn(clippy::disallowed_methods)]

pub mod math;
pub mod parallel;
