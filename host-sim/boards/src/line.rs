//! Requests and answers over a port.

use super::link::Link;
use super::port::{self, Port};
use super::serial_port;
use std::time::{Duration, Instant};
use thermyo_protocol::{Answer, Event, HostCommand, LastReset, PROTOCOL, Status, Timing, Version};
use thermyo_simulation::board::BoardError;

/// Interval of the keep-alive messages of an idle host: a fraction of `link.timeout_s`.
pub(super) const ALIVE: Duration = Duration::from_millis(100);
/// Steps per telemetry frame when nothing is recorded.
pub const VIEW_DIVIDER: u16 = 10;

/// Time after which a request without an answer fails; an emulated board may be slow.
const PATIENCE: Duration = Duration::from_secs(3);

/// Time for which the version is requested from the emulated board.
const PATIENCE_WITH_EMULATED: Duration = Duration::from_secs(5);

/// A port and the protocol over it.
pub struct Line {
    name: String,
    port: Box<dyn Port>,
    pub(super) link: Link,
}

impl Line {
    /// Opens a port and requests the version.
    ///
    /// # Errors
    /// [`BoardError`], if there is no answer or another protocol.
    pub fn open(name: &str) -> Result<(Self, Version), BoardError> {
        let (line, version) = Self::meet(name)?;
        if version.protocol == PROTOCOL {
            Ok((line, version))
        } else {
            Err(BoardError::Protocol { board: version.protocol })
        }
    }

    /// As [`Line::open`], but accepts any protocol version; use only the requests that all versions
    /// have.
    pub fn meet(name: &str) -> Result<(Self, Version), BoardError> {
        Self::meet_by(name, || port::open(name))
    }

    /// As [`Line::meet`], over the port that `open` opens.
    pub(super) fn meet_by(
        name: &str,
        open: impl Fn() -> Result<Box<dyn Port>, BoardError>,
    ) -> Result<(Self, Version), BoardError> {
        let began = Instant::now();
        loop {
            let mut line = Self::over(open()?, name);
            match line.ask(HostCommand::Version, "version") {
                Ok(Answer::Version(version)) => return Ok((line, version)),
                Ok(_) => return Err(BoardError::Silent { asked: "version" }),
                // The emulated board accepts one client and closes further connections: on a busy
                // machine even after the earlier client has left. It may also take long to start.
                Err(BoardError::Line(_) | BoardError::EmulatedSilent { .. })
                    if name == port::EMULATED && began.elapsed() < PATIENCE_WITH_EMULATED => {}
                Err(BoardError::Line(_)) if name == port::EMULATED => {
                    return Err(BoardError::Taken { port: name.to_owned() });
                }
                Err(error) => return Err(error),
            }
        }
    }

    pub(super) fn over(port: Box<dyn Port>, name: &str) -> Self {
        Self { name: name.to_owned(), port, link: Link::default() }
    }

    pub fn name(&self) -> &str {
        &self.name
    }

    /// Sends a request; returns its number.
    pub fn send(&mut self, command: HostCommand) -> Result<u8, BoardError> {
        let (sequence, frame) = self.link.request(command);
        self.port.write_all(&frame)?;
        Ok(sequence)
    }

    /// Sends a request and waits for its answer.
    pub fn ask(&mut self, command: HostCommand, asked: &'static str) -> Result<Answer, BoardError> {
        let sequence = self.send(command)?;
        match self.wait(|link| link.take_answer(sequence), asked)? {
            Answer::Refused(refusal) => Err(BoardError::Refused(refusal)),
            answer => Ok(answer),
        }
    }

    pub fn ask_status(&mut self) -> Result<Status, BoardError> {
        match self.ask(HostCommand::Status, "status")? {
            Answer::Status(status) => Ok(status),
            _ => Err(BoardError::Silent { asked: "status" }),
        }
    }

    pub fn timing(&mut self) -> Result<Timing, BoardError> {
        match self.ask(HostCommand::Timing, "timing")? {
            Answer::Timing(timing) => Ok(timing),
            _ => Err(BoardError::Silent { asked: "timing" }),
        }
    }

    pub fn last_reset(&mut self) -> Result<LastReset, BoardError> {
        const ASKED: &str = "reason of the last restart";
        match self.ask(HostCommand::LastReset, ASKED)? {
            Answer::LastReset(last_reset) => Ok(last_reset),
            _ => Err(BoardError::Silent { asked: ASKED }),
        }
    }

    /// Restarts and venting faults, the latest first.
    pub fn history(&mut self) -> Result<Vec<Event>, BoardError> {
        let mut events = Vec::new();
        for number in 0..=u8::MAX {
            match self.ask(HostCommand::History(number), "history")? {
                Answer::Event(Some(event)) => events.push(event),
                Answer::Event(None) => break,
                _ => return Err(BoardError::Silent { asked: "history" }),
            }
        }
        Ok(events)
    }

    /// Waits until `arrived` returns something.
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

    /// Reads bytes that have arrived, waiting some milliseconds for them.
    pub fn poll(&mut self) -> Result<(), BoardError> {
        let mut buffer = [0; 4096];
        let count = serial_port::read(&mut self.port, &mut buffer)?;
        self.link.feed(&buffer[..count]);
        Ok(())
    }

    /// Whether unread telemetry has arrived.
    pub fn is_behind(&self) -> bool {
        self.link.is_behind()
    }

    /// Returns the refusal of a request that was only sent, if it has arrived.
    pub fn check(&mut self, sequence: u8) -> Result<(), BoardError> {
        match self.link.take_answer(sequence) {
            Some(Answer::Refused(refusal)) => Err(BoardError::Refused(refusal)),
            _ => Ok(()),
        }
    }

    /// Latest status that the board sent.
    pub fn status(&self) -> Option<Status> {
        self.link.status()
    }
}
