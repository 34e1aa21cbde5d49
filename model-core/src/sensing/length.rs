//! Potentiometer: 5 to 95 % of the reference over its range.

use super::adc::{Adc, Line, Point};
use super::{Calibration, Quality};
use crate::parameter::parameters;

parameters! {
    /// Length potentiometer.
    "sensor.length": LengthSensor {
        range_m: 0.4, "m", 0.001 to 100.0, "full scale; the range starts at 0";
        gain: 1.0, "", 0.5 to 2.0, "calibration: length = gain reading + offset_m";
        offset_m: 0.0, "m", -100.0 to 100.0, "calibration: length = gain reading + offset_m";
    }
}

impl LengthSensor {
    /// Length over codes.
    pub fn line(&self) -> Line {
        let calibration = Calibration { gain: self.gain, offset: self.offset_m };
        let zero = Point { share: 0.05, value: 0.0 };
        Line::through(zero, Point { share: 0.95, value: self.range_m }).calibrated(calibration)
    }

    /// What its readings are worth \[m\]: eight conversions are summed, so that their noise is less than
    /// what a code shows.
    #[inline(never)]
    pub fn quality(&self, adc: &Adc) -> Quality {
        let resolution = self.gain * (self.range_m / (0.9 * 4096.0));
        Quality {
            noise2: resolution * resolution,
            resolution,
            wide: 0.5 * adc.wide_code_lsb * resolution,
        }
    }
}
