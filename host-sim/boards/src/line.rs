//! Questions and answers over a port.

use super::link::Link;
use super::port::{self, Port};
use super::serial_port;
use model_core::Telemetry;
use model_core::link::{Answer, HostCommand, PROTOCOL, Status, Version};
use std::time::{Duration, Instant};
use thermyo_simulation::board::BoardError;

/// A board that has not answered after this time will not; an emulated one may be slow.
const PATIENCE: Duration = Duration::from_secs(3);

/// The emulated board is asked again for so long who it is.
const PATIENCE_WITH_EMULATED: Duration = Duration::from_secs(5);

/// A port and what is said over it.
pub struct Line {
    name: String,
    port: Box<dyn Port>,
    link: Link,
}

impl Line {
    /// Opens a port and asks who is there.
    ///
    /// # Errors
    /// [`BoardError`], where nobody answers or what answers speaks another protocol.
    pub fn open(name: &str) -> Result<(Self, Version), BoardError> {
        let (line, version) = Self::meet(name)?;
        if version.protocol == PROTOCOL {
            Ok((line, version))
        } else {
            Err(BoardError::Protocol { board: version.protocol })
        }
    }

    /// The same with a board of any protocol, of which nothing is to be asked but what all of them know.
    ///
    /// # Errors
    /// [`BoardError`], where nobody answers.
    pub fn meet(name: &str) -> Result<(Self, Version), BoardError> {
        let began = Instant::now();
        loop {
            let mut line = Self::over(port::open(name)?, name);
            match line.ask(HostCommand::Version, "version") {
                Ok(Answer::Version(version)) => return Ok((line, version)),
                Ok(_) => return Err(BoardError::Silent { asked: "version" }),
                // The emulated board lets one client in, and shows the next one the door: on a busy machine before
                // it has seen that the one before has left, and it may take long to start.
                Err(BoardError::Line(_) | BoardError::EmulatedSilent { .. })
                    if name == port::EMULATED && began.elapsed() < PATIENCE_WITH_EMULATED => {}
                Err(BoardError::Line(_)) if name == port::EMULATED => {
                    return Err(BoardError::Taken { port: name.to_owned() });
                }
                Err(error) => return Err(error),
            }
        }
    }

    /// Over an open port of this name.
    pub(super) fn over(port: Box<dyn Port>, name: &str) -> Self {
        Self { name: name.to_owned(), port, link: Link::default() }
    }

    /// Name of the port.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Sends a request; its number.
    ///
    /// # Errors
    /// [`BoardError::Line`]
    pub fn send(&mut self, command: HostCommand) -> Result<u8, BoardError> {
        let (sequence, frame) = self.link.request(command);
        self.port.write_all(&frame)?;
        Ok(sequence)
    }

    /// Sends a request and waits for its answer.
    ///
    /// # Errors
    /// [`BoardError::Line`], [`BoardError::Silent`], [`BoardError::Refused`]
    pub fn ask(&mut self, command: HostCommand, asked: &'static str) -> Result<Answer, BoardError> {
        let sequence = self.send(command)?;
        match self.wait(|link| link.take_answer(sequence), asked)? {
            Answer::Refused(refusal) => Err(BoardError::Refused(refusal)),
            answer => Ok(answer),
        }
    }

    /// Waits for something to come.
    ///
    /// # Errors
    /// [`BoardError::Line`], [`BoardError::Silent`]
    pub fn wait<T>(
        &mut self,
        mut arrived: impl FnMut(&mut Link) -> Option<T>,
        asked: &'static str,
    ) -> Result<T, BoardError> {
        let start = Instant::now();
        loop {
            if let Some(found) = arrived(&mut self.link) {
                return Ok(found);
            }
            if start.elapsed() > PATIENCE {
                return Err(if self.name == port::EMULATED {
                    BoardError::EmulatedSilent { asked }
                } else {
                    BoardError::Silent { asked }
                });
            }
            self.poll()?;
        }
    }

    /// Takes what has come, waiting some milliseconds for it.
    ///
    /// # Errors
    /// [`BoardError::Line`]
    pub fn poll(&mut self) -> Result<(), BoardError> {
        let mut buffer = [0; 4096];
        let count = serial_port::read(&mut self.port, &mut buffer)?;
        self.link.feed(&buffer[..count]);
        Ok(())
    }

    /// Whether telemetry has come that nobody has taken.
    pub fn is_behind(&self) -> bool {
        self.link.is_behind()
    }

    /// The next telemetry that has come.
    pub fn take_telemetry(&mut self) -> Option<Telemetry> {
        self.link.take_telemetry()
    }

    /// Whether the answer to a request has come, and it.
    pub fn take_answer(&mut self, sequence: u8) -> Option<Answer> {
        self.link.take_answer(sequence)
    }

    /// What the board has said last of what changes rarely.
    pub fn status(&self) -> Option<Status> {
        self.link.status()
    }
}
