//! Where a flashed board is found: at a serial port, or emulated in a process of its own.

use super::{serial_port, service};
use std::io::{Read, Write};
use thermyo_simulation::board::BoardError;

/// The name of the emulated board.
pub const EMULATED: &str = "emulated";

/// A stream of bytes to and from a board, whose reads return within some milliseconds.
pub trait Port: Read + Write + Send {}

impl<P: Read + Write + Send> Port for P {}

/// Opens a port by its name.
///
/// # Errors
/// [`BoardError::NoPort`], [`BoardError::NoPermission`], [`BoardError::Taken`]; of the emulated board also why
/// it cannot be made.
pub fn open(name: &str) -> Result<Box<dyn Port>, BoardError> {
    match name {
        EMULATED => Ok(Box::new(service::connect()?)),
        _ => Ok(Box::new(serial_port::open(name)?)),
    }
}
