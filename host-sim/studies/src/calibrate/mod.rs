//! `thermyo board PORT calibrate`, also in Python and on the page of `thermyo serve`: gain and offset
//! of a sensor from two points with a reference reading.

mod joint;
mod procedure;

pub use joint::JointSensor;
pub use procedure::{Bench, CalibrateError, Calibrated, Dialogue, calibrate, wait};

use model_core::control::Mode;
use model_core::{Config, Sample};
use serde::Deserialize;
use thermyo_files::units::{Unit, Unread, Wanted};
use thermyo_record::measured::NOT_ABSOLUTE;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
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
/// Least distance of two temperatures \[K\]: ice water and a cool room. The whole scale of a platinum resistor's chip
/// is 1078 K, a twentieth of which exceeds the range of any bath; two references that are right within 0.1 K give the
/// gain within 1.4 %.
const LEAST_SPAN_K: f64 = 15.0;
/// Largest difference of the gain from 1; beyond it, the sensor is not the configured one.
const MOST_GAIN: f64 = 0.1;
/// Largest correction within the range, as a fraction of it.
const MOST_SHIFT: f64 = 0.1;
/// Scatter, as a fraction of the range, above which a reading is not at rest.
const MOST_SCATTER: f64 = 0.005;

/// Reason why a point or a calibration is refused. Values are texts with their units.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Implausible {
    /// The first point is not at ambient pressure.
    #[error("it does not vent: the first point is read vented; vent it, then type again")]
    NotVented,
    /// The points are too close to each other.
    #[error("the two points are {found} apart: must be at least {least}")]
    TooClose { found: String, least: String },
    /// The sensor, or its range, is not the configured one.
    #[error(
        "the gain came out as {gain}: must be from {:.2} to {:.2}; is the sensor's range the one in the \
         configuration?",
        1.0 - MOST_GAIN, 1.0 + MOST_GAIN
    )]
    Gain { gain: String },
    /// The correction is too large.
    #[error(
        "the reference reads {reference} and the sensor {reading}: at most {most} are put right; is the \
         unit the right one?"
    )]
    Shift { reference: String, reading: String, most: String },
    /// The reading is not at rest.
    #[error("the reading scatters by {found}: at most {most} are taken; is it at rest?")]
    Restless { found: String, most: String },
    /// The reference reads gauge pressure, or is in another unit.
    #[error(
        "the reference reads {reference} and the sensor {reading}: must be absolute, and at least {least}, 80 % of the \
         configured ambient pressure; is this gauge pressure, or another unit?"
    )]
    NotAbsolute { reference: String, reading: String, least: String },
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    pub reading: f64,
    pub reference: f64,
}

/// A sensor of a muscle or of a joint, whose readings are corrected by a gain and an offset.
pub trait Gauge: Copy + Send {
    type Config: Copy + Send;
    type Sample: Copy + Send;

    /// SI symbol.
    fn unit(self) -> &'static str;

    /// A value or difference as text.
    fn text(self, value: f64) -> String;

    /// Range of the sensor, in its unit.
    fn range(self, config: &Self::Config) -> f64;

    /// Least distance of two points, in its unit.
    fn least_span(self, config: &Self::Config) -> f64 {
        LEAST_SPAN * self.range(config)
    }

    /// Reading without any calibration.
    fn read(self, config: &Self::Config, sample: &Self::Sample) -> f64;

    /// The configuration that corrects the readings of [`read`](Self::read): gain times the reading, and the offset.
    fn corrected(self, config: &Self::Config, gain: f64, offset: f64) -> Self::Config;

    fn reading(self, config: &Self::Config, samples: &[Self::Sample]) -> Result<f64, Implausible> {
        let readings: Vec<f64> = samples.iter().map(|sample| self.read(config, sample)).collect();
        let count = readings.len().max(1) as f64;
        let mean = readings.iter().sum::<f64>() / count;
        let found = (readings.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / count).sqrt();
        let most = MOST_SCATTER * self.range(config);
        // NaN is refused too.
        if found <= most {
            Ok(mean)
        } else {
            Err(Implausible::Restless { found: self.text(found), most: self.text(most) })
        }
    }

    /// Least absolute pressure that a reference can read \[Pa\]; none for another quantity.
    fn least_pa(self, config: &Self::Config) -> Option<f64>;

    /// Refuses a point whose reference is no absolute pressure, or far from the sensor's reading.
    fn check_point(self, config: &Self::Config, point: Point) -> Result<(), Implausible> {
        if let Some(least_pa) = self.least_pa(config).filter(|least_pa| point.reference < *least_pa)
        {
            let [reference, reading, least] =
                [point.reference, point.reading, least_pa].map(|value| self.text(value));
            return Err(Implausible::NotAbsolute { reference, reading, least });
        }
        let most = MOST_SHIFT * self.range(config);
        // NaN is refused too.
        if (point.reference - point.reading).abs() <= most {
            return Ok(());
        }
        let [reference, reading, most] =
            [point.reference, point.reading, most].map(|value| self.text(value));
        Err(Implausible::Shift { reference, reading, most })
    }

    /// The configuration with the sensor calibrated so that its readings match the reference at
    /// both points.
    fn calibrated(
        self,
        config: &Self::Config,
        [a, b]: [Point; 2],
    ) -> Result<Self::Config, Implausible> {
        let span = |of: fn(&Point) -> f64| of(&b) - of(&a);
        let found = span(|point| point.reference).abs().min(span(|point| point.reading).abs());
        let least = self.least_span(config);
        if found.is_nan() || found < least {
            let [found, least] = [found, least].map(|value| self.text(value));
            return Err(Implausible::TooClose { found, least });
        }
        let gain = span(|point| point.reference) / span(|point| point.reading);
        if !(1.0 - MOST_GAIN..=1.0 + MOST_GAIN).contains(&gain) {
            return Err(Implausible::Gain { gain: format!("{gain:.4}") });
        }
        for point in [a, b] {
            self.check_point(config, point)?;
        }
        Ok(self.corrected(config, gain, a.reference - gain * a.reading))
    }
}

impl Gauge for Sensor {
    type Config = Config;
    type Sample = Sample;

    fn unit(self) -> &'static str {
        match self {
            Self::Pressure => "Pa",
            Self::Length => "m",
            Self::Gas => "K",
        }
    }

    fn text(self, value: f64) -> String {
        let Unit { symbol, factor } = match self {
            Self::Pressure => Unit::of_column("pressure_pa"),
            Self::Length => Unit::of_column("length_m"),
            Self::Gas => Unit::of_column("sensor_gas_k"),
        };
        format!("{:.2} {symbol}", value * factor)
    }

    fn range(self, config: &Config) -> f64 {
        let sensors = &config.sensors;
        f64::from(match self {
            Self::Pressure => sensors.pressure.range_pa,
            Self::Length => sensors.length.range_m,
            Self::Gas => {
                let sensing = uncalibrated(config).sensing();
                let at = |code| sensing.gas_k(model_core::AdcCode(code));
                (at(31_122) - at(1_638)).abs()
            }
        })
    }

    fn least_span(self, config: &Config) -> f64 {
        let least = LEAST_SPAN * self.range(config);
        if self == Self::Gas { least.min(LEAST_SPAN_K) } else { least }
    }

    fn least_pa(self, config: &Config) -> Option<f64> {
        (self == Self::Pressure).then(|| NOT_ABSOLUTE * f64::from(config.ambient.pressure_pa))
    }

    fn read(self, config: &Config, sample: &Sample) -> f64 {
        let sensing = uncalibrated(config).sensing();
        f64::from(match self {
            Self::Pressure => sensing.pressure_pa(sample.pressure),
            Self::Length => sensing.length_m(sample.length),
            Self::Gas => sensing.gas_k(sample.gas),
        })
    }

    fn corrected(self, config: &Config, gain: f64, offset: f64) -> Config {
        let (gain, offset) = (gain as f32, offset as f32);
        let mut config = *config;
        let sensors = &mut config.sensors;
        match self {
            Self::Pressure => (sensors.pressure.gain, sensors.pressure.offset_pa) = (gain, offset),
            Self::Length => (sensors.length.gain, sensors.length.offset_m) = (gain, offset),
            Self::Gas => (sensors.gas.gain, sensors.gas.offset_k) = (gain, offset),
        }
        config
    }
}

/// Guides through the two points: asks for the reference, then averages the sensor's readings.
#[derive(Debug, Clone)]
pub struct Guide<G: Gauge = Sensor> {
    sensor: G,
    config: G::Config,
    points: Vec<Point>,
    /// Reference reading of the current point.
    reference: Option<f64>,
    samples: Vec<G::Sample>,
}

impl<G: Gauge> Guide<G> {
    /// Starts at the first point. `config` is the board's configuration.
    pub fn new(sensor: G, config: G::Config) -> Self {
        Self { sensor, config, points: Vec::new(), reference: None, samples: Vec::new() }
    }

    pub fn question(&self) -> String {
        let (number, how) = if self.points.is_empty() {
            ("first", "vented")
        } else {
            ("second", "at another value")
        };
        format!("{number} point, {how} and at rest: what does the reference read?")
    }

    /// The current question, and the units in which it may be answered.
    pub fn question_with_units(&self) -> String {
        format!("{} ({}) ", self.question(), Wanted::new(self.sensor.unit()).names())
    }

    /// Sets the reference of the current point, an SI number or one with its unit, and starts
    /// averaging the sensor.
    ///
    /// # Errors
    /// If it is no value of the sensor's quantity; the point is then asked for again.
    pub fn answer(&mut self, typed: &str) -> Result<(), NoValue> {
        let read = Wanted::new(self.sensor.unit()).read(typed);
        let value = read.map_err(|why| NoValue { typed: typed.trim().to_owned(), why })?;
        self.reference = Some(value);
        self.samples.clear();
        Ok(())
    }

    /// Takes one of 100 samples a second, and whether the muscle vents; returns the point once it has enough. Does
    /// nothing before the reference is set.
    ///
    /// # Errors
    /// [`Implausible`]; the point is then asked for again.
    pub fn see(&mut self, sample: &G::Sample, vents: bool) -> Result<Option<Point>, Implausible> {
        let Some(reference) = self.reference else { return Ok(None) };
        if self.points.is_empty() && !vents {
            self.reference = None;
            return Err(Implausible::NotVented);
        }
        self.samples.push(*sample);
        if self.samples.len() < READINGS {
            return Ok(None);
        }
        self.reference = None;
        let reading = self.sensor.reading(&self.config, &self.samples)?;
        let point = Point { reading, reference };
        self.sensor.check_point(&self.config, point)?;
        if let [first] = self.points[..] {
            self.sensor.calibrated(&self.config, [first, point])?;
        }
        self.points.push(point);
        Ok(Some(point))
    }

    /// The configuration with the calibrated sensor, and the corrections at the two points; none
    /// before both points are known.
    pub fn calibrated(&self) -> Option<(G::Config, [f64; 2])> {
        let [a, b] = self.points[..] else { return None };
        let config = self.sensor.calibrated(&self.config, [a, b]).ok()?;
        Some((config, [a, b].map(|point| point.reference - point.reading)))
    }
}

/// Error for a reference that is no value of the sensor's quantity.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{typed:?}: the reference must be {why}")]
pub struct NoValue {
    typed: String,
    why: Unread,
}

/// Whether a first point may be read in this mode.
pub fn vents(mode: Mode) -> bool {
    matches!(mode, Mode::Vent | Mode::StartupCheck)
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
    use model_core::sensing::gas::GasElement;

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
        // Bar in place of pascals, and a range of 800 kPa configured as 700.
        let gain = pressure(point(1.0e5, 1.0), point(3.0e5, 3.0));
        assert!(matches!(gain, Implausible::TooClose { .. }), "{gain}");
        let gain = pressure(point(1.0e5, 1.14e5), point(3.0e5, 3.43e5));
        assert!(gain.to_string().contains("must be from 0.90 to 1.10"), "{gain}");
        let shift = pressure(point(1.0e5, 1.8e5), point(3.0e5, 3.8e5));
        assert!(matches!(shift, Implausible::Shift { .. }), "{shift}");
    }

    /// A sensor of 150 psi: a tenth of its range is more than an atmosphere. The limit of the pressure used to be
    /// higher than stated.
    #[test]
    fn gauge_pressures_are_refused() {
        let mut config = Config::default();
        config.sensors.pressure.range_pa = 1_034_214.0;
        let gauge = [point(101_325.0, 0.0), point(2.0e5, 0.987e5)];
        let error = Sensor::Pressure.calibrated(&config, gauge).unwrap_err().to_string();
        let expected = "the reference reads 0.00 kPa and the sensor 101.33 kPa: must be absolute, and at least 81.06 kPa";
        assert!(error.starts_with(expected), "{error}");
    }

    /// The scale of a MAX31865 is 1078 K wide: no two baths of a laboratory are a twentieth of it apart.
    #[test]
    fn ice_water_and_a_room_calibrate_any_gas_sensor() {
        let mut config = Config::default();
        for element in GasElement::all() {
            config.sensors.gas_element = element;
            let of = |room_k: f64| {
                let points = [point(273.9, 273.15), point(room_k + 1.0, room_k)];
                Sensor::Gas.calibrated(&config, points).map(|right| right.sensors.gas.gain)
            };
            let gain = of(293.15).unwrap();
            assert!((gain - 20.0 / 20.25).abs() < 1e-6, "{element:?}: {gain}");
            assert!(matches!(of(275.0), Err(Implausible::TooClose { .. })), "{element:?}");
        }
    }

    #[test]
    fn a_guide_asks_for_two_points_and_averages() {
        let mut guide = Guide::new(Sensor::Length, Config::default());
        let sample = |code| Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(code));
        assert_eq!(guide.see(&sample(16_380), true), Ok(None), "no reference has been entered");
        assert!(guide.question().contains("first point") && guide.calibrated().is_none());
        let typo = guide.answer("0,2").unwrap_err().to_string();
        assert!(typo.contains("a number in m, or one with its unit: m, cm, mm"), "{typo}");
        for (code, reference) in [(16_380, "0.201"), (20_475, " 257 mm\n")] {
            guide.answer(reference).unwrap();
            let seen: Vec<_> =
                (0..READINGS).map(|_| guide.see(&sample(code), true).unwrap()).collect();
            assert_eq!(seen.iter().flatten().count(), 1);
            assert!(seen[READINGS - 1].is_some());
        }
        let (config, shifts) = guide.calibrated().unwrap();
        let sensing = config.sensing();
        for (code, reference, shift) in [(16_380, 0.201, shifts[0]), (20_475, 0.257, shifts[1])] {
            let length_m = f64::from(sensing.length_m(AdcCode(code)));
            assert!((length_m - reference).abs() < 1e-5, "{length_m} where {reference} is read");
            assert!((1e-4..1e-2).contains(&shift), "{shift}");
        }
    }

    /// A first point in a wrong unit used to be refused only after the second.
    #[test]
    fn a_point_is_refused_at_once_and_asked_for_again() {
        let mut guide = Guide::new(Sensor::Pressure, Config::default());
        let sample = |code| Sample::new(AdcCode(code), AdcCode(15_950), AdcCode(16_380));
        let see = |guide: &mut Guide, typed: &str, code, vents| {
            guide.answer(typed).unwrap();
            let mut seen = (0..READINGS).map(|_| guide.see(&sample(code), vents));
            seen.find(|seen| !matches!(seen, Ok(None))).unwrap().map(drop)
        };
        let config = Config::default();
        let low_pa = Sensor::Pressure.reading(&config, &[sample(7000)]).unwrap();
        let high_pa = Sensor::Pressure.reading(&config, &[sample(12_000)]).unwrap();
        let low = format!("{low_pa}");
        assert_eq!(see(&mut guide, &low, 7000, false), Err(Implausible::NotVented));
        let unit = see(&mut guide, "101.3", 7000, true).unwrap_err().to_string();
        assert!(unit.contains("the reference reads 0.10 kPa and the sensor "), "{unit}");
        assert!(guide.question().contains("first"));
        see(&mut guide, &low, 7000, true).unwrap();
        let gain = see(&mut guide, &format!("{} kPa", high_pa / 0.85e3), 12_000, false);
        assert!(gain.is_err() && guide.question().contains("second"), "{gain:?}");
        see(&mut guide, &format!("{} kPa", high_pa / 1e3), 12_000, false).unwrap();
        assert!(guide.calibrated().is_some());
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
