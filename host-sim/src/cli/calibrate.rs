//! `thermyo board PORT calibrate`: leads through the two points, and tells the board.

use super::{Failure, interrupt, print};
use crate::board::BoardError;
use crate::board::live::LiveBoard;
use crate::commands::calibrate::{Point, Sensor};
use clap::{Args, ValueEnum};
use model_core::link::ConfigSource;
use model_core::safety::supervisor::VENTING;
use model_core::{Faults, Sample, SetPoint};
use std::io::{self, Write};
use std::sync::mpsc::{self, Receiver, TryRecvError};
use std::thread;

/// Steps that the muscle is given to come to rest at a pressure that is held for a point.
const SETTLING_STEPS: u32 = 3000;
/// Readings that are averaged: a second.
const READINGS: usize = 100;

#[derive(Debug, Args)]
pub(super) struct CalibrateArgs {
    /// Which sensor
    #[arg(value_enum)]
    sensor: Which,
    /// The board holds this absolute pressure for the second point, in Pa; it has to be armed for it
    #[arg(long, value_name = "PA")]
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
    out: &mut dyn Write,
) -> Result<(), Failure> {
    let sensor = Sensor::from(args.sensor);
    let before = board.status()?;
    if before.config_source == ConfigSource::Defaults {
        return Err(BoardError::Refused(model_core::link::Refusal::NotConfigured).into());
    }
    let config = board.config()?;
    interrupt::watch();
    let lines = typed();
    let mut points = Vec::new();
    for (number, how) in [("first", "vented"), ("second", "at another value")] {
        if let (Some(pressure_pa), "second") = (args.hold, number) {
            let first = board.set(SetPoint::Pressure { pressure_pa })?;
            print(out, &format!("it holds {:.1} kPa\n", pressure_pa / 1e3))?;
            wait(board, |step, _| step.saturating_sub(first) >= SETTLING_STEPS)?;
        }
        let unit = sensor.unit();
        print(
            out,
            &format!(
                "{number} point, {how} and at rest: what does the reference read, in {unit}? "
            ),
        )?;
        let mut text = None;
        wait(board, |_, _| match lines.try_recv() {
            Ok(line) => {
                text = Some(line);
                true
            }
            Err(TryRecvError::Disconnected) => true,
            Err(TryRecvError::Empty) => false,
        })?;
        let reference = text.as_deref().map(str::trim).and_then(|text| text.parse::<f64>().ok());
        let Some(reference) = reference.filter(|value| value.is_finite()) else {
            let said = text.unwrap_or_default();
            let said = said.trim();
            return Err(Failure::Usage(format!(
                "{said:?}: must be what the reference reads, in {unit}"
            )));
        };
        let mut samples = Vec::new();
        wait(board, |_, sample| {
            samples.push(*sample);
            samples.len() >= READINGS
        })?;
        let reading = sensor.reading(&config, &samples).map_err(implausible)?;
        print(out, &format!("the sensor reads {reading:.4} {unit}\n"))?;
        points.push(Point { reading, reference });
    }
    board.stop()?;
    let [a, b] = [points[0], points[1]];
    let calibrated = sensor.calibrated(&config, [a, b]).map_err(implausible)?;
    let status = board.configure(&calibrated, before.config_name.as_str())?;
    print(
        out,
        &format!(
            "put right by {:+.4} and {:+.4} {unit}; configuration {} {:08x}, not saved; it vents and is not armed\n",
            a.reference - a.reading,
            b.reference - b.reading,
            status.config_name.as_str(),
            status.config_checksum,
            unit = sensor.unit(),
        ),
    )
}

fn implausible(why: crate::commands::calibrate::Implausible) -> Failure {
    Failure::Usage(format!("not calibrated: {why}"))
}

/// Lines that the user types, while the board is looked after.
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

/// Looks after the board until `done`, which sees the telemetry's step and sample.
fn wait(board: &mut LiveBoard, mut done: impl FnMut(u32, &Sample) -> bool) -> Result<(), Failure> {
    loop {
        if interrupt::wanted() {
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
