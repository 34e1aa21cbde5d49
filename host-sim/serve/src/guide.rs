//! What is guided on the page: a calibration, and what is left of one or of a tuning to be read.

use super::state;
use model_core::{Config, Sample};
use thermyo_studies::calibrate::{Guide, Implausible, Sensor};

/// A guided task, or its end.
#[derive(Debug)]
pub enum Guided {
    /// A sensor is calibrated.
    Calibration(Box<Calibration>),
    /// It is over: what came out.
    Over(state::Guide),
}

/// A calibration that waits for a reference, or reads.
#[derive(Debug)]
pub struct Calibration {
    sensor: Sensor,
    guide: Guide,
    /// What came before, a line each.
    said: String,
    reads: bool,
}

/// What a sample has led to.
#[derive(Debug)]
pub enum Step {
    /// It goes on.
    Goes,
    /// Both points are known: the configuration, and by how much the sensor was off at them.
    Calibrated(Box<Config>, [f64; 2]),
}

impl Calibration {
    /// Of a sensor, on a board with this configuration.
    pub fn new(sensor: Sensor, config: Config) -> Self {
        Self { sensor, guide: Guide::new(sensor, config), said: String::new(), reads: false }
    }

    /// What the reference reads, as it was typed.
    pub fn answer(&mut self, text: &str) {
        match self.guide.answer(text) {
            Ok(()) => self.reads = true,
            Err(error) => self.said += &format!("{error}\n"),
        }
    }

    /// One of 100 samples a second.
    ///
    /// # Errors
    /// [`Implausible`], where the two points tell no calibration.
    pub fn see(&mut self, sample: &Sample) -> Result<Step, Implausible> {
        match self.guide.see(sample) {
            Ok(None) => return Ok(Step::Goes),
            Ok(Some(point)) => {
                let unit = self.sensor.unit();
                self.said += &format!(
                    "the reference reads {} {unit}, the sensor {:.4} {unit}\n",
                    point.reference, point.reading
                );
            }
            // It is asked for again.
            Err(restless) => self.said += &format!("{restless}\n"),
        }
        self.reads = false;
        let calibrated = self.guide.calibrated()?;
        Ok(calibrated.map_or(Step::Goes, |(config, off)| Step::Calibrated(Box::new(config), off)))
    }

    /// What came out.
    pub fn outcome(&self, text: &str) -> Guided {
        Guided::over(&title(self.sensor), format!("{}{text}", self.said), None)
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
    /// The end of a task, and the result that it left.
    pub fn over(title: &str, text: String, result: Option<String>) -> Self {
        let title = title.to_owned();
        Self::Over(state::Guide { title, text, asks: None, progress: None, result, over: true })
    }

    /// As the page shows it.
    pub fn state(&self) -> state::Guide {
        match self {
            Self::Over(over) => over.clone(),
            Self::Calibration(calibration) => state::Guide {
                title: title(calibration.sensor),
                text: if calibration.reads {
                    format!("{}The sensor is read for a second.", calibration.said)
                } else {
                    format!("{}{}", calibration.said, calibration.guide.question())
                },
                asks: (!calibration.reads).then(|| calibration.sensor.unit()),
                progress: None,
                result: None,
                over: false,
            },
        }
    }
}
