//! f64 functions that give the same bits on every machine, jobs on every core, and the request to end them.

#![warn(clippy::disallowed_methods)]

pub mod math;
pub mod parallel;
pub mod stop;
