//! The model behind a unit's interface: a scenario that is run on request.

use super::Kind;
pub use super::running::ModelError;
use super::running::{Inputs, Running};
use super::scenario::Scenario;
use super::variables::{FIRST_INPUT, Role, Variable};
use std::path::Path;

/// Tolerance of times as a fraction of a step, for rounding errors of sums.
const TOLERANCE: f64 = 1e-3;

/// How far a simulation has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    Initial,
    Stepping,
    /// Terminated, or broken off by an error: values can be read, and a reset begins again.
    Over,
}

pub struct Model {
    kind: Kind,
    scenario: Scenario,
    variables: Vec<Variable>,
    inputs: Inputs,
    start_s: f64,
    /// The importer's end, if it states one \[s\].
    stop_s: Option<f64>,
    running: Box<dyn Running>,
    /// Cells of the trace, current for the importer.
    cells: Vec<f64>,
    steps: u64,
    phase: Phase,
}

impl Model {
    pub fn load(resources: &Path) -> Result<Self, ModelError> {
        let kind =
            Kind::ALL.into_iter().find(|kind| resources.join(kind.scenario_file()).is_file());
        let kind = kind.unwrap_or(Kind::Plant);
        Self::new(Scenario::load(&resources.join(kind.scenario_file()))?, kind)
    }

    /// A scenario as a unit, at rest at time zero.
    pub fn new(scenario: impl Into<Scenario>, kind: Kind) -> Result<Self, ModelError> {
        let scenario = scenario.into();
        let inputs = scenario.inputs(kind);
        let mut running = scenario.start(kind, &inputs)?;
        Ok(Self {
            kind,
            variables: scenario.variables(kind),
            cells: running.look(),
            scenario,
            inputs,
            start_s: 0.0,
            stop_s: None,
            running,
            steps: 0,
            phase: Phase::Initial,
        })
    }

    pub fn kind(&self) -> Kind {
        self.kind
    }

    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    pub fn variables(&self) -> &[Variable] {
        &self.variables
    }

    pub fn reset(&mut self) -> Result<(), ModelError> {
        *self = Self::new(self.scenario.clone(), self.kind)?;
        Ok(())
    }

    fn check_initial(&self, call: &'static str) -> Result<(), ModelError> {
        if self.phase == Phase::Initial {
            return Ok(());
        }
        Err(ModelError::OutOfTurn { call, must: "before the first step, or after fmi3Reset" })
    }

    /// Sets the scenario's time zero in the importer's time, and the time at which that ends \[s\].
    ///
    /// # Errors
    /// Once it steps, and for a start that is not finite or lies behind the end.
    pub fn begin_at(&mut self, start_s: f64, stop_s: Option<f64>) -> Result<(), ModelError> {
        self.check_initial("fmi3EnterInitializationMode")?;
        let end_s = stop_s.unwrap_or(f64::INFINITY);
        if !(start_s.is_finite() && start_s <= end_s) {
            let allowed = format!("finite, and no later than the stop time of {end_s} s");
            return Err(ModelError::Value { name: "startTime", value: start_s, allowed });
        }
        (self.start_s, self.stop_s) = (start_s, stop_s);
        Ok(())
    }

    /// Starts stepping.
    ///
    /// # Errors
    /// As [`Model::new`], for the values set since; once it steps.
    pub fn start(&mut self) -> Result<(), ModelError> {
        self.check_initial("fmi3ExitInitializationMode")?;
        self.running = self.scenario.start(self.kind, &self.inputs)?;
        self.cells = self.running.look();
        self.phase = Phase::Stepping;
        Ok(())
    }

    /// Ends the simulation; the last values can still be read.
    pub fn terminate(&mut self) {
        self.phase = Phase::Over;
    }

    pub fn time_s(&self) -> f64 {
        self.start_s + self.steps as f64 * self.scenario.run().step_s
    }

    pub fn number(&self, reference: u32) -> Result<f64, ModelError> {
        let variable = self.variables.get(reference as usize);
        let found = variable.and_then(|variable| match variable.role {
            Role::Time => Some(self.time_s()),
            Role::Input | Role::Opening => self.inputs.numbers.get(input(reference)).copied(),
            Role::Plant | Role::Sampled => {
                let columns = self.scenario.columns();
                let column = columns.iter().position(|name| *name == variable.name);
                column.and_then(|column| self.cells.get(column)).copied()
            }
            Role::Parameter => None,
        });
        found.ok_or(ModelError::Reference { reference, what: "number" })
    }

    pub fn set_number(&mut self, reference: u32, value: f64) -> Result<(), ModelError> {
        let unknown = ModelError::Reference { reference, what: "number that can be set" };
        let Some(variable) = self.variables.get(reference as usize) else { return Err(unknown) };
        let (allowed, is_allowed) = match variable.role {
            Role::Opening => ("from 0 to 1", (0.0..=1.0).contains(&value)),
            Role::Input => ("a finite number", value.is_finite()),
            _ => return Err(unknown),
        };
        if !is_allowed {
            let (name, allowed) = (variable.name, allowed.to_owned());
            return Err(ModelError::Value { name, value, allowed });
        }
        self.inputs.numbers[input(reference)] = value;
        Ok(())
    }

    /// Whether a reference belongs to a Boolean.
    fn is_switch(&self, reference: u32) -> bool {
        let variable = self.variables.get(reference as usize);
        variable.is_some_and(|variable| variable.role == Role::Parameter)
    }

    pub fn switch(&self, reference: u32) -> Result<bool, ModelError> {
        if !self.is_switch(reference) {
            return Err(ModelError::Reference { reference, what: "truth value" });
        }
        Ok(self.inputs.follow_scenario)
    }

    /// Sets a Boolean, before the first step.
    pub fn set_switch(&mut self, reference: u32, value: bool) -> Result<(), ModelError> {
        if self.phase != Phase::Initial || !self.is_switch(reference) {
            let what = "truth value that can be set now";
            return Err(ModelError::Reference { reference, what });
        }
        self.inputs.follow_scenario = value;
        Ok(())
    }

    /// Advances from a time by a duration \[s\].
    ///
    /// # Errors
    /// [`ModelError`]; see [`ModelError::leaves_all`].
    pub fn step(&mut self, from_s: f64, length_s: f64) -> Result<(), ModelError> {
        let must = match self.phase {
            Phase::Stepping => None,
            Phase::Initial => Some("after fmi3ExitInitializationMode"),
            Phase::Over => Some("before fmi3Terminate and any error, or after fmi3Reset"),
        };
        if let Some(must) = must {
            return Err(ModelError::OutOfTurn { call: "fmi3DoStep", must });
        }
        let step_s = self.scenario.run().step_s;
        let (time_s, tolerance_s) = (self.time_s(), TOLERANCE * step_s);
        let is_now = (from_s - time_s).abs() <= tolerance_s;
        if !is_now {
            return Err(ModelError::NotNow { asked_s: from_s, time_s });
        }
        let steps = (length_s / step_s).round();
        if !(steps >= 1.0 && (length_s - steps * step_s).abs() <= tolerance_s) {
            return Err(ModelError::StepSize { asked_s: length_s, step_s });
        }
        let asked_s = time_s + length_s;
        if let Some(stop_s) = self.stop_s.filter(|stop_s| asked_s > stop_s + tolerance_s) {
            return Err(ModelError::PastStop { asked_s, stop_s });
        }
        self.running.take(&self.inputs)?;
        for _ in 0..steps as u64 {
            self.steps += 1;
            if let Err(error) = self.running.step(self.steps, &self.inputs) {
                self.phase = Phase::Over;
                return Err(error);
            }
        }
        self.cells = self.running.look();
        Ok(())
    }
}

/// Index of an input among the inputs.
fn input(reference: u32) -> usize {
    reference.saturating_sub(FIRST_INPUT) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use thermyo_joint::JointLoaded;

    const STEP_S: f64 = 0.001;

    fn joint(model: &str) -> JointLoaded {
        let text = format!(
            "[run]\nduration_s = 1.5\nlog_every = 1\n[plant]\nmodel = \"{model}\"\n\
             initial_pressure_pa = 290000\n[joint]\ngravity_n_m = 4.9\n\
             [joint.b.muscle]\nbladder_stiffness_n_m = 700\n[drive]\nshape = \"sine\"\n\
             angle_rad = 0.1\namplitude_rad = 0.3\nload_n_m = 0.5\n"
        );
        thermyo_joint::parse(&text, "joint.toml".as_ref()).unwrap()
    }

    /// Rows of `thermyo run`.
    fn rows(loaded: &JointLoaded) -> Vec<Vec<f64>> {
        let mut rows = Vec::new();
        let observer = &mut |row: &thermyo_joint::Row| {
            rows.push(row.cells());
            Ok(())
        };
        thermyo_joint::run(loaded, observer).unwrap();
        assert_eq!(rows.len(), 1501);
        rows
    }

    fn column(name: &str) -> usize {
        thermyo_joint::COLUMNS.iter().position(|column| *column == name).unwrap()
    }

    /// Checks every output against a row, to the bit.
    fn assert_is(model: &Model, row: &[f64]) {
        for (reference, variable) in (0..).zip(model.variables()) {
            if matches!(variable.role, Role::Plant | Role::Sampled) {
                let (is, wanted) = (model.number(reference).unwrap(), row[column(variable.name)]);
                let (name, time_s) = (variable.name, row[0]);
                assert_eq!(is.to_bits(), wanted.to_bits(), "{name} at {time_s} s: {is} {wanted}");
            }
        }
    }

    fn reference(model: &Model, name: &str) -> u32 {
        model.variables().iter().position(|variable| variable.name == name).unwrap() as u32
    }

    #[test]
    fn a_joint_with_its_core_is_the_run_to_the_bit() {
        for plant in ["lumped", "full"] {
            let loaded = joint(plant);
            let mut model = Model::new(loaded.clone(), Kind::WithCore).unwrap();
            model.start().unwrap();
            for (row, step) in rows(&loaded).iter().zip(0..) {
                assert_is(&model, row);
                model.step(f64::from(step) * STEP_S, STEP_S).unwrap();
            }
        }
    }

    #[test]
    fn the_plant_of_a_joint_driven_as_it_was_is_the_run_to_the_bit() {
        for plant in ["lumped", "full"] {
            let loaded = joint(plant);
            let mut model = Model::new(loaded.clone(), Kind::Plant).unwrap();
            model.start().unwrap();
            for (row, step) in rows(&loaded).iter().zip(0..) {
                assert_is(&model, row);
                for name in ["a_duty_in", "a_duty_out", "b_duty_in", "b_duty_out", "load_n_m"] {
                    model.set_number(reference(&model, name), row[column(name)]).unwrap();
                }
                model.step(f64::from(step) * STEP_S, STEP_S).unwrap();
            }
        }
    }

    /// As the standard requires; without a stop time the importer may continue after the scenario's end.
    #[test]
    fn a_step_past_the_stop_time_is_refused() {
        for kind in Kind::ALL {
            let mut model = Model::new(joint("lumped"), kind).unwrap();
            model.begin_at(1.0, Some(1.5)).unwrap();
            model.start().unwrap();
            model.step(1.0, 0.4).unwrap();
            let refused = model.step(1.4, 0.101).unwrap_err();
            assert!(!refused.leaves_all());
            let text = "a step to 1.501 s: must not pass the stop time, 1.5 s";
            assert_eq!(refused.to_string(), text);
            model.step(1.4, 0.1).unwrap();
            model.reset().unwrap();
            model.start().unwrap();
            model.step(0.0, 1.6).unwrap();
        }
    }

    #[test]
    fn calls_out_of_turn_are_refused() {
        let mut model = Model::new(joint("lumped"), Kind::WithCore).unwrap();
        let refused = |done: Result<(), ModelError>| done.unwrap_err().to_string();
        for (start_s, stop_s) in [(f64::NAN, None), (2.0, Some(1.0)), (0.0, Some(f64::NAN))] {
            let message = refused(model.begin_at(start_s, stop_s));
            assert!(
                message.starts_with(&format!("startTime = {start_s}: must be finite")),
                "{message}"
            );
        }
        model.start().unwrap();
        model.step(0.0, 0.1).unwrap();
        let again =
            "fmi3ExitInitializationMode: must come before the first step, or after fmi3Reset";
        assert_eq!(refused(model.start()), again);
        model.terminate();
        let over = "fmi3DoStep: must come before fmi3Terminate and any error, or after fmi3Reset";
        assert_eq!(refused(model.step(0.1, 0.1)), over);
        assert_eq!(model.time_s(), 0.1);
        model.reset().unwrap();
        model.start().unwrap();
        model.step(0.0, 0.1).unwrap();
    }

    #[test]
    fn a_joint_follows_the_importer() {
        let mut model = Model::new(joint("lumped"), Kind::WithCore).unwrap();
        let [follow, angle, stiffness, load] =
            ["follow_scenario", "angle_reference_rad", "stiffness_reference_n_m_rad", "load_n_m"]
                .map(|name| reference(&model, name));
        assert_eq!(model.number(angle).unwrap(), f64::from(0.1_f32));
        model.set_switch(follow, false).unwrap();
        model.start().unwrap();
        model.set_number(angle, 0.3).unwrap();
        model.set_number(stiffness, 18.0).unwrap();
        model.set_number(load, 1.0).unwrap();
        model.step(0.0, 3.0).unwrap();
        let value = |model: &Model, name| model.number(reference(model, name)).unwrap();
        assert!((value(&model, "angle_rad") - 0.3).abs() < 0.01);
        assert!((value(&model, "stiffness_n_m_rad") - 18.0).abs() < 0.5);
        // The value is refused before anything moves.
        model.set_number(angle, 2.0).unwrap();
        let refused = model.step(3.0, STEP_S).unwrap_err();
        assert!(refused.leaves_all());
        let said = "angle_reference_rad = 2: must be from -0.8 to 0.8";
        assert_eq!(refused.to_string(), said);
        model.set_number(angle, 0.2).unwrap();
        model.step(3.0, STEP_S).unwrap();
        assert!(model.set_switch(follow, true).is_err());
        assert!(model.set_number(load, f64::NAN).is_err());
    }
}
