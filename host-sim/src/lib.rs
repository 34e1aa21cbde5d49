//! Simulated plant, virtual board, scenarios and reports.
pub mod plant;
pub mod report;
pub mod scenario;
