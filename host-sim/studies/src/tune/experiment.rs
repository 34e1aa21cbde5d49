//! The experiment: set points of pressure only, followed by the core's own pressure loop, which
//! keeps its limits.
//!
//! ```text
//! rest | slow ramps | fast ramps | steps                  | vent
//!      |  /\/\      |  /\/\/\/\  | valve fully open, then |
//!      |            |            | closing on the set point
//! ```
//!
//! Only telemetry is used, so that it works on any board.

use super::Refusal;
use model_core::config::{Config, Load};
use model_core::control::contractions;
use model_core::physics::chamber::{AnyChamber, Chamber};
use model_core::{Faults, SetPoint, Telemetry};
use std::io;
use std::ops::Range;
use thermyo_record::board_trace::kind_and_values;
use thermyo_record::trace::Row;
use thermyo_scenario::DriveKind;
use thermyo_setup::Loaded;
use thermyo_simulation::board::{Board, BoardError};
use thermyo_simulation::run;
use thermyo_simulation::run::RunError;

/// Default of the highest absolute pressure of an experiment \[Pa\].
pub const HIGHEST_PA: f64 = 4.0e5;
/// Used fraction of the supply's pressure: beyond it the inlet passes little \[-\].
const SUPPLY_SHARE: f64 = 0.85;
/// Used fraction of the pressure at which the supervisor vents \[-\].
const LIMIT_SHARE: f64 = 0.9;
/// Contractions between which the configured muscle moves, if its stroke is long enough \[-\].
const CONTRACTIONS: [f64; 2] = [0.03, 0.28];
/// The same as fractions of a shorter stroke \[-\].
const OF_STROKE: [f64; 2] = [0.1, 0.8];
/// Least difference of the two contractions \[-\].
const LEAST_WIDTH: f64 = 0.06;
/// Rest before and after, for measuring noise and for venting \[s\].
const REST_S: f64 = 1.5;
/// Contraction per time of slow and fast ramps, and the number of each \[1/s\].
const RAMPS: [(f64, usize); 2] = [(0.05, 2), (0.2, 4)];
/// Rest at the ends of a ramp \[s\].
const DWELL_S: f64 = 0.3;
/// Number of steps up, and of steps down.
const STEPS: u32 = 5;
const STEP_S: f64 = 0.7;
/// Lower end of the steps, as a fraction of the range of pressures: below it the outlet passes
/// little.
const STEP_FROM: f64 = 0.15;
/// Distance of a ramp's points \[s\].
const POINT_S: f64 = 0.02;

/// Data of one step of the core.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Record {
    /// Number of the step.
    pub step: u32,
    pub time_s: f64,
    /// The set point, in the drive's unit.
    pub set_point: f64,
    /// Measured absolute pressure \[Pa\].
    pub pressure_pa: f64,
    pub length_m: f64,
    pub gas_k: f64,
    pub wall_k: f64,
    pub inlet: f64,
    pub outlet: f64,
    pub faults: Faults,
}

impl Record {
    fn new(telemetry: &Telemetry, step_s: f64) -> Self {
        let Telemetry { step, pressure_pa, length_m, estimate, command, faults, .. } = telemetry;
        // The active set point: over a link it may arrive late.
        let (_, set_point, _) = kind_and_values(telemetry.set_point);
        Self {
            step: *step,
            time_s: f64::from(*step) * step_s,
            set_point: f64::from(set_point),
            pressure_pa: f64::from(*pressure_pa),
            length_m: f64::from(*length_m),
            gas_k: f64::from(estimate.gas_k),
            wall_k: f64::from(estimate.wall_k),
            inlet: f64::from(command.inlet.share()),
            outlet: f64::from(command.outlet.share()),
            faults: *faults,
        }
    }
}

/// Board on which an experiment runs: with a simulated muscle, or with a real one.
pub trait Bench {
    /// Runs a scenario from start to end and calls `each` with the telemetry of every step.
    fn drive(&mut self, driven: &Loaded, each: &mut dyn FnMut(&Telemetry)) -> Result<(), RunError>;

    /// Vents, and leaves the board with a configuration.
    fn leave(&mut self, left: Left<'_, Config>) -> Result<(), BoardError>;
}

/// The configuration that an experiment leaves on a board.
#[derive(Debug, Clone, Copy)]
pub enum Left<'a, C> {
    /// The values found.
    Found(&'a C),
    /// The board's former configuration or, if it had none, this one of the scenario.
    Former(&'a C),
}

impl<'a, C> Left<'a, C> {
    pub fn config(self) -> &'a C {
        match self {
            Self::Found(config) | Self::Former(config) => config,
        }
    }
}

/// A board that gets the samples of a simulated muscle, step by step.
pub struct Simulated<'a> {
    pub board: &'a mut dyn Board,
    pub stopped: &'a dyn Fn() -> bool,
}

impl Bench for Simulated<'_> {
    fn drive(&mut self, driven: &Loaded, each: &mut dyn FnMut(&Telemetry)) -> Result<(), RunError> {
        let mut observer = |row: &Row| {
            each(&row.telemetry);
            if (self.stopped)() { Err(io::ErrorKind::Interrupted.into()) } else { Ok(()) }
        };
        run::run(driven, self.board, None, &mut observer).map(drop)
    }

    fn leave(&mut self, left: Left<'_, Config>) -> Result<(), BoardError> {
        self.board.start(left.config(), SetPoint::Vent)
    }
}

/// Runs a set-point profile and records every step.
pub fn record(
    loaded: &Loaded,
    kind: DriveKind,
    profile: Vec<(f64, f64)>,
    bench: &mut dyn Bench,
) -> Result<Vec<Record>, RunError> {
    let driven = loaded.driven(kind, profile);
    let step_s = driven.plant.run.step_s;
    let mut records = Vec::new();
    bench.drive(&driven, &mut |telemetry| {
        records.push(Record::new(telemetry, step_s));
    })?;
    Ok(records)
}

#[derive(Debug, Clone, PartialEq)]
pub struct Ramp {
    /// Time from the start of the ramp to the end of the following rest \[s\].
    pub time_s: Range<f64>,
    pub rises: bool,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Lowest and highest set point \[Pa\].
    pub pressures_pa: [f64; 2],
    /// Contractions of the configured muscle at these pressures \[-\].
    pub contractions: [f64; 2],
    /// Set points over time \[s, Pa\].
    pub profile: Vec<(f64, f64)>,
    pub rest_s: Range<f64>,
    /// Time of even motion \[s\].
    pub ramps_s: Range<f64>,
    pub ramps: Vec<Ramp>,
    pub steps_s: Range<f64>,
}

/// The configured chamber and the force of its load.
///
/// # Errors
/// [`Refusal::NothingMoves`] if the load fixes the length.
pub fn configured(config: &Config) -> Result<(AnyChamber, f64), Refusal> {
    match config.load {
        Load::Isotonic { force_n } => Ok((AnyChamber::new(&config.chamber), f64::from(force_n))),
        Load::Isometric { .. } => Err(Refusal::NothingMoves),
    }
}

/// Highest pressure of an experiment with a configuration, up to the allowed one \[Pa\].
pub fn usable_pa(config: &Config, allowed_pa: f64) -> f64 {
    let supply_pa = f64::from(config.supply.pressure_pa);
    let limit_pa = f64::from(config.pressure_limit_pa);
    allowed_pa.min(SUPPLY_SHARE * supply_pa).min(LIMIT_SHARE * limit_pa)
}

impl Plan {
    /// The experiment for the core's configuration, up to `highest_pa`.
    ///
    /// # Errors
    /// If the allowed pressures do not move the configured muscle.
    pub fn new(config: &Config, highest_pa: f64) -> Result<Self, Refusal> {
        let (chamber, load_n) = configured(config)?;
        let usable_pa = usable_pa(config, f64::INFINITY);
        let highest_pa = highest_pa.min(usable_pa);
        let rest_m = chamber.rest_length_m();
        let [least, greatest] = contractions(config, &chamber).map(f64::from);
        let (sign, stroke) = if greatest > -least { (1.0, greatest) } else { (-1.0, -least) };
        let pressure_pa = |contraction: f64| {
            let length_m = rest_m * (1.0 - (sign * contraction) as f32);
            let gauge_pa = chamber.gauge_pressure_for_force_pa(load_n as f32, length_m);
            // 0 if the muscle cannot hold the load.
            if gauge_pa > 0.0 {
                f64::from(config.ambient.pressure_pa + gauge_pa)
            } else {
                f64::INFINITY
            }
        };
        let [from, most] = [0, 1].map(|i| CONTRACTIONS[i].min(OF_STROKE[i] * stroke));
        let steps = ((most - from) / 0.001) as u32;
        let to = (0..=steps)
            .map(|step| most - 0.001 * f64::from(step))
            .find(|contraction| pressure_pa(*contraction) <= highest_pa)
            .filter(|contraction| contraction - from >= LEAST_WIDTH)
            .ok_or_else(|| Refusal::NoRange {
                highest_pa,
                needed_pa: pressure_pa(from + LEAST_WIDTH),
                usable_pa,
            })?;
        let pressures_pa = [from, to].map(pressure_pa);
        let mut profile = Profile { points: vec![(0.0, pressures_pa[0])] };
        profile.hold(REST_S);
        let rest_s = 0.5 * REST_S..profile.end_s();
        let ramps_from_s = profile.end_s();
        let ramps = profile.ramps([from, to], pressure_pa);
        let steps_from_s = profile.end_s();
        profile.steps(pressures_pa);
        let steps_to_s = profile.end_s();
        profile.go(0.001, f64::from(config.ambient.pressure_pa));
        profile.hold(REST_S);
        Ok(Self {
            pressures_pa,
            contractions: [sign * from, sign * to],
            profile: profile.points,
            rest_s,
            ramps_s: ramps_from_s..steps_from_s,
            ramps,
            steps_s: steps_from_s..steps_to_s,
        })
    }
}

struct Profile {
    points: Vec<(f64, f64)>,
}

impl Profile {
    fn last(&self) -> (f64, f64) {
        self.points[self.points.len() - 1]
    }

    fn end_s(&self) -> f64 {
        self.last().0
    }

    fn go(&mut self, after_s: f64, pa: f64) {
        self.points.push((self.end_s() + after_s, pa));
    }

    fn hold(&mut self, duration_s: f64) {
        self.go(duration_s, self.last().1);
    }

    /// Ramps between two contractions, up and down at every speed.
    fn ramps(&mut self, [from, to]: [f64; 2], pressure_pa: impl Fn(f64) -> f64) -> Vec<Ramp> {
        let mut ramps = Vec::new();
        for (speed, times) in RAMPS {
            let duration_s = (to - from) / speed;
            let points = (duration_s / POINT_S).ceil() as u32;
            for (start, end) in [(from, to), (to, from)].repeat(times) {
                let start_s = self.end_s();
                for i in 1..=points {
                    let share = f64::from(i) / f64::from(points);
                    let pa = pressure_pa(start + share * (end - start));
                    self.go(duration_s / f64::from(points), pa);
                }
                self.hold(DWELL_S);
                ramps.push(Ramp { time_s: start_s..self.end_s(), rises: end > start });
            }
        }
        ramps
    }

    fn steps(&mut self, [low_pa, high_pa]: [f64; 2]) {
        for _ in 0..STEPS {
            for pa in [low_pa + STEP_FROM * (high_pa - low_pa), high_pa] {
                self.go(0.001, pa);
                self.hold(STEP_S - 0.001);
            }
        }
    }
}

pub fn during<'a>(records: &'a [Record], time_s: &Range<f64>) -> &'a [Record] {
    let from = records.partition_point(|record| record.time_s < time_s.start);
    let to = records.partition_point(|record| record.time_s < time_s.end);
    &records[from..to]
}
