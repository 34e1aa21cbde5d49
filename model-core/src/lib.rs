//! Thermodynamic model, temperature estimator and valve controller of a pneumatic muscle actuator
//! (pMA, McKibben muscle), as one core for the board and the host.
//!
//! The core takes a [`Sample`] of raw ADC codes and returns a [`Telemetry`] with the [`Command`] of
//! valve openings, once per fixed step. It is `no_std`, allocates nothing, cannot panic, and
//! computes in f32 with operations that give the same bits on every machine.
//!
//! ```
//! use model_core::{AdcCode, Command, Config, Core, Sample, SetPoint};
//!
//! let mut core = Core::new(&Config::default()).unwrap();
//! let sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));
//! assert_eq!(core.step(&sample).command, Command::VENT);
//! core.set(SetPoint::MassFlowCycle { flow_kg_s: 3.6e-4, period_s: 5.0 }).unwrap();
//! ```
//!
//! Equation numbers are those of Kopecny and Zalud, "Sensors for Evaluation of Thermodynamical
//! Model of pMA", 2013.

#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]
#![warn(missing_docs)]
#![deny(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![cfg_attr(test, allow(clippy::indexing_slicing, clippy::unwrap_used, clippy::panic))]
// `!(x > 0.0)` is how a NaN is caught.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

pub mod config;
pub mod control;
pub mod estimation;
pub mod forward_model;
pub mod joint;
pub mod math;
pub mod parameter;
pub mod physics;
pub mod safety;
pub mod sample;
pub mod sensing;
mod step;
pub mod step_counts;

pub use config::Config;
pub use control::SetPointError;
pub use parameter::ConfigError;
pub use sample::{
    AdcCode, Command, Duty, Estimate, Faults, Mode, PartCode, RawCode, Sample, SetPoint, Telemetry,
};
pub use step::Core;
