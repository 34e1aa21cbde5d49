//! Pt1000 in a half bridge, behind an amplifier. The circuit is in `docs/reference/board.md`.

use super::adc::{Characteristic, Point};
use super::element::{Curve, Element};
use super::platinum::{platinum_resistance_ohm, platinum_temperature_k};
use crate::parameter::{ConfigError, parameters, within};

parameters! {
    /// Pt1000 in a half bridge, amplified so that this range spans 5 to 95 % of the reference.
    "sensor.gas": Pt1000 {
        range_min_k: 270.0, "K", 73.0 to 800.0, "lowest temperature resolved";
        range_max_k: 330.0, "K", 74.0 to 1100.0, "highest temperature resolved";
    }
}

/// Resistance at 0 degC \[ohm\].
const ZERO_OHM: f32 = 1000.0;
/// Upper resistor of the half bridge \[ohm\].
const BRIDGE_OHM: f32 = 4700.0;

impl Element for Pt1000 {
    type Curve = Bridge;

    fn check_ranges(&self) -> Result<(), ConfigError> {
        // The minimum of the upper end depends on the lower one.
        const HIGHEST_K: f32 = 1100.0;
        Self { range_max_k: HIGHEST_K, ..*self }.check()?;
        within("sensor.gas.range_max_k", self.range_max_k, self.range_min_k + 1.0, HIGHEST_K)
    }

    fn curve(&self) -> Bridge {
        let [low, high] = [(0.05, self.range_min_k), (0.95, self.range_max_k)]
            .map(|(share, temperature_k)| Point { share, value: bridge_ratio(temperature_k) });
        Bridge { ratio: Characteristic::through(low, high) }
    }

    fn resolution_k(&self) -> f32 {
        (self.range_max_k - self.range_min_k) / (0.9 * 4096.0)
    }
}

/// Bridge ratio over codes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bridge {
    ratio: Characteristic,
}

impl Curve for Bridge {
    fn at_k(&self, ideal_code: f32) -> f32 {
        let resistance_ohm = BRIDGE_OHM * ratio_to_resistance(self.ratio.at(ideal_code));
        platinum_temperature_k(ZERO_OHM, resistance_ohm)
    }
}

/// Ratio of the half bridge, R/(R + R_upper), at a temperature \[K\].
fn bridge_ratio(temperature_k: f32) -> f32 {
    let resistance_ohm = platinum_resistance_ohm(ZERO_OHM, temperature_k);
    resistance_ohm / (resistance_ohm + BRIDGE_OHM)
}

/// R/R_upper from the ratio R/(R + R_upper).
pub(super) fn ratio_to_resistance(ratio: f32) -> f32 {
    ratio / (1.0 - ratio)
}
