//! Errors of the commands and their exit codes.

use crate::commands::flash::FlashError;
use crate::commands::monitor::MonitorError;
use model_core::joint::JointError;
use model_core::{Faults, SetPointError};
use std::fmt;
use thermyo_evaluate::truth::TruthError;
use thermyo_files::input::InputError;
use thermyo_identify::IdentifyError;
use thermyo_protocol::Refusal::{JointSetPoint, NotConfigured, SetPoint};
use thermyo_serve::OpenError;
use thermyo_simulation::board::BoardError;
use thermyo_simulation::run::RunError;
use thermyo_studies::joint_tune;
use thermyo_studies::tune::{Refusal, TuneError};
use thermyo_sweep::{MergeError, SweepError};

/// Exit code that shells report for a command that Ctrl-C ended.
pub(super) const STOPPED: u8 = 130;

#[derive(Debug)]
pub(super) enum Failure {
    /// Exit 2.
    Input(InputError),
    /// Exit 2, or 1 where the plant diverges.
    Identify(IdentifyError),
    /// Exit 2.
    Sweep(SweepError),
    /// Exit 2.
    Merge(MergeError),
    /// Exit 1: the data of a tuning was not good enough.
    Tune(Refusal),
    /// As above, for a joint.
    JointTune(joint_tune::Refusal),
    /// Exit 2: arguments that do not go together.
    Usage(String),
    /// Exit 2: the board cannot be used.
    Board(BoardError),
    /// Exit 2: nothing was flashed.
    Flash(FlashError),
    /// Exit 2.
    Monitor(MonitorError),
    /// Exit 1, or 2 where the board cannot be used, or nothing was run.
    Run(RunError),
    /// Exit 1, or 2 where nothing was run: a joint.
    Joint(thermyo_joint::RunError),
    /// Exit 1: the command ran, and a stated check did not hold.
    Check(String),
    /// Exit 130: Ctrl-C was pressed.
    Interrupted,
    /// As above, at a time that the message states.
    StoppedAt(String),
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Input(error) => error.fmt(f),
            Self::Identify(error) => error.fmt(f),
            Self::Sweep(error) => error.fmt(f),
            Self::Merge(error) => error.fmt(f),
            Self::Tune(refusal) => write!(f, "nothing was tuned: {refusal}"),
            Self::JointTune(refusal) => write!(f, "nothing was tuned: {refusal}"),
            Self::Usage(message) => f.write_str(message),
            Self::Board(error)
            | Self::Run(RunError::Board(error))
            | Self::Monitor(MonitorError::Board(error)) => write!(f, "{error}{}", remedy(error)),
            Self::Flash(error) => error.fmt(f),
            Self::Monitor(error) => error.fmt(f),
            Self::Run(error) => error.fmt(f),
            Self::Joint(error) => error.fmt(f),
            Self::Check(message) => f.write_str(message),
            Self::Interrupted => f.write_str("stopped"),
            Self::StoppedAt(time) => write!(f, "stopped at {time}"),
        }
    }
}

/// The command that helps, if there is one.
fn remedy(error: &BoardError) -> &'static str {
    use SetPointError::{Faults as Latched, NotArmed};
    match error {
        BoardError::EmulatedSilent { .. } => {
            "; try again, or start it afresh: thermyo board emulated plug"
        }
        BoardError::Restarted => ": `thermyo monitor` shows the reason",
        BoardError::Refused(NotConfigured | SetPoint(Latched(Faults::NOT_CONFIGURED))) => {
            ": `thermyo board PORT config write SCENARIO.toml`"
        }
        BoardError::Vented(_)
        | BoardError::Refused(SetPoint(Latched(_)) | JointSetPoint(JointError::Faults(..))) => {
            ". Remove the cause, then `thermyo board PORT clear` and `arm`"
        }
        BoardError::Refused(SetPoint(NotArmed) | JointSetPoint(JointError::NotArmed)) => {
            ": `thermyo board PORT arm`, or `--arm`"
        }
        _ => "",
    }
}

impl From<InputError> for Failure {
    fn from(error: InputError) -> Self {
        Self::Input(error)
    }
}

impl From<TruthError> for Failure {
    fn from(error: TruthError) -> Self {
        match error {
            TruthError::Input(error) => Self::Input(error),
            TruthError::Identify(error) => Self::Identify(error),
            TruthError::Run(error) => Self::Run(error),
        }
    }
}

impl From<OpenError> for Failure {
    fn from(error: OpenError) -> Self {
        match error {
            OpenError::Scenario(error) => Self::Input(error),
            OpenError::Board(error) => Self::Board(error),
        }
    }
}

impl From<BoardError> for Failure {
    fn from(error: BoardError) -> Self {
        match error {
            BoardError::Vented(_) => Self::Check(format!("{error}{}", remedy(&error))),
            error => Self::Board(error),
        }
    }
}

impl From<MonitorError> for Failure {
    fn from(error: MonitorError) -> Self {
        Self::Monitor(error)
    }
}

impl From<TuneError> for Failure {
    fn from(error: TuneError) -> Self {
        match error {
            TuneError::Input(error) => Self::Input(error),
            TuneError::Run(error) => Self::Run(error),
            TuneError::Refused(refusal) => Self::Tune(refusal),
        }
    }
}

impl Failure {
    pub(super) fn exit_code(&self) -> u8 {
        match self {
            Self::Board(BoardError::Interrupted)
            | Self::Run(RunError::Board(BoardError::Interrupted) | RunError::Stopped)
            | Self::Identify(IdentifyError::Stopped { .. }) => STOPPED,
            Self::Run(RunError::Board(BoardError::Vented(_))) => 1,
            // Found from the scenario, before any experiment.
            Self::Tune(Refusal::NoPulses)
            | Self::JointTune(joint_tune::Refusal::Muscle(Refusal::NoPulses)) => 2,
            Self::Input(_)
            | Self::Sweep(_)
            | Self::Merge(_)
            | Self::Usage(_)
            | Self::Board(_)
            | Self::Run(RunError::Board(_))
            | Self::Flash(_)
            | Self::Monitor(_)
            | Self::Identify(IdentifyError::Input(_) | IdentifyError::Build(_))
            | Self::Run(RunError::Build(_) | RunError::Config(_))
            | Self::Joint(thermyo_joint::RunError::Build(_) | thermyo_joint::RunError::Config(_)) => {
                2
            }
            Self::Identify(IdentifyError::Diverged(_))
            | Self::Tune(_)
            | Self::JointTune(_)
            | Self::Run(_)
            | Self::Joint(_)
            | Self::Check(_) => 1,
            Self::Interrupted | Self::StoppedAt(_) => STOPPED,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use thermyo_simulation::board::BoardError::Silent;

    /// A board that cannot be used once ended `tune` of a muscle with 1, and that of a joint with
    /// 2.
    #[test]
    fn a_board_that_cannot_be_used_is_exit_code_2_in_every_command() {
        let silent = || Silent { asked: "status" };
        assert_eq!(Failure::Board(silent()).exit_code(), 2);
        assert_eq!(Failure::Run(RunError::Board(silent())).exit_code(), 2);
        assert_eq!(Failure::Run(RunError::Board(BoardError::Interrupted)).exit_code(), STOPPED);
        let vented = BoardError::Vented(Faults::PRESSURE_SENSOR);
        assert_eq!(Failure::Run(RunError::Board(vented)).exit_code(), 1);
    }

    #[test]
    fn a_latched_fault_names_what_clears_it() {
        let latched = BoardError::Refused(SetPoint(SetPointError::Faults(Faults::PRESSURE_SENSOR)));
        let said = Failure::Board(latched).to_string();
        assert!(
            said.ends_with("Remove the cause, then `thermyo board PORT clear` and `arm`"),
            "{said}"
        );
    }
}
