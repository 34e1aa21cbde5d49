//! A board with a muscle of its own, for `thermyo tune`.

use super::{DriveError, Ended, drive};
use crate::tune::Bench;
use model_core::{Config, Telemetry};
use thermyo_boards::live::LiveBoard;
use thermyo_boards::subject::Subject;
use thermyo_protocol::checksum;
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;
use thermyo_simulation::board::BoardError;
use thermyo_simulation::run::RunError;

/// The board, armed for each run up to a pressure, a little above which it vents.
pub struct LiveBench<'a> {
    board: &'a mut LiveBoard,
    name: &'a str,
    highest_pa: f64,
    /// Returns whether the user wants to stop.
    wanted: &'a dyn Fn() -> bool,
}

impl<'a> LiveBench<'a> {
    /// `name` is the name of the configurations that the board gets.
    pub fn new(
        board: &'a mut LiveBoard,
        name: &'a str,
        highest_pa: f64,
        wanted: &'a dyn Fn() -> bool,
    ) -> Self {
        Self { board, name, highest_pa, wanted }
    }
}

impl Bench for LiveBench<'_> {
    fn drive(&mut self, driven: &Loaded, each: &mut dyn FnMut(&Telemetry)) -> Result<(), RunError> {
        let config = core_config(&driven.believed);
        self.board.configure(&config, self.name)?;
        self.board.arm(Some((self.highest_pa as f32).min(config.working_limit_pa())))?;
        let mut show = |telemetry: &Telemetry, _: Option<&_>| {
            each(telemetry);
            Ok(())
        };
        match drive(self.board, driven, self.wanted, &mut show) {
            Ok(Ended::Whole) => Ok(()),
            Ok(Ended::Stopped) => Err(BoardError::Interrupted.into()),
            Err(DriveError::Board(error)) => Err(RunError::Board(error)),
            Err(DriveError::Output(error)) => Err(RunError::Output(error)),
        }
    }

    fn leave(&mut self, config: &Config) -> Result<(), BoardError> {
        self.board.stop()?;
        if self.board.status()?.config_checksum != checksum(config) {
            self.board.configure(config, self.name)?;
        }
        Ok(())
    }
}
