//! A flashed board behind a serial port, on samples from here (`hil` firmware): one request and one
//! telemetry per step.

use super::link::Link;
use super::{Board, BoardError, BoardStep};
use model_core::control::Mode;
use model_core::link::{Answer, BAUD, HostCommand, PROTOCOL, Version};
use model_core::{Config, Sample, SetPoint, Telemetry};
use serialport::SerialPort;
use std::io::{self, Read, Write};
use std::time::{Duration, Instant};

/// A board that has not answered after this time will not.
const PATIENCE: Duration = Duration::from_secs(1);
/// Longest wait of one read.
const READ: Duration = Duration::from_millis(20);

/// Opens a port at the board's speed.
///
/// # Errors
/// [`BoardError::NoPort`]
pub fn open(port: &str) -> Result<Box<dyn SerialPort>, BoardError> {
    serialport::new(port, BAUD).timeout(READ).open().map_err(|error| {
        let reason = match error.to_string() {
            // The system's word of 1979 for what no speed can be set of.
            text if text == "Not a typewriter" || text.starts_with("Inappropriate ioctl") => {
                "is no serial port".to_owned()
            }
            text => text,
        };
        BoardError::NoPort { port: port.to_owned(), reason }
    })
}

/// Reads what is there; nothing after the port's timeout.
///
/// # Errors
/// Those of the port, once it is gone.
pub fn read<R: Read>(port: &mut R, buffer: &mut [u8]) -> io::Result<usize> {
    match port.read(buffer) {
        Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
        Err(error)
            if matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::Interrupted) =>
        {
            Ok(0)
        }
        other => other,
    }
}

/// The board.
pub struct SerialBoard {
    port: Box<dyn SerialPort>,
    link: Link,
}

impl SerialBoard {
    /// The board at a port, which must have the `hil` firmware of this protocol version.
    ///
    /// # Errors
    /// [`BoardError`]
    pub fn open(port: &str) -> Result<Self, BoardError> {
        let mut board = Self { port: open(port)?, link: Link::default() };
        let version = board.version()?;
        if version.protocol != PROTOCOL {
            return Err(BoardError::Protocol { board: version.protocol });
        }
        if !version.hil {
            return Err(BoardError::NotHil { chip: version.chip });
        }
        Ok(board)
    }

    fn version(&mut self) -> Result<Version, BoardError> {
        match self.ask(HostCommand::Version, "version")? {
            Answer::Version(version) => Ok(version),
            _ => Err(BoardError::Silent { asked: "version" }),
        }
    }

    fn ask(&mut self, command: HostCommand, name: &'static str) -> Result<Answer, BoardError> {
        let (sequence, frame) = self.link.request(command);
        self.port.write_all(&frame)?;
        match self.wait(|link| link.take_answer(sequence), name)? {
            Answer::Refused(refusal) => Err(BoardError::Refused(refusal)),
            answer => Ok(answer),
        }
    }

    fn wait<T>(
        &mut self,
        mut arrived: impl FnMut(&mut Link) -> Option<T>,
        asked: &'static str,
    ) -> Result<T, BoardError> {
        let start = Instant::now();
        let mut buffer = [0; 512];
        loop {
            if let Some(found) = arrived(&mut self.link) {
                return Ok(found);
            }
            if start.elapsed() > PATIENCE {
                return Err(BoardError::Silent { asked });
            }
            let count = read(&mut self.port, &mut buffer)?;
            self.link.feed(&buffer[..count]);
        }
    }
}

impl Board for SerialBoard {
    fn name(&self) -> &'static str {
        "serial"
    }

    fn start(&mut self, config: &Config, set_point: SetPoint) -> Result<(), BoardError> {
        self.ask(HostCommand::Configure(*config), "configure")?;
        self.ask(HostCommand::Start(set_point), "start")?;
        Ok(())
    }

    fn set(&mut self, set_point: SetPoint) -> Result<(), BoardError> {
        self.ask(HostCommand::Set(set_point), "set point").map(drop)
    }

    fn step(&mut self, sample: &Sample) -> Result<BoardStep, BoardError> {
        let telemetry = loop {
            let (_, frame) = self.link.request(HostCommand::Step(*sample));
            self.port.write_all(&frame)?;
            let telemetry: Telemetry = self.wait(Link::take_telemetry, "step")?;
            if telemetry.mode != Mode::Judging {
                break telemetry;
            }
        };
        let actuation = telemetry.command.into();
        Ok(BoardStep { telemetry: Some(telemetry), actuation })
    }
}
