//! Boards: raw samples in, openings and telemetry out, once per step.

use model_core::{Config, ConfigError, Core, Sample, SetPoint, Telemetry};
use std::fmt;

/// A board that runs the core.
pub trait Board {
    /// What it is, for summaries: "core", "emulated", "serial".
    fn name(&self) -> &'static str;

    /// Configures the core and gives the first set point. Steps count from 0 after it.
    ///
    /// # Errors
    /// When the board cannot be reached or refuses the configuration.
    fn start(&mut self, config: &Config, set_point: SetPoint) -> Result<(), BoardError>;

    /// Changes the set point before the next step.
    ///
    /// # Errors
    /// When the board cannot be reached.
    fn set(&mut self, set_point: SetPoint) -> Result<(), BoardError>;

    /// One step: what the core made of the sample.
    ///
    /// # Errors
    /// When the board cannot be reached or has stopped.
    fn step(&mut self, sample: &Sample) -> Result<Telemetry, BoardError>;
}

/// Why a board does not do what it is asked.
#[derive(Debug, Clone, PartialEq)]
pub enum BoardError {
    /// The core refuses its configuration.
    Config(ConfigError),
    /// A step was asked for before the board was started.
    NotStarted,
}

impl fmt::Display for BoardError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Config(error) => write!(f, "the core refuses its configuration: {error}"),
            Self::NotStarted => write!(f, "the board was asked for a step before it was started"),
        }
    }
}

impl std::error::Error for BoardError {}

/// The core in this process.
#[derive(Debug, Default)]
pub struct CoreBoard {
    core: Option<Core>,
}

impl Board for CoreBoard {
    fn name(&self) -> &'static str {
        "core"
    }

    fn start(&mut self, config: &Config, set_point: SetPoint) -> Result<(), BoardError> {
        let mut core = Core::new(config).map_err(BoardError::Config)?;
        core.set(set_point);
        self.core = Some(core);
        Ok(())
    }

    fn set(&mut self, set_point: SetPoint) -> Result<(), BoardError> {
        self.core.as_mut().ok_or(BoardError::NotStarted)?.set(set_point);
        Ok(())
    }

    fn step(&mut self, sample: &Sample) -> Result<Telemetry, BoardError> {
        Ok(self.core.as_mut().ok_or(BoardError::NotStarted)?.step(sample))
    }
}
