//! The valve controller's firmware.
//!
//! Two executors run the tasks. The upper one, in an interrupt, has the control task alone: at every
//! whole millisecond it samples, steps the core and drives the valves. The lower one, in the thread,
//! has the line to the host and the supervisor, which feeds the watchdog. The folder `board` knows
//! the chip; everything else knows the traits in [`board`] only.

#![no_std]
#![no_main]
#![deny(clippy::indexing_slicing, clippy::unwrap_used)]

mod board;
mod control;
#[cfg(feature = "pico")]
mod float;
mod link;
mod shared;
mod source;
mod supervisor;
