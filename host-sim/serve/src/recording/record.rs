//! Files of a record that the kind of board decides.

use std::io;
use thermyo_boards::subject::Subject;
use thermyo_files::input::InputError;
use thermyo_logs::topics::Layout;
use thermyo_protocol::{Status, Timing};
use thermyo_record::board_trace::Recorder;

/// The files of a record, beside the recorder of its rows.
pub trait Record: Sized + Send + 'static {
    type Board: Subject;

    /// Name of the file of rows.
    const TRACE: &'static str;
    /// Columns of the record.
    const LAYOUT: Layout;
    /// Whether the page can identify from it, and compare it.
    const STUDIED: bool;

    fn new(config: &<Self::Board as Subject>::Config) -> Result<Self, InputError>;

    fn scenario(&self) -> String;

    fn write(
        &mut self,
        recorder: &mut Recorder,
        status: Option<&Status>,
        telemetry: &<Self::Board as Subject>::Telemetry,
    ) -> io::Result<()>;

    /// The end of a record of that name at a port.
    fn finish(self, of: (&str, &str), status: &Status, timing: &Timing) -> Finished;
}

/// Texts and figures of a whole record.
pub struct Finished {
    pub duration_s: f64,
    pub lost_steps: u64,
    /// `scenario.toml`, `summary.json` and `report.html`.
    pub scenario: String,
    pub summary: String,
    pub report: String,
}
