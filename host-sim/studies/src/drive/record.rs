//! The record of a board: its rows, and at its end summary and page, of one muscle or of a joint.

use serde::Serialize;
use std::io;
use thermyo_boards::subject::Subject;
use thermyo_files::input::InputError;
use thermyo_logs::topics::Layout;
use thermyo_protocol::{Status, Timing};
use thermyo_record::board_trace::Recorder;

pub type ConfigOf<R> = <<R as Record>::Board as Subject>::Config;
pub type TelemetryOf<R> = <<R as Record>::Board as Subject>::Telemetry;
pub type SetPointOf<R> = <<R as Record>::Board as Subject>::SetPoint;

/// Collects summary and page row by row.
pub trait Record: Sized + Send + 'static {
    type Board: Subject;
    type Row;
    /// Content of `summary.json`.
    type Driven: Serialize;

    const LAYOUT: Layout;
    /// Whether a page can identify parameters from the record, and compare it.
    const STUDIED: bool;

    /// Starts the record of a board that the user drives, from any step.
    ///
    /// # Errors
    /// For a configuration that no scenario can express.
    fn of_board(config: &ConfigOf<Self>) -> Result<Self, InputError>;

    /// Writes one row; an empty `status` leaves its columns empty.
    ///
    /// # Errors
    /// Error of the file, or of an output beside it.
    fn write(
        recorder: &mut Recorder,
        config: &ConfigOf<Self>,
        status: Option<&Status>,
        telemetry: &TelemetryOf<Self>,
    ) -> io::Result<Self::Row>;

    fn add(&mut self, row: &Self::Row);

    /// The rows so far.
    fn steps(&self) -> &Counted;

    /// Content of `scenario.toml`.
    fn scenario(&self) -> String;

    /// Sets the scenario's duration to the record's.
    fn cut(&mut self);

    /// Summary and page with this title; `stopped_of_s` is the planned time of a drive that was stopped early \[s\].
    fn finish(
        self,
        title: &str,
        of: (&str, &Status, &Timing),
        stopped_of_s: Option<f64>,
    ) -> (Self::Driven, String);
}

/// Rows of a record so far.
#[derive(Debug, Default)]
pub struct Counted {
    pub(super) rows: u64,
    /// Time of the last row \[s\].
    pub last_s: f64,
    pub lost: u64,
    /// Number of the next step if none is lost; none at the start of a record that may begin at any
    /// step.
    next: Option<u32>,
}

impl Counted {
    /// Starts a run at step 0.
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
