//! Simulated plant, virtual board, scenarios and reports.
pub mod board;
pub mod monitor;
pub mod plant;
pub mod replay;
pub mod scenario;
