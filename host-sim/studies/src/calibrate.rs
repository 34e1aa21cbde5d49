//! `thermyo board PORT calibrate`, also on the page of `thermyo serve`: gain and offset of a sensor
//! from two points with a reference reading.

use model_core::{Config, Sample};

/// A sensor that can be calibrated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sensor {
    /// Absolute pressure \[Pa\].
    Pressure,
    /// Length \[m\].
    Length,
    /// Gas temperature \[K\].
    Gas,
}

/// Readings averaged for a point: one second.
const READINGS: usize = 100;
/// Least distance of the points, as a fraction of the sensor's range.
const LEAST_SPAN: f64 = 0.05;
/// Largest difference of the gain from 1; beyond it, the sensor is not the configured one.
const MOST_GAIN: f64 = 0.1;
/// Largest correction within the range, as a fraction of it.
const MOST_SHIFT: f64 = 0.1;
/// A reading that scatters by more than this fraction of the range is not at rest.
const MOST_SCATTER: f64 = 0.005;

/// Reason why a calibration is refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Implausible {
    /// The points are too close to each other.
    #[error("the two points are {found} {unit} apart: must be at least {least} {unit}")]
    TooClose { found: f64, least: f64, unit: &'static str },
    /// Another sensor, or another range than configured.
    #[error(
        "the gain came out as {gain:.4}: must be from {:.2} to {:.2}; is the sensor's range the one in the \
         configuration, and the reference read in {unit}?",
        1.0 - MOST_GAIN, 1.0 + MOST_GAIN
    )]
    Gain { gain: f64, unit: &'static str },
    /// The correction is too large.
    #[error("the sensor is {found:.4} {unit} off: at most {most:.4} {unit} are put right")]
    Shift { found: f64, most: f64, unit: &'static str },
    #[error(
        "the reading scatters by {found:.4} {unit}: at most {most:.4} {unit} are taken; is it at rest?"
    )]
    Restless { found: f64, most: f64, unit: &'static str },
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Uncalibrated reading of the sensor.
    pub reading: f64,
    pub reference: f64,
}

impl Sensor {
    pub fn unit(self) -> &'static str {
        match self {
            Self::Pressure => "Pa",
            Self::Length => "m",
            Self::Gas => "K",
        }
    }

    /// Range of the sensor, in its unit.
    fn range(self, config: &Config) -> f64 {
        let sensors = &config.sensors;
        f64::from(match self {
            Self::Pressure => sensors.pressure.range_pa,
            Self::Length => sensors.length.range_m,
            Self::Gas => {
                let sensing = uncalibrated(config).sensing();
                let at = |code| sensing.gas_k(model_core::AdcCode(code));
                at(31_122) - at(1_638)
            }
        })
    }

    /// Mean of the uncalibrated readings.
    pub fn reading(self, config: &Config, samples: &[Sample]) -> Result<f64, Implausible> {
        let sensing = uncalibrated(config).sensing();
        let readings = samples.iter().map(|sample| {
            f64::from(match self {
                Self::Pressure => sensing.pressure_pa(sample.pressure),
                Self::Length => sensing.length_m(sample.length),
                Self::Gas => sensing.gas_k(sample.gas),
            })
        });
        let readings: Vec<f64> = readings.collect();
        let count = readings.len().max(1) as f64;
        let mean = readings.iter().sum::<f64>() / count;
        let found = (readings.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / count).sqrt();
        let most = MOST_SCATTER * self.range(config);
        // NaN is refused too.
        if found <= most {
            Ok(mean)
        } else {
            Err(Implausible::Restless { found, most, unit: self.unit() })
        }
    }

    /// The configuration with the sensor calibrated so that its readings match the reference at
    /// both points.
    pub fn calibrated(self, config: &Config, [a, b]: [Point; 2]) -> Result<Config, Implausible> {
        let (range, unit) = (self.range(config), self.unit());
        let span = |of: fn(&Point) -> f64| of(&b) - of(&a);
        let found = span(|point| point.reference).abs().min(span(|point| point.reading).abs());
        let least = LEAST_SPAN * range;
        if found.is_nan() || found < least {
            return Err(Implausible::TooClose { found, least, unit });
        }
        let gain = span(|point| point.reference) / span(|point| point.reading);
        if !(1.0 - MOST_GAIN..=1.0 + MOST_GAIN).contains(&gain) {
            return Err(Implausible::Gain { gain, unit });
        }
        let most = MOST_SHIFT * range;
        let off = |point: &Point| (point.reference - point.reading).abs();
        let found = off(&a).max(off(&b));
        if found > most {
            return Err(Implausible::Shift { found, most, unit });
        }
        let (gain, offset) = (gain as f32, (a.reference - gain * a.reading) as f32);
        let mut config = *config;
        let sensors = &mut config.sensors;
        match self {
            Self::Pressure => (sensors.pressure.gain, sensors.pressure.offset_pa) = (gain, offset),
            Self::Length => (sensors.length.gain, sensors.length.offset_m) = (gain, offset),
            Self::Gas => (sensors.gas.gain, sensors.gas.offset_k) = (gain, offset),
        }
        Ok(config)
    }
}

/// Guides through the two points: asks for the reference, then averages the sensor's readings.
#[derive(Debug, Clone)]
pub struct Guide {
    sensor: Sensor,
    config: Config,
    points: Vec<Point>,
    /// Reference reading of the current point.
    reference: Option<f64>,
    samples: Vec<Sample>,
}

impl Guide {
    /// `config` is the board's configuration.
    pub fn new(sensor: Sensor, config: Config) -> Self {
        Self { sensor, config, points: Vec::new(), reference: None, samples: Vec::new() }
    }

    /// The current question.
    pub fn question(&self) -> String {
        let (number, how) = if self.points.is_empty() {
            ("first", "vented")
        } else {
            ("second", "at another value")
        };
        let unit = self.sensor.unit();
        format!("{number} point, {how} and at rest: what does the reference read, in {unit}?")
    }

    /// Sets the reference of the current point and starts averaging the sensor.
    ///
    /// # Errors
    /// Where it is no number.
    pub fn answer(&mut self, said: &str) -> Result<(), NoNumber> {
        let said = said.trim();
        let value = said.parse().ok().filter(|value: &f64| value.is_finite());
        let unit = self.sensor.unit();
        self.reference = Some(value.ok_or_else(|| NoNumber { said: said.to_owned(), unit })?);
        self.samples.clear();
        Ok(())
    }

    /// Takes one of 100 samples a second; returns the point when there are enough. Does nothing
    /// before the reference is set.
    ///
    /// # Errors
    /// [`Implausible::Restless`]; the point is then asked for again.
    pub fn see(&mut self, sample: &Sample) -> Result<Option<Point>, Implausible> {
        let Some(reference) = self.reference else { return Ok(None) };
        self.samples.push(*sample);
        if self.samples.len() < READINGS {
            return Ok(None);
        }
        self.reference = None;
        let reading = self.sensor.reading(&self.config, &self.samples)?;
        let point = Point { reading, reference };
        self.points.push(point);
        Ok(Some(point))
    }

    /// The configuration with the calibrated sensor, and the corrections at the two points; none
    /// before both points are known.
    pub fn calibrated(&self) -> Result<Option<(Config, [f64; 2])>, Implausible> {
        let [a, b] = self.points[..] else { return Ok(None) };
        let config = self.sensor.calibrated(&self.config, [a, b])?;
        Ok(Some((config, [a, b].map(|point| point.reference - point.reading))))
    }
}

/// Error for a reference that is no number.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{said:?}: must be what the reference reads, in {unit}")]
pub struct NoNumber {
    said: String,
    unit: &'static str,
}

/// The configuration without any calibration.
fn uncalibrated(config: &Config) -> Config {
    let mut config = *config;
    let sensors = &mut config.sensors;
    (sensors.pressure.gain, sensors.pressure.offset_pa) = (1.0, 0.0);
    (sensors.length.gain, sensors.length.offset_m) = (1.0, 0.0);
    (sensors.gas.gain, sensors.gas.offset_k) = (1.0, 0.0);
    config
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::AdcCode;

    fn point(reading: f64, reference: f64) -> Point {
        Point { reading, reference }
    }

    #[test]
    fn two_points_put_a_sensor_right() {
        let mut config = Config::default();
        // The new calibration replaces the old one.
        (config.sensors.pressure.gain, config.sensors.pressure.offset_pa) = (0.97, 800.0);
        let points = [point(1.0e5, 1.01e5), point(3.0e5, 3.05e5)];
        let calibrated = Sensor::Pressure.calibrated(&config, points).unwrap().sensors.pressure;
        assert!((calibrated.gain - 1.02).abs() < 1e-5, "{calibrated:?}");
        assert!((calibrated.offset_pa + 1000.0).abs() < 0.1, "{calibrated:?}");
    }

    #[test]
    fn impossible_calibrations_are_refused() {
        let config = Config::default();
        let pressure = |a, b| Sensor::Pressure.calibrated(&config, [a, b]).unwrap_err();
        let close = pressure(point(1.0e5, 1.0e5), point(1.1e5, 1.1e5));
        assert!(matches!(close, Implausible::TooClose { .. }), "{close}");
        // Bar in place of pascals, and a range of 800 kPa that is configured as 700.
        let gain = pressure(point(1.0e5, 1.0), point(3.0e5, 3.0));
        assert!(matches!(gain, Implausible::TooClose { .. }), "{gain}");
        let gain = pressure(point(1.0e5, 1.14e5), point(3.0e5, 3.43e5));
        assert!(gain.to_string().contains("must be from 0.90 to 1.10"), "{gain}");
        let shift = pressure(point(1.0e5, 1.8e5), point(3.0e5, 3.8e5));
        assert!(matches!(shift, Implausible::Shift { .. }), "{shift}");
    }

    #[test]
    fn a_guide_asks_for_two_points_and_averages() {
        let mut guide = Guide::new(Sensor::Length, Config::default());
        let sample = |code| Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(code));
        assert_eq!(guide.see(&sample(16_380)), Ok(None), "no reference has been entered");
        assert!(guide.question().contains("first point") && guide.calibrated() == Ok(None));
        assert!(guide.answer("0,2").unwrap_err().to_string().contains("in m"));
        for (code, reference) in [(16_380, "0.201"), (20_475, " 0.257\n")] {
            guide.answer(reference).unwrap();
            let seen: Vec<_> = (0..READINGS).map(|_| guide.see(&sample(code)).unwrap()).collect();
            assert_eq!(seen.iter().flatten().count(), 1);
            assert!(seen[READINGS - 1].is_some());
        }
        let (config, shifts) = guide.calibrated().unwrap().unwrap();
        let sensing = config.sensing();
        for (code, reference, shift) in [(16_380, 0.201, shifts[0]), (20_475, 0.257, shifts[1])] {
            let length_m = f64::from(sensing.length_m(AdcCode(code)));
            assert!((length_m - reference).abs() < 1e-5, "{length_m} where {reference} is read");
            assert!((1e-4..1e-2).contains(&shift), "{shift}");
        }
    }

    #[test]
    fn a_reading_is_uncalibrated_and_at_rest() {
        let mut config = Config::default();
        config.sensors.length.gain = 1.1;
        let sample = |code| Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(code));
        let rest = [sample(16_380), sample(16_381)];
        let reading = Sensor::Length.reading(&config, &rest).unwrap();
        assert!((reading - 0.2).abs() < 1e-3, "{reading}");
        let moving = [sample(16_380), sample(17_380)];
        let error = Sensor::Length.reading(&config, &moving).unwrap_err();
        assert!(matches!(error, Implausible::Restless { .. }), "{error}");
    }
}
