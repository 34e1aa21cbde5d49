//! The model behind a unit's interface: a scenario that is run on request.

use super::Kind;
use super::variables::{FIRST_INPUT, Role, SECOND, TIME, Variable, variables};
use model_core::control::Mode;
use model_core::{Command, Estimate, Faults, Sample, SetPoint, SetPointError, Telemetry};
use std::path::Path;
use thermyo_files::input::InputError;
use thermyo_plant::{Actuation, BuildError, Diverged};
use thermyo_record::trace::Row;
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;
use thermyo_simulation::board::{Board, BoardError, BoardStep, CoreBoard};
use thermyo_simulation::rig::{MeanFlows, Reader, Rig};
use thermyo_simulation::run::SetPoints;

/// Tolerance of times as a fraction of a step, for rounding errors of sums.
const TOLERANCE: f64 = 1e-3;

/// Why a request of the importer fails.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    #[error(transparent)]
    Input(#[from] InputError),
    /// The plant cannot be built.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// The core refuses its configuration or a set point.
    #[error(transparent)]
    Core(#[from] BoardError),
    /// The plant left the range of its equations.
    #[error(transparent)]
    Diverged(#[from] Diverged),
    /// A step of a wrong length.
    #[error(
        "a communication step of {asked_s} s: must be a whole number of steps of {step_s} s, at least one"
    )]
    StepSize { asked_s: f64, step_s: f64 },
    /// A step from a wrong time.
    #[error(
        "a step from {asked_s} s, and the time is {time_s} s: a unit cannot go back, or leave out time"
    )]
    NotNow {
        /// The time that the step should begin at \[s\].
        asked_s: f64,
        time_s: f64,
    },
    /// A call at the wrong time.
    #[error("{call}: must come {must}")]
    OutOfTurn {
        call: &'static str,
        /// When it is allowed.
        must: &'static str,
    },
    /// A value out of range.
    #[error("{name} = {value}: must be {allowed}")]
    Value { name: &'static str, value: f64, allowed: String },
    /// There is no such variable of that type, or it cannot be set now.
    #[error("value reference {reference}: no {what}")]
    Reference {
        reference: u32,
        /// The expected type.
        what: &'static str,
    },
}

impl ModelError {
    /// Whether nothing has changed, so that another request is possible.
    pub fn leaves_all(&self) -> bool {
        matches!(self, Self::StepSize { .. } | Self::Value { .. })
    }
}

/// A scenario as a unit.
pub struct Model {
    kind: Kind,
    loaded: Loaded,
    variables: Vec<Variable>,
    inputs: Inputs,
    start_s: f64,
    running: Running,
    /// The importer has begun to step.
    started: bool,
}

/// Inputs from the importer.
#[derive(Debug, Clone, Copy)]
struct Inputs {
    duties: [f64; 2],
    set_point: f64,
    follow_scenario: bool,
}

/// Plant and board in operation.
struct Running {
    rig: Rig,
    flows: MeanFlows,
    driver: Driver,
    steps: u64,
    /// The importer's last set point.
    given: f64,
    row: Row,
}

/// Where the valves' openings come from.
enum Driver {
    /// The importer. The sensors are read as the core would.
    Importer(Box<Reader>),
    Core {
        board: Box<CoreBoard>,
        drive: Box<SetPoints>,
        step: BoardStep,
    },
}

impl Model {
    /// The unit with the resources in a folder.
    ///
    /// # Errors
    /// [`ModelError`], for a scenario that cannot be run.
    pub fn load(resources: &Path) -> Result<Self, ModelError> {
        let kind =
            Kind::ALL.into_iter().find(|kind| resources.join(kind.scenario_file()).is_file());
        let kind = kind.unwrap_or(Kind::Plant);
        Self::new(thermyo_setup::load(&resources.join(kind.scenario_file()))?, kind)
    }

    /// A scenario as a unit, at rest at time zero.
    ///
    /// # Errors
    /// [`ModelError`], for a scenario that cannot be run.
    pub fn new(loaded: Loaded, kind: Kind) -> Result<Self, ModelError> {
        let inputs = Inputs {
            // A muscle without power vents.
            duties: [0.0, 1.0],
            set_point: SetPoints::new(&loaded).value(0.0),
            follow_scenario: true,
        };
        let running = Running::new(&loaded, kind, &inputs)?;
        Ok(Self {
            kind,
            loaded,
            variables: variables(kind),
            inputs,
            start_s: 0.0,
            running,
            started: false,
        })
    }

    pub fn kind(&self) -> Kind {
        self.kind
    }

    pub fn scenario(&self) -> &Loaded {
        &self.loaded
    }

    pub fn reset(&mut self) -> Result<(), ModelError> {
        *self = Self::new(self.loaded.clone(), self.kind)?;
        Ok(())
    }

    /// Sets the scenario's time zero in the importer's time \[s\].
    ///
    /// # Errors
    /// After the first step.
    pub fn begin_at(&mut self, start_s: f64) -> Result<(), ModelError> {
        if self.started {
            let call = "fmi3EnterInitializationMode";
            return Err(ModelError::OutOfTurn {
                call,
                must: "before the first step, or after fmi3Reset",
            });
        }
        self.start_s = start_s;
        Ok(())
    }

    /// Begins to step.
    ///
    /// # Errors
    /// As [`Model::new`], for the values set since.
    pub fn start(&mut self) -> Result<(), ModelError> {
        self.running = Running::new(&self.loaded, self.kind, &self.inputs)?;
        self.started = true;
        Ok(())
    }

    pub fn time_s(&self) -> f64 {
        self.start_s + self.running.steps as f64 * self.loaded.plant.run.step_s
    }

    pub fn number(&self, reference: u32) -> Result<f64, ModelError> {
        match (reference, self.kind) {
            (TIME, _) => return Ok(self.time_s()),
            (FIRST_INPUT, Kind::Plant) => return Ok(self.inputs.duties[0]),
            (SECOND, Kind::Plant) => return Ok(self.inputs.duties[1]),
            (FIRST_INPUT, Kind::WithCore) => return Ok(self.inputs.set_point),
            _ => (),
        }
        self.variables
            .get(reference as usize)
            .filter(|variable| matches!(variable.role, Role::Plant | Role::Sampled))
            .and_then(Variable::column)
            .map(|column| self.running.row.cells()[column])
            .ok_or(ModelError::Reference { reference, what: "number" })
    }

    pub fn set_number(&mut self, reference: u32, value: f64) -> Result<(), ModelError> {
        let allowed = |name, allowed: &str| {
            Err(ModelError::Value { name, value, allowed: allowed.to_owned() })
        };
        match (reference, self.kind) {
            (FIRST_INPUT | SECOND, Kind::Plant) => {
                let opening = (reference - FIRST_INPUT) as usize;
                if !(0.0..=1.0).contains(&value) {
                    return allowed(self.variables[reference as usize].name, "from 0 to 1");
                }
                self.inputs.duties[opening] = value;
            }
            (FIRST_INPUT, Kind::WithCore) => {
                if !value.is_finite() {
                    return allowed(self.variables[reference as usize].name, "a finite number");
                }
                self.inputs.set_point = value;
            }
            _ => return Err(ModelError::Reference { reference, what: "number that can be set" }),
        }
        Ok(())
    }

    /// Reads a Boolean.
    pub fn switch(&self, reference: u32) -> Result<bool, ModelError> {
        match (reference, self.kind) {
            (SECOND, Kind::WithCore) => Ok(self.inputs.follow_scenario),
            _ => Err(ModelError::Reference { reference, what: "truth value" }),
        }
    }

    /// Sets a Boolean, before the first step.
    pub fn set_switch(&mut self, reference: u32, value: bool) -> Result<(), ModelError> {
        match (reference, self.kind, self.started) {
            (SECOND, Kind::WithCore, false) => self.inputs.follow_scenario = value,
            _ => {
                let what = "truth value that can be set now";
                return Err(ModelError::Reference { reference, what });
            }
        }
        Ok(())
    }

    /// Advances from a time by a duration \[s\].
    ///
    /// # Errors
    /// [`ModelError`]; see [`ModelError::leaves_all`].
    pub fn step(&mut self, from_s: f64, length_s: f64) -> Result<(), ModelError> {
        if !self.started {
            let must = "after fmi3ExitInitializationMode";
            return Err(ModelError::OutOfTurn { call: "fmi3DoStep", must });
        }
        let step_s = self.loaded.plant.run.step_s;
        let (time_s, tolerance_s) = (self.time_s(), TOLERANCE * step_s);
        let is_now = (from_s - time_s).abs() <= tolerance_s;
        if !is_now {
            return Err(ModelError::NotNow { asked_s: from_s, time_s });
        }
        let steps = (length_s / step_s).round();
        if !(steps >= 1.0 && (length_s - steps * step_s).abs() <= tolerance_s) {
            return Err(ModelError::StepSize { asked_s: length_s, step_s });
        }
        self.running.take(&self.inputs)?;
        for _ in 0..steps as u64 {
            self.running.step(&self.loaded, &self.inputs)?;
        }
        self.running.look();
        Ok(())
    }
}

impl Running {
    fn new(loaded: &Loaded, kind: Kind, inputs: &Inputs) -> Result<Self, ModelError> {
        let mut rig = Rig::new(loaded)?;
        let config = core_config(&loaded.believed);
        let flows = MeanFlows::new(&rig);
        let sample = rig.sample();
        let driver = match kind {
            Kind::Plant => Driver::Importer(Box::new(Reader::new(&config))),
            Kind::WithCore => {
                let mut board = Box::<CoreBoard>::default();
                let drive = Box::new(SetPoints::new(loaded));
                let set_point =
                    if inputs.follow_scenario { drive.at(0.0) } else { drive.of(inputs.set_point) };
                board.start(&config, set_point).map_err(|error| refused(error, inputs))?;
                let step = board.step(&sample)?;
                Driver::Core { board, drive, step }
            }
        };
        let row = Row {
            truth: rig.truth(),
            sensor_gas_k: 0.0,
            sensor_wall_k: 0.0,
            model_k: f64::NAN,
            model_sensor_k: f64::NAN,
            set_point: f64::NAN,
            telemetry: unread(sample),
        };
        let given = inputs.set_point;
        let mut running = Self { rig, flows, driver, steps: 0, given, row };
        running.read(sample);
        running.look();
        Ok(running)
    }

    /// Takes the importer's set point, if it has changed.
    fn take(&mut self, inputs: &Inputs) -> Result<(), ModelError> {
        let Driver::Core { board, drive, .. } = &mut self.driver else { return Ok(()) };
        if inputs.follow_scenario || inputs.set_point == self.given {
            return Ok(());
        }
        match board.core()?.set(drive.of(inputs.set_point)) {
            // Venting faults vent; the outputs have the reason.
            Ok(()) | Err(SetPointError::Faults(_)) => self.given = inputs.set_point,
            Err(error) => return Err(refused(BoardError::SetPoint(error), inputs)),
        }
        Ok(())
    }

    fn step(&mut self, loaded: &Loaded, inputs: &Inputs) -> Result<(), ModelError> {
        self.steps += 1;
        let actuation = match &mut self.driver {
            Driver::Importer(_) => {
                let [inlet, outlet] = inputs.duties;
                Actuation { inlet, outlet }
            }
            Driver::Core { board, drive, step } => {
                let update = drive.acting_from(self.steps, loaded);
                if let Some(set_point) = update.filter(|_| inputs.follow_scenario) {
                    match board.core()?.set(set_point) {
                        Ok(()) | Err(SetPointError::Faults(_)) => (),
                        Err(error) => return Err(BoardError::SetPoint(error).into()),
                    }
                }
                step.actuation
            }
        };
        self.rig.advance(actuation)?;
        let restarts = self.rig.board_restarts();
        let sample = self.rig.sample();
        if let Driver::Core { board, step, .. } = &mut self.driver {
            if restarts {
                board.restart()?;
            }
            *step = board.step(&sample)?;
        }
        self.read(sample);
        Ok(())
    }

    /// The board's output for a sample.
    fn read(&mut self, sample: Sample) {
        self.row.telemetry = match &mut self.driver {
            Driver::Importer(reader) => {
                let (pressure_pa, length_m) = reader.read(&sample);
                Telemetry { pressure_pa, length_m, ..unread(sample) }
            }
            Driver::Core { step, .. } => step.telemetry.unwrap_or_else(|| unread(sample)),
        };
    }

    /// The importer's current outputs.
    fn look(&mut self) {
        let elapsed_s = self.flows.elapsed_s(&self.rig);
        self.row.truth = self.rig.truth();
        (self.row.truth.flow_in_kg_s, self.row.truth.flow_out_kg_s) =
            self.flows.since(&self.rig, elapsed_s);
        self.row.sensor_gas_k = self.rig.gas_reading_k();
        self.row.sensor_wall_k = self.rig.wall_reading_k();
    }
}

/// A refused set point is the importer's fault if the importer sets it.
fn refused(error: BoardError, inputs: &Inputs) -> ModelError {
    match error {
        BoardError::SetPoint(SetPointError::Range { minimum, maximum, .. })
            if !inputs.follow_scenario =>
        {
            let allowed = format!("from {minimum} to {maximum}");
            ModelError::Value { name: "set_point", value: inputs.set_point, allowed }
        }
        error => error.into(),
    }
}

/// Telemetry of a board without a core.
fn unread(sample: Sample) -> Telemetry {
    Telemetry {
        step: 0,
        sample,
        pressure_pa: 0.0,
        length_m: 0.0,
        estimate: Estimate::default(),
        command: Command::CLOSED,
        mode: Mode::Vent,
        limited: false,
        set_point: SetPoint::Vent,
        faults: Faults::NONE,
    }
}
