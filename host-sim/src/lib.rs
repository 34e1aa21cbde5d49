//! Simulated plant, virtual board, scenarios, reports: everything behind the `thermyo` command.
//!
//! The plant is f64 and knows more than the core; the core is `model-core`, unchanged. They meet in
//! [`simulation`], over raw ADC codes and valve openings.

pub mod analysis;
pub mod board;
#[cfg(feature = "command")]
pub mod checkout;
#[cfg(feature = "command")]
pub mod cli;
pub mod commands;
pub mod files;
pub mod fmu;
#[cfg(feature = "command")]
mod inside;
mod math;
pub mod plant;
pub mod report;
pub mod scenario;
#[cfg(feature = "command")]
pub mod serve;
pub mod simulation;
pub mod stop;
