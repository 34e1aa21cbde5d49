//! Simulated plant, virtual board, scenarios and reports.
pub mod scenario;
