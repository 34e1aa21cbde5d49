//! `thermyo board PORT calibrate`: leads through two points and configures the board.

use super::{Failure, FormatArgs, core_quantity, interrupt, print};
use clap::{Args, ValueEnum};
use model_core::control::Mode;
use model_core::safety::supervisor::VENTING;
use model_core::{Config, Faults, SetPoint, Telemetry};
use std::io::{self, Write};
use std::sync::mpsc::{self, Receiver, TryRecvError};
use std::thread;
use thermyo_boards::live::LiveBoard;
use thermyo_files::units::Wanted;
use thermyo_protocol::ConfigSource;
use thermyo_simulation::board::BoardError;
use thermyo_studies::calibrate::{Guide, Implausible, Point, Sensor};

/// Steps that the muscle gets to settle at a held pressure.
const SETTLING_STEPS: u32 = 3000;

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
    let sensor = Sensor::from(args.sensor);
    let before = board.status()?;
    if before.config_source == ConfigSource::Defaults {
        return Err(BoardError::Refused(thermyo_protocol::Refusal::NotConfigured).into());
    }
    let config = board.config()?;
    interrupt::watch();
    let (calibrated, shifts) = two_points(board, sensor, config, args.hold, asks)?;
    board.stop()?;
    let status = board.configure(&calibrated, before.config_name.as_str())?;
    format.done(
        out,
        &serde_json::json!({
            "shifts": shifts,
            "unit": sensor.unit(),
            "config_name": status.config_name.as_str(),
            "config_checksum": status.config_checksum,
        }),
        &format!(
            "put right by {} and {}; configuration {} {:08x}, not saved; it vents and is not armed\n",
            sensor.text(shifts[0]),
            sensor.text(shifts[1]),
            status.config_name.as_str(),
            status.config_checksum,
        ),
    )
}

/// Asks for the readings of the reference until both points are known; returns the calibrated
/// configuration and the sensor's errors at the points.
fn two_points(
    board: &mut LiveBoard,
    sensor: Sensor,
    config: Config,
    hold: Option<f32>,
    asks: &mut dyn Write,
) -> Result<(Config, [f64; 2]), Failure> {
    let lines = typed();
    let mut hold = hold;
    let mut guide = Guide::new(sensor, config);
    let mut refused = None;
    loop {
        if let Some(calibrated) = guide.calibrated() {
            return Ok(calibrated);
        }
        let units = Wanted::new(sensor.unit()).names();
        print(asks, &format!("{} ({units}) ", guide.question()))?;
        let typed = line(board, &lines)?;
        let Some(typed) = typed else {
            let why = refused.unwrap_or_else(|| "the input has ended".to_owned());
            return Err(Failure::Usage(format!("not calibrated: {why}")));
        };
        let seen = match guide.answer(&typed) {
            Err(unread) => Err(unread.to_string()),
            Ok(()) => averaged(board, &mut guide)?.map_err(|why| why.to_string()),
        };
        match seen {
            Err(why) => {
                print(asks, &format!("{why}\n"))?;
                refused = Some(why);
            }
            Ok(None) => {}
            Ok(Some(Point { reading, .. })) => {
                print(asks, &format!("the sensor reads {}\n", sensor.text(reading)))?;
                if let Some(pressure_pa) = hold.take() {
                    let first = board.set(SetPoint::Pressure { pressure_pa })?;
                    print(asks, &format!("it holds {:.1} kPa\n", pressure_pa / 1e3))?;
                    wait(board, |telemetry| {
                        telemetry.step.saturating_sub(first) >= SETTLING_STEPS
                    })?;
                }
            }
        }
    }
}

/// The next line that the user types; none at the end of the input.
fn line(board: &mut LiveBoard, lines: &Receiver<String>) -> Result<Option<String>, Failure> {
    let mut typed = None;
    wait(board, |_| match lines.try_recv() {
        Ok(line) => {
            typed = Some(line);
            true
        }
        Err(TryRecvError::Disconnected) => true,
        Err(TryRecvError::Empty) => false,
    })?;
    Ok(typed)
}

/// The point that the guide averages, or why it is refused.
fn averaged(
    board: &mut LiveBoard,
    guide: &mut Guide,
) -> Result<Result<Option<Point>, Implausible>, Failure> {
    let mut seen = Ok(None);
    wait(board, |telemetry| {
        seen =
            guide.see(&telemetry.sample, matches!(telemetry.mode, Mode::Vent | Mode::StartupCheck));
        !matches!(seen, Ok(None))
    })?;
    Ok(seen)
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

/// Keeps the board alive until `done`, which gets the telemetry.
fn wait(board: &mut LiveBoard, mut done: impl FnMut(&Telemetry) -> bool) -> Result<(), Failure> {
    loop {
        if interrupt::is_requested() {
            return Err(BoardError::Interrupted.into());
        }
        let Some(telemetry) = board.poll()? else { continue };
        let faults = telemetry.faults.of(VENTING);
        if faults != Faults::NONE {
            return Err(BoardError::Vented(faults).into());
        }
        if done(&telemetry) {
            return Ok(());
        }
    }
}
