//! Ratiometric pressure sensor: 10 to 90 % of the reference over its range.

use super::Calibration;
use super::adc::{Line, Point};
use crate::parameter::parameters;
use crate::sample::OVERSAMPLING;

/// What linearising the converter leaves, in codes of 12 bit.
const LINEARITY_LSB: f32 = 0.25;

parameters! {
    /// Absolute pressure sensor.
    "sensor.pressure": PressureSensor {
        range_pa: 700_000.0, "Pa", 1.0e3 to 1.0e9, "full scale; the range starts at 0";
        noise_pa: 150.0, "Pa", 0.0 to 1.0e8, "noise of one conversion, standard deviation";
        gain: 1.0, "", 0.5 to 2.0, "calibration: pressure = gain reading + offset_pa";
        offset_pa: 0.0, "Pa", -1.0e8 to 1.0e8, "calibration: pressure = gain reading + offset_pa";
    }
}

impl PressureSensor {
    /// Pressure over codes.
    pub fn line(&self) -> Line {
        let calibration = Calibration { gain: self.gain, offset: self.offset_pa };
        let zero = Point { share: 0.1, value: 0.0 };
        Line::through(zero, Point { share: 0.9, value: self.range_pa }).calibrated(calibration)
    }

    /// What one code of 12 bit is worth \[Pa\].
    pub fn resolution_pa(&self) -> f32 {
        self.gain * (self.range_pa / (0.8 * 4096.0))
    }

    /// Variance of the noise of one reading, with what linearising the converter leaves \[Pa2\].
    pub fn noise_pa2(&self) -> f32 {
        let rounding_pa = LINEARITY_LSB * self.resolution_pa();
        self.noise_pa * self.noise_pa / f32::from(OVERSAMPLING) + rounding_pa * rounding_pa
    }
}
