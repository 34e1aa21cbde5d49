//! State of a monitored board, and its connection.

use super::MonitorError;
use model_core::control::Mode;
use model_core::safety::supervisor::FirstFailure;
use model_core::{Config, SetPoint, Telemetry};
use serde::Serialize;
use std::io::Write;
use std::time::{Duration, Instant};
use thermyo_boards::link::Link;
use thermyo_boards::live::for_one_muscle;
use thermyo_boards::port::Port;
use thermyo_boards::{port, serial_port};
use thermyo_protocol::{Answer, HostCommand, LastReset, PROTOCOL, Refusal, Timing, Version};
use thermyo_record::board_trace::Recorder;
use thermyo_simulation::board::BoardError;

/// Interval of attempts to open a lost port, and of requests.
const RETRY: Duration = Duration::from_millis(500);
/// A board without telemetry for this long counts as silent.
const SILENCE: Duration = Duration::from_secs(2);
/// Telemetry is requested once per this many steps by default: a record of every step can be replayed.
pub const EVERY: u16 = 1;
/// Interval of the keep-alive messages of an idle host: a fraction of `link.timeout_s`.
const ALIVE: Duration = Duration::from_millis(100);
/// Requests whose answers are awaited: those of some seconds, fewer than there are sequence
/// numbers.
const OPEN_QUESTIONS: usize = 64;
/// Increment of the pressure's set point \[Pa\].
pub const MOVE_PA: f32 = 5.0e3;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// Telemetry arrives.
    Connected,
    /// The port is open, and no telemetry arrives.
    Silent,
    /// The port is lost; opening it is tried again and again.
    Unplugged,
}

/// A configuration of the board, used from some row of the record on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Configured {
    /// Rows recorded before it was known.
    pub rows_before: u64,
    pub config: Config,
}

pub struct Session {
    name: String,
    /// Steps per row.
    every: u16,
    port: Option<Box<dyn Port>>,
    link: Link,
    recorder: Recorder,
    configurations: Vec<Configured>,
    version: Option<Version>,
    last_reset: Option<LastReset>,
    first_failure: Option<FirstFailure>,
    timing: Option<Timing>,
    questions: Vec<u8>,
    asked: Option<Instant>,
    tried: Instant,
    heard: Instant,
    connections: u32,
    latest: Option<Telemetry>,
    wanted: Option<f32>,
    last_sent: Instant,
    refused: Option<Refusal>,
}

impl Session {
    /// Records a row per `every` steps, at least 1.
    pub fn open(name: &str, every: u16, recorder: Recorder) -> Result<Self, BoardError> {
        let now = Instant::now();
        Ok(Self {
            name: name.to_owned(),
            every,
            port: Some(port::open(name)?),
            link: Link::default(),
            recorder,
            configurations: Vec::new(),
            version: None,
            last_reset: None,
            first_failure: None,
            timing: None,
            questions: Vec::new(),
            asked: None,
            tried: now,
            heard: now,
            connections: 1,
            latest: None,
            wanted: None,
            last_sent: now,
            refused: None,
        })
    }

    /// Reads new data, requests missing data and reopens a lost port.
    ///
    /// # Errors
    /// [`BoardError::Protocol`], and errors of the recording. A line that breaks is no error.
    pub fn poll(&mut self) -> Result<(), MonitorError> {
        self.recorder.hand_over_in_time().map_err(MonitorError::Recording)?;
        let Some(port) = &mut self.port else {
            self.reopen();
            return Ok(());
        };
        let mut buffer = [0; 4096];
        let Ok(count) = serial_port::read(port, &mut buffer) else {
            self.port = None;
            return Ok(());
        };
        self.link.feed(&buffer[..count]);
        self.take_answers()?;
        while let Some(telemetry) = self.link.take_telemetry() {
            self.heard = Instant::now();
            let config = self.config();
            // The core does not count the steps of its startup check.
            if telemetry.mode == Mode::StartupCheck {
                continue;
            }
            let status = self.link.status();
            let written = self.recorder.write(&config, status.as_ref(), &telemetry);
            written.map_err(MonitorError::Recording)?;
            self.latest = Some(telemetry);
        }
        if self.asked.is_none_or(|at| at.elapsed() > RETRY) {
            self.ask();
        } else if self.last_sent.elapsed() > ALIVE {
            self.send(HostCommand::Alive);
        }
        Ok(())
    }

    fn send(&mut self, command: HostCommand) {
        self.last_sent = Instant::now();
        let (sequence, frame) = self.link.request(command);
        self.questions.push(sequence);
        if let Some(port) = &mut self.port
            && port.write_all(&frame).is_err()
        {
            self.port = None;
        }
    }

    pub fn vent(&mut self) {
        self.wanted = None;
        self.send(HostCommand::Stop);
    }

    /// Vents a driven muscle before it is left alone.
    pub fn let_go(&mut self) {
        if self.latest.is_some_and(|telemetry| telemetry.set_point != SetPoint::Vent) {
            self.vent();
        }
    }

    /// Arms the board, as far as its configuration allows.
    pub fn arm(&mut self) {
        (self.wanted, self.refused) = (None, None);
        self.send(HostCommand::Arm { most_pa: None });
    }

    /// Moves the pressure's set point, from the measured pressure if there is none \[Pa\].
    pub fn move_set_point(&mut self, by_pa: f32) {
        let Some(telemetry) = self.latest else { return };
        let config = self.config();
        let from_pa = self.wanted.unwrap_or(telemetry.pressure_pa);
        let to_pa = ((from_pa + by_pa) / MOVE_PA).round() * MOVE_PA;
        let pressure_pa = to_pa.clamp(config.ambient.pressure_pa, config.working_limit_pa());
        (self.wanted, self.refused) = (Some(pressure_pa), None);
        self.send(HostCommand::Set(SetPoint::Pressure { pressure_pa }));
    }

    /// Refusal of the last request.
    pub fn refused(&self) -> Option<Refusal> {
        self.refused
    }

    /// Latest status that the board sent.
    pub fn last_status(&self) -> Option<thermyo_protocol::Status> {
        self.link.status()
    }

    fn reopen(&mut self) {
        if self.tried.elapsed() < RETRY {
            std::thread::sleep(Duration::from_millis(20));
            return;
        }
        self.tried = Instant::now();
        if let Ok(port) = port::open(&self.name) {
            self.port = Some(port);
            // Half a frame may be lost, and the board may have restarted.
            self.link = Link::default();
            self.questions.clear();
            self.asked = None;
            self.connections += 1;
        }
    }

    fn ask(&mut self) {
        self.asked = Some(Instant::now());
        // Old requests are not answered any more.
        self.questions.drain(..self.questions.len().saturating_sub(OPEN_QUESTIONS));
        for command in [
            HostCommand::Version,
            HostCommand::ReadConfig,
            HostCommand::LastReset,
            HostCommand::FirstFailure,
            HostCommand::TelemetryDivider(self.every),
            HostCommand::Timing,
        ] {
            self.send(command);
        }
    }

    fn take_answers(&mut self) -> Result<(), BoardError> {
        for sequence in self.questions.clone() {
            match self.link.take_answer(sequence) {
                Some(Answer::Version(version)) if version.protocol != PROTOCOL => {
                    return Err(BoardError::Protocol { board: version.protocol });
                }
                Some(Answer::Version(version)) => {
                    for_one_muscle(version)?;
                    self.version = Some(version);
                }
                Some(Answer::Config(config)) => self.take_config(config),
                Some(Answer::LastReset(last_reset)) => self.last_reset = Some(last_reset),
                Some(Answer::FirstFailure(first)) => self.first_failure = first,
                Some(Answer::Timing(timing)) => self.timing = Some(timing),
                Some(Answer::Refused(refusal)) => {
                    (self.wanted, self.refused) = (None, Some(refusal))
                }
                _ => (),
            }
        }
        Ok(())
    }

    fn take_config(&mut self, config: Config) {
        if self.configurations.last().is_none_or(|last| last.config != config) {
            self.configurations.push(Configured { rows_before: self.recorder.rows(), config });
        }
    }

    pub fn status(&self) -> Status {
        match &self.port {
            None => Status::Unplugged,
            Some(_) if self.heard.elapsed() > SILENCE => Status::Silent,
            Some(_) => Status::Connected,
        }
    }

    pub fn port(&self) -> &str {
        &self.name
    }

    /// How often the port has been opened.
    pub fn connections(&self) -> u32 {
        self.connections
    }

    /// The board's configuration; the default until it is known.
    pub fn config(&self) -> Config {
        self.configurations.last().map_or_else(Config::default, |last| last.config)
    }

    /// Every configuration that the board has had, the oldest first.
    pub fn configurations(&self) -> &[Configured] {
        &self.configurations
    }

    pub fn version(&self) -> Option<Version> {
        self.version
    }

    /// The first venting fault since faults were last cleared.
    pub fn first_failure(&self) -> Option<FirstFailure> {
        self.first_failure
    }

    pub fn last_reset(&self) -> Option<LastReset> {
        self.last_reset
    }

    pub fn timing(&self) -> Option<Timing> {
        self.timing
    }

    pub fn latest(&self) -> Option<&Telemetry> {
        self.latest.as_ref()
    }

    pub fn rows(&self) -> u64 {
        self.recorder.rows()
    }

    /// Ends the recording.
    pub fn finish(&mut self) -> Result<(), MonitorError> {
        self.recorder.hand_over().map_err(MonitorError::Recording)
    }
}
