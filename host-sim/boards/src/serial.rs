//! A flashed board behind a serial port, fed with samples (`hil` firmware): one request and one
//! telemetry per step.

use super::armed::if_armed;
use super::line::Line;
use super::link::Link;
use model_core::control::Mode;
use model_core::{Config, Sample, SetPoint, Telemetry};
use thermyo_protocol::{HostCommand, Image};
use thermyo_simulation::board::{Board, BoardError, BoardStep};

pub struct SerialBoard {
    line: Line,
}

impl SerialBoard {
    /// Opens the board at a port, which must have the `hil` firmware of this protocol version.
    pub fn open(port: &str) -> Result<Self, BoardError> {
        let (line, version) = Line::open(port)?;
        if version.image == Image::Hil {
            Ok(Self { line })
        } else {
            Err(BoardError::NotHil { chip: version.chip })
        }
    }
}

impl Board for SerialBoard {
    fn name(&self) -> &'static str {
        "serial"
    }

    fn start(&mut self, config: &Config, set_point: SetPoint) -> Result<(), BoardError> {
        self.line.ask(HostCommand::Configure(*config), "configure")?;
        let armed = self.line.ask(HostCommand::Arm { most_pa: None }, "arm");
        let set_point = if_armed(armed, set_point)?;
        self.line.ask(HostCommand::Start(set_point), "start")?;
        Ok(())
    }

    fn set(&mut self, set_point: SetPoint) -> Result<(), BoardError> {
        self.line.ask(HostCommand::Set(set_point), "set point").map(drop)
    }

    fn step(&mut self, sample: &Sample) -> Result<BoardStep, BoardError> {
        let telemetry = loop {
            self.line.send(HostCommand::Step(*sample))?;
            let telemetry: Telemetry = self.line.wait(Link::take_telemetry, "step")?;
            if telemetry.mode != Mode::StartupCheck {
                break telemetry;
            }
        };
        let actuation = telemetry.command.into();
        Ok(BoardStep { telemetry: Some(telemetry), actuation })
    }
}
