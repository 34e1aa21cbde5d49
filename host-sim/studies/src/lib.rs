//! Studies: tuning, driving a real muscle along a profile, calibration, stops.

pub mod calibrate;
pub mod drive;
pub mod joint_tune;
pub mod stops;
pub mod tune;
