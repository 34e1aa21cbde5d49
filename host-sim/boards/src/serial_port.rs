//! Serial ports: how one is opened and read.

use model_core::link::BAUD;
use serialport::{ErrorKind, SerialPort};
use std::io::{self, Read, Write};
use std::time::Duration;
use thermyo_simulation::board::BoardError;

/// Longest wait of one read.
pub const READ: Duration = Duration::from_millis(20);

/// Opens a port at the board's speed.
///
/// # Errors
/// [`BoardError::NoPort`], [`BoardError::NoPermission`], [`BoardError::Taken`]
pub fn open(port: &str) -> Result<Box<dyn SerialPort>, BoardError> {
    let opened = serialport::new(port, BAUD).timeout(READ).open();
    let mut opened = opened.map_err(|error| {
        let (port, reason) = (port.to_owned(), error.to_string());
        match error.kind() {
            ErrorKind::Io(io::ErrorKind::PermissionDenied) => BoardError::NoPermission { port },
            ErrorKind::Io(io::ErrorKind::ResourceBusy) => BoardError::Taken { port },
            // What the crate knows no kind for.
            _ if reason.contains("busy") => BoardError::Taken { port },
            _ if reason.contains("ermission denied") => BoardError::NoPermission { port },
            // The system's word of 1979 for what no speed can be set of.
            _ if reason == "Not a typewriter" || reason.starts_with("Inappropriate ioctl") => {
                BoardError::NoPort { port, reason: "is no serial port".to_owned() }
            }
            _ => BoardError::NoPort { port, reason },
        }
    })?;
    // Over USB the board takes it that nobody listens without it; a pseudo-terminal has none.
    let _ = opened.write_data_terminal_ready(true);
    // Ends what a program that was here before may have left half sent.
    opened.write_all(&[0])?;
    Ok(opened)
}

/// Reads what is there; nothing after the port's timeout.
///
/// # Errors
/// Those of the port, once it is gone.
pub fn read<R: Read + ?Sized>(port: &mut R, buffer: &mut [u8]) -> io::Result<usize> {
    use io::ErrorKind::{Interrupted, TimedOut, UnexpectedEof, WouldBlock};
    match port.read(buffer) {
        Ok(0) => Err(UnexpectedEof.into()),
        Err(error) if matches!(error.kind(), TimedOut | WouldBlock | Interrupted) => Ok(0),
        other => other,
    }
}
