//! `summary.json` of a run on a board: readings and estimates, without a plant's true values.

use serde::Serialize;
use std::collections::BTreeMap;
use thermyo_boards::port;
use thermyo_record::summary::{CoreFigures, Difference, Range, Readings, TimingFigures};
use thermyo_record::tracking::Control;

/// Content of `summary.json` of a run on a board.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Driven {
    pub duration_s: f64,
    /// Planned time, if the run was stopped early \[s\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stopped_of_s: Option<f64>,
    /// Working strokes; 0 if the drive has no period.
    pub strokes: u64,
    pub board: String,
    pub config_name: String,
    pub config_checksum: u32,
    /// Measured absolute pressure \[Pa\].
    pub pressure_pa: Range,
    /// Measured contraction of a muscle, as a fraction of the rest length \[-\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contraction: Option<Range>,
    pub sensor_gas_k: Readings,
    pub estimate_k: Range,
    pub core: CoreFigures,
    /// Steps whose telemetry did not arrive.
    pub lost_steps: u64,
    /// Timing of the steps since the board started.
    pub timing: TimingFigures,
    /// Tracking of the set point, if one was driven.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub control: Option<Control>,
    /// Root-mean-square and largest difference to measured columns, if the scenario has some.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub measured: Option<BTreeMap<String, Difference>>,
}

/// The board at a port, for a sentence.
pub(super) fn board_at(name: &str) -> String {
    if name == port::EMULATED {
        "the emulated board".to_owned()
    } else {
        format!("the board at {name}")
    }
}

/// Driven time, "4.00 s", or "2.46 s of 4 s" if it was stopped early.
pub fn driven(duration_s: f64, stopped_of_s: Option<f64>) -> String {
    let of = stopped_of_s.map_or_else(String::new, |of_s| format!(" of {of_s} s"));
    format!("{duration_s:.2} s{of}")
}
