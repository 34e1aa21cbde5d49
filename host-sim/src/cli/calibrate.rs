//! `thermyo board PORT calibrate`: leads through two points and configures the board.

use super::{Failure, FormatArgs, interrupt, number, print};
use clap::{Args, ValueEnum};
use model_core::safety::supervisor::VENTING;
use model_core::{Config, Faults, Sample, SetPoint};
use std::io::{self, Write};
use std::sync::mpsc::{self, Receiver, TryRecvError};
use std::thread;
use thermyo_boards::live::LiveBoard;
use thermyo_protocol::ConfigSource;
use thermyo_simulation::board::BoardError;
use thermyo_studies::calibrate::{Guide, Point, Sensor};

/// Steps that the muscle gets to settle at a held pressure.
const SETTLING_STEPS: u32 = 3000;

#[derive(Debug, Args)]
pub(super) struct CalibrateArgs {
    /// Sensor to calibrate
    #[arg(value_enum)]
    sensor: Which,
    /// Absolute pressure that the board holds for the second point, in Pa; the board must be armed
    #[arg(long, value_name = "PA", allow_negative_numbers = true, value_parser = number)]
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
            "put right by {:+.4} and {:+.4} {}; configuration {} {:08x}, not saved; it vents and is not armed\n",
            shifts[0],
            shifts[1],
            sensor.unit(),
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
    let mut held = false;
    let mut guide = Guide::new(sensor, config);
    loop {
        if let Some(calibrated) = guide.calibrated().map_err(implausible)? {
            return Ok(calibrated);
        }
        print(asks, &format!("{} ", guide.question()))?;
        let mut typed = None;
        wait(board, |_, _| match lines.try_recv() {
            Ok(line) => {
                typed = Some(line);
                true
            }
            Err(TryRecvError::Disconnected) => true,
            Err(TryRecvError::Empty) => false,
        })?;
        let typed = typed.unwrap_or_default();
        guide.answer(&typed).map_err(|error| Failure::Usage(error.to_string()))?;
        let mut seen = Ok(None);
        wait(board, |_, sample| {
            seen = guide.see(sample);
            !matches!(seen, Ok(None))
        })?;
        if let Some(Point { reading, .. }) = seen.map_err(implausible)? {
            print(asks, &format!("the sensor reads {reading:.4} {}\n", sensor.unit()))?;
        }
        if let Some(pressure_pa) = hold.filter(|_| !std::mem::replace(&mut held, true)) {
            let first = board.set(SetPoint::Pressure { pressure_pa })?;
            print(asks, &format!("it holds {:.1} kPa\n", pressure_pa / 1e3))?;
            wait(board, |step, _| step.saturating_sub(first) >= SETTLING_STEPS)?;
        }
    }
}

fn implausible(why: thermyo_studies::calibrate::Implausible) -> Failure {
    Failure::Usage(format!("not calibrated: {why}"))
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

/// Keeps the board alive until `done`, which gets the telemetry's step and sample.
fn wait(board: &mut LiveBoard, mut done: impl FnMut(u32, &Sample) -> bool) -> Result<(), Failure> {
    loop {
        if interrupt::is_requested() {
            return Err(BoardError::Interrupted.into());
        }
        let Some(telemetry) = board.poll()? else { continue };
        let faults = telemetry.faults.of(VENTING);
        if faults != Faults::NONE {
            return Err(BoardError::Vented(faults).into());
        }
        if done(telemetry.step, &telemetry.sample) {
            return Ok(());
        }
    }
}
