//! Sensors of a joint: pressure and gas of either muscle, and the angle.

use super::{Gauge, LEAST_SPAN, Sensor};
use model_core::Config;
use model_core::joint::{JointConfig, JointTelemetry};
use thermyo_protocol::Side;

/// A sensor of a joint that can be calibrated. Its muscles have no length sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointSensor {
    /// Absolute pressure of a muscle \[Pa\].
    Pressure(Side),
    /// Gas temperature of a muscle \[K\].
    Gas(Side),
    /// Angle \[rad\].
    Angle,
}

/// The muscle of a side, a or b.
fn of_side<T>(side: Side, [a, b]: [T; 2]) -> T {
    match side {
        Side::A => a,
        Side::B => b,
    }
}

impl JointSensor {
    /// The muscle's sensor and its side, unless it is the angle.
    fn of_muscle(self) -> Option<(Side, Sensor)> {
        match self {
            Self::Pressure(side) => Some((side, Sensor::Pressure)),
            Self::Gas(side) => Some((side, Sensor::Gas)),
            Self::Angle => None,
        }
    }
}

fn muscle(config: &JointConfig, side: Side) -> &Config {
    of_side(side, config.muscles.each_ref())
}

impl Gauge for JointSensor {
    type Config = JointConfig;
    type Sample = JointTelemetry;

    fn unit(self) -> &'static str {
        self.of_muscle().map_or("rad", |(_, sensor)| sensor.unit())
    }

    fn text(self, value: f64) -> String {
        let degrees = || format!("{:.2} deg", value.to_degrees());
        self.of_muscle().map_or_else(degrees, |(_, sensor)| sensor.text(value))
    }

    fn range(self, config: &JointConfig) -> f64 {
        match self.of_muscle() {
            Some((side, sensor)) => sensor.range(muscle(config, side)),
            None => f64::from(config.sensor_maximum_rad() - config.mechanism.sensor_minimum_rad),
        }
    }

    fn least_span(self, config: &JointConfig) -> f64 {
        match self.of_muscle() {
            Some((side, sensor)) => sensor.least_span(muscle(config, side)),
            None => LEAST_SPAN * self.range(config),
        }
    }

    fn least_pa(self, config: &JointConfig) -> Option<f64> {
        self.of_muscle().and_then(|(side, sensor)| sensor.least_pa(muscle(config, side)))
    }

    /// The angle has no calibration beyond the angles at the ends of its sensor: it is read as on the board.
    fn read(self, config: &JointConfig, telemetry: &JointTelemetry) -> f64 {
        match self.of_muscle() {
            Some((side, sensor)) => {
                let sample = of_side(side, telemetry.muscles).sample;
                sensor.read(muscle(config, side), &sample)
            }
            None => f64::from(telemetry.angle_rad),
        }
    }

    fn corrected(self, config: &JointConfig, gain: f64, offset: f64) -> JointConfig {
        let mut config = *config;
        if let Some((side, sensor)) = self.of_muscle() {
            let one = of_side(side, config.muscles.each_mut());
            *one = sensor.corrected(one, gain, offset);
            return config;
        }
        let least_rad = f64::from(config.mechanism.sensor_minimum_rad);
        let most_rad = f64::from(config.sensor_maximum_rad());
        let right = |angle_rad: f64| gain * angle_rad + offset;
        if config.angle_part.is_digital() {
            // A turn of an encoder is exact: only its offset is corrected, at the middle.
            let middle_rad = 0.5 * (least_rad + most_rad);
            let by_rad = right(middle_rad) - middle_rad;
            config.mechanism.sensor_minimum_rad = (least_rad + by_rad) as f32;
        } else {
            config.mechanism.sensor_minimum_rad = right(least_rad) as f32;
            config.mechanism.sensor_maximum_rad = right(most_rad) as f32;
        }
        config
    }
}

#[cfg(test)]
mod tests {
    use super::super::Point;
    use super::*;
    use model_core::joint::encoder::AnglePart;

    const POINTS: [Point; 2] =
        [Point { reading: -0.5, reference: -0.45 }, Point { reading: 0.3, reference: 0.38 }];

    #[test]
    fn a_potentiometer_reads_the_reference_at_both_points() {
        let config = JointConfig::default();
        let right = JointSensor::Angle.calibrated(&config, POINTS).unwrap();
        let (old, new) = (config.mechanism, right.mechanism);
        for Point { reading, reference } in POINTS {
            let share = (reading as f32 - old.sensor_minimum_rad)
                / (old.sensor_maximum_rad - old.sensor_minimum_rad);
            let angle_rad =
                new.sensor_minimum_rad + share * (new.sensor_maximum_rad - new.sensor_minimum_rad);
            assert!((angle_rad - reference as f32).abs() < 1e-5, "{angle_rad}, {reference}");
        }
    }

    /// Half of the difference between both points remains.
    #[test]
    fn an_encoder_keeps_its_turn() {
        let config = JointConfig { angle_part: AnglePart::As5600, ..JointConfig::default() };
        let points =
            [Point { reading: -0.4, reference: -0.3 }, Point { reading: 0.4, reference: 0.5 }];
        let right = JointSensor::Angle.calibrated(&config, points).unwrap().mechanism;
        let moved_rad = right.sensor_minimum_rad - config.mechanism.sensor_minimum_rad;
        assert!((moved_rad - 0.1).abs() < 1e-5, "{moved_rad}");
        assert_eq!(right.sensor_maximum_rad, config.mechanism.sensor_maximum_rad);
    }

    #[test]
    fn a_muscle_is_put_right_and_the_other_is_not() {
        let config = JointConfig::default();
        let points = [
            Point { reading: 1.0e5, reference: 1.01e5 },
            Point { reading: 3.0e5, reference: 3.05e5 },
        ];
        let right = JointSensor::Pressure(Side::B).calibrated(&config, points).unwrap();
        let [a, b] = right.muscles.map(|muscle| muscle.sensors.pressure.gain);
        assert!(a == 1.0 && (b - 1.02).abs() < 1e-5, "{a}, {b}");
    }
}
