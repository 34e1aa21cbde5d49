//! Platinum resistance thermometers, IEC 60751.

use crate::math::sqrt;

/// R = R0 (1 + A t + B t^2) above 0 degC, \[1/K\].
pub const PLATINUM_A: f32 = 3.9083e-3;
/// Coefficient B of the same equation, \[1/K2\].
pub const PLATINUM_B: f32 = -5.775e-7;
/// 0 degC \[K\].
pub const ZERO_CELSIUS_K: f32 = 273.15;

/// Resistance \[ohm\] at a temperature \[K\] of an element with `zero_ohm` at 0 degC, without the term for temperatures
/// below 0 degC (0.02 % at -40 degC). Not inlined: four calls, each at a start.
#[inline(never)]
pub fn platinum_resistance_ohm(zero_ohm: f32, temperature_k: f32) -> f32 {
    let celsius = temperature_k - ZERO_CELSIUS_K;
    zero_ohm * (1.0 + celsius * (PLATINUM_A + celsius * PLATINUM_B))
}

/// Temperature \[K\] of such an element at a resistance \[ohm\]: the quadratic of [`platinum_resistance_ohm`], solved
/// without cancellation. Not inlined: two calls.
#[inline(never)]
pub fn platinum_temperature_k(zero_ohm: f32, resistance_ohm: f32) -> f32 {
    let excess = resistance_ohm / zero_ohm - 1.0;
    let root = sqrt(PLATINUM_A * PLATINUM_A + 4.0 * PLATINUM_B * excess);
    ZERO_CELSIUS_K + 2.0 * excess / (PLATINUM_A + root)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// IEC 60751 tables, 0 to 100 degC.
    #[test]
    fn platinum_table() {
        for (celsius, ohm) in [(0.0, 1000.0), (25.0, 1097.35), (50.0, 1193.97), (100.0, 1385.06)] {
            let r = platinum_resistance_ohm(1000.0, celsius + ZERO_CELSIUS_K);
            assert!((r / ohm - 1.0).abs() < 1e-5, "{r} for {ohm}");
            let t = platinum_temperature_k(1000.0, ohm);
            assert!((t - celsius - ZERO_CELSIUS_K).abs() < 0.01, "{t} at {celsius} degC");
        }
    }
}
