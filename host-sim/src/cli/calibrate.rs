//! `thermyo board PORT calibrate`: leads through two points and configures the board.

use super::{Failure, FormatArgs, core_quantity, interrupt, print};
use clap::{Args, ValueEnum};
use std::io::{self, Write};
use std::sync::mpsc::{self, Receiver, TryRecvError};
use std::thread;
use thermyo_boards::live::LiveBoard;
use thermyo_simulation::board::BoardError;
use thermyo_studies::calibrate::{self, CalibrateError, Calibrated, Dialogue, Sensor};

#[derive(Debug, Args)]
pub(super) struct CalibrateArgs {
    /// Sensor to calibrate
    #[arg(value_enum)]
    sensor: Which,
    /// Absolute pressure that the board holds for the second point, such as 2.5bar or 250000 (Pa);
    /// the board must be armed
    #[arg(long, value_name = "PRESSURE", allow_negative_numbers = true, value_parser = core_quantity("Pa"))]
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
}

impl From<Which> for Sensor {
    fn from(which: Which) -> Self {
        match which {
            Which::Pressure => Self::Pressure,
            Which::Length => Self::Length,
            Which::Gas => Self::Gas,
        }
    }
}

pub(super) fn run(
    board: &mut LiveBoard,
    args: &CalibrateArgs,
    format: FormatArgs,
    out: &mut dyn Write,
    err: &mut dyn Write,
) -> Result<(), Failure> {
    // The dialogue is not part of the result.
    let asks: &mut dyn Write = if format.json { err } else { &mut *out };
    interrupt::watch();
    let mut terminal = Terminal { board, lines: typed(), asks, failed: None };
    let calibrated = calibrate::calibrate(&mut terminal, args.sensor.into(), args.hold);
    if let Some(failure) = terminal.failed {
        return Err(failure);
    }
    let calibrated = calibrated?;
    let Calibrated { sensor, shifts, config_name, config_checksum, .. } = &calibrated;
    format.done(
        out,
        &serde_json::json!(calibrated),
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
            CalibrateError::Board(error) => error.into(),
            unfinished @ CalibrateError::Unfinished(_) => Self::Usage(unfinished.to_string()),
        }
    }
}

/// A person who types, and reads what is asked.
struct Terminal<'a> {
    board: &'a mut LiveBoard,
    lines: Receiver<String>,
    asks: &'a mut dyn Write,
    /// The output cannot be written.
    failed: Option<Failure>,
}

impl Terminal<'_> {
    fn print(&mut self, text: &str) {
        if let Err(failure) = print(self.asks, text) {
            self.failed.get_or_insert(failure);
        }
    }
}

impl Dialogue for Terminal<'_> {
    fn board<T: Send>(
        &mut self,
        using: impl FnOnce(&mut LiveBoard, &dyn Fn() -> bool) -> Result<T, BoardError> + Send,
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
            // The message that follows has a line of its own.
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
