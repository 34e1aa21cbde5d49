//! `thermyo board PORT calibrate`: leads through two points and configures the board.

use super::{Console, Failure, core_quantity, interrupt, print};
use clap::{Args, ValueEnum};
use model_core::SetPointError;
use std::io::{self, Write};
use std::sync::mpsc::{self, Receiver, TryRecvError};
use std::thread;
use thermyo_boards::live::LiveBoard;
use thermyo_boards::live_joint::LiveJoint;
use thermyo_protocol::{Refusal, Side};
use thermyo_simulation::board::BoardError;
use thermyo_studies::calibrate::{
    self, Bench, CalibrateError, Calibrated, Dialogue, Gauge, JointSensor, Sensor,
};

#[derive(Debug, Args)]
pub(super) struct CalibrateArgs {
    /// Sensor to calibrate
    #[arg(value_enum)]
    sensor: Which,
    /// Muscle of a joint whose pressure or gas is calibrated
    #[arg(long, value_enum, value_name = "a|b")]
    muscle: Option<OfJoint>,
    /// Absolute pressure that the board holds for the second point, such as 2.5bar or 250000 (Pa), in
    /// both muscles of a joint; the board must be armed
    #[arg(long, value_name = "PRESSURE", allow_hyphen_values = true, value_parser = core_quantity("Pa"))]
    hold: Option<f32>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Which {
    /// Absolute pressure, in Pa
    Pressure,
    /// Length, in m
    Length,
    /// Gas temperature, in K
    Gas,
    /// Angle of a joint, in rad
    Angle,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum OfJoint {
    A,
    B,
}

impl CalibrateArgs {
    /// The sensor of a board for one muscle.
    fn of_muscle(&self) -> Result<Sensor, Failure> {
        match (self.sensor, self.muscle) {
            (Which::Pressure, None) => Ok(Sensor::Pressure),
            (Which::Length, None) => Ok(Sensor::Length),
            (Which::Gas, None) => Ok(Sensor::Gas),
            (Which::Angle, _) | (_, Some(_)) => {
                let why = "the board drives one muscle: calibrate pressure, length or gas, without --muscle";
                Err(Failure::Usage(why.to_owned()))
            }
        }
    }

    /// The sensor of a joint's board.
    fn of_joint(&self) -> Result<JointSensor, Failure> {
        let side = self.muscle.map(|muscle| match muscle {
            OfJoint::A => Side::A,
            OfJoint::B => Side::B,
        });
        let why = match (self.sensor, side) {
            (Which::Pressure, Some(side)) => return Ok(JointSensor::Pressure(side)),
            (Which::Gas, Some(side)) => return Ok(JointSensor::Gas(side)),
            (Which::Angle, None) => return Ok(JointSensor::Angle),
            (Which::Angle, Some(_)) => "a joint has one angle: leave out --muscle",
            (Which::Length, _) => "a joint's lengths follow from its angle: calibrate angle",
            (_, None) => "a joint has two muscles: give --muscle a or --muscle b",
        };
        Err(Failure::Usage(why.to_owned()))
    }
}

/// Calibrates a muscle's board.
pub(super) fn run(
    board: &mut LiveBoard,
    args: &CalibrateArgs,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    ask(board, (args.of_muscle()?, args.hold), to)
}

/// Calibrates a joint's board.
pub(super) fn run_joint(
    board: &mut LiveJoint,
    args: &CalibrateArgs,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    ask(board, (args.of_joint()?, args.hold), to)
}

fn ask<B: Bench>(
    board: &mut B,
    (sensor, hold_pa): (B::Gauge, Option<f32>),
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    // The dialogue is not part of the result.
    let asks: &mut dyn Write = if to.format.json { to.err } else { to.out };
    interrupt::watch();
    let mut terminal = Terminal { board, lines: typed(), asks, failed: None };
    let calibrated = calibrate::calibrate(&mut terminal, sensor, hold_pa);
    if let Some(failure) = terminal.failed {
        return Err(failure);
    }
    let calibrated = calibrated?;
    let Calibrated { shifts, config_name, config_checksum, .. } = &calibrated;
    to.done(&serde_json::json!(calibrated),
        &format!(
            "put right by {} and {}; configuration {config_name} {config_checksum:08x}, not saved; it \
             vents and is not armed\n",
            sensor.text(shifts[0]),
            sensor.text(shifts[1]),
        ),
    )
}

impl From<CalibrateError> for Failure {
    fn from(error: CalibrateError) -> Self {
        match error {
            // `calibrate` has no `--arm`, which the message of other commands names.
            CalibrateError::Board(
                error @ BoardError::Refused(Refusal::SetPoint(SetPointError::NotArmed)),
            ) => Self::Usage(format!("{error}: `thermyo board PORT arm`")),
            CalibrateError::Board(error) => error.into(),
            unfinished @ CalibrateError::Unfinished(_) => Self::Usage(unfinished.to_string()),
        }
    }
}

/// A person who types, and reads the questions.
struct Terminal<'a, B> {
    board: &'a mut B,
    lines: Receiver<String>,
    asks: &'a mut dyn Write,
    /// Set once the output cannot be written.
    failed: Option<Failure>,
}

impl<B> Terminal<'_, B> {
    fn print(&mut self, text: &str) {
        if let Err(failure) = print(self.asks, text) {
            self.failed.get_or_insert(failure);
        }
    }
}

impl<B: Bench> Dialogue for Terminal<'_, B> {
    type Board = B;

    fn board<T: Send>(
        &mut self,
        using: impl FnOnce(&mut B, &dyn Fn() -> bool) -> Result<T, BoardError> + Send,
    ) -> Result<T, BoardError> {
        using(self.board, &interrupt::is_requested)
    }

    /// The next line that the user types; none at the end of the input.
    fn ask(&mut self, question: &str, refused: Option<&str>) -> Result<Option<String>, BoardError> {
        if let Some(why) = refused {
            self.say(why);
        }
        self.print(question);
        if self.failed.is_some() {
            return Ok(None);
        }
        let (mut typed, mut ended) = (None, false);
        calibrate::wait(self.board, &interrupt::is_requested, |_| match self.lines.try_recv() {
            Ok(line) => {
                typed = Some(line);
                true
            }
            Err(TryRecvError::Disconnected) => {
                ended = true;
                true
            }
            Err(TryRecvError::Empty) => false,
        })?;
        if ended {
            // Puts the message that follows on a line of its own.
            self.print("\n");
        }
        Ok(typed)
    }

    fn say(&mut self, text: &str) {
        self.print(&format!("{text}\n"));
    }
}

/// Lines that the user types, read while the board is kept alive.
fn typed() -> Receiver<String> {
    let (sender, receiver) = mpsc::channel();
    thread::spawn(move || {
        for line in io::stdin().lines().map_while(Result::ok) {
            if sender.send(line).is_err() {
                break;
            }
        }
    });
    receiver
}
