//! One run with one fault.

use super::VENTED_S;
use super::cases::{Fault, Reaction};
use super::muscle::{self, Draw};
use model_core::control::Mode;
use model_core::{Command, Faults};
use thermyo_record::trace::Row;
use thermyo_scenario::{FaultWindow, PlantModel};
use thermyo_setup::Loaded;
use thermyo_setup::core_config::pressure_limit_pa;
use thermyo_simulation::board::{Board, CoreBoard};
use thermyo_simulation::run;
use thermyo_simulation::run::RunError;

pub const VENTED_PA: f64 = 1.2e5;
/// Range of the fault's start \[s\].
pub const COMES_S: [f64; 2] = [4.0, 7.0];
/// Largest pressure of a muscle whose venting is blocked, over the pressure at detection: gas in
/// the tube, and noise \[-\].
const NO_RISE: f64 = 1.02;

#[derive(Debug, Clone, PartialEq, Default)]
pub struct Outcome {
    /// Time until detection, counted as `Counted` requires \[s\].
    pub found_s: Option<f64>,
    /// Time during which the fault was visible, counted likewise \[s\].
    pub counted_s: f64,
    /// Time until detection from the fault's start \[s\].
    pub since_s: f64,
    /// Faults shown before the start.
    pub before: Faults,
    /// Faults shown after the start.
    pub shown: Faults,
    /// Whether the required reaction happened.
    pub reacted: bool,
    /// Highest pressure after the fault's start \[Pa\].
    pub highest_pa: f64,
    /// RMS error of the estimate after the fault's start \[K\].
    pub error_k: f64,
}

/// Evaluates a run step by step.
struct Judge<'a> {
    fault: &'a Fault,
    from_s: f64,
    limit_pa: f64,
    counted_steps: u64,
    step_s: f64,
    found_s: Option<f64>,
    found_pa: f64,
    outcome: Outcome,
    fails: bool,
    steps: u64,
    squares_k2: f64,
}

impl<'a> Judge<'a> {
    fn new(trial: &'a Trial) -> Self {
        Self {
            fault: &trial.fault,
            from_s: trial.from_s,
            limit_pa: pressure_limit_pa(&trial.loaded.plant),
            counted_steps: 0,
            step_s: trial.loaded.plant.run.step_s,
            found_s: None,
            found_pa: 0.0,
            outcome: Outcome::default(),
            fails: false,
            steps: 0,
            squares_k2: 0.0,
        }
    }

    fn add(&mut self, row: &Row) {
        let Row { truth, telemetry, .. } = row;
        let faults = telemetry.faults;
        // A step that began before the fault is still healthy.
        if truth.time_s < self.from_s - 0.5 * self.step_s {
            self.outcome.before = self.outcome.before.with(faults);
            return;
        }
        let outcome = &mut self.outcome;
        outcome.shown = outcome.shown.with(faults);
        outcome.highest_pa = outcome.highest_pa.max(truth.pressure_pa);
        let error_k = f64::from(telemetry.estimate.gas_k) - truth.gas_temperature_k;
        self.squares_k2 += error_k * error_k;
        self.steps += 1;
        if self.found_s.is_none() {
            let above = truth.pressure_pa > self.limit_pa;
            self.counted_steps += u64::from(self.fault.counted.counts(telemetry, truth, above));
            if faults.intersects(self.fault.found) {
                outcome.since_s = truth.time_s - self.from_s + self.step_s;
                self.found_s = Some(truth.time_s);
                self.found_pa = truth.pressure_pa;
            }
        }
        let Some(found_s) = self.found_s else { return };
        let venting = telemetry.command == Command::VENT;
        self.fails |= match self.fault.reaction {
            Reaction::Vents => {
                let late = truth.time_s > found_s + VENTED_S;
                !venting || (late && truth.pressure_pa > VENTED_PA)
            }
            Reaction::VentsInVain => {
                !venting || truth.pressure_pa > NO_RISE * self.found_pa.max(self.limit_pa)
            }
            Reaction::Shown => telemetry.mode == Mode::Vent,
            Reaction::ShownOrVents => truth.pressure_pa > self.limit_pa,
            Reaction::NotStated => false,
        };
    }

    fn outcome(self) -> Outcome {
        // Counting ends with the detection.
        let counted_s = self.counted_steps as f64 * self.step_s;
        Outcome {
            found_s: self.found_s.map(|_| counted_s),
            reacted: self.found_s.is_some() && !self.fails,
            counted_s,
            error_k: (self.squares_k2 / self.steps.max(1) as f64).sqrt(),
            ..self.outcome
        }
    }
}

#[derive(Debug, Clone)]
pub struct Trial {
    pub fault: Fault,
    /// The muscle's scenario, with the fault in its window.
    pub loaded: Loaded,
    pub from_s: f64,
}

impl Trial {
    /// Run `number` with this fault, which starts within `comes_s`; every fourth run is on `full`.
    pub fn random(fault: &Fault, number: u64, comes_s: [f64; 2]) -> Self {
        let name = fault.name.bytes().fold(0, |sum, byte| (31 * sum + u64::from(byte)) % (1 << 40));
        let mut draw = Draw::new(name ^ (number << 40));
        let model = if number % 4 == 3 { PlantModel::Full } else { PlantModel::Lumped };
        let task = draw.of(fault.tasks);
        let from_s = (draw.between(comes_s) * 1000.0).round() / 1000.0;
        let duration_s = from_s + fault.observed_s + VENTED_S + 0.3;
        let mut loaded = muscle::random(&mut draw, model, task, duration_s);
        let mut window = FaultWindow { from_s, ..FaultWindow::default() };
        (fault.inject)(&mut draw, &loaded.plant, &mut window);
        loaded.plant.faults.own = window;
        Self { fault: *fault, loaded, from_s }
    }

    /// Runs the trial with the core in this process.
    pub fn run(&self) -> Result<Outcome, RunError> {
        self.run_on(&mut CoreBoard::default())
    }

    pub fn run_on(&self, board: &mut dyn Board) -> Result<Outcome, RunError> {
        let mut judge = Judge::new(self);
        let mut observer = |row: &Row| {
            judge.add(row);
            Ok(())
        };
        run::run(&self.loaded, board, None, &mut observer)?;
        Ok(judge.outcome())
    }
}
