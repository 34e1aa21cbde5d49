//! State of a monitored board, and its connection.

use super::MonitorError;
use super::subject::Monitored;
use model_core::safety::supervisor::FirstFailure;
use serde::Serialize;
use std::io::Write;
use std::time::{Duration, Instant};
use thermyo_boards::link::Link;
use thermyo_boards::port::Port;
use thermyo_boards::{port, serial_port};
use thermyo_protocol::{Answer, HostCommand, LastReset, PROTOCOL, Refusal, Timing, Version};
use thermyo_record::board_trace::Recorder;
use thermyo_simulation::board::BoardError;
use thermyo_studies::drive::Record;

/// Interval of attempts to open a lost port, and of requests.
const RETRY: Duration = Duration::from_millis(500);
/// A board without telemetry for this long counts as silent.
const SILENCE: Duration = Duration::from_secs(2);
/// Telemetry is requested once per this many steps by default: a record of every step can be replayed.
pub const EVERY: u16 = 1;
/// Interval of the keep-alive messages of an idle host: a fraction of `link.timeout_s`.
const ALIVE: Duration = Duration::from_millis(100);
/// Number of pending requests: those of some seconds, fewer than there are sequence numbers.
const OPEN_QUESTIONS: usize = 64;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// Telemetry arrives.
    Connected,
    /// The port is open, and no telemetry arrives.
    Silent,
    /// The port is lost; opening it is retried.
    Unplugged,
}

/// A configuration of the board, used from some row of the record on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Configured<C> {
    /// Rows recorded before the configuration was known.
    pub rows_before: u64,
    pub config: C,
}

pub struct Session<S: Monitored> {
    name: String,
    /// Steps per row.
    every: u16,
    port: Option<Box<dyn Port>>,
    link: Link,
    recorder: Recorder,
    configurations: Vec<Configured<S::Config>>,
    version: Option<Version>,
    last_reset: Option<LastReset>,
    first_failure: Option<FirstFailure>,
    timing: Option<Timing>,
    /// Sequence numbers of requests, with the index in [`Monitored::QUESTIONS`] if they are among those.
    questions: Vec<(u8, Option<usize>)>,
    /// Answers to [`Monitored::QUESTIONS`].
    answers: Vec<Option<Answer>>,
    asked: Option<Instant>,
    tried: Instant,
    heard: Instant,
    connections: u32,
    latest: Option<S::Telemetry>,
    /// The set point that the keys have requested.
    wanted: Option<f32>,
    last_sent: Instant,
    refused: Option<Refusal>,
}

impl<S: Monitored> Session<S> {
    /// Opens a session that records a row per `every` steps, at least 1.
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
            answers: Vec::new(),
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
    /// [`BoardError::Protocol`], and errors of the recording. A broken link is no error.
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
        while let Some(telemetry) = S::take_telemetry(&mut self.link) {
            self.heard = Instant::now();
            let config = self.config();
            // The core does not count the steps of its startup check.
            if S::is_checking(&telemetry) {
                continue;
            }
            let status = self.link.status();
            let written =
                S::Record::write(&mut self.recorder, &config, status.as_ref(), &telemetry);
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
        self.send_as(command, None);
    }

    /// Sends a request; `index` is its index in [`Monitored::QUESTIONS`].
    fn send_as(&mut self, command: HostCommand, index: Option<usize>) {
        self.last_sent = Instant::now();
        let (sequence, frame) = self.link.request(command);
        self.questions.push((sequence, index));
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

    /// Vents a driven muscle before leaving it.
    pub fn let_go(&mut self) {
        if self.latest.is_some_and(|latest| S::set_point(&latest) != S::VENT) {
            self.vent();
        }
    }

    /// Arms the board, as far as its configuration allows.
    pub fn arm(&mut self) {
        (self.wanted, self.refused) = (None, None);
        self.send(HostCommand::Arm { most_pa: None });
    }

    /// Moves the set point by this many increments.
    pub fn move_set_point(&mut self, increments: f32) {
        let Some(telemetry) = self.latest else { return };
        let (wanted, command) = S::moved(&self.config(), &telemetry, (self.wanted, increments));
        (self.wanted, self.refused) = (Some(wanted), None);
        self.send(command);
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
            self.version = None;
            self.questions.clear();
            self.answers.clear();
            self.asked = None;
            self.connections += 1;
        }
    }

    fn ask(&mut self) {
        self.asked = Some(Instant::now());
        // Old requests will not be answered.
        self.questions.drain(..self.questions.len().saturating_sub(OPEN_QUESTIONS));
        // The answers are long, and a board without time for them and for every step would lose telemetry.
        if self.is_configuration_known() {
            self.send(HostCommand::TelemetryDivider(self.every));
        } else {
            self.answers = vec![None; S::QUESTIONS.len()];
            for (index, question) in S::QUESTIONS.iter().enumerate() {
                self.send_as(*question, Some(index));
            }
        }
        // A board takes a version request for a new connection, and then does not receive driving requests.
        if self.version.is_none() {
            self.send(HostCommand::Version);
        }
        for command in [HostCommand::LastReset, HostCommand::FirstFailure, HostCommand::Timing] {
            self.send(command);
        }
    }

    /// Whether the last configuration is the one that the board states, if it has stated one.
    fn is_configuration_known(&self) -> bool {
        let stated = self.link.status().map(|status| status.config_checksum);
        self.configurations.last().is_some_and(|last| {
            let checksum = S::checksum(&last.config);
            stated.is_none_or(|stated| stated == checksum)
        })
    }

    fn take_answers(&mut self) -> Result<(), BoardError> {
        for (sequence, index) in self.questions.clone() {
            match self.link.take_answer(sequence) {
                Some(Answer::Version(version)) if version.protocol != PROTOCOL => {
                    return Err(BoardError::Protocol { board: version.protocol });
                }
                Some(Answer::Version(version)) => {
                    S::fits(version)?;
                    self.version = Some(version);
                }
                Some(answer @ (Answer::Config(_) | Answer::Joint(_))) => {
                    self.take_config(index, answer);
                }
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

    /// Takes a part of the configuration, and the whole once it is complete.
    fn take_config(&mut self, index: Option<usize>, answer: Answer) {
        if let Some(place) = index.and_then(|index| self.answers.get_mut(index)) {
            *place = Some(answer);
        }
        let Some(config) = S::config_of(&self.answers) else { return };
        self.answers.clear();
        if self.configurations.last().is_none_or(|last| last.config != config) {
            self.configurations.push(Configured { rows_before: self.recorder.rows(), config });
            // Every step can come from now on.
            self.asked = None;
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

    /// Number of times that the port has been opened.
    pub fn connections(&self) -> u32 {
        self.connections
    }

    /// The board's configuration; the default until it is known.
    pub fn config(&self) -> S::Config {
        self.configurations.last().map_or_else(S::Config::default, |last| last.config)
    }

    /// Every configuration that the board has had, the oldest first.
    pub fn configurations(&self) -> &[Configured<S::Config>] {
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

    pub fn latest(&self) -> Option<&S::Telemetry> {
        self.latest.as_ref()
    }

    pub fn rows(&self) -> u64 {
        self.recorder.rows()
    }

    pub fn finish(&mut self) -> Result<(), MonitorError> {
        self.recorder.hand_over().map_err(MonitorError::Recording)
    }
}
