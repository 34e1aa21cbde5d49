//! Ratiometric pressure sensor: 10 to 90 % of the reference over its range.

use super::adc::{Adc, Line, Point};
use super::{Calibration, Quality};
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

    /// What its readings are worth \[Pa\].
    #[inline(never)]
    pub fn quality(&self, adc: &Adc) -> Quality {
        let resolution = self.gain * (self.range_pa / (0.8 * 4096.0));
        let rounding_pa = LINEARITY_LSB * resolution;
        let noise_pa2 = self.noise_pa * self.noise_pa;
        Quality {
            noise2: noise_pa2 / f32::from(OVERSAMPLING) + rounding_pa * rounding_pa,
            resolution,
            wide: 0.5 * adc.wide_code_lsb * resolution,
        }
    }
}
