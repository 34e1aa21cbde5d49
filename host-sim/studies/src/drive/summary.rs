//! `summary.json` of a run on a board: readings and estimates, without a plant's true values.

use serde::Serialize;
use std::collections::BTreeMap;
use thermyo_plant::{Ledger, chamber};
use thermyo_protocol::{Status, Timing};
use thermyo_record::measured::Measured;
use thermyo_record::summary::{
    Accumulator, CoreFigures, Difference, Ending, Range, Readings, TimingFigures,
};
use thermyo_record::trace::Row;
use thermyo_record::tracking::{Control, Reference};
use thermyo_scenario::DriveKind;
use thermyo_setup::Loaded;
use thermyo_simulation::run::SetPoints;

/// Content of `summary.json` of a run on a board.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Driven {
    pub duration_s: f64,
    /// Planned time, where the run was stopped early \[s\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stopped_of_s: Option<f64>,
    /// Working strokes; 0 where the drive has no period.
    pub strokes: u64,
    pub board: String,
    pub config_name: String,
    pub config_checksum: u32,
    /// Measured absolute pressure \[Pa\].
    pub pressure_pa: Range,
    /// Measured contraction, as a fraction of the rest length \[-\]; of a muscle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contraction: Option<Range>,
    pub sensor_gas_k: Readings,
    pub estimate_k: Range,
    pub core: CoreFigures,
    /// Steps whose telemetry did not arrive.
    pub lost_steps: u64,
    /// How the steps were timed, since the board started.
    pub timing: TimingFigures,
    /// Tracking of the set point, where one was driven.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub control: Option<Control>,
    /// Root-mean-square and largest difference to measured columns, where the scenario has some.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub measured: Option<BTreeMap<String, Difference>>,
}

impl Driven {
    /// Driven time: "4.00 s", or "2.46 s of 4 s".
    pub fn driven(&self) -> String {
        driven(self.duration_s, self.stopped_of_s)
    }
}

/// Driven time, of a planned one where it was stopped early.
pub(super) fn driven(duration_s: f64, stopped_of_s: Option<f64>) -> String {
    let of = stopped_of_s.map_or_else(String::new, |of_s| format!(" of {of_s} s"));
    format!("{duration_s:.2} s{of}")
}

#[derive(Debug, Default)]
pub(super) struct Counted {
    rows: u64,
    /// Time of the last one \[s\].
    pub(super) last_s: f64,
    pub(super) lost: u64,
    /// Number of the next step if none is lost; none at the start of a record that may begin at any
    /// step.
    next: Option<u32>,
}

impl Counted {
    /// Of a run, which begins at step 0.
    pub(super) fn from_start() -> Self {
        Self { next: Some(0), ..Self::default() }
    }

    pub(super) fn add(&mut self, step: u32, time_s: f64) {
        // A board that restarts counts from 0 again.
        let lost = self.next.and_then(|next| step.checked_sub(next));
        self.lost += u64::from(lost.unwrap_or_default());
        self.next = Some(step.wrapping_add(1));
        self.last_s = time_s;
        self.rows += 1;
    }
}

/// Collects the summary step by step.
pub struct Gathered {
    accumulator: Accumulator,
    set_points: SetPoints,
    scenario: Loaded,
    /// Of a muscle or cylinder \[m\].
    rest_length_m: Option<f64>,
    estimate: Range,
    steps: Counted,
}

impl Gathered {
    /// For a run, which begins at step 0.
    pub fn new(driven: &Loaded, measured: Option<&Measured>) -> Self {
        Self {
            accumulator: Accumulator::new(
                driven.plant.run.duration_s,
                Reference::of(&driven.plant),
                measured,
            ),
            set_points: SetPoints::new(driven),
            scenario: driven.clone(),
            rest_length_m: chamber::of(&driven.believed).map(|chamber| chamber.rest_length()),
            estimate: Range { min: f64::INFINITY, max: f64::NEG_INFINITY, mean: 0.0 },
            steps: Counted::from_start(),
        }
    }

    /// For a record that may begin at any step.
    pub fn of_record(driven: &Loaded) -> Self {
        Self { steps: Counted::default(), ..Self::new(driven, None) }
    }

    pub fn add(&mut self, row: &Row) {
        let estimate_k = f64::from(row.telemetry.estimate.gas_k);
        self.steps.add(row.telemetry.step, row.truth.time_s);
        let Range { min, max, mean } = self.estimate;
        self.estimate = Range {
            min: min.min(estimate_k),
            max: max.max(estimate_k),
            mean: mean + (estimate_k - mean) / self.steps.rows as f64,
        };
        self.accumulator.add(row, self.set_points.controlled(self.rest_length_m, row));
    }

    pub fn finish(self, port: &str, status: &Status, timing: &Timing) -> Driven {
        let scenario = &self.scenario.plant;
        let cycle = scenario.drive.kind == DriveKind::MassFlow && !self.set_points.moves();
        let summary = self.accumulator.finish(Ending {
            limit_cycle: None,
            controlled: self.set_points.quantity(),
            wall_clock_s: f64::INFINITY,
            board: "live",
            period_s: cycle.then_some(scenario.drive.period_s),
            rest_length_m: self.rest_length_m,
            ledger: Ledger::default(),
            axial_wall_k: Vec::new(),
            axial_gas_k: Vec::new(),
            timing: None,
        });
        Driven {
            duration_s: self.steps.last_s,
            stopped_of_s: None,
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
        }
    }
}
