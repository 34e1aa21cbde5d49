//! A flashed board that samples its own muscle, in its own time.

use super::BoardError;
use super::line::Line;
use model_core::control::Mode;
use model_core::link::{
    Answer, Chip, Event, HostCommand, LastReset, Name, Refusal, Status, Timing, Version, checksum,
};
use model_core::{Config, Faults, SetPoint, SetPointError, Telemetry};
use std::time::{Duration, Instant};

/// Time between two words of a host that has nothing to ask: a fraction of `link.timeout_s`.
const ALIVE: Duration = Duration::from_millis(100);
/// Steps per telemetry frame where nobody records.
pub const VIEW_DIVIDER: u16 = 10;

/// The board. Dropped while it drives, it vents.
pub struct LiveBoard {
    line: Line,
    version: Version,
    /// As it was asked for last.
    config: Option<Config>,
    said: Instant,
    driving: bool,
}

impl LiveBoard {
    /// The board at a port.
    ///
    /// # Errors
    /// [`BoardError`], where nobody answers, another protocol is spoken, or samples are waited for.
    pub fn open(port: &str) -> Result<Self, BoardError> {
        let (line, version) = Line::open(port)?;
        if version.hil {
            return Err(BoardError::Hil { chip: version.chip });
        }
        let mut board = Self { line, version, config: None, said: Instant::now(), driving: false };
        board.telemetry_every(VIEW_DIVIDER)?;
        Ok(board)
    }

    /// Who it is.
    pub fn version(&self) -> Version {
        self.version
    }

    /// Name of its port.
    pub fn port(&self) -> &str {
        self.line.name()
    }

    /// One frame per this many steps.
    ///
    /// # Errors
    /// [`BoardError`]
    pub fn telemetry_every(&mut self, steps: u16) -> Result<(), BoardError> {
        self.line.ask(HostCommand::TelemetryDivider(steps), "telemetry").map(drop)
    }

    /// What changes rarely.
    ///
    /// # Errors
    /// [`BoardError`]
    pub fn status(&mut self) -> Result<Status, BoardError> {
        match self.line.ask(HostCommand::Status, "status")? {
            Answer::Status(status) => Ok(status),
            _ => Err(BoardError::Silent { asked: "status" }),
        }
    }

    /// What changes rarely, as the board has said it last of its own accord.
    pub fn last_status(&self) -> Option<Status> {
        self.line.status()
    }

    /// The configuration in use.
    ///
    /// # Errors
    /// [`BoardError`]
    pub fn config(&mut self) -> Result<Config, BoardError> {
        match self.line.ask(HostCommand::ReadConfig, "configuration")? {
            Answer::Config(config) => {
                self.config = Some(config);
                Ok(config)
            }
            _ => Err(BoardError::Silent { asked: "configuration" }),
        }
    }

    /// Another configuration, taken as a whole or refused as a whole, and what it is called.
    ///
    /// # Errors
    /// [`BoardError::Config`] with the value that is out of its range; [`BoardError::OtherChip`];
    /// [`BoardError::Damaged`] where the board
    /// has another one afterwards.
    pub fn configure(&mut self, config: &Config, name: &str) -> Result<Status, BoardError> {
        config.check().map_err(BoardError::Config)?;
        let chip = self.version.chip;
        if chip != Chip::Rp2040 && config.sensors.adc.wide_code_lsb > 0.0 {
            return Err(BoardError::OtherChip { chip });
        }
        self.config = None;
        self.line.ask(HostCommand::Configure(*config), "configure")?;
        self.line.ask(HostCommand::Name(Name::new(name)), "name")?;
        let status = self.status()?;
        if status.config_checksum == checksum(config) {
            Ok(status)
        } else {
            Err(BoardError::Damaged)
        }
    }

    /// Keeps the configuration in use over the loss of power.
    ///
    /// # Errors
    /// [`BoardError`]
    pub fn save(&mut self) -> Result<(), BoardError> {
        self.line.ask(HostCommand::Save, "save").map(drop)
    }

    /// Forgets what was saved.
    ///
    /// # Errors
    /// [`BoardError`]
    pub fn forget(&mut self) -> Result<(), BoardError> {
        self.line.ask(HostCommand::Forget, "forget").map(drop)
    }

    /// How the steps were timed.
    ///
    /// # Errors
    /// [`BoardError`]
    pub fn timing(&mut self) -> Result<Timing, BoardError> {
        match self.line.ask(HostCommand::Timing, "timing")? {
            Answer::Timing(timing) => Ok(timing),
            _ => Err(BoardError::Silent { asked: "timing" }),
        }
    }

    /// Why it started last.
    ///
    /// # Errors
    /// [`BoardError`]
    pub fn last_reset(&mut self) -> Result<LastReset, BoardError> {
        match self.line.ask(HostCommand::LastReset, "reason of the last restart")? {
            Answer::LastReset(last_reset) => Ok(last_reset),
            _ => Err(BoardError::Silent { asked: "reason of the last restart" }),
        }
    }

    /// What happened, the last event first.
    ///
    /// # Errors
    /// [`BoardError`]
    pub fn history(&mut self) -> Result<Vec<Event>, BoardError> {
        let mut events = Vec::new();
        for number in 0..=u8::MAX {
            match self.line.ask(HostCommand::History(number), "history")? {
                Answer::Event(Some(event)) => events.push(event),
                Answer::Event(None) => break,
                _ => return Err(BoardError::Silent { asked: "history" }),
            }
        }
        Ok(events)
    }

    /// Set points are taken from now on, up to this absolute pressure \[Pa\].
    ///
    /// # Errors
    /// [`BoardError::Refused`]
    pub fn arm(&mut self, most_pa: Option<f32>) -> Result<(), BoardError> {
        self.line.ask(HostCommand::Arm { most_pa }, "arm").map(drop)
    }

    /// Another set point; the step from which on it holds.
    ///
    /// # Errors
    /// [`BoardError::Refused`]; [`BoardError::Pressure`], below ambient too, where the board vents.
    pub fn set(&mut self, set_point: SetPoint) -> Result<u32, BoardError> {
        if let SetPoint::Pressure { pressure_pa } = set_point {
            let config = self.known_config()?;
            let least_pa = config.ambient.pressure_pa;
            if pressure_pa < least_pa {
                let most_pa = self.status()?.armed_pa.unwrap_or(config.working_limit_pa());
                return Err(BoardError::Pressure { pressure_pa, least_pa, most_pa });
            }
            return self.set_any(set_point).map_err(|error| match error {
                BoardError::Refused(Refusal::SetPoint(SetPointError::Range {
                    maximum, ..
                })) => BoardError::Pressure { pressure_pa, least_pa, most_pa: maximum },
                other => other,
            });
        }
        self.set_any(set_point)
    }

    fn set_any(&mut self, set_point: SetPoint) -> Result<u32, BoardError> {
        self.driving |= set_point != SetPoint::Vent;
        match self.line.ask(HostCommand::Set(set_point), "set point")? {
            Answer::Done { step } => Ok(step),
            _ => Err(BoardError::Silent { asked: "set point" }),
        }
    }

    /// The configuration in use, asked for where it may have become another one.
    fn known_config(&mut self) -> Result<Config, BoardError> {
        let said = self.last_status();
        let in_use =
            |config: &Config| said.is_none_or(|said| said.config_checksum == checksum(config));
        match self.config.filter(in_use) {
            Some(config) => Ok(config),
            None => self.config(),
        }
    }

    /// The core starts anew, with this set point in its step 0.
    ///
    /// # Errors
    /// [`BoardError::Refused`]
    pub fn start(&mut self, set_point: SetPoint) -> Result<(), BoardError> {
        self.driving = true;
        self.line.ask(HostCommand::Start(set_point), "start").map(drop)
    }

    /// Another set point, without a wait for the answer.
    ///
    /// # Errors
    /// [`BoardError::Line`]
    pub fn send(&mut self, set_point: SetPoint) -> Result<u8, BoardError> {
        self.driving |= set_point != SetPoint::Vent;
        self.said = Instant::now();
        self.line.send(HostCommand::Set(set_point))
    }

    /// Whether telemetry has come that nobody has taken: what it says of now is later than what was taken.
    pub fn is_behind(&self) -> bool {
        self.line.is_behind()
    }

    /// Whether the answer to a request that was only sent is a refusal.
    ///
    /// # Errors
    /// [`BoardError::Refused`]
    pub fn check(&mut self, sequence: u8) -> Result<(), BoardError> {
        match self.line.take_answer(sequence) {
            Some(Answer::Refused(refusal)) => Err(BoardError::Refused(refusal)),
            _ => Ok(()),
        }
    }

    /// Vents; returns when the board says that it does.
    ///
    /// # Errors
    /// [`BoardError`]
    pub fn stop(&mut self) -> Result<(), BoardError> {
        self.vent()?;
        let vents = |telemetry: &Telemetry| matches!(telemetry.mode, Mode::Vent | Mode::Judging);
        self.line.wait(|link| link.take_telemetry().filter(vents), "telemetry").map(drop)
    }

    /// Vents, for those who take every telemetry themselves.
    ///
    /// # Errors
    /// [`BoardError`]
    pub fn vent(&mut self) -> Result<(), BoardError> {
        self.line.ask(HostCommand::Stop, "stop")?;
        self.driving = false;
        Ok(())
    }

    /// Forgets the latched faults whose cause is gone; those that are left.
    ///
    /// # Errors
    /// [`BoardError`]
    pub fn clear(&mut self) -> Result<Faults, BoardError> {
        self.forget_faults()?;
        Ok(self.fresh_telemetry()?.faults)
    }

    /// The same, for those who take every telemetry themselves.
    ///
    /// # Errors
    /// [`BoardError`]
    pub fn forget_faults(&mut self) -> Result<(), BoardError> {
        self.line.ask(HostCommand::ClearFaults, "clear")?;
        self.driving = false;
        Ok(())
    }

    /// The telemetry of a step that is not yet done.
    ///
    /// # Errors
    /// [`BoardError`]
    pub fn fresh_telemetry(&mut self) -> Result<Telemetry, BoardError> {
        while self.line.take_telemetry().is_some() {}
        // The first one that comes may have been on its way.
        self.line.wait(|link| link.take_telemetry(), "telemetry")?;
        self.line.wait(|link| link.take_telemetry(), "telemetry")
    }

    /// The next telemetry that has come; tells the board that its host is there, and waits some milliseconds.
    ///
    /// # Errors
    /// [`BoardError::Line`]
    pub fn poll(&mut self) -> Result<Option<Telemetry>, BoardError> {
        if let Some(telemetry) = self.line.take_telemetry() {
            return Ok(Some(telemetry));
        }
        if self.said.elapsed() > ALIVE {
            self.said = Instant::now();
            self.line.send(HostCommand::Alive)?;
        }
        self.line.poll()?;
        Ok(self.line.take_telemetry())
    }
}

impl Drop for LiveBoard {
    fn drop(&mut self) {
        if self.driving {
            // Without a line the board finds out for itself.
            let _ = self.line.ask(HostCommand::Stop, "stop");
        }
    }
}
