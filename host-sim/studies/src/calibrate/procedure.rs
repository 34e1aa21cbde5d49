//! The calibration of a board's sensor, from the first question to the board's new configuration.

use super::{Gauge, Guide, Implausible, JointSensor, Point, Sensor, vents};
use model_core::joint::{JointMode, JointSetPoint, JointTelemetry};
use model_core::{Faults, Sample, SetPoint, SetPointError, Telemetry};
use serde::Serialize;
use thermyo_boards::live::{LiveBoard, VIEW_DIVIDER};
use thermyo_boards::live_joint::LiveJoint;
use thermyo_boards::subject::Subject;
use thermyo_protocol::{ConfigSource, Refusal};
use thermyo_simulation::board::BoardError;

/// Steps in which the muscle may settle at a held pressure.
const SETTLING_STEPS: u32 = 3000;

/// A board whose sensors are calibrated.
pub trait Bench: Subject {
    type Gauge: Gauge<Config = Self::Config>;

    fn sample(telemetry: &Self::Telemetry) -> <Self::Gauge as Gauge>::Sample;

    /// Whether a first point may be read.
    fn vents(telemetry: &Self::Telemetry) -> bool;

    /// The set point that holds a pressure \[Pa\]. In a joint it applies to both muscles, so that the arm stays where
    /// it is.
    fn holding(pressure_pa: f32) -> Self::SetPoint;
}

impl Bench for LiveBoard {
    type Gauge = Sensor;

    fn sample(telemetry: &Telemetry) -> Sample {
        telemetry.sample
    }

    fn vents(telemetry: &Telemetry) -> bool {
        vents(telemetry.mode)
    }

    fn holding(pressure_pa: f32) -> SetPoint {
        SetPoint::Pressure { pressure_pa }
    }
}

impl Bench for LiveJoint {
    type Gauge = JointSensor;

    fn sample(telemetry: &JointTelemetry) -> JointTelemetry {
        *telemetry
    }

    fn vents(telemetry: &JointTelemetry) -> bool {
        matches!(telemetry.mode, JointMode::Vent | JointMode::StartupCheck)
    }

    fn holding(pressure_pa: f32) -> JointSetPoint {
        JointSetPoint::Pressures { pressure_pa: [pressure_pa; 2] }
    }
}

/// The board, and the person who reads the reference.
pub trait Dialogue {
    type Board: Bench;

    /// Lends the board to a closure, which also gets a function that returns whether to stop early.
    fn board<T: Send>(
        &mut self,
        using: impl FnOnce(&mut Self::Board, &dyn Fn() -> bool) -> Result<T, BoardError> + Send,
    ) -> Result<T, BoardError>;

    /// Asks for the reading of the reference, and keeps the board alive until the answer. `refused` is the reason why
    /// the last answer was not accepted. None if there are no further answers.
    fn ask(&mut self, question: &str, refused: Option<&str>) -> Result<Option<String>, BoardError>;

    fn say(&mut self, text: &str);
}

/// Result of a calibration; the board uses it, but has not saved it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Calibrated {
    /// Corrections at the two points, in `unit`.
    pub shifts: [f64; 2],
    /// SI symbol.
    pub unit: &'static str,
    pub config_name: String,
    pub config_checksum: u32,
}

type GaugeOf<D> = <<D as Dialogue>::Board as Bench>::Gauge;
type TelemetryOf<D> = <<D as Dialogue>::Board as Subject>::Telemetry;

#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    #[error(transparent)]
    Board(#[from] BoardError),
    /// The answers ended before both points were known.
    #[error("not calibrated: {0}")]
    Unfinished(String),
}

/// Asks for the reference at two points, the second at `hold_pa` if given, and configures the board, which then vents.
///
/// # Errors
/// [`CalibrateError`]. The board may still drive: the caller vents it.
pub fn calibrate<D: Dialogue>(
    dialogue: &mut D,
    sensor: GaugeOf<D>,
    hold_pa: Option<f32>,
) -> Result<Calibrated, CalibrateError> {
    let (before, config) = dialogue.board(|board, _| {
        let status = board.status()?;
        if status.config_source == ConfigSource::Defaults {
            return Err(BoardError::Refused(Refusal::NotConfigured));
        }
        if hold_pa.is_some() && status.armed_pa.is_none() {
            return Err(BoardError::Refused(Refusal::SetPoint(SetPointError::NotArmed)));
        }
        Ok((status, board.config()?))
    })?;
    let mut guide = Guide::new(sensor, config);
    two_points(dialogue, &mut guide, hold_pa)?;
    let (calibrated, shifts) = guide.calibrated().unwrap_or((config, [0.0; 2]));
    let status = dialogue.board(move |board, _| {
        board.stop()?;
        board.configure(&calibrated, before.config_name.as_str())
    })?;
    Ok(Calibrated {
        shifts,
        unit: sensor.unit(),
        config_name: status.config_name.as_str().to_owned(),
        config_checksum: status.config_checksum,
    })
}

/// Asks until both points are known.
fn two_points<D: Dialogue>(
    dialogue: &mut D,
    guide: &mut Guide<GaugeOf<D>>,
    mut hold_pa: Option<f32>,
) -> Result<(), CalibrateError> {
    let mut refused: Option<String> = None;
    while guide.calibrated().is_none() {
        let Some(answer) = dialogue.ask(&guide.question_with_units(), refused.as_deref())? else {
            let why = refused.unwrap_or_else(|| "the input has ended".to_owned());
            return Err(CalibrateError::Unfinished(why));
        };
        let seen = match guide.answer(&answer) {
            Err(unread) => Err(unread.to_string()),
            Ok(()) => {
                let point = dialogue.board(|board, stopped| averaged(board, guide, stopped))?;
                point.map_err(|why| why.to_string())
            }
        };
        refused = match seen {
            Err(why) => Some(why),
            Ok(Point { reading, .. }) => {
                dialogue.say(&format!("the sensor reads {}", guide.sensor.text(reading)));
                if let Some(pressure_pa) = hold_pa.take() {
                    hold(dialogue, pressure_pa)?;
                }
                None
            }
        };
    }
    Ok(())
}

fn hold<D: Dialogue>(dialogue: &mut D, pressure_pa: f32) -> Result<(), BoardError> {
    let first = dialogue.board(|board, _| board.set(D::Board::holding(pressure_pa)))?;
    dialogue.say(&format!("it holds {:.1} kPa", pressure_pa / 1e3));
    dialogue.board(|board, stopped| {
        let settled = |now: &TelemetryOf<D>| D::Board::step(now).saturating_sub(first);
        wait(board, stopped, |now| settled(now) >= SETTLING_STEPS)
    })
}

/// The point that the guide averages, or the reason for its refusal.
fn averaged<B: Bench>(
    board: &mut B,
    guide: &mut Guide<B::Gauge>,
    stopped: &dyn Fn() -> bool,
) -> Result<Result<Point, Implausible>, BoardError> {
    // Another rate may have been requested meanwhile, and earlier telemetry is out of date.
    board.telemetry_anew(VIEW_DIVIDER)?;
    loop {
        let mut point = None;
        wait(board, stopped, |telemetry| {
            point = guide.see(&B::sample(telemetry), B::vents(telemetry)).transpose();
            point.is_some()
        })?;
        if let Some(point) = point {
            return Ok(point);
        }
    }
}

/// Keeps the board alive until `done`, which gets the telemetry, ends the wait.
///
/// # Errors
/// [`BoardError::Interrupted`] once `stopped`, [`BoardError::Vented`] if a fault vents.
pub fn wait<B: Subject>(
    board: &mut B,
    stopped: &dyn Fn() -> bool,
    mut done: impl FnMut(&B::Telemetry) -> bool,
) -> Result<(), BoardError> {
    loop {
        if stopped() {
            return Err(BoardError::Interrupted);
        }
        let Some(telemetry) = board.poll()? else { continue };
        let faults = B::venting(&telemetry);
        if faults != Faults::NONE {
            return Err(BoardError::Vented(faults));
        }
        if done(&telemetry) {
            return Ok(());
        }
    }
}
