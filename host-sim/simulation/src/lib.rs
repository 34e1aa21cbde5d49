//! The loop of one run: plant, faults, front end and board, a step of the core at a time.

#![warn(clippy::disallowed_methods)]

pub mod adc;
pub mod board;
pub mod elements;
pub mod encoder;
pub mod faults;
mod noise;
pub mod rig;
pub mod run;
