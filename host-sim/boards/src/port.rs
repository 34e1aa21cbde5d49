//! Ports of boards: a serial port, or the emulated board in a separate process.

use super::{serial_port, service};
use std::io::{Read, Write};
use thermyo_simulation::board::BoardError;

pub const EMULATED: &str = "emulated";

/// A stream of bytes to and from a board. Reads return within some milliseconds.
pub trait Port: Read + Write + Send {}

impl<P: Read + Write + Send> Port for P {}

pub fn open(name: &str) -> Result<Box<dyn Port>, BoardError> {
    match name {
        EMULATED => Ok(Box::new(service::connect()?)),
        _ if name.trim().is_empty() => {
            let reason = "is no name of a port".to_owned();
            Err(BoardError::NoPort { port: format!("{name:?}"), reason })
        }
        _ => Ok(Box::new(serial_port::open(name)?)),
    }
}
