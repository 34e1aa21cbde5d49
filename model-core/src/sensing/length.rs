//! Potentiometer: 5 to 95 % of the reference over its range.

use super::adc::{Characteristic, Point};
use super::calibration::{Calibrated, Calibration};
use crate::parameter::parameters;

parameters! {
    /// Length potentiometer.
    "sensor.length": LengthSensor {
        range_m: 0.4, "m", 0.001 to 100.0, "full scale; the range starts at 0";
        gain: 1.0, "", 0.5 to 2.0, "calibration: length = gain (reading + correction) + offset_m";
        offset_m: 0.0, "m", -100.0 to 100.0, "calibration: length = gain (reading + correction) + offset_m";
        correction_25: 0.0, "", -0.05 to 0.05, "calibration: correction at a quarter of the range, as a share of it";
        correction_50: 0.0, "", -0.05 to 0.05, "at half of the range; linear between, none at both ends";
        correction_75: 0.0, "", -0.05 to 0.05, "at three quarters of the range";
    }
}

impl LengthSensor {
    /// Length over codes.
    pub fn calibrated(&self) -> Calibrated {
        let zero = Point { share: 0.05, value: 0.0 };
        let line = Characteristic::through(zero, Point { share: 0.95, value: self.range_m });
        let calibration = Calibration {
            gain: self.gain,
            offset: self.offset_m,
            corrections: [self.correction_25, self.correction_50, self.correction_75],
        };
        Calibrated::new(line, self.range_m, calibration)
    }

    /// Width of a 12-bit code \[m\]. A reading's noise is less, because eight conversions are summed.
    pub fn resolution_m(&self) -> f32 {
        self.gain * (self.range_m / (0.9 * 4096.0))
    }
}
