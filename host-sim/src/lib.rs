//! Simulated plant, virtual board, scenarios and reports.
pub mod adc;
pub mod plant;
pub mod profile;
pub mod scenario;
