//! The record of a measurement, from a board with a simulated muscle or a real one.

use super::REFERENCE_S;
use super::plan::Plan;
use crate::drive::{Ended, drive};
use model_core::safety::supervisor::VENTING;
use model_core::{Config, Telemetry};
use std::cell::Cell;
use std::io::{self, Write};
use thermyo_boards::live::LiveBoard;
use thermyo_boards::subject::Subject;
use thermyo_files::rows::Rows as Lines;
use thermyo_fit::stops::{Row, Rows, Stop};
use thermyo_protocol::Status;
use thermyo_record::board_trace::{every_column, more_cells, row};
use thermyo_record::trace;
use thermyo_simulation::board::{Board, BoardError};
use thermyo_simulation::run;
use thermyo_simulation::run::RunError;

/// Distance of the recorded rows \[s\].
const ROW_S: f64 = 0.01;
/// Columns after those of a board's trace.
const REFERENCE: [&str; 2] = ["reference_gas_k", "reference_sd_k"];

#[derive(Debug, Clone, PartialEq, Default)]
pub struct Record {
    pub rows: Rows,
    cells: Vec<Vec<f64>>,
}

impl Record {
    fn add(&mut self, row: &trace::Row, more: &[f64]) {
        let telemetry = &row.telemetry;
        let known = |value: f64| Some(value).filter(|value| !value.is_nan());
        let duties = [telemetry.command.inlet, telemetry.command.outlet];
        self.rows.rows.push(Row {
            time_s: row.truth.time_s,
            pressure_pa: f64::from(telemetry.pressure_pa),
            length_m: f64::from(telemetry.length_m),
            sensor_k: row.sensor_gas_k,
            estimate_k: Some(f64::from(telemetry.estimate.gas_k)),
            estimate_sd_k: Some(f64::from(telemetry.estimate.gas_sd_k)),
            wall_k: Some(f64::from(telemetry.estimate.wall_k)),
            mass_kg: Some(f64::from(telemetry.estimate.mass_kg)),
            truth_k: known(row.truth.gas_temperature_k),
            faults: telemetry.faults,
            gas_code: Some(f64::from(telemetry.sample.gas.to_bits())),
            shut: duties.iter().all(|duty| duty.share() == 0.0)
                && !telemetry.faults.intersects(VENTING),
        });
        self.cells.push(row.cells().iter().chain(more).copied().collect());
    }

    /// Writes `trace.csv`, with the measured temperature as a reference after each usable stop.
    pub fn write<W: Write>(&self, out: W, stops: &[Stop]) -> io::Result<()> {
        let header = [every_column(), REFERENCE.to_vec()].concat().join(",");
        let mut lines = Lines::new(out, &header)?;
        let mut references = vec![[f64::NAN; 2]; self.cells.len()];
        for stop in stops.iter().filter(|stop| stop.usable()) {
            for (at, gas_k) in stop.rows.clone().zip(&stop.curve_k) {
                if self.rows.rows[at].time_s <= stop.time_s + REFERENCE_S {
                    references[at] = [*gas_k, stop.gas_sd_k];
                }
            }
        }
        for (cells, reference) in self.cells.iter().zip(references) {
            lines.push(&trace::cells_text(cells.iter().copied().chain(reference)))?;
        }
        lines.finish().map(drop)
    }
}

/// A board on which stops are measured.
pub trait RowBench {
    /// Drives a plan, and records it. `each` gets the telemetry of every step, and returns whether
    /// to stop. After an error, `record` contains the rows until then.
    ///
    /// # Errors
    /// If the board is lost or vents by a fault; [`RunError::Stopped`] if `each` ended it.
    fn measure(
        &mut self,
        plan: &Plan,
        record: &mut Record,
        each: &mut dyn FnMut(&Telemetry) -> bool,
    ) -> Result<(), RunError>;
}

/// Steps between two rows.
fn every(plan: &Plan) -> u32 {
    (ROW_S / plan.driven.plant.run.step_s).round().max(1.0) as u32
}

/// A board that gets the samples of a simulated muscle.
pub struct SimulatedRows<'a>(pub &'a mut dyn Board);

impl RowBench for SimulatedRows<'_> {
    fn measure(
        &mut self,
        plan: &Plan,
        record: &mut Record,
        each: &mut dyn FnMut(&Telemetry) -> bool,
    ) -> Result<(), RunError> {
        let every = every(plan);
        let mut observer = |row: &trace::Row| {
            if row.telemetry.step.is_multiple_of(every) {
                record.add(row, &more_cells(None, &row.telemetry));
            }
            if each(&row.telemetry) { Err(io::ErrorKind::Interrupted.into()) } else { Ok(()) }
        };
        run::run(&plan.driven, self.0, None, &mut observer).map(drop)
    }
}

/// A board with a real muscle, which is armed and configured already.
pub struct LiveRows<'a> {
    pub board: &'a mut LiveBoard,
    pub config: Config,
}

impl RowBench for LiveRows<'_> {
    fn measure(
        &mut self,
        plan: &Plan,
        record: &mut Record,
        each: &mut dyn FnMut(&Telemetry) -> bool,
    ) -> Result<(), RunError> {
        let (every, step_s) = (every(plan), plan.driven.plant.run.step_s);
        let ends = Cell::new(false);
        let config = self.config;
        let mut show = |telemetry: &Telemetry, status: Option<&Status>| {
            if telemetry.step.is_multiple_of(every) {
                let time_s = f64::from(telemetry.step) * step_s;
                record.add(&row(time_s, &config, telemetry), &more_cells(status, telemetry));
            }
            ends.set(each(telemetry));
            Ok(())
        };
        match drive(self.board, &plan.driven, &|| ends.get(), &mut show)? {
            Ended::Whole => Ok(()),
            Ended::Stopped => Err(RunError::Stopped),
        }
    }
}

impl<'a> LiveRows<'a> {
    /// Arms the board up to the plan's highest pressure, if requested.
    pub fn arm(
        board: &'a mut LiveBoard,
        config: Config,
        plan: &Plan,
        arm: bool,
    ) -> Result<Self, BoardError> {
        if arm {
            board.arm(Some(plan.pressures_pa[1] as f32))?;
        }
        Ok(Self { board, config })
    }
}
