//! One run: plant, front end and board in lockstep.
//!
//! ```text
//! plant --Truth--> front end, ADC --Sample--> board (core) --Command--> plant, once per step
//! ```

use crate::board::{Board, BoardError, BoardStep, CoreBoard};
use crate::rig::{MeanFlows, Rig};
use model_core::control::Mode;
use model_core::forward_model::Model;
use model_core::{Command, ConfigError, Duty, Sample, SetPoint, Telemetry};
use std::collections::VecDeque;
use std::io;
use std::ops::Range;
use std::time::Instant;
use thermyo_plant::chamber;
use thermyo_plant::{BuildError, Diverged, Truth};
use thermyo_record::limit_cycle::Detector;
use thermyo_record::measured::Measured;
use thermyo_record::summary::{Accumulator, Ending, Summary};
use thermyo_record::trace::Row;
use thermyo_record::tracking::{Controlled, Tracked};
use thermyo_scenario::profile::Profile;
use thermyo_scenario::{Drive, DriveKind, LoadKind, Scenario, Shape};
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;

/// Interval at which a set point that follows a profile is updated \[s\].
const SET_POINT_INTERVAL_S: f64 = 0.01;

/// This interval in steps of the core.
pub fn set_point_interval_steps(step_s: f64) -> u64 {
    (SET_POINT_INTERVAL_S / step_s).round().max(1.0) as u64
}

/// Steps after the end within which the last telemetry has to arrive.
pub const MOST_LATE_STEPS: u64 = 5;

/// Reason why a run ended early.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The plant cannot be built from the scenario.
    #[error(transparent)]
    Build(BuildError),
    #[error("the core refuses its configuration: {0}")]
    Config(ConfigError),
    /// The plant left the range of its equations.
    #[error(transparent)]
    Diverged(#[from] Diverged),
    /// The board does not answer.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// The observer cannot write a row.
    #[error(transparent)]
    Output(io::Error),
    /// The observer ended the run with an error of the kind `Interrupted`.
    #[error("stopped")]
    Stopped,
}

/// Receives the rows of a run.
pub trait Observer {
    /// One row per `[run] log_every` steps, the last step included.
    ///
    /// # Errors
    /// If the row cannot be written, or of the kind `Interrupted`; the run stops.
    fn row(&mut self, row: &Row) -> io::Result<()>;
}

impl<F: FnMut(&Row) -> io::Result<()>> Observer for F {
    fn row(&mut self, row: &Row) -> io::Result<()> {
        self(row)
    }
}

pub fn run(
    loaded: &Loaded,
    board: &mut dyn Board,
    measured: Option<&Measured>,
    observer: &mut dyn Observer,
) -> Result<Summary, RunError> {
    // WebAssembly has no clock of its own.
    let started = (!cfg!(target_family = "wasm")).then(Instant::now);
    let mut run = Run::start(loaded, board, measured)?;
    while run.step(board, observer)? {}
    let wall_clock_s = started.map_or(f64::INFINITY, |started| started.elapsed().as_secs_f64());
    run.finish(board, wall_clock_s)
}

/// Runs a scenario on the core in this process; `each` gets its rows.
pub fn on_core(loaded: &Loaded, mut each: impl FnMut(&Row)) -> Result<Summary, RunError> {
    run(loaded, &mut CoreBoard::default(), None, &mut |row: &Row| {
        each(row);
        Ok(())
    })
}

/// The rows of a scenario on the core in this process.
pub fn rows(loaded: &Loaded) -> Result<Vec<Row>, RunError> {
    let mut rows = Vec::new();
    on_core(loaded, |row| rows.push(*row))?;
    Ok(rows)
}

pub struct Run {
    loaded: Loaded,
    rig: Rig,
    drive: SetPoints,
    model: Model,
    accumulator: Accumulator,
    /// Detects limit cycles, if there is a controlled quantity.
    detector: Option<Detector>,
    rest_length_m: Option<f64>,
    length_held: bool,
    sample: Sample,
    flows: MeanFlows,
    step_flows: MeanFlows,
    /// Steps whose telemetry has not arrived: none in this process, one over a link.
    waiting: VecDeque<Waiting>,
    alignment: StepAlignment,
    step: u64,
    steps: u64,
}

impl Run {
    /// Plant and board at time zero.
    pub fn start(
        loaded: &Loaded,
        board: &mut dyn Board,
        measured: Option<&Measured>,
    ) -> Result<Self, RunError> {
        let scenario = &loaded.plant;
        let config = core_config(&loaded.believed);
        let rig = Rig::new(loaded).map_err(RunError::Build)?;
        let drive = SetPoints::new(loaded);
        let truth = rig.truth();
        let model = Model::new(
            &config,
            truth.pressure_pa as f32,
            truth.gas_temperature_k as f32,
            truth.length_m as f32,
        )
        .map_err(RunError::Config)?;
        let rest_length_m = chamber::of(scenario).map(|chamber| chamber.rest_length());
        let flows = MeanFlows::new(&rig);
        board.start(&config, drive.at(0.0))?;
        Ok(Self {
            detector: drive.dead_zone(&loaded.believed).map(Detector::new),
            drive,
            model,
            accumulator: Accumulator::new(scenario.run.duration_s, Tracked::of(scenario), measured),
            rest_length_m,
            length_held: rest_length_m.is_none() || scenario.load.kind == LoadKind::Isometric,
            sample: Sample::default(),
            flows,
            step_flows: flows,
            waiting: VecDeque::new(),
            alignment: StepAlignment::STARTED,
            step: 0,
            steps: scenario.run.steps(),
            rig,
            loaded: loaded.clone(),
        })
    }

    /// Runs one step. Returns whether there is another one.
    pub fn step(
        &mut self,
        board: &mut dyn Board,
        observer: &mut dyn Observer,
    ) -> Result<bool, RunError> {
        let (step, steps) = (self.step, self.steps);
        let ended = step > steps;
        if ended && (self.waiting.is_empty() || step > steps + MOST_LATE_STEPS) {
            return Ok(false);
        }
        if !ended {
            self.prepare(board)?;
        }
        let BoardStep { telemetry, actuation } = board.step(&self.sample)?;
        if let Some(telemetry) = telemetry {
            self.take(telemetry, observer)?;
        }
        if step < steps {
            self.rig.advance(actuation)?;
        }
        self.step += 1;
        Ok(true)
    }

    /// The board's input for this step, and the plant's state.
    fn prepare(&mut self, board: &mut dyn Board) -> Result<(), RunError> {
        let Self { rig, step, .. } = self;
        let step = *step;
        let mut truth = rig.truth();
        let run = &self.loaded.plant.run;
        let (inflow, outflow) = self.step_flows.since(rig, run.step_s);
        if step > 0 {
            let held = self.length_held.then_some(truth.length_m as f32);
            self.model.step(inflow as f32, outflow as f32, held);
        }
        // The set point acts from the next step on.
        if let Some(set_point) = self.drive.acting_from(step + 1, &self.loaded) {
            board.set(set_point)?;
        }
        if rig.board_restarts() {
            board.restart()?;
        }
        self.sample = rig.sample();
        let logged = step.is_multiple_of(run.log_every) || step == self.steps;
        if logged {
            let elapsed_s = self.flows.elapsed_s(rig);
            (truth.flow_in_kg_s, truth.flow_out_kg_s) = self.flows.since(rig, elapsed_s);
        }
        self.waiting.push_back(Waiting {
            step,
            logged,
            truth,
            sensor_gas_k: rig.gas_reading_k(),
            sensor_wall_k: rig.wall_reading_k(),
            model_k: f64::from(self.model.gas_k()),
            model_sensor_k: f64::from(self.model.sensor_k()),
        });
        Ok(())
    }

    /// Takes the board's output for a step.
    fn take(&mut self, telemetry: Telemetry, observer: &mut dyn Observer) -> Result<(), RunError> {
        let reported = self.alignment.step_of(&telemetry, self.step);
        while self.waiting.front().is_some_and(|front| front.step < reported) {
            self.waiting.pop_front();
        }
        let Some(done) = self.waiting.pop_front() else { return Ok(()) };
        let row = Row {
            sensor_gas_k: done.sensor_gas_k,
            sensor_wall_k: done.sensor_wall_k,
            model_k: done.model_k,
            model_sensor_k: done.model_sensor_k,
            set_point: self.drive.value(done.truth.time_s),
            truth: done.truth,
            telemetry,
        };
        let controlled = self.drive.controlled(self.rest_length_m, &row);
        self.accumulator.add(&row, controlled);
        if let (Some(detector), Some(value)) = (&mut self.detector, controlled) {
            let Command { inlet, outlet } = row.telemetry.command;
            let driven = [inlet > Duty::ZERO, outlet > Duty::ZERO];
            detector.add(row.truth.time_s, row.set_point, value, driven);
        }
        if done.logged {
            observer.row(&row).map_err(|error| match error.kind() {
                io::ErrorKind::Interrupted => RunError::Stopped,
                _ => RunError::Output(error),
            })?;
        }
        Ok(())
    }

    /// Changes supply, load, heat transfer, sensor lags or set point from the next step on: see
    /// [`Rig::retune`]. The core receives only the set point.
    ///
    /// # Errors
    /// [`RunError`] for an impossible plant; then nothing has changed.
    pub fn retune(&mut self, plant: &Scenario, board: &mut dyn Board) -> Result<(), RunError> {
        self.rig.retune(plant).map_err(RunError::Build)?;
        let driven = plant.drive != self.loaded.plant.drive;
        self.loaded.plant = plant.clone();
        if driven {
            self.drive = SetPoints::new(&self.loaded);
            self.detector = self.drive.dead_zone(&self.loaded.believed).map(Detector::new);
            board.set(self.drive.at(self.rig.truth().time_s))?;
        }
        Ok(())
    }

    /// Ends the run and returns its summary; `wall_clock_s` is the time that the run took \[s\].
    pub fn finish(self, board: &mut dyn Board, wall_clock_s: f64) -> Result<Summary, RunError> {
        let Self { loaded, rig, drive, .. } = self;
        let scenario = &loaded.plant;
        Ok(self.accumulator.finish(Ending {
            wall_clock_s,
            board: board.name(),
            period_s: (scenario.drive.kind == DriveKind::MassFlow && !drive.moves())
                .then_some(scenario.drive.period_s),
            controlled: drive.quantity(),
            limit_cycle: self.detector.and_then(Detector::finish),
            rest_length_m: self.rest_length_m,
            ledger: rig.ledger(),
            axial_wall_k: rig.axial_wall_k(),
            axial_gas_k: rig.axial_gas_k(),
            timing: board.timing()?,
        }))
    }
}

/// A step of the plant whose telemetry has not arrived.
#[derive(Debug, Clone, Copy)]
struct Waiting {
    step: u64,
    logged: bool,
    truth: Truth,
    sensor_gas_k: f64,
    sensor_wall_k: f64,
    model_k: f64,
    model_sensor_k: f64,
}

/// Matches telemetry to the steps of the run.
#[derive(Debug, Clone, Copy)]
struct StepAlignment {
    /// The run's step at the board's step 0; none during the startup check after a restart.
    zero: Option<u64>,
    late: u64,
    /// The step that was matched last.
    last: Option<u64>,
}

impl StepAlignment {
    const STARTED: Self = Self { zero: Some(0), late: 0, last: None };

    fn step_of(&mut self, telemetry: &Telemetry, now: u64) -> u64 {
        let in_time = now.saturating_sub(self.late);
        if telemetry.mode == Mode::StartupCheck {
            self.zero = None;
            return in_time;
        }
        let counted = u64::from(telemetry.step);
        // A board that counts back has restarted, even if no frame of its startup check arrived.
        let goes_on = |zero: &u64| self.last.is_none_or(|last| zero + counted > last);
        let zero = self.zero.filter(goes_on).unwrap_or(in_time.saturating_sub(counted));
        let step = zero + counted;
        (self.zero, self.late, self.last) = (Some(zero), now.saturating_sub(step), Some(step));
        step
    }
}

/// The scenario's drive as set points over time.
#[derive(Debug, Clone)]
pub struct SetPoints {
    drive: Drive,
    profile: Option<Profile>,
    shut_s: Vec<Range<f64>>,
    duration_s: f64,
}

impl SetPoints {
    pub fn new(loaded: &Loaded) -> Self {
        Self {
            drive: loaded.plant.drive.clone(),
            profile: loaded.drive_profile.clone(),
            shut_s: loaded.shut_s.clone(),
            duration_s: loaded.plant.run.duration_s,
        }
    }

    /// The set point to send before this step, at intervals, if a profile changes it.
    pub fn acting_from(&self, step: u64, loaded: &Loaded) -> Option<SetPoint> {
        let step_s = loaded.plant.run.step_s;
        let due = self.moves() && step.is_multiple_of(set_point_interval_steps(step_s));
        due.then(|| self.at(step as f64 * step_s))
    }

    /// Whether a profile or a shape moves the set point.
    pub fn moves(&self) -> bool {
        self.profile.is_some() || self.drive.shape != Shape::Constant
    }

    /// Smallest and largest value with their times \[s\], in the drive's own unit.
    pub fn extremes(&self) -> Vec<(f64, f64)> {
        match &self.profile {
            Some(profile) => profile.points().to_vec(),
            None if self.drive.shape != Shape::Constant => {
                self.drive.extremes().map(|value| (0.0, value)).to_vec()
            }
            None => vec![(0.0, self.value(0.0))],
        }
    }

    /// The value in the drive's own unit; 0 if it has none.
    pub fn value(&self, time_s: f64) -> f64 {
        if let Some(profile) = &self.profile {
            return profile.value(time_s);
        }
        match self.drive.kind {
            DriveKind::MassFlow => {
                let filling = (time_s / self.drive.period_s + 1e-9).fract() < 0.5;
                if filling { self.drive.flow_kg_s } else { -self.drive.flow_kg_s }
            }
            DriveKind::Pressure | DriveKind::Contraction => {
                self.drive.shaped(time_s, self.duration_s)
            }
            DriveKind::Fill => 1.0,
            DriveKind::Discharge => -1.0,
            DriveKind::Duty | DriveKind::Closed => 0.0,
        }
    }

    pub fn at(&self, time_s: f64) -> SetPoint {
        if self.shut_s.iter().any(|shut_s| shut_s.contains(&time_s)) {
            return SetPoint::Duty { inlet: 0.0, outlet: 0.0 };
        }
        match self.drive.kind {
            DriveKind::MassFlow if self.profile.is_none() => SetPoint::MassFlowCycle {
                flow_kg_s: self.drive.flow_kg_s as f32,
                period_s: self.drive.period_s as f32,
            },
            _ => self.of(self.value(time_s)),
        }
    }

    /// The set point for a value in the drive's own unit.
    pub fn of(&self, value: f64) -> SetPoint {
        match self.drive.kind {
            DriveKind::MassFlow => SetPoint::MassFlow { flow_kg_s: value as f32 },
            DriveKind::Pressure => SetPoint::Pressure { pressure_pa: value as f32 },
            DriveKind::Contraction => SetPoint::Contraction { contraction: value as f32 },
            DriveKind::Duty | DriveKind::Fill | DriveKind::Discharge | DriveKind::Closed => {
                let share = |value: f64| value.clamp(0.0, 1.0) as f32;
                SetPoint::Duty { inlet: share(value), outlet: share(-value) }
            }
        }
    }

    /// The controlled quantity's value in the plant.
    pub fn controlled(&self, rest_length_m: Option<f64>, row: &Row) -> Option<f64> {
        self.quantity().and_then(|quantity| match quantity {
            Controlled::Pressure => Some(row.truth.pressure_pa),
            Controlled::Contraction => {
                rest_length_m.map(|rest_m| 1.0 - row.truth.length_m / rest_m)
            }
        })
    }

    /// The core's dead zone at rest, in the unit of the controlled quantity.
    fn dead_zone(&self, believed: &Scenario) -> Option<f64> {
        self.quantity().map(|quantity| match quantity {
            Controlled::Pressure => f64::from(believed.controller.pressure_dead_zone_pa),
            Controlled::Contraction => f64::from(believed.controller.contraction_dead_zone),
        })
    }

    pub fn quantity(&self) -> Option<Controlled> {
        match self.drive.kind {
            DriveKind::Pressure => Some(Controlled::Pressure),
            DriveKind::Contraction => Some(Controlled::Contraction),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board::CoreBoard;
    use thermyo_record::trace::COLUMNS;

    type Change = fn(&mut Scenario);

    /// Rows of 2 s of a scenario, with a change after the first second.
    fn rows(text: &str, change: Option<Change>) -> Vec<[f64; COLUMNS.len()]> {
        let text = format!("[run]\nduration_s = 2.0\nlog_every = 1\n{text}");
        let loaded = thermyo_setup::parse(&text, "test".as_ref()).unwrap();
        let mut board = CoreBoard::default();
        let mut run = Run::start(&loaded, &mut board, None).unwrap();
        let mut rows = Vec::new();
        let mut observer = |row: &Row| {
            rows.push(row.cells());
            Ok(())
        };
        for step in 0_u32.. {
            if let Some(change) = change.filter(|_| step == 1000) {
                let mut plant = loaded.plant.clone();
                change(&mut plant);
                run.retune(&plant, &mut board).unwrap();
            }
            if !run.step(&mut board, &mut observer).unwrap() {
                break;
            }
        }
        rows
    }

    const PLANTS: [&str; 3] = [
        "[plant]\nmodel = \"lumped\"\n",
        "[plant]\nmodel = \"full\"\n",
        "[plant]\nkind = \"vessel\"\ninitial_pressure_pa = 5e5\n[drive]\nkind = \"discharge\"\n",
    ];

    #[test]
    fn what_is_turned_to_what_it_is_changes_no_bit() {
        for plant in PLANTS {
            let (plain, turned) = (rows(plant, None), rows(plant, Some(|_| ())));
            assert_eq!(plain.len(), 2001);
            for (a, b) in plain.iter().zip(&turned) {
                assert_eq!(a.map(f64::to_bits), b.map(f64::to_bits), "{plant} at {} s", a[0]);
            }
        }
    }

    #[test]
    fn what_is_turned_acts_from_then_on_and_nothing_jumps() {
        let column = |name: &str| COLUMNS.iter().position(|column| *column == name).unwrap();
        let changes: [(&str, Change); 4] = [
            ("length_m", |plant| plant.load.force_n = 160.0),
            ("flow_in_kg_s", |plant| plant.supply.pressure_pa = 5.0e5),
            ("gas_temperature_k", |plant| plant.heat.scale = 4.0),
            ("sensor_gas_k", |plant| plant.sensor.gas.time_constant_s = 0.2),
        ];
        for plant in &PLANTS[..2] {
            let plain = rows(plant, None);
            for (name, change) in changes {
                let turned = rows(plant, Some(change));
                assert_eq!(plain[..1000], turned[..1000], "{name}");
                let place = column(name);
                let differs = plain
                    .iter()
                    .zip(&turned)
                    .any(|(a, b)| (a[place] - b[place]).abs() > 1e-3 * a[place].abs());
                assert!(differs, "{plant}: {name}");
                // The gas itself may jump: a lumped muscle follows a new load at once.
                for (jump, most) in
                    [("mass_kg", 1e-6), ("wall_temperature_k", 0.1), ("sensor_gas_k", 1.0)]
                {
                    let jump = column(jump);
                    let by = (turned[1001][jump] - turned[999][jump]).abs();
                    assert!(by < most, "{plant}: {name} turned, {jump} jumps by {by}");
                }
            }
        }
    }
}
