//! Guided tasks on the page: a calibration, and the result of a calibration or tuning.

use super::state;
use model_core::{Config, Sample};
use thermyo_studies::calibrate::{Gauge, Guide, Sensor};

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
    /// Earlier messages, one per line.
    notes: String,
    reads: bool,
}

/// Result of a sample.
#[derive(Debug)]
pub enum Step {
    Goes,
    /// Both points are known: the configuration, and the sensor's error at them as text.
    Calibrated(Box<Config>, [String; 2]),
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

    /// Takes one of 100 samples per second, and whether the muscle vents.
    pub fn see(&mut self, sample: &Sample, vents: bool) -> Step {
        match self.guide.see(sample, vents) {
            Ok(None) => return Step::Goes,
            Ok(Some(point)) => {
                let [reference, reading] =
                    [point.reference, point.reading].map(|value| self.sensor.text(value));
                self.notes += &format!("The reference reads {reference}, the sensor {reading}.\n");
            }
            // The reference is requested again.
            Err(implausible) => self.notes += &format!("Not taken: {implausible}.\n"),
        }
        self.reads = false;
        let off = |off: [f64; 2]| off.map(|off| self.sensor.text(off));
        let calibrated = self.guide.calibrated();
        calibrated.map_or(Step::Goes, |(config, by)| Step::Calibrated(Box::new(config), off(by)))
    }

    /// The outcome of the task; `chooses` if the board has another calibration.
    pub fn outcome(&self, text: &str, chooses: bool) -> Guided {
        let text = format!("{text}\n{}", self.notes);
        Guided::Over(state::Guide { chooses, ..state::Guide::over(title(self.sensor), text) })
    }
}

fn title(sensor: Sensor) -> &'static str {
    match sensor {
        Sensor::Pressure => "Calibration: pressure",
        Sensor::Length => "Calibration: length",
        Sensor::Gas => "Calibration: gas temperature",
    }
}

impl Guided {
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
                ..state::Guide::default()
            },
        }
    }
}
