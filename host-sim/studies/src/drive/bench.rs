//! A board with a muscle or a joint of its own, for `thermyo tune`.

use super::{Ended, drive};
use crate::tune::Bench;
use model_core::{Config, Telemetry};
use thermyo_boards::live::LiveBoard;
use thermyo_boards::subject::Subject;
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;
use thermyo_simulation::board::BoardError;
use thermyo_simulation::run::RunError;

/// The board, armed for each run up to a pressure, a little above which it vents.
pub struct LiveBench<'a, B> {
    pub(crate) board: &'a mut B,
    name: &'a str,
    highest_pa: f64,
    /// Returns whether the user wants to stop.
    pub(crate) wanted: &'a dyn Fn() -> bool,
}

impl<'a, B: Subject> LiveBench<'a, B> {
    /// `name` is the name of the configurations that the board gets.
    pub fn new(
        board: &'a mut B,
        name: &'a str,
        highest_pa: f64,
        wanted: &'a dyn Fn() -> bool,
    ) -> Self {
        Self { board, name, highest_pa, wanted }
    }

    /// Configures and arms the board, up to `limit_pa` at most.
    pub(crate) fn prepare(&mut self, config: &B::Config, limit_pa: f32) -> Result<(), BoardError> {
        self.board.configure(config, self.name)?;
        self.board.arm(Some((self.highest_pa as f32).min(limit_pa)))
    }

    pub(crate) fn vent_with(&mut self, config: &B::Config) -> Result<(), BoardError> {
        self.board.stop()?;
        if self.board.status()?.config_checksum != B::checksum(config) {
            self.board.configure(config, self.name)?;
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

    fn leave(&mut self, config: &Config) -> Result<(), BoardError> {
        self.vent_with(config)
    }
}
