//! One run of a scenario.

use crate::load::JointLoaded;
use crate::rig::{Inputs, Rig, Row, RunError};
use crate::summary::{Accumulator, Summary};
use model_core::joint::JointTelemetry;
use std::collections::VecDeque;
use std::io;
use std::time::Instant;
use thermyo_record::summary::TimingFigures;
use thermyo_simulation::board::{BoardError, JointBoard, JointStep};
use thermyo_simulation::run::set_point_interval_steps;

/// Runs a scenario; `observer` gets one row per `[run] log_every` steps, the last step included.
///
/// # Errors
/// [`RunError`]; errors of the observer as [`RunError::Output`].
pub fn run(
    loaded: &JointLoaded,
    observer: &mut dyn FnMut(&Row) -> io::Result<()>,
) -> Result<Summary, RunError> {
    timed(loaded, |run| run.step(observer))
}

/// As [`run`], with the core on a board.
///
/// # Errors
/// As of [`run`]; [`RunError::Board`], also for a fault that restarts the board, which nothing does here.
pub fn run_on(
    board: &mut dyn JointBoard,
    loaded: &JointLoaded,
    observer: &mut dyn FnMut(&Row) -> io::Result<()>,
) -> Result<Summary, RunError> {
    let mut waiting = VecDeque::new();
    let summary = timed(loaded, |run| run.step_on(board, &mut waiting, observer))?;
    let timing = Some(TimingFigures::from(&board.timing()?));
    Ok(Summary { board: board.name(), timing, ..summary })
}

fn timed(
    loaded: &JointLoaded,
    mut step: impl FnMut(&mut Run) -> Result<bool, RunError>,
) -> Result<Summary, RunError> {
    // WebAssembly has no clock of its own.
    let started = (!cfg!(target_family = "wasm")).then(Instant::now);
    let mut run = Run::start(loaded)?;
    while step(&mut run)? {}
    let wall_clock_s = started.map_or(f64::INFINITY, |started| started.elapsed().as_secs_f64());
    Ok(run.finish(wall_clock_s))
}

/// A step whose telemetry has not arrived.
type Waiting = (u64, Box<dyn FnOnce(JointTelemetry) -> Row>);

/// Steps by which telemetry may arrive after the end of a run.
const MOST_LATE_STEPS: u64 = 10;

impl JointLoaded {
    pub fn inputs(&self, time_s: f64) -> Inputs {
        let load_n_m = self.load_n_m(time_s);
        Inputs { load_n_m, ..Inputs::of(self.motion(time_s)) }
    }

    /// Updates the inputs for a step: the load in each step, the set point at intervals.
    pub fn follow(&self, inputs: &mut Inputs, step: u64) {
        let step_s = self.muscles[0].plant.run.step_s;
        let time_s = step as f64 * step_s;
        inputs.load_n_m = self.load_n_m(time_s);
        if step.is_multiple_of(set_point_interval_steps(step_s)) {
            inputs.set_point = self.inputs(time_s).set_point;
        }
    }
}

/// A run in progress, step by step.
pub struct Run {
    loaded: JointLoaded,
    rig: Rig,
    inputs: Inputs,
    accumulator: Accumulator,
    step: u64,
    steps: u64,
}

impl Run {
    /// Joint and core at time zero.
    ///
    /// # Errors
    /// [`RunError`] for a scenario that cannot be run.
    pub fn start(loaded: &JointLoaded) -> Result<Self, RunError> {
        let run = &loaded.muscles[0].plant.run;
        let inputs = loaded.inputs(0.0);
        Ok(Self {
            rig: Rig::new(loaded, inputs)?,
            inputs,
            accumulator: Accumulator::new(loaded),
            step: 0,
            steps: run.steps(),
            loaded: loaded.clone(),
        })
    }

    /// Runs one step. Returns whether there is another one.
    ///
    /// # Errors
    /// [`RunError`]; errors of the observer as [`RunError::Output`].
    pub fn step(
        &mut self,
        observer: &mut dyn FnMut(&Row) -> io::Result<()>,
    ) -> Result<bool, RunError> {
        if self.step > self.steps {
            return Ok(false);
        }
        self.loaded.follow(&mut self.inputs, self.step + 1);
        let row = self.rig.step(self.inputs)?;
        self.take(self.step, &row, observer)?;
        self.step += 1;
        Ok(true)
    }

    /// As [`Self::step`], with the core on a board, whose output may arrive later: until then the step's row waits.
    fn step_on(
        &mut self,
        board: &mut dyn JointBoard,
        waiting: &mut VecDeque<Waiting>,
        observer: &mut dyn FnMut(&Row) -> io::Result<()>,
    ) -> Result<bool, RunError> {
        let ended = self.step > self.steps;
        if ended && (waiting.is_empty() || self.step > self.steps + MOST_LATE_STEPS) {
            return Ok(false);
        }
        if self.rig.board_restarts() {
            return Err(BoardError::NoRestart.into());
        }
        let former = self.inputs.set_point;
        self.loaded.follow(&mut self.inputs, self.step + 1);
        let next = Some(self.inputs.set_point).filter(|next| *next != former);
        let sample = self.rig.sample();
        if !ended {
            waiting.push_back((self.step, Box::new(self.rig.row())));
        }
        let JointStep { telemetry, actuations } = board.step(&sample, next)?;
        for telemetry in telemetry {
            let of = u64::from(telemetry.step());
            while waiting.front().is_some_and(|(step, _)| *step < of) {
                waiting.pop_front();
            }
            if let Some((step, row)) = waiting.pop_front() {
                self.take(step, &row(telemetry), observer)?;
            }
        }
        if !ended {
            self.rig.proceed(actuations, self.inputs)?;
        }
        self.step += 1;
        Ok(true)
    }

    /// Takes the row of a step.
    fn take(
        &mut self,
        step: u64,
        row: &Row,
        observer: &mut dyn FnMut(&Row) -> io::Result<()>,
    ) -> Result<(), RunError> {
        self.accumulator.add(row);
        let logged = step.is_multiple_of(self.loaded.muscles[0].plant.run.log_every);
        if logged || step == self.steps {
            observer(row).map_err(RunError::Output)?;
        }
        Ok(())
    }

    /// Takes over set point, load, supply, heat transfer, sensor lags and arm of another scenario from the next step
    /// on: see [`Rig::retune`]. The core receives only the set point.
    ///
    /// # Errors
    /// [`RunError`] for an impossible plant; then nothing has changed.
    pub fn retune(&mut self, loaded: &JointLoaded) -> Result<(), RunError> {
        self.rig.retune(loaded)?;
        self.loaded = loaded.clone();
        Ok(())
    }

    /// Ends the run and returns its summary; `wall_clock_s` is the time that the run took \[s\].
    pub fn finish(self, wall_clock_s: f64) -> Summary {
        self.accumulator.finish(wall_clock_s, self.rig.ledgers())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load::parse;
    use crate::trace::COLUMNS;
    use thermyo_files::units::UnitSystem;

    /// Rows of 1 s, with other lines in the scenario from 0.5 s on.
    fn rows(model: &str, text: &str, later: Option<&str>) -> Vec<Vec<f64>> {
        let loaded = |text: &str| {
            let text = format!(
                "[run]\nduration_s = 1.0\nlog_every = 1\n[plant]\nmodel = \"{model}\"\ninitial_pressure_pa = 290000\n{text}"
            );
            parse(&text, "joint.toml".as_ref()).unwrap()
        };
        let mut run = Run::start(&loaded(text)).unwrap();
        let mut rows = Vec::new();
        for step in 0_u32.. {
            if let Some(later) = later.filter(|_| step == 500) {
                run.retune(&loaded(later)).unwrap();
            }
            let observer = &mut |row: &Row| {
                rows.push(row.cells());
                Ok(())
            };
            if !run.step(observer).unwrap() {
                break;
            }
        }
        rows
    }

    const ARM: &str = "[joint]\ngravity_n_m = 4.9\nfriction_n_m = 0.2\n[drive]\n\
                       shape = \"sine\"\namplitude_rad = 0.2\n";

    #[test]
    fn what_is_turned_to_what_it_is_changes_no_bit() {
        for model in ["lumped", "full"] {
            let bits = |rows: Vec<Vec<f64>>| {
                rows.into_iter().flatten().map(f64::to_bits).collect::<Vec<_>>()
            };
            let [plain, turned] = [None, Some(ARM)].map(|later| bits(rows(model, ARM, later)));
            assert_eq!(plain.len(), 1001 * COLUMNS.len());
            assert!(plain == turned, "{model}");
        }
    }

    #[test]
    fn what_is_turned_acts_from_then_on_and_nothing_jumps() {
        let column = |name: &str| COLUMNS.iter().position(|column| *column == name).unwrap();
        let angle = column("angle_rad");
        for model in ["lumped", "full"] {
            let plain = rows(model, ARM, None);
            for (was, is) in [
                ("[drive]\n", "inertia_kg_m2 = 0.005\n[drive]\n"),
                ("friction_n_m = 0.2", "friction_n_m = 2.0"),
                ("gravity_n_m = 4.9", "gravity_n_m = 1.0"),
                ("[drive]\n", "[supply]\npressure_pa = 350000\n[drive]\n"),
                ("[drive]\n", "[drive]\nload_n_m = 2\n"),
                ("amplitude_rad = 0.2", "amplitude_rad = 0.1"),
                ("[drive]\n", "[drive]\nstiffness_n_m_rad = 10\n"),
            ] {
                let turned = rows(model, ARM, Some(&ARM.replace(was, is)));
                let same = |a: &[f64], b: &[f64]| a[..COLUMNS.len()] == b[..COLUMNS.len()];
                assert!(plain[..500].iter().zip(&turned).all(|(a, b)| same(a, b)), "{is}");
                let moved = plain.iter().zip(&turned).map(|(a, b)| (a[angle] - b[angle]).abs());
                let moved = moved.fold(0.0, f64::max);
                assert!(moved > 1e-5, "{model}, {is}: {moved} rad");
                for (name, most) in [
                    ("angle_rad", 0.01),
                    ("a_pressure_pa", 3e3),
                    ("b_gas_temperature_k", 0.5),
                    ("a_sensor_gas_k", 1.0),
                ] {
                    let place = column(name);
                    let by = (turned[501][place] - turned[500][place]).abs();
                    assert!(by < most, "{model}, {is}: {name} jumps by {by}");
                }
            }
        }
    }

    /// A joint's angle has the figures that a muscle's contraction has.
    #[test]
    fn every_shape_has_its_figures() {
        let of = |shape: &str| {
            let text = format!(
                "[run]\nduration_s = 8.0\n[plant]\nmodel = \"lumped\"\ninitial_pressure_pa = 290000\n[joint]\n[drive]\n\
                 amplitude_rad = 0.1\nshape = {shape}\n"
            );
            let loaded = parse(&text, "joint.toml".as_ref()).unwrap();
            run(&loaded, &mut |_| Ok(())).unwrap().figures.control.unwrap()
        };
        let sine = of("\"sine\"\nperiod_s = 2.0");
        assert!((0.95..1.05).contains(&sine.gain.unwrap()), "{sine:?}");
        assert!(sine.phase_deg.unwrap().abs() < 5.0, "{sine:?}");
        for (shape, jumps_s) in [("step", 2.0), ("staircase", 0.5)] {
            let found = of(&format!("\"{shape}\"\nperiod_s = 4.0"));
            assert!((0.01..jumps_s).contains(&found.settled_s.unwrap()), "{shape}: {found:?}");
            let overshoot = found.overshoot.unwrap();
            assert!(overshoot < 0.1 && found.unsettled == 0, "{shape}: {found:?}");
            assert_eq!((found.gain, found.bandwidth_hz), (None, None));
        }
        // From 0.5 to 8 Hz.
        let chirp = of("\"chirp\"\nperiod_s = 2.0");
        assert!((3.0..8.0).contains(&chirp.bandwidth_hz.unwrap()), "{chirp:?}");
        // An arm that stays at 0 rad used to overshoot by "inf %".
        for shape in ["\"constant\"\nload_n_m = 0.5", "\"staircase\"\nperiod_s = 100.0"] {
            let found = of(shape);
            assert!(found.overshoot.is_none() && found.shape_text().is_empty(), "{found:?}");
        }
    }

    /// The reference of a heavy arm once had the torque of a light one: an arm of 1.5 kg m2 stood nearly still.
    #[test]
    fn a_heavy_arm_on_strong_muscles_follows() {
        let text = "[run]\nduration_s = 6.0\n[plant]\nmodel = \"lumped\"\ninitial_pressure_pa = 250000\n[muscle]\n\
                    rest_length_m = 0.6\ndiameter_m = 0.04\n[valve]\nconductance_m3_s_pa = 5e-8\n[joint]\n\
                    radius_m = 0.06\nmid_length_a_m = 0.54\nmid_length_b_m = 0.54\ninertia_kg_m2 = 1.5\n[drive]\n\
                    stiffness_n_m_rad = 300\nshape = \"sine\"\namplitude_rad = 0.35\nperiod_s = 1.0\n";
        let loaded = parse(text, "joint.toml".as_ref()).unwrap();
        assert_eq!(loaded.controller.reference_torque_n_m, 25.5);
        let figures = run(&loaded, &mut |_| Ok(())).unwrap().figures;
        let sine = figures.control.as_ref().unwrap();
        assert!((0.95..1.05).contains(&sine.gain.unwrap()), "{sine:?}");
        assert!((0.001..0.03).contains(&figures.rms_error_rad), "{figures:?}");
        // A light arm has the usual torque, and one on weak muscles a quarter of theirs.
        let of = |inertia: &str| {
            let text = format!("[joint]\ninertia_kg_m2 = {inertia}\n");
            parse(&text, "joint.toml".as_ref()).unwrap().controller.reference_torque_n_m
        };
        assert_eq!(of("0.14"), 2.5);
        assert!((2.6..10.0).contains(&of("100")), "{}", of("100"));
    }

    /// Much gain, and an inertia believed too large: an arm that swings used to be shown by its plots alone.
    #[test]
    fn an_arm_that_swings_on_is_named() {
        let of = |tuning: &str| {
            let text = format!(
                "[run]\nduration_s = 6.0\n[plant]\nmodel = \"lumped\"\ninitial_pressure_pa = 290000\n{tuning}[drive]\n\
                 amplitude_rad = 0.3\nshape = \"step\"\nperiod_s = 4.0\n"
            );
            let loaded = parse(&text, "joint.toml".as_ref()).unwrap();
            run(&loaded, &mut |_| Ok(())).unwrap().figures
        };
        let swings = of(
            "[joint]\nfriction_n_m = 0.0\n[believed.joint]\ninertia_kg_m2 = 0.05\n[joint.controller]\n\
             gain_n_m_rad = 40.0\ndisturbance_rad_s = 40.0\n",
        );
        let cycle = swings.limit_cycle.unwrap();
        assert!((0.5..20.0).contains(&cycle.frequency_hz), "{cycle:?}");
        assert!((0.01..0.3).contains(&cycle.amplitude), "{cycle:?}");
        let warning = swings.unrest(UnitSystem::Practical).unwrap();
        assert!(
            warning.contains(" Hz with an amplitude of ") && warning.contains(" deg "),
            "{warning}"
        );
        assert_eq!(of("[joint]\nfriction_n_m = 0.2\n").limit_cycle, None);
    }
}
