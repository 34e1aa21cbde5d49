//! The served board: at a port, emulated, or emulated with the muscle of a scenario.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use thermyo_boards::image::Variant;
use thermyo_boards::live::LiveBoard;
use thermyo_boards::live_joint::LiveJoint;
use thermyo_boards::subject::Subject;
use thermyo_boards::{plug, port, service};
use thermyo_files::input::{InputError, read_text};
use thermyo_joint::JointLoaded;
use thermyo_protocol::Refusal;
use thermyo_scenario::Document;
use thermyo_setup::core_config::core_config;
use thermyo_setup::{Loaded, assemble, refuse_vessel};
use thermyo_simulation::board::BoardError;

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Target {
    Port(String),
    /// The emulated board, with its present muscle or joint, or the nominal muscle.
    Emulated,
    /// The emulated board, with the muscle or joint of this scenario.
    Scenario(PathBuf),
}

/// An open board.
pub enum Opened {
    Muscle(Box<LiveBoard>),
    Joint(Box<LiveJoint>),
}

#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    #[error(transparent)]
    Scenario(#[from] InputError),
    #[error(transparent)]
    Board(#[from] BoardError),
}

impl Target {
    /// Parses the argument of the command.
    pub fn new(text: &OsStr) -> Self {
        let path = Path::new(text);
        let is_toml =
            path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
        match text.to_str() {
            Some(port::EMULATED) => Self::Emulated,
            _ if is_toml => Self::Scenario(path.to_path_buf()),
            _ => Self::Port(text.to_string_lossy().into_owned()),
        }
    }

    /// Opens the board; a scenario's board is configured with its muscle or joint.
    pub fn open(&self) -> Result<Opened, OpenError> {
        let Self::Scenario(path) = self else { return self.open_either() };
        if let Some(joint) = thermyo_joint::load(path)? {
            plug::plug(Variant::Joint, Some(path))?;
            let mut board = LiveJoint::open(port::EMULATED)?;
            board.configure(&joint.config(), &self.muscle_name())?;
            return Ok(Opened::Joint(Box::new(board)));
        }
        let document = Document::parse(&read_text(path)?, path)?;
        let muscle = assemble(&document)?;
        refuse_vessel(&document, &muscle, "at a board's page")?;
        plug::plug(Variant::Standard, Some(path))?;
        let mut board = LiveBoard::open(port::EMULATED)?;
        board.configure(&core_config(&muscle.believed), &self.muscle_name())?;
        Ok(Opened::Muscle(Box::new(board)))
    }

    /// Opens a board of either image.
    fn open_either(&self) -> Result<Opened, OpenError> {
        match LiveBoard::open(self.port()) {
            Err(BoardError::Refused(Refusal::OtherImage { joint: true })) => {
                Ok(Opened::Joint(Box::new(LiveJoint::open(self.port())?)))
            }
            opened => Ok(Opened::Muscle(Box::new(opened?))),
        }
    }

    /// Opens the board again after it was lost.
    pub fn reopen<S: Subject>(&self) -> Result<S, BoardError> {
        let there = matches!(self, Self::Port(_)) || service::is_plugged_in();
        if there { S::open(self.port()) } else { Err(BoardError::Silent { asked: "version" }) }
    }

    pub fn port(&self) -> &str {
        match self {
            Self::Port(port) => port,
            Self::Emulated | Self::Scenario(_) => port::EMULATED,
        }
    }

    pub fn name(&self) -> String {
        match self {
            Self::Port(port) => port.clone(),
            Self::Emulated => "emulated board".to_owned(),
            Self::Scenario(path) => format!("emulated board, {}", path.display()),
        }
    }

    /// Name of the muscle behind an emulated board.
    pub fn muscle_name(&self) -> String {
        match self {
            Self::Scenario(path) => {
                path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
            }
            Self::Port(_) | Self::Emulated => "nominal".to_owned(),
        }
    }

    /// The muscle behind an emulated board; `None` for a port, whose muscle is unknown.
    pub fn muscle(&self) -> Result<Option<Loaded>, InputError> {
        match self {
            Self::Port(_) => Ok(None),
            Self::Emulated => thermyo_setup::parse("", Path::new("the nominal muscle")).map(Some),
            Self::Scenario(path) => thermyo_setup::load(path).map(Some),
        }
    }

    /// The joint behind an emulated board, if its scenario has one.
    pub fn joint(&self) -> Result<Option<JointLoaded>, InputError> {
        match self {
            Self::Port(_) | Self::Emulated => Ok(None),
            Self::Scenario(path) => thermyo_joint::load(path),
        }
    }
}
