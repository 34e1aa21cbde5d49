//! Gas temperature: the sensor's own parameters, and what its element makes of the converter's codes.

use super::adc::{Line, Point};
use super::platinum::{platinum_resistance_ohm, platinum_temperature_k};
use crate::config::{ConfigError, within};
use crate::parameter::parameters;

parameters! {
    /// The gas sensor, whatever its element is.
    "sensor.gas": GasSensor {
        time_constant_s: 3.0, "s", 0.001 to 1000.0, "lag of the element";
        housing_time_constant_s: 0.2, "s", 0.0 to 1000.0, "lag of its housing, in series";
        noise_k: 0.05, "K", 0.0 to 100.0, "noise of one conversion, standard deviation";
        gain: 1.0, "", 0.5 to 2.0, "calibration: temperature = gain reading + offset_k";
        offset_k: 0.0, "K", -500.0 to 500.0, "calibration: temperature = gain reading + offset_k";
    }
}

parameters! {
    /// Pt1000 in a half bridge, amplified so that this range takes 5 to 95 % of the reference.
    "sensor.gas": Pt1000 {
        range_min_k: 270.0, "K", 73.0 to 800.0, "lowest temperature resolved";
        range_max_k: 330.0, "K", 74.0 to 1100.0, "highest temperature resolved";
    }
}

/// Resistance of a Pt1000 at 0 degC \[ohm\].
const PT1000_OHM: f32 = 1000.0;
/// Upper resistor of the half bridge \[ohm\].
const BRIDGE_OHM: f32 = 4700.0;

impl Pt1000 {
    /// Bridge ratio over codes.
    fn line(&self) -> Line {
        Line::through(
            Point { share: 0.05, value: bridge_ratio(self.range_min_k) },
            Point { share: 0.95, value: bridge_ratio(self.range_max_k) },
        )
    }
}

/// What senses the gas temperature.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum GasElement {
    /// Pt1000 in a half bridge.
    Pt1000(Pt1000),
}

impl Default for GasElement {
    fn default() -> Self {
        Self::Pt1000(Pt1000::default())
    }
}

impl GasElement {
    /// Checks every value.
    ///
    /// # Errors
    /// The first value that is not a number or lies outside of its range.
    pub fn check(&self) -> Result<(), ConfigError> {
        match self {
            Self::Pt1000(bridge) => {
                // The least of the upper end follows from the lower one.
                const HIGHEST_K: f32 = 1100.0;
                Pt1000 { range_max_k: HIGHEST_K, ..*bridge }.check()?;
                let least_k = bridge.range_min_k + 1.0;
                within("sensor.gas.range_max_k", bridge.range_max_k, least_k, HIGHEST_K)
            }
        }
    }

    /// What one code of 12 bit is worth, mean over its range \[K\].
    pub fn resolution_k(&self) -> f32 {
        match self {
            Self::Pt1000(bridge) => (bridge.range_max_k - bridge.range_min_k) / (0.9 * 4096.0),
        }
    }
}

/// A gas sensor with its constants worked out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GasLine {
    gain: f32,
    offset_k: f32,
    element: ElementLine,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum ElementLine {
    Pt1000(Line),
}

impl GasLine {
    /// Works the constants out.
    pub fn new(sensor: &GasSensor, element: &GasElement) -> Self {
        let element = match element {
            GasElement::Pt1000(bridge) => ElementLine::Pt1000(bridge.line()),
        };
        Self { gain: sensor.gain, offset_k: sensor.offset_k, element }
    }

    /// Temperature \[K\] at an ideal code.
    pub fn at(&self, ideal_code: f32) -> f32 {
        let reading_k = match &self.element {
            ElementLine::Pt1000(line) => {
                let resistance_ohm = BRIDGE_OHM * ratio_to_resistance(line.at(ideal_code));
                platinum_temperature_k(PT1000_OHM, resistance_ohm)
            }
        };
        self.gain * reading_k + self.offset_k
    }
}

/// Ratio of the half bridge, R/(R + R_upper), at a temperature \[K\].
fn bridge_ratio(temperature_k: f32) -> f32 {
    let resistance_ohm = platinum_resistance_ohm(PT1000_OHM, temperature_k);
    resistance_ohm / (resistance_ohm + BRIDGE_OHM)
}

/// R/R_upper from the ratio R/(R + R_upper).
fn ratio_to_resistance(ratio: f32) -> f32 {
    ratio / (1.0 - ratio)
}
