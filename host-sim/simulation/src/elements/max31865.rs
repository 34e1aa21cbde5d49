//! Platinum resistor over the reference resistor of a MAX31865.

use super::pt1000::pt1000_ohm;
use model_core::sensing::gas::Max31865;

/// Fraction of the chip's scale at a temperature \[K\].
pub fn share(chip: &Max31865, temperature_k: f64) -> f64 {
    f64::from(chip.zero_ohm) / 1000.0 * pt1000_ohm(temperature_k) / f64::from(chip.reference_ohm)
}
