//! Calibration: value = gain (reading + correction) + offset. Two points give gain and offset; the correction follows
//! the bend between them, as the five points of a calibration certificate state it.

use super::adc::Characteristic;
use crate::math::limit;

/// Corrections at a quarter, half and three quarters of a sensor's range, as shares of it; both ends have none.
pub type Corrections = [f32; 3];

/// Calibration of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// Factor \[-\].
    pub gain: f32,
    /// In the sensor's unit.
    pub offset: f32,
    /// Correction that is added to the reading, linear between these points; as shares of the range \[-\].
    pub corrections: Corrections,
}

/// A sensor's value over codes, calibrated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibrated {
    line: Characteristic,
    bend: Option<Bend>,
}

/// The correction of a bent sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Bend {
    /// Quarters of the range over codes.
    quarters: Characteristic,
    /// Corrections at the quarters, in the sensor's unit.
    values: [f32; 5],
}

impl Calibrated {
    /// Creates a calibrated sensor with the range 0 to `range`, in its own unit.
    ///
    /// ```
    /// use model_core::sensing::adc::{Characteristic, Point};
    /// use model_core::sensing::calibration::{Calibrated, Calibration};
    ///
    /// let line = Characteristic::through(Point { share: 0.0, value: 0.0 }, Point { share: 1.0, value: 8.0 });
    /// let calibration = Calibration { gain: 1.0, offset: 0.0, corrections: [0.01, 0.0, 0.0] };
    /// let quarter = Calibrated::new(line, 8.0, calibration).at(0.25 * 32_768.0);
    /// assert!((quarter - 2.08).abs() < 0.001);
    /// ```
    pub fn new(line: Characteristic, range: f32, calibration: Calibration) -> Self {
        let Calibration { gain, offset, corrections } = calibration;
        let [a, b, c] = corrections.map(|share| gain * range * share);
        Self {
            line: line.scaled(gain, offset),
            bend: (corrections != [0.0; 3]).then(|| Bend {
                quarters: line.scaled(4.0 / range, 0.0),
                values: [0.0, a, b, c, 0.0],
            }),
        }
    }

    /// Value at an ideal code.
    pub fn at(&self, ideal_code: f32) -> f32 {
        let value = self.line.at(ideal_code);
        match &self.bend {
            None => value,
            Some(bend) => value + bend.at(ideal_code),
        }
    }
}

impl Bend {
    /// Not inlined: most sensors are straight, and this would slow down their readings.
    #[inline(never)]
    fn at(&self, ideal_code: f32) -> f32 {
        let place = limit(self.quarters.at(ideal_code), 0.0, 4.0);
        let before = place as usize;
        let value = |i: usize| self.values.get(i).copied().unwrap_or(0.0);
        value(before) + (place - before as f32) * (value(before + 1) - value(before))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensing::adc::Point;
    use proptest::prelude::*;

    fn sensor(corrections: Corrections) -> Calibrated {
        let line = Characteristic::of_part(
            Point { share: 0.0, value: -1.0e5 },
            Point { share: 1.0, value: 7.0e5 },
        );
        Calibrated::new(line, 6.0e5, Calibration { gain: 1.02, offset: 300.0, corrections })
    }

    /// Ideal code of a reading \[Pa\].
    fn code(reading_pa: f32) -> f32 {
        (reading_pa + 1.0e5) / 8.0e5 * 32_768.0
    }

    #[test]
    fn five_points_of_a_certificate_come_out() {
        let sensor = sensor([0.01, -0.02, 0.005]);
        for (reading_pa, correction_pa) in [
            (-5.0e4, 0.0),
            (0.0, 0.0),
            (0.75e5, 3.0e3),
            (1.5e5, 6.0e3),
            (3.0e5, -12.0e3),
            (4.5e5, 3.0e3),
            (6.0e5, 0.0),
            (6.5e5, 0.0),
        ] {
            let expected = 1.02 * (reading_pa + correction_pa) + 300.0;
            let found = sensor.at(code(reading_pa));
            assert!((found - expected).abs() < 0.5, "{reading_pa}: {found} for {expected}");
        }
    }

    proptest! {
        /// Any corrections within their range leave a reading that rises with the code.
        #[test]
        fn a_corrected_reading_rises(
            corrections in [-0.05_f32..0.05, -0.05_f32..0.05, -0.05_f32..0.05],
            low in 0.0_f32..30_000.0,
            step in 50.0_f32..2_500.0,
        ) {
            let sensor = sensor(corrections);
            prop_assert!(sensor.at(low + step) > sensor.at(low));
        }
    }
}
