//! f64 functions that give the same bits on every machine, parallel jobs, and the stop request.

#![warn(clippy::disallowed_methods)]

pub mod math;
pub mod parallel;
pub mod stop;
