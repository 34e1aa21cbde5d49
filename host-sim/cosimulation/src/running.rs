//! A scenario in operation, and its errors.

use thermyo_files::input::InputError;
use thermyo_plant::{BuildError, Diverged};
use thermyo_simulation::board::BoardError;

/// Reason why a request of the importer fails.
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
    /// The joint cannot be built, its core refuses, or its plant left the range of its equations.
    #[error(transparent)]
    Joint(#[from] thermyo_joint::RunError),
    #[error(
        "a communication step of {asked_s} s: must be a whole number of steps of {step_s} s, at least one"
    )]
    StepSize { asked_s: f64, step_s: f64 },
    /// A step from a wrong time.
    #[error(
        "a step from {asked_s} s, and the time is {time_s} s: a unit cannot go back, or leave out time"
    )]
    NotNow {
        /// The requested start time of the step \[s\].
        asked_s: f64,
        time_s: f64,
    },
    /// A step beyond the importer's stop time.
    #[error("a step to {asked_s} s: must not pass the stop time, {stop_s} s")]
    PastStop { asked_s: f64, stop_s: f64 },
    /// A call at the wrong time.
    #[error("{call}: must come {must}")]
    OutOfTurn {
        call: &'static str,
        /// Condition under which it is allowed.
        must: &'static str,
    },
    #[error("{name} = {value}: must be {allowed}")]
    Value { name: &'static str, value: f64, allowed: String },
    /// There is no such variable of that type, or it cannot be set now.
    #[error("value reference {reference}: no {what}")]
    Reference { reference: u32, what: &'static str },
}

impl ModelError {
    /// Whether nothing has changed, so that another request is possible.
    pub fn leaves_all(&self) -> bool {
        matches!(self, Self::StepSize { .. } | Self::Value { .. })
    }
}

/// Inputs from the importer.
#[derive(Debug, Clone, PartialEq)]
pub struct Inputs {
    /// Values in the order of the variables.
    pub numbers: Vec<f64>,
    pub follow_scenario: bool,
}

/// Plant and board in operation, from time zero on.
pub trait Running {
    /// Takes the importer's set point, if it has changed.
    ///
    /// # Errors
    /// If the set point is out of its range; then nothing has changed.
    fn take(&mut self, inputs: &Inputs) -> Result<(), ModelError>;
    /// Advances by one step, the `steps`-th.
    fn step(&mut self, steps: u64, inputs: &Inputs) -> Result<(), ModelError>;
    /// Cells of the trace now. Flows are means since the last call.
    fn look(&mut self) -> Vec<f64>;
}
