//! Errors of the quantities that a fit takes as known; stated errors include them. Assumed.

/// A weighed load, or the force of a load cell, over the true one \[-\].
pub const LOAD_OFF: f64 = 1.01;
/// Slip and creep over the configured ones \[-\].
pub const HYSTERESIS_OFF: f64 = 1.2;
/// Added to a measured pressure \[Pa\].
pub const PRESSURE_OFF_PA: f64 = 3.0e3;
