use serialport::{ErrorKind, SerialPort};
use std::io::{self, Read, Write};
use std::thread;
use std::time::{Duration, Instant};
use thermyo_protocol::BAUD;
use thermyo_simulation::board::BoardError;

pub const READ: Duration = Duration::from_millis(20);

/// Time for which a port that another program has open is tried again: a port that was closed just now may stay locked
/// for as long as a process takes to start that was forked meanwhile.
const RELEASED: Duration = Duration::from_millis(500);

pub fn open(port: &str) -> Result<Box<dyn SerialPort>, BoardError> {
    let began = Instant::now();
    loop {
        match open_once(port) {
            Err(BoardError::Taken { .. }) if began.elapsed() < RELEASED => thread::sleep(READ),
            other => return other,
        }
    }
}

fn open_once(port: &str) -> Result<Box<dyn SerialPort>, BoardError> {
    let opened = serialport::new(port, BAUD).timeout(READ).open();
    let mut opened = opened.map_err(|error| {
        let (port, reason) = (port.to_owned(), error.to_string());
        match error.kind() {
            ErrorKind::Io(io::ErrorKind::PermissionDenied) => BoardError::NoPermission { port },
            ErrorKind::Io(io::ErrorKind::ResourceBusy) => BoardError::Taken { port },
            // The crate has no kind for these.
            _ if reason.contains("busy") || reason.contains("exclusive lock") => {
                BoardError::Taken { port }
            }
            _ if reason.contains("ermission denied") => BoardError::NoPermission { port },
            // The system's message for a device that has no speed.
            _ if reason == "Not a typewriter" || reason.starts_with("Inappropriate ioctl") => {
                BoardError::NoPort { port, reason: "is no serial port".to_owned() }
            }
            _ => BoardError::NoPort { port, reason },
        }
    })?;
    // Without this signal a board at USB assumes that there is no reader; a pseudo-terminal has no
    // such line.
    let _ = opened.write_data_terminal_ready(true);
    // Ends a frame that an earlier program may have left half sent.
    opened.write_all(&[0])?;
    Ok(opened)
}

/// Reads the available bytes; none after the port's timeout.
pub fn read<R: Read + ?Sized>(port: &mut R, buffer: &mut [u8]) -> io::Result<usize> {
    use io::ErrorKind::{Interrupted, TimedOut, UnexpectedEof, WouldBlock};
    match port.read(buffer) {
        Ok(0) => Err(UnexpectedEof.into()),
        Err(error) if matches!(error.kind(), TimedOut | WouldBlock | Interrupted) => Ok(0),
        other => other,
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use serialport::TTYPort;

    /// The lock that the other program holds was once called a missing board.
    #[test]
    fn a_port_that_another_program_has_open_is_taken_until_it_is_closed() {
        let (_board, end) = TTYPort::pair().unwrap();
        let name = end.name().unwrap();
        drop(end);
        let first = open(&name).unwrap();
        let taken = open(&name).map(drop).unwrap_err();
        assert!(matches!(taken, BoardError::Taken { .. }), "{taken}");
        let closes = thread::spawn(move || {
            thread::sleep(RELEASED / 5);
            drop(first);
        });
        open(&name).unwrap();
        closes.join().unwrap();
    }
}
