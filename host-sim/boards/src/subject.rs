//! A board of one muscle or of a joint, for programs that handle both.

use super::line::{ALIVE, Line, VIEW_DIVIDER};
use super::link::Link;
use model_core::Faults;
use std::time::Instant;
use thermyo_protocol::{Answer, Event, HostCommand, LastReset, Status, Timing, Version};
use thermyo_simulation::board::BoardError;

/// The link to a board. Dropping it while it drives vents the board.
pub struct Live {
    pub(super) line: Line,
    pub(super) version: Version,
    pub(super) last_sent: Instant,
    pub(super) driving: bool,
    /// Steps per telemetry frame, as last requested.
    every: u16,
}

impl Live {
    pub(super) fn new(line: Line, version: Version) -> Self {
        Self { line, version, last_sent: Instant::now(), driving: false, every: VIEW_DIVIDER }
    }

    /// Sends a request that is carried out or refused; returns the step from which it holds.
    pub(super) fn done(
        &mut self,
        command: HostCommand,
        asked: &'static str,
    ) -> Result<u32, BoardError> {
        match self.line.ask(command, asked)? {
            Answer::Done { step } => Ok(step),
            _ => Err(BoardError::Silent { asked }),
        }
    }

    /// Sends a request without waiting for the answer; returns its number.
    fn send(&mut self, command: HostCommand) -> Result<u8, BoardError> {
        self.last_sent = Instant::now();
        self.line.send(command)
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        if self.driving {
            // If the link is gone, the board vents by its own timeout.
            let _ = self.line.ask(HostCommand::Stop, "stop");
        }
    }
}

/// A live board, and the contents of its telemetry.
pub trait Subject: Sized + Send + 'static {
    type Config: Copy + PartialEq + Send;
    type Telemetry: Copy + Send;
    type SetPoint: Copy + PartialEq + Send;

    const VENT: Self::SetPoint;

    /// Opens the board at a port.
    ///
    /// # Errors
    /// [`BoardError`], if there is no answer, another protocol, or another image.
    fn open(port: &str) -> Result<Self, BoardError> {
        let (line, version) = Line::open(port)?;
        Self::fits(version)?;
        let mut board = Self::of(Live::new(line, version));
        board.telemetry_every(VIEW_DIVIDER)?;
        Ok(board)
    }

    /// Whether the board has the image for this subject.
    ///
    /// # Errors
    /// [`BoardError`] that names the other image.
    fn fits(version: Version) -> Result<(), BoardError>;

    fn of(live: Live) -> Self;

    fn live(&self) -> &Live;

    fn live_mut(&mut self) -> &mut Live;

    fn version(&self) -> Version {
        self.live().version
    }

    fn port(&self) -> &str {
        self.live().line.name()
    }

    fn status(&mut self) -> Result<Status, BoardError> {
        self.live_mut().line.ask_status()
    }

    /// Latest status that the board sent without a request.
    fn last_status(&self) -> Option<Status> {
        self.live().line.status()
    }

    fn timing(&mut self) -> Result<Timing, BoardError> {
        self.live_mut().line.timing()
    }

    fn last_reset(&mut self) -> Result<LastReset, BoardError> {
        self.live_mut().line.last_reset()
    }

    /// Restarts and venting faults, the latest first.
    fn history(&mut self) -> Result<Vec<Event>, BoardError> {
        self.live_mut().line.history()
    }

    fn checksum(config: &Self::Config) -> u32;

    fn config(&mut self) -> Result<Self::Config, BoardError>;

    /// Sends a configuration and its name; the board accepts or refuses it as a whole.
    ///
    /// # Errors
    /// [`BoardError::Config`] with the value that is out of its range; [`BoardError::OtherChip`];
    /// [`BoardError::Damaged`] if the board's configuration differs afterwards.
    fn configure(&mut self, config: &Self::Config, name: &str) -> Result<Status, BoardError>;

    /// Saves the configuration in use in flash.
    fn save(&mut self) -> Result<(), BoardError> {
        self.live_mut().done(HostCommand::Save, "save").map(drop)
    }

    /// Deletes the saved configuration.
    fn forget(&mut self) -> Result<(), BoardError> {
        self.live_mut().done(HostCommand::Forget, "forget").map(drop)
    }

    /// Arms up to this absolute pressure \[Pa\] in either muscle, or up to the configured limit.
    ///
    /// # Errors
    /// [`BoardError::Refused`]; [`BoardError::Pressure`] outside the limits of the configuration.
    fn arm(&mut self, most_pa: Option<f32>) -> Result<(), BoardError>;

    /// Refuses a set point that the board would refuse, whatever the pressure for which it is armed.
    ///
    /// # Errors
    /// As for [`Self::set`].
    fn check_set_point(&mut self, set_point: Self::SetPoint) -> Result<(), BoardError>;

    /// Sends a set point; returns the step from which it holds.
    ///
    /// # Errors
    /// [`BoardError::Refused`]; [`BoardError::Pressure`], also below ambient, where the board would vent.
    fn set(&mut self, set_point: Self::SetPoint) -> Result<u32, BoardError>;

    /// Clears the latched faults whose cause is gone, without reading telemetry.
    fn forget_faults(&mut self) -> Result<(), BoardError> {
        self.live_mut().done(HostCommand::ClearFaults, "clear")?;
        self.live_mut().driving = false;
        Ok(())
    }

    /// Sets the number of steps per telemetry frame.
    fn telemetry_every(&mut self, steps: u16) -> Result<(), BoardError> {
        self.live_mut().done(HostCommand::TelemetryDivider(steps), "telemetry")?;
        self.live_mut().every = steps;
        Ok(())
    }

    /// As [`Self::telemetry_every`], and drops earlier telemetry.
    fn telemetry_anew(&mut self, steps: u16) -> Result<(), BoardError> {
        self.telemetry_every(steps)?;
        // The board sends in order: everything before its answer is older than the request.
        while Self::take_telemetry(&mut self.live_mut().line.link).is_some() {}
        Ok(())
    }

    /// The request of a set point.
    fn request(set_point: Self::SetPoint) -> HostCommand;

    /// The request that restarts the core, with this set point in its step 0.
    fn restart(set_point: Self::SetPoint) -> HostCommand;

    /// Restarts the core, with this set point in its step 0.
    fn start(&mut self, set_point: Self::SetPoint) -> Result<(), BoardError> {
        self.live_mut().driving = true;
        self.live_mut().done(Self::restart(set_point), "start").map(drop)
    }

    /// Sends a set point without waiting for the answer; returns the number of the request.
    fn send(&mut self, set_point: Self::SetPoint) -> Result<u8, BoardError> {
        self.live_mut().driving |= set_point != Self::VENT;
        self.live_mut().send(Self::request(set_point))
    }

    /// Returns the refusal of a request that was only sent, if there is one.
    fn check(&mut self, sequence: u8) -> Result<(), BoardError> {
        self.live_mut().line.check(sequence)
    }

    /// The next telemetry that has arrived.
    fn take_telemetry(link: &mut Link) -> Option<Self::Telemetry>;

    /// The next telemetry that has arrived; keeps the board's set point alive, and waits some milliseconds.
    fn poll(&mut self) -> Result<Option<Self::Telemetry>, BoardError> {
        let live = self.live_mut();
        if live.last_sent.elapsed() > ALIVE {
            live.send(HostCommand::Alive)?;
        }
        if let Some(telemetry) = Self::take_telemetry(&mut live.line.link) {
            return Ok(Some(telemetry));
        }
        live.line.poll()?;
        Ok(Self::take_telemetry(&mut live.line.link))
    }

    /// The present telemetry, skipping unread older telemetry.
    fn fresh_telemetry(&mut self) -> Result<Self::Telemetry, BoardError> {
        self.fresh(|_| true)
    }

    /// The first telemetry from now on that `wanted` accepts. The wait is shorter than for rare
    /// frames.
    fn fresh(
        &mut self,
        wanted: impl Fn(&Self::Telemetry) -> bool,
    ) -> Result<Self::Telemetry, BoardError> {
        let every = self.live().every;
        self.telemetry_anew(every.min(VIEW_DIVIDER))?;
        let arrived = |link: &mut Link| Self::take_telemetry(link).filter(&wanted);
        let fresh = self.live_mut().line.wait(arrived, "telemetry");
        if every > VIEW_DIVIDER {
            self.telemetry_anew(every)?;
        }
        fresh
    }

    /// Whether unread telemetry has arrived: then the last telemetry read is not the latest.
    fn is_behind(&self) -> bool {
        self.live().line.is_behind()
    }

    /// Vents, without reading telemetry.
    fn vent(&mut self) -> Result<(), BoardError> {
        self.live_mut().done(HostCommand::Stop, "stop")?;
        self.live_mut().driving = false;
        Ok(())
    }

    /// Vents; returns once this is confirmed.
    fn stop(&mut self) -> Result<(), BoardError>;

    fn step(telemetry: &Self::Telemetry) -> u32;

    fn set_point(telemetry: &Self::Telemetry) -> Self::SetPoint;

    fn is_checking(telemetry: &Self::Telemetry) -> bool;

    fn pressure_pa(telemetry: &Self::Telemetry) -> f32;

    fn venting(telemetry: &Self::Telemetry) -> Faults;
}
