//! Potentiometer: 5 to 95 % of the reference over its range.

use super::Calibration;
use super::adc::{Characteristic, Point};
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
    pub fn characteristic(&self) -> Characteristic {
        let calibration = Calibration { gain: self.gain, offset: self.offset_m };
        let zero = Point { share: 0.05, value: 0.0 };
        Characteristic::through(zero, Point { share: 0.95, value: self.range_m })
            .calibrated(calibration)
    }

    /// What one code of 12 bit is worth \[m\]. Eight conversions are summed, so that the noise of a reading is
    /// less.
    pub fn resolution_m(&self) -> f32 {
        self.gain * (self.range_m / (0.9 * 4096.0))
    }
}
