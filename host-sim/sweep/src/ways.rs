//! Methods for the gas temperature that a sweep compares.

use thermyo_record::summary::Errors;

/// Method for the gas temperature: name, column of `sweep.csv`, error.
pub(super) type Way = (&'static str, &'static str, fn(&Errors) -> f64);

pub(super) const WAYS: [Way; 4] = [
    ("bare sensor in the gas", "sensor_gas_rmse_k", |errors| errors.sensor_gas),
    ("bare sensor in the wall", "sensor_wall_rmse_k", |errors| errors.sensor_wall),
    ("forward model", "model_rmse_k", |errors| errors.model),
    ("estimate", "estimate_rmse_k", |errors| errors.estimate),
];
pub(super) const BARE: usize = 0;
pub(super) const ESTIMATE: usize = 3;
