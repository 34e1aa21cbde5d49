//! The record of one muscle, or of a vessel.

use super::page::{Drawn, page};
use super::record::{Counted, Record};
use super::summary::Driven;
use model_core::{Config, Telemetry};
use std::io;
use thermyo_boards::live::LiveBoard;
use thermyo_files::input::InputError;
use thermyo_logs::topics::{self, Layout};
use thermyo_plant::{Ledger, chamber};
use thermyo_protocol::{Status, Timing};
use thermyo_record::board_trace::Recorder;
use thermyo_record::measured::Measured;
use thermyo_record::summary::{Accumulator, Ending, Range, TimingFigures};
use thermyo_record::trace::Row;
use thermyo_record::tracking::Tracked;
use thermyo_scenario::DriveKind;
use thermyo_setup::{Loaded, from_config};
use thermyo_simulation::run::SetPoints;

/// Collects summary and page step by step.
pub struct Gathered {
    accumulator: Accumulator,
    set_points: SetPoints,
    driven: Loaded,
    /// Rest length of a muscle or cylinder \[m\].
    rest_length_m: Option<f64>,
    estimate: Range,
    steps: Counted,
    drawn: Drawn,
}

impl Gathered {
    /// Starts a run at step 0.
    pub fn new(driven: Loaded, measured: Option<&Measured>) -> Self {
        Self {
            accumulator: Accumulator::new(
                driven.plant.run.duration_s,
                Tracked::of(&driven.plant),
                measured,
            ),
            set_points: SetPoints::new(&driven),
            rest_length_m: chamber::of(&driven.believed).map(|chamber| chamber.rest_length()),
            estimate: Range { min: f64::INFINITY, max: f64::NEG_INFINITY, mean: 0.0 },
            steps: Counted::from_start(),
            drawn: Drawn::default(),
            driven,
        }
    }
}

impl Record for Gathered {
    type Board = LiveBoard;
    type Row = Row;
    type Driven = Driven;

    const LAYOUT: Layout = topics::MUSCLE;
    const STUDIED: bool = true;

    fn of_board(config: &Config) -> Result<Self, InputError> {
        let configured = from_config::to_scenario(config)?.scenario;
        let driven = configured.with(|scenario| scenario.drive.kind = DriveKind::Closed);
        Ok(Self { steps: Counted::default(), ..Self::new(driven, None) })
    }

    fn write(
        recorder: &mut Recorder,
        config: &Config,
        status: Option<&Status>,
        telemetry: &Telemetry,
    ) -> io::Result<Row> {
        recorder.write(config, status, telemetry)
    }

    fn add(&mut self, row: &Row) {
        let estimate_k = f64::from(row.telemetry.estimate.gas_k);
        self.steps.add(row.telemetry.step, row.truth.time_s);
        let Range { min, max, mean } = self.estimate;
        self.estimate = Range {
            min: min.min(estimate_k),
            max: max.max(estimate_k),
            mean: mean + (estimate_k - mean) / self.steps.rows as f64,
        };
        self.accumulator.add(row, self.set_points.controlled(self.rest_length_m, row));
        self.drawn.add(row);
    }

    fn steps(&self) -> &Counted {
        &self.steps
    }

    fn scenario(&self) -> String {
        thermyo_setup::render(&self.driven)
    }

    fn cut(&mut self) {
        let Loaded { plant, believed, .. } = &mut self.driven;
        plant.run.duration_s = self.steps.last_s.max(plant.run.step_s);
        believed.run = plant.run.clone();
    }

    fn finish(
        self,
        title: &str,
        (port, status, timing): (&str, &Status, &Timing),
        stopped_of_s: Option<f64>,
    ) -> (Driven, String) {
        let drive = &self.driven.plant.drive;
        let cycle = drive.kind == DriveKind::MassFlow && !self.set_points.moves();
        let summary = self.accumulator.finish(Ending {
            limit_cycle: None,
            controlled: self.set_points.quantity(),
            wall_clock_s: f64::INFINITY,
            board: "live",
            period_s: cycle.then_some(drive.period_s),
            rest_length_m: self.rest_length_m,
            ledger: Ledger::default(),
            axial_wall_k: Vec::new(),
            axial_gas_k: Vec::new(),
            timing: None,
        });
        let summary = Driven {
            duration_s: self.steps.last_s,
            stopped_of_s,
            strokes: summary.strokes,
            board: port.to_owned(),
            config_name: status.config_name.as_str().to_owned(),
            config_checksum: status.config_checksum,
            pressure_pa: summary.pressure_pa,
            contraction: summary.contraction,
            sensor_gas_k: summary.sensor_gas_k,
            estimate_k: self.estimate,
            core: summary.core,
            lost_steps: self.steps.lost,
            timing: TimingFigures::from(timing),
            control: summary.control,
            measured: summary.measured,
        };
        let page = page(title, &self.driven, &self.drawn, &summary);
        (summary, page)
    }
}
