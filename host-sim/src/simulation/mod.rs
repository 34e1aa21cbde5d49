//! The loop of one run: plant, faults, front end and board, a step of the core at a time.

pub mod adc;
pub mod elements;
pub mod faults;
pub mod rig;
pub mod run;
