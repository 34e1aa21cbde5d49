//! `--board` and `--image`.

use super::Failure;
use crate::board::emulated::EmulatedBoard;
use crate::board::serial::SerialBoard;
use crate::board::{Board, BoardError, CoreBoard};
use clap::Args;
use std::path::PathBuf;

#[derive(Debug, Args)]
pub(super) struct BoardArgs {
    /// Where the core runs: "core" (in this process), "emulated" (the firmware on an emulated
    /// RP2040) or "serial:PORT" (a flashed board, firmware built with its feature `hil`)
    #[arg(long, value_name = "BOARD", default_value = "core", value_parser = board_kind)]
    board: BoardKind,
    /// Image for the emulated board, ELF or UF2 [default: the firmware of this checkout]
    #[arg(long, value_name = "FILE")]
    image: Option<PathBuf>,
}

#[derive(Debug, Clone)]
enum BoardKind {
    Core,
    Emulated,
    Serial(String),
}

fn board_kind(text: &str) -> Result<BoardKind, String> {
    match (text, text.strip_prefix("serial:")) {
        ("core", _) => Ok(BoardKind::Core),
        ("emulated", _) => Ok(BoardKind::Emulated),
        (_, Some(port)) if !port.is_empty() => Ok(BoardKind::Serial(port.to_owned())),
        _ => Err("must be core, emulated or serial:PORT".to_owned()),
    }
}

impl BoardArgs {
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
            (BoardKind::Core | BoardKind::Serial(_), Some(_)) => {
                return Err(Failure::Usage("--image goes with --board emulated only".to_owned()));
            }
        };
        board.map_err(Failure::Board)
    }
}
