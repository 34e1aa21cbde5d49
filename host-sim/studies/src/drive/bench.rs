//! A board with a muscle or a joint of its own, for `thermyo tune`.

use super::{Ended, drive};
use crate::tune::{Bench, Left};
use model_core::{Config, Telemetry};
use thermyo_boards::live::LiveBoard;
use thermyo_boards::subject::Subject;
use thermyo_protocol::{ConfigSource, Name};
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;
use thermyo_simulation::board::BoardError;
use thermyo_simulation::run::RunError;

/// The board, armed for each run up to a pressure; slightly above that it vents.
pub struct LiveBench<'a, B: Subject> {
    pub(crate) board: &'a mut B,
    name: &'a str,
    highest_pa: f64,
    /// Returns whether the user wants to stop.
    pub(crate) wanted: &'a dyn Fn() -> bool,
    /// The earlier configuration, and its name; none if the board had the core's defaults.
    former: Option<(B::Config, Name)>,
}

impl<'a, B: Subject> LiveBench<'a, B> {
    /// Bench of a board. `name` is the name of the configurations that it sets.
    ///
    /// # Errors
    /// [`BoardError`], if the board does not send its configuration.
    pub fn new(
        board: &'a mut B,
        name: &'a str,
        highest_pa: f64,
        wanted: &'a dyn Fn() -> bool,
    ) -> Result<Self, BoardError> {
        let status = board.status()?;
        let former = match status.config_source {
            ConfigSource::Defaults => None,
            ConfigSource::Host | ConfigSource::Flash => Some((board.config()?, status.config_name)),
        };
        Ok(Self { board, name, highest_pa, wanted, former })
    }

    /// Configures and arms the board, up to `limit_pa` at most.
    pub(crate) fn prepare(&mut self, config: &B::Config, limit_pa: f32) -> Result<(), BoardError> {
        self.board.configure(config, self.name)?;
        self.board.arm(Some((self.highest_pa as f32).min(limit_pa)))
    }

    pub(crate) fn vent_with(&mut self, left: Left<'_, B::Config>) -> Result<(), BoardError> {
        let (config, name) = match (left, &self.former) {
            (Left::Former(_), Some((config, name))) => (config, name.as_str()),
            _ => (left.config(), self.name),
        };
        self.board.stop()?;
        let status = self.board.status()?;
        if status.config_checksum != B::checksum(config) || status.config_name.as_str() != name {
            self.board.configure(config, name)?;
        }
        Ok(())
    }
}

impl Bench for LiveBench<'_, LiveBoard> {
    fn drive(&mut self, driven: &Loaded, each: &mut dyn FnMut(&Telemetry)) -> Result<(), RunError> {
        let config = core_config(&driven.believed);
        self.prepare(&config, config.working_limit_pa())?;
        let mut show = |telemetry: &Telemetry, _: Option<&_>| {
            each(telemetry);
            Ok(())
        };
        match drive(self.board, driven, self.wanted, &mut show)? {
            Ended::Whole => Ok(()),
            Ended::Stopped => Err(BoardError::Interrupted.into()),
        }
    }

    fn leave(&mut self, left: Left<'_, Config>) -> Result<(), BoardError> {
        self.vent_with(left)
    }
}
