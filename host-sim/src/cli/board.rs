use super::Failure;
use clap::Args;
use std::path::PathBuf;
use thermyo_boards::emulated::EmulatedBoard;
use thermyo_boards::emulated_joint::EmulatedJoint;
use thermyo_boards::serial::SerialBoard;
use thermyo_joint::JointLoaded;
use thermyo_simulation::board::{Board, BoardError, CoreBoard, JointBoard};

#[derive(Debug, Args)]
pub(super) struct BoardArgs {
    /// Where the core runs: "core" (in this process), "emulated" (the firmware on an emulated
    /// RP2040), "serial:PORT" (a flashed board, firmware built with its feature `hil`), or for
    /// `tune` a PORT such as /dev/ttyACM0 (a flashed board with a real muscle; "port:emulated"
    /// tries that)
    #[arg(long, value_name = "BOARD", default_value = "core", value_parser = board_kind)]
    board: BoardKind,
    /// Image for the emulated board, ELF or UF2 [default: the firmware of this program, or of its checkout]
    #[arg(long, value_name = "FILE")]
    image: Option<PathBuf>,
}

const IMAGE_OF_EMULATED: &str = "--image goes with --board emulated only";

#[derive(Debug, Clone)]
enum BoardKind {
    Core,
    Emulated,
    Serial(String),
    Port(String),
}

fn board_kind(text: &str) -> Result<BoardKind, String> {
    match (text, text.strip_prefix("serial:")) {
        ("core", _) => Ok(BoardKind::Core),
        ("emulated", _) => Ok(BoardKind::Emulated),
        (_, Some(port)) if !port.is_empty() => Ok(BoardKind::Serial(port.to_owned())),
        _ => match text.strip_prefix("port:") {
            Some(port) => Ok(BoardKind::Port(port.to_owned())),
            None if text.starts_with("/dev/") || text.starts_with("COM") => {
                Ok(BoardKind::Port(text.to_owned()))
            }
            None => {
                Err("must be core, emulated, serial:PORT or a PORT such as /dev/ttyACM0".to_owned())
            }
        },
    }
}

impl BoardArgs {
    /// Whether the core runs in this process.
    pub(super) fn is_core(&self) -> bool {
        matches!(self.board, BoardKind::Core) && self.image.is_none()
    }

    /// Port of a board that samples a real muscle.
    pub(super) fn port(&self) -> Option<&str> {
        match &self.board {
            BoardKind::Port(port) => Some(port),
            _ => None,
        }
    }

    pub(super) fn open(&self) -> Result<Box<dyn Board>, Failure> {
        let board: Result<Box<dyn Board>, BoardError> = match (&self.board, &self.image) {
            (BoardKind::Core, None) => return Ok(Box::new(CoreBoard::default())),
            (BoardKind::Emulated, None) => EmulatedBoard::new().map(|board| Box::new(board) as _),
            (BoardKind::Emulated, Some(image)) => {
                EmulatedBoard::with_image(image).map(|board| Box::new(board) as _)
            }
            (BoardKind::Serial(port), None) => {
                SerialBoard::open(port).map(|board| Box::new(board) as _)
            }
            (BoardKind::Port(_), None) => {
                let usage = "a board at a PORT samples a muscle of its own: `thermyo board PORT drive` drives it; \
                             for the simulated one give serial:PORT, with firmware built with `--features hil`";
                return Err(Failure::Usage(usage.to_owned()));
            }
            (_, Some(_)) => {
                return Err(Failure::Usage(IMAGE_OF_EMULATED.to_owned()));
            }
        };
        board.map_err(Failure::Board)
    }

    /// The board of a joint; `None` if the core runs in this process.
    pub(super) fn open_joint(
        &self,
        loaded: &JointLoaded,
    ) -> Result<Option<Box<dyn JointBoard>>, Failure> {
        let usage = |text: &str| Err(Failure::Usage(text.to_owned()));
        match (&self.board, self.image.as_deref()) {
            (BoardKind::Core, None) => Ok(None),
            (BoardKind::Emulated, image) => {
                let first = loaded.inputs(0.0).set_point;
                let board = EmulatedJoint::new(image, loaded.config(), first);
                Ok(Some(Box::new(board.map_err(Failure::Board)?)))
            }
            (_, Some(_)) => usage(IMAGE_OF_EMULATED),
            (BoardKind::Serial(_), None) => usage(
                "no firmware for a joint takes simulated samples: `--board emulated` runs its image without hardware",
            ),
            (BoardKind::Port(_), None) => usage(
                "a board at a PORT samples a joint of its own: `thermyo board PORT drive` drives it; the simulated one \
                 runs with `--board emulated`",
            ),
        }
    }
}
