//! From the code of the angle's sensor to the angle.

use super::config::{JointConfig, Mechanism};
use super::encoder::AnglePart;
use crate::sample::AdcCode;
use crate::sensing::adc::{Characteristic, Linearisation, Point};

/// Conversion from code to angle: 5 to 95 % of the scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct AngleLine {
    /// For a potentiometer: the converter's linearisation, and half the width of its widest codes
    /// \[rad\].
    converter: Option<(Linearisation, f32)>,
    characteristic: Characteristic,
}

impl AngleLine {
    pub(super) fn new(config: &JointConfig) -> Self {
        let Mechanism { sensor_minimum_rad, .. } = config.mechanism;
        let low = Point { share: 0.05, value: sensor_minimum_rad };
        let high = Point { share: 0.95, value: config.sensor_maximum_rad() };
        let [a, _] = &config.muscles;
        match config.angle_part {
            AnglePart::Potentiometer => {
                let characteristic = Characteristic::through(low, high);
                let wide_rad = a.sensors.adc.half_width(characteristic.per_code());
                let converter = Some((Linearisation::new(&a.sensors.adc), wide_rad));
                Self { converter, characteristic }
            }
            AnglePart::As5600 => {
                Self { converter: None, characteristic: Characteristic::of_part(low, high) }
            }
        }
    }

    /// Angle, and half the width of its code if a healthy channel may stay in it \[rad\].
    pub(super) fn read(&self, code: AdcCode) -> (f32, f32) {
        match &self.converter {
            Some((linearisation, wide_rad)) => {
                let wide_rad = if linearisation.widens(code) { *wide_rad } else { 0.0 };
                (self.characteristic.at(linearisation.ideal(code)), wide_rad)
            }
            None => (self.characteristic.at(f32::from(code.0)), 0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::encoder::{TURN, code};
    use super::*;
    use core::f32::consts::TAU;

    /// A code's angle equals that of its reading, to 0.21 LSB of 1.5 mrad.
    #[test]
    fn a_turn_begins_at_the_sensors_minimum() {
        let mut config = JointConfig { angle_part: AnglePart::As5600, ..JointConfig::default() };
        config.mechanism.sensor_minimum_rad = -2.5;
        let line = AngleLine::new(&config);
        for of in (0..TURN).step_by(37) {
            let expected_rad = -2.5 + TAU / 4096.0 * f32::from(of);
            for odd in [false, true] {
                let (angle_rad, wide_rad) = line.read(code(of, odd));
                assert!((angle_rad - expected_rad).abs() < 3.4e-4, "{of}: {angle_rad}");
                assert_eq!(wide_rad, 0.0);
            }
        }
    }
}
