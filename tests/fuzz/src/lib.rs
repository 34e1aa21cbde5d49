//! Random inputs, and properties that have to hold for all of them.
//!
//! A case is a few hundred bytes. [`core`], [`frames`], [`scenarios`], [`tables`] and [`hosts`]
//! each derive their input from them, and panic if a property does not hold. [`hunt`] generates
//! cases, half of them from those of `corpus/`, and shortens the ones that fail.

pub mod any;
pub mod config;
pub mod core;
pub mod flush;
pub mod frames;
pub mod hosts;
pub mod hunt;
pub mod scenarios;
mod signal;
pub mod tables;
