//! Studies: sweeps of a scenario, tuning, driving a real muscle along a profile, calibration.

pub mod calibrate;
pub mod drive;
pub mod sweep;
pub mod tune;
