//! NTC thermistor as the lower leg of a divider, with no amplifier. The circuit is in `docs/reference/board.md`.
//!
//! ```text
//! 1/T = 1/298.15 K + x/beta + square x^2 + cube x^3,   x = ln(R/R_25)
//! ```
//!
//! Without the last two terms this is the Beta equation. Steinhart and Hart's 1/T = A + B ln R + C ln^3 R is the same
//! curve: 1/beta = B + 3 C ln^2 R_25, square = 3 C ln R_25, cube = C.

use super::adc::{Characteristic, Point};
use super::element::{Curve, Element};
use super::pt1000::ratio_to_resistance;
use crate::math::{limit, ln};
use crate::parameter::{ConfigError, parameters};

parameters! {
    /// NTC thermistor in a divider.
    "sensor.ntc": Ntc {
        resistance_ohm: 10_000.0, "Ohm", 100.0 to 1.0e6, "resistance at 25 degC";
        beta_k: 3977.0, "K", 1000.0 to 10000.0, "1/T = 1/298.15 + x/beta_k + square_per_k x^2 + cube_per_k x^3, x = ln(R/resistance_ohm)";
        square_per_k: 0.0, "1/K", -1.0e-5 to 1.0e-5, "0 in the Beta equation";
        cube_per_k: 0.0, "1/K", 0.0 to 1.0e-6, "0 in the Beta equation";
        series_ohm: 10_000.0, "Ohm", 100.0 to 1.0e6, "upper resistor of the divider";
    }
}

/// 25 degC \[K\].
const REFERENCE_K: f32 = 298.15;
/// Temperatures that no thermistor exceeds; a reading beyond them is a broken channel \[K\].
const HOTTEST_K: f32 = 1000.0;
const COLDEST_K: f32 = 100.0;

impl Element for Ntc {
    type Curve = Divider;

    fn check_ranges(&self) -> Result<(), ConfigError> {
        self.check()
    }

    fn curve(&self) -> Divider {
        let low = Point { share: 0.0, value: 0.0 };
        Divider {
            ratio: Characteristic::through(low, Point { share: 1.0, value: 1.0 }),
            series_share: self.series_ohm / self.resistance_ohm,
            slope_per_k: 1.0 / self.beta_k,
            square_per_k: self.square_per_k,
            cube_per_k: self.cube_per_k,
        }
    }

    fn resolution_k(&self) -> f32 {
        let ratio = self.resistance_ohm / (self.resistance_ohm + self.series_ohm);
        REFERENCE_K * REFERENCE_K / (self.beta_k * ratio * (1.0 - ratio) * 4096.0)
    }
}

/// The divider with its computed constants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Divider {
    /// R/(R + R_series) over codes.
    ratio: Characteristic,
    /// R_series/R_25.
    series_share: f32,
    slope_per_k: f32,
    square_per_k: f32,
    cube_per_k: f32,
}

impl Curve for Divider {
    fn at_k(&self, ideal_code: f32) -> f32 {
        // A ratio at a rail is no resistance.
        let ratio = limit(self.ratio.at(ideal_code), 1.0e-4, 1.0 - 1.0e-4);
        let x = ln(self.series_share * ratio_to_resistance(ratio));
        let powers = self.slope_per_k + x * (self.square_per_k + x * self.cube_per_k);
        1.0 / limit(1.0 / REFERENCE_K + x * powers, 1.0 / HOTTEST_K, 1.0 / COLDEST_K)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Temperature \[K\] that a thermistor reads at a resistance.
    fn read_k(ntc: &Ntc, resistance_ohm: f32) -> f32 {
        let ratio = resistance_ohm / (resistance_ohm + ntc.series_ohm);
        ntc.curve().at_k(ratio * 32_768.0 - 4.0)
    }

    /// B = ln(R1/R2) / (1/T1 - 1/T2), as a data sheet states it for 25 and 85 degC.
    #[test]
    fn beta_is_what_a_data_sheet_means() {
        let ntc = Ntc::default();
        assert!((read_k(&ntc, 10_000.0) - 298.15).abs() < 0.001);
        let hot_ohm = 10_000.0 * (3977.0_f64 * (1.0 / 358.15 - 1.0 / 298.15)).exp();
        assert!((read_k(&ntc, hot_ohm as f32) - 358.15).abs() < 0.01);
    }

    /// The usual coefficients of a thermistor of 10 kohm, R-T curve 3.
    #[test]
    fn steinhart_and_hart_are_followed() {
        let (a, b, c) = (1.129_241e-3_f64, 2.341_077e-4_f64, 8.775_468e-8_f64);
        let reference = 10_000.0_f64.ln();
        let ntc = Ntc {
            beta_k: (1.0 / (b + 3.0 * c * reference * reference)) as f32,
            square_per_k: (3.0 * c * reference) as f32,
            cube_per_k: c as f32,
            ..Ntc::default()
        };
        assert_eq!(ntc.check(), Ok(()));
        for resistance_ohm in [95_000.0_f64, 32_650.0, 10_000.0, 3_600.0, 680.0] {
            let x = resistance_ohm.ln();
            let expected_k = 1.0 / (a + b * x + c * x * x * x);
            let error_k = f64::from(read_k(&ntc, resistance_ohm as f32)) - expected_k;
            assert!(error_k.abs() < 0.02, "{error_k} K at {expected_k}");
        }
    }

    #[test]
    fn the_resolution_is_that_at_25_degrees() {
        let ntc = Ntc { series_ohm: 3000.0, ..Ntc::default() };
        let code = 32_768.0 * 10.0 / 13.0;
        let eight_k = ntc.curve().at_k(code - 4.0) - ntc.curve().at_k(code + 4.0);
        assert!((ntc.resolution_k() / eight_k - 1.0).abs() < 0.01, "{eight_k}");
    }
}
