//! Inputs of the board's estimator, interval by interval.
//!
//! The estimator's matrices are private; its debug output (`{:?}`) has them to the last bit.

use crate::covariance::{Covariance, Transition};
use crate::forms::{Interval, N, SENSOR};
use model_core::{Config, Duty, Sample, SetPoint, Telemetry};
use thermyo_record::trace::Row;
use thermyo_setup::Loaded;
use thermyo_simulation::board::{Board, BoardError, BoardStep, CoreBoard};
use thermyo_simulation::run;

/// Steps of an interval of the estimator, at a step of a millisecond.
const INTERVAL_STEPS: usize = 20;

/// The core in this process, inspected after every interval.
#[derive(Debug, Default)]
struct WatchedBoard {
    board: CoreBoard,
    config: Config,
    steps: usize,
    intervals: Vec<Interval>,
    first: Covariance,
    last: Covariance,
}

impl Board for WatchedBoard {
    fn name(&self) -> &'static str {
        "watched"
    }

    fn start(&mut self, config: &Config, set_point: SetPoint) -> Result<(), BoardError> {
        self.config = *config;
        self.board.start(config, set_point)
    }

    fn set(&mut self, set_point: SetPoint) -> Result<(), BoardError> {
        self.board.set(set_point)
    }

    fn step(&mut self, sample: &Sample) -> Result<BoardStep, BoardError> {
        let step = self.board.step(sample)?;
        self.steps += 1;
        if let Some(telemetry) = &step.telemetry
            && self.steps.is_multiple_of(INTERVAL_STEPS)
        {
            let printed = format!("{:?}", self.board);
            let printed = Printed(&printed).within("estimator: Estimator");
            self.last = printed.covariance();
            if self.intervals.is_empty() {
                self.first = self.last;
            }
            self.intervals.push(printed.interval(&self.config, telemetry));
        }
        Ok(step)
    }
}

/// A part of a value's debug output.
#[derive(Debug, Clone, Copy)]
struct Printed<'a>(&'a str);

impl<'a> Printed<'a> {
    /// The text after `name`.
    fn within(self, name: &str) -> Self {
        let at = self.0.find(name).unwrap_or_else(|| panic!("the core prints no `{name}`"));
        Self(&self.0[at + name.len()..])
    }

    fn number(self, name: &str) -> f32 {
        let Self(rest) = self.within(&format!(" {name}: "));
        let end = rest.find([',', ' ', '}']).unwrap_or(rest.len());
        rest[..end].parse().unwrap_or_else(|_| panic!("`{name}` is no number: {}", &rest[..end]))
    }

    fn covariance(self) -> Covariance {
        let p = self.within("covariance: Covariance");
        Covariance {
            gas_gas: p.number("gas_gas"),
            gas_wall: p.number("gas_wall"),
            gas_sensor: p.number("gas_sensor"),
            gas_scale: p.number("gas_scale"),
            gas_lag: p.number("gas_lag"),
            wall_wall: p.number("wall_wall"),
            wall_sensor: p.number("wall_sensor"),
            wall_scale: p.number("wall_scale"),
            wall_lag: p.number("wall_lag"),
            sensor_sensor: p.number("sensor_sensor"),
            sensor_scale: p.number("sensor_scale"),
            sensor_lag: p.number("sensor_lag"),
            scale_scale: p.number("scale_scale"),
            scale_lag: p.number("scale_lag"),
            lag_lag: p.number("lag_lag"),
        }
    }

    fn interval(self, config: &Config, telemetry: &Telemetry) -> Interval {
        let pending = self.within("pending: Pending");
        let f = pending.within("Rows(Transition");
        let transition = Transition {
            gas_gas: f.number("gas_gas"),
            gas_wall: f.number("gas_wall"),
            gas_scale: f.number("gas_scale"),
            wall_gas: f.number("wall_gas"),
            wall_wall: f.number("wall_wall"),
            wall_scale: f.number("wall_scale"),
            sensor_gas: f.number("sensor_gas"),
            sensor_sensor: f.number("sensor_sensor"),
            sensor_lag: f.number("sensor_lag"),
        };
        let gas_k = pending.number("gas_k");
        let Self(innovation) = pending.within(" innovation_k: ");
        let innovation_k = innovation
            .strip_prefix("Some(")
            .and_then(|rest| rest.split(')').next())
            .and_then(|number| number.parse().ok());
        let tuning = &config.estimator;
        let duration_s = INTERVAL_STEPS as f32 * config.step_s;
        let forget = duration_s / tuning.memory_s;
        let keep = 1.0 - forget;
        let relative = tuning.gas_drift_k / gas_k;
        let f = &transition;
        Interval {
            transition,
            matrix: [
                [1.0 + f.gas_gas, f.gas_wall, 0.0, f.gas_scale, 0.0],
                [f.wall_gas, 1.0 + f.wall_wall, 0.0, f.wall_scale, 0.0],
                [f.sensor_gas, 0.0, 1.0 + f.sensor_sensor, 0.0, f.sensor_lag],
                [0.0, 0.0, 0.0, keep, 0.0],
                [0.0, 0.0, 0.0, 0.0, keep],
            ],
            drift: [
                relative * relative * duration_s,
                tuning.wall_drift_k * tuning.wall_drift_k * duration_s,
                1.0e-6,
                2.0 * forget * tuning.heat_scale_sd * tuning.heat_scale_sd,
                2.0 * forget * tuning.lag_sd * tuning.lag_sd,
            ],
            keep,
            reading_k2: self.number("reading_k2"),
            innovation_k,
            charging: telemetry.command.inlet > Duty::ZERO,
        }
    }
}

/// A run of the core with its estimator's intervals.
#[derive(Debug)]
pub struct Recording {
    pub intervals: Vec<Interval>,
    /// The covariance before the first of them.
    pub first: Covariance,
    /// The covariance before the last of them.
    pub last: Covariance,
    pub telemetry: Vec<Telemetry>,
    /// True gas temperature at every step \[K\].
    pub truth_k: Vec<f64>,
}

impl Recording {
    pub fn new(loaded: &Loaded) -> Self {
        let mut loaded = loaded.clone();
        loaded.plant.run.log_every = 1;
        let (mut telemetry, mut truth_k) = (Vec::new(), Vec::new());
        let mut observer = |row: &Row| {
            telemetry.push(row.telemetry);
            truth_k.push(row.truth.gas_temperature_k);
            Ok(())
        };
        let mut board = WatchedBoard::default();
        run::run(&loaded, &mut board, None, &mut observer).expect("the scenario runs");
        let WatchedBoard { intervals, first, last, .. } = board;
        Self { intervals, first, last, telemetry, truth_k }
    }

    /// Error at every step of the estimator with other gains, to first order \[K\]:
    /// e' = A e, e = e' + K (v - e'_s) - K_core v. T moves by u = dT/T.
    pub fn errors_k(
        &self,
        mut core: impl FnMut(&Interval) -> [f64; N],
        mut other: impl FnMut(&Interval) -> [f64; N],
    ) -> Vec<f64> {
        let steps = self.telemetry.iter().zip(&self.truth_k);
        let mut errors_k: Vec<f64> = Vec::with_capacity(self.truth_k.len());
        let (mut error, mut correcting) = ([0.0; N], self.intervals.iter());
        for (step, (telemetry, truth_k)) in steps.enumerate() {
            let ended = step > 0 && step.is_multiple_of(INTERVAL_STEPS);
            if ended && let Some(interval) = correcting.next() {
                let before = error;
                error = interval.matrix.map(|row| {
                    row.iter().zip(before).map(|(entry, e)| f64::from(*entry) * e).sum()
                });
                let (core_gain, gain) = (core(interval), other(interval));
                if let Some(innovation_k) = interval.innovation_k.map(f64::from) {
                    let seen = innovation_k - error[SENSOR];
                    for i in 0..N {
                        error[i] += gain[i] * seen - core_gain[i] * innovation_k;
                    }
                }
            }
            errors_k.push(f64::from(telemetry.estimate.gas_k) * (1.0 + error[0]) - truth_k);
        }
        errors_k
    }
}
