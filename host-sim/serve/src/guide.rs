//! Guided tasks on the page: a calibration, and the result of a calibration or tuning.

use super::state;
use model_core::{Config, Sample};
use thermyo_studies::calibrate::{Guide, Implausible, Sensor};

#[derive(Debug)]
pub enum Guided {
    Calibration(Box<Calibration>),
    /// The task is over; its outcome is shown.
    Over(state::Guide),
}

/// A calibration that waits for a reference, or averages samples.
#[derive(Debug)]
pub struct Calibration {
    sensor: Sensor,
    guide: Guide,
    /// Earlier messages, a line each.
    notes: String,
    reads: bool,
}

/// Result of a sample.
#[derive(Debug)]
pub enum Step {
    Goes,
    /// Both points are known: the configuration, and the sensor's error at them.
    Calibrated(Box<Config>, [f64; 2]),
}

impl Calibration {
    pub fn new(sensor: Sensor, config: Config) -> Self {
        Self { sensor, guide: Guide::new(sensor, config), notes: String::new(), reads: false }
    }

    /// Takes the reading of the reference, as typed.
    pub fn answer(&mut self, text: &str) {
        match self.guide.answer(text) {
            Ok(()) => self.reads = true,
            Err(error) => self.notes += &format!("{error}\n"),
        }
    }

    /// Takes one of 100 samples per second.
    pub fn see(&mut self, sample: &Sample) -> Result<Step, Implausible> {
        match self.guide.see(sample) {
            Ok(None) => return Ok(Step::Goes),
            Ok(Some(point)) => {
                let unit = self.sensor.unit();
                self.notes += &format!(
                    "the reference reads {} {unit}, the sensor {:.4} {unit}\n",
                    point.reference, point.reading
                );
            }
            // The reference is requested again.
            Err(restless) => self.notes += &format!("{restless}\n"),
        }
        self.reads = false;
        let calibrated = self.guide.calibrated()?;
        Ok(calibrated.map_or(Step::Goes, |(config, off)| Step::Calibrated(Box::new(config), off)))
    }

    pub fn outcome(&self, text: &str) -> Guided {
        Guided::over(&title(self.sensor), format!("{}{text}", self.notes), None)
    }
}

fn title(sensor: Sensor) -> String {
    let name = match sensor {
        Sensor::Pressure => "pressure",
        Sensor::Length => "length",
        Sensor::Gas => "gas temperature",
    };
    format!("Calibration: {name}")
}

impl Guided {
    /// A finished task, and the result that it wrote.
    pub fn over(title: &str, text: String, result: Option<String>) -> Self {
        let title = title.to_owned();
        Self::Over(state::Guide { title, text, asks: None, progress: None, result, over: true })
    }

    pub fn state(&self) -> state::Guide {
        match self {
            Self::Over(over) => over.clone(),
            Self::Calibration(calibration) => state::Guide {
                title: title(calibration.sensor),
                text: if calibration.reads {
                    format!("{}The sensor is read for a second.", calibration.notes)
                } else {
                    format!("{}{}", calibration.notes, calibration.guide.question())
                },
                asks: (!calibration.reads).then(|| calibration.sensor.unit()),
                progress: None,
                result: None,
                over: false,
            },
        }
    }
}
