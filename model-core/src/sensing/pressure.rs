//! Pressure sensor: 10 to 90 % of the reference over its range, ratiometric on the converter or from a part that is
//! read over a bus.

use super::adc::{Characteristic, Point};
use super::calibration::{Calibrated, Calibration};
use super::part::Limits;
use crate::parameter::{ConfigError, parameters};
use crate::sample::OVERSAMPLING;

/// Error that remains after linearising the converter, in 12-bit codes.
const LINEARITY_LSB: f32 = 0.25;

parameters! {
    /// Absolute pressure sensor.
    "sensor.pressure": PressureSensor {
        range_pa: 700_000.0, "Pa", 1.0e3 to 1.0e9, "full scale; the range starts at 0";
        noise_pa: 150.0, "Pa", 0.0 to 1.0e8, "noise of one conversion, standard deviation";
        gain: 1.0, "", 0.5 to 2.0, "calibration: pressure = gain (reading + correction) + offset_pa";
        offset_pa: 0.0, "Pa", -1.0e8 to 1.0e8, "calibration: pressure = gain (reading + correction) + offset_pa";
        correction_25: 0.0, "", -0.05 to 0.05, "calibration: correction at a quarter of the range, as a share of it";
        correction_50: 0.0, "", -0.05 to 0.05, "at half of the range; linear between, none at both ends";
        correction_75: 0.0, "", -0.05 to 0.05, "at three quarters of the range";
    }
}

parameters! {
    /// Honeywell MPR on I2C, transfer function A: 10 to 90 % of its 24 bits over `sensor.pressure.range_pa`. It has a
    /// reading every 6 ms.
    "sensor.mpr": Mpr {
        timeout_s: 0.05, "s", 0.01 to 0.2, "silence after which the part is lost";
    }
}

/// Type of the pressure sensor.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum PressurePart {
    /// A ratiometric sensor on the converter.
    #[default]
    Ratiometric,
    /// Honeywell MPR.
    Mpr(Mpr),
}

/// Codes of a digital part within 2 % of either end are no pressure.
const LOWEST: u16 = 32_768 / 50;
const HIGHEST: u16 = 32_767 - LOWEST;

impl PressurePart {
    /// Checks every value.
    ///
    /// # Errors
    /// The first value that is not a number or lies outside of its range.
    pub fn check(&self) -> Result<(), ConfigError> {
        match self {
            Self::Ratiometric => Ok(()),
            Self::Mpr(mpr) => mpr.check(),
        }
    }

    /// Whether it is read over a bus, at its own rate.
    pub fn is_digital(&self) -> bool {
        *self != Self::Ratiometric
    }

    /// Limits of a digital sensor.
    pub(super) fn part(&self) -> Option<Limits> {
        match self {
            Self::Ratiometric => None,
            // Nothing is driven before the first reading has arrived or is known to be missing.
            Self::Mpr(mpr) => Some(Limits {
                timeout_s: mpr.timeout_s,
                first_s: 0.05,
                latency_s: 0.0,
                codes: LOWEST..=HIGHEST,
            }),
        }
    }

    /// Pressure of the sensor over codes.
    pub(super) fn calibrated(&self, sensor: &PressureSensor) -> Calibrated {
        let zero = Point { share: 0.1, value: 0.0 };
        let full = Point { share: 0.9, value: sensor.range_pa };
        let line = if self.is_digital() {
            Characteristic::of_part(zero, full)
        } else {
            Characteristic::through(zero, full)
        };
        let calibration = Calibration {
            gain: sensor.gain,
            offset: sensor.offset_pa,
            corrections: [sensor.correction_25, sensor.correction_50, sensor.correction_75],
        };
        Calibrated::new(line, sensor.range_pa, calibration)
    }

    /// Variance of the noise of one reading, including the error that remains after linearising the converter \[Pa2\].
    pub fn noise_pa2(&self, sensor: &PressureSensor) -> f32 {
        if self.is_digital() {
            // Its LSB is an eighth of a 12-bit LSB; the quantization noise is 0.3 LSB.
            let rounding_pa = (0.3 / 8.0) * sensor.resolution_pa();
            return sensor.noise_pa * sensor.noise_pa + rounding_pa * rounding_pa;
        }
        let rounding_pa = LINEARITY_LSB * sensor.resolution_pa();
        sensor.noise_pa * sensor.noise_pa / f32::from(OVERSAMPLING) + rounding_pa * rounding_pa
    }
}

impl PressureSensor {
    /// Width of a 12-bit code \[Pa\].
    pub fn resolution_pa(&self) -> f32 {
        self.gain * (self.range_pa / (0.8 * 4096.0))
    }
}
