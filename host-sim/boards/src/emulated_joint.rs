//! The image of a joint on an emulated Pico, in lockstep with its plant.
//!
//! The link is USB: on the UART, a joint's telemetry takes longer than a step.

use super::emulated::{EmulatedBoard, STEP_NS};
use super::image::{self, Variant};
use super::live_joint::{configuration, drives_joint};
use model_core::joint::{
    JointConfig, JointError, JointMode, JointSample, JointSetPoint, JointTelemetry,
};
use model_core::step_counts::StepCounts;
use std::path::Path;
use thermyo_protocol::{HostCommand, PROTOCOL, Refusal, Timing};
use thermyo_simulation::board::{BoardError, JointBoard, JointStep};

/// Part of an exchange in which the board reads its inputs and begins its step; a request that is sent then acts from
/// the following step on \[ns\].
const BEGUN_NS: u32 = STEP_NS / 5;

/// Time from a configuration until the digital sensors have converted, and the check of the startup is over, in steps.
const CHECK_STEPS: u32 = 200;

pub struct EmulatedJoint {
    board: EmulatedBoard,
    config: JointConfig,
    first: JointSetPoint,
    started: bool,
}

impl EmulatedJoint {
    /// Starts a board with the firmware for a joint, or with an image, ELF or UF2; its core starts with the set point
    /// `first` in the first step.
    pub fn new(
        image: Option<&Path>,
        config: JointConfig,
        first: JointSetPoint,
    ) -> Result<Self, BoardError> {
        let board = match image {
            Some(image) => EmulatedBoard::with_image(image)?,
            None => {
                let scripts = image::prepare_emulator()?;
                EmulatedBoard::start_up(&scripts, &image::firmware(Variant::Joint)?, None)?
            }
        };
        Ok(Self { board, config, first, started: false })
    }

    /// Configures, arms and starts the core, and runs its startup check but for the last step.
    fn start(&mut self, sample: &JointSample) -> Result<(), BoardError> {
        let board = &mut self.board;
        board.connect_usb_while(&mut |board| board.exchange(sample))?;
        let version = board.version()?;
        if version.protocol != PROTOCOL {
            return Err(BoardError::Protocol { board: version.protocol });
        }
        drives_joint(version)?;
        for command in configuration(&self.config) {
            board.ask(command)?;
        }
        for _ in 0..CHECK_STEPS {
            board.exchange(sample)?;
        }
        board.ask(HostCommand::TelemetryDivider(1))?;
        let first = match board.ask(HostCommand::Arm { most_pa: None }) {
            Ok(_) => self.first,
            // The telemetry has the reason.
            Err(BoardError::Refused(Refusal::JointSetPoint(JointError::Faults(..)))) => {
                JointSetPoint::Vent
            }
            Err(error) => return Err(error),
        };
        board.run(sample, BEGUN_NS)?;
        board.send(HostCommand::StartJoint(first));
        board.run(sample, STEP_NS - BEGUN_NS)?;
        let [a, _] = &self.config.muscles;
        for _ in 1..StepCounts::new(a.step_s).startup_steps {
            board.exchange(sample)?;
        }
        board.take_joint_telemetry();
        Ok(())
    }
}

impl JointBoard for EmulatedJoint {
    fn name(&self) -> &'static str {
        "emulated"
    }

    fn step(
        &mut self,
        sample: &JointSample,
        next: Option<JointSetPoint>,
    ) -> Result<JointStep, BoardError> {
        if !std::mem::replace(&mut self.started, true) {
            self.start(sample)?;
        }
        let board = &mut self.board;
        board.run(sample, BEGUN_NS)?;
        if let Some(next) = next {
            board.send(HostCommand::SetJoint(next));
        }
        board.keep_alive(sample.heard);
        let exchange = board.run(sample, STEP_NS - BEGUN_NS)?;
        if exchange.restarts > 0 {
            return Err(BoardError::Restarted);
        }
        let mut telemetry = board.take_joint_telemetry();
        telemetry.retain(|seen: &JointTelemetry| seen.mode != JointMode::StartupCheck);
        Ok(JointStep { telemetry, actuations: exchange.set_duties() })
    }

    fn timing(&mut self) -> Result<Timing, BoardError> {
        self.board.timing()
    }
}
