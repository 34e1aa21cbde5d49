//! Simulated plant, virtual board, scenarios, reports: everything behind the `thermyo` command.
//!
//! The plant is f64 and knows more than the core; the core is `model-core`, unchanged. They meet in
//! [`run`], over raw ADC codes and valve openings.

pub mod adc;
pub mod analysis;
pub mod board;
#[cfg(feature = "command")]
pub mod cli;
pub mod core_config;
pub mod core_model;
pub mod evaluate;
pub mod faults;
pub mod identify;
pub mod input;
pub mod measured;
#[cfg(feature = "command")]
pub mod monitor;
pub mod output;
pub mod parallel;
pub mod plant;
pub mod profile;
pub mod replay;
pub mod report;
pub mod reproduce;
pub mod rows;
pub mod run;
pub mod scenario;
pub mod smoother;
pub mod summary;
pub mod sweep;
pub mod table;
pub mod trace;
pub mod tune;
