//! Records in addition to `trace.csv`.

pub mod mcap;
mod mcap_file;
pub mod stream;
pub mod topics;

use crate::mcap::McapLog;
use crate::stream::{Stream, StreamTo};
use crate::topics::{Layout, MUSCLE};
use std::path::Path;
use thermyo_files::input::InputError;
use thermyo_files::output::OutputDir;
use thermyo_record::board_trace::Recorder;
use thermyo_record::sinks::Sinks;

const MCAP: &str = "trace.mcap";

/// The user's choice of records.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Logs {
    /// `trace.mcap`.
    pub mcap: bool,
    /// Datagrams.
    pub stream: Option<StreamTo>,
}

impl Logs {
    /// Checks whether the address can be reached; for commands that record later.
    pub fn check(&self) -> Result<(), InputError> {
        self.open_stream(MUSCLE).map(drop)
    }

    /// Starts a record in this folder: a file with these columns of the layout, and the chosen records beside it.
    pub fn record(
        &self,
        out: &mut OutputDir,
        layout: Layout,
        columns: &[&str],
    ) -> Result<Recorder, InputError> {
        let file = out.file(layout.file)?;
        let beside = self.open(out, layout)?;
        let recorder = Recorder::with_columns(file, columns);
        Ok(recorder.map_err(|error| out.unwritable(layout.file, &error))?.beside(beside))
    }

    fn open(&self, out: &mut OutputDir, layout: Layout) -> Result<Sinks, InputError> {
        let mut sinks = Sinks::default();
        if let Some(stream) = self.open_stream(layout)? {
            sinks.add(stream);
        }
        if self.mcap {
            let file = out.file(MCAP)?;
            sinks.add(McapLog::new(file, layout).map_err(|error| out.unwritable(MCAP, &error))?);
        }
        Ok(sinks)
    }

    fn open_stream(&self, layout: Layout) -> Result<Option<Stream>, InputError> {
        let Some(to) = &self.stream else { return Ok(None) };
        let no_way = |error| InputError::output(Path::new(&to.to_string()), &error);
        Stream::open(to, layout).map(Some).map_err(no_way)
    }
}
