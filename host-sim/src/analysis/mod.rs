//! What a recorded run is compared with: the core's model in f64, the best estimate of it, signals.

pub mod core_model;
pub mod signals;
pub mod smoother;
