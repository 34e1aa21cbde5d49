//! What is recorded besides `trace.csv`.

pub mod mcap;
pub mod stream;
pub mod topics;

use crate::mcap::McapLog;
use crate::stream::{Stream, StreamTo};
use std::path::Path;
use thermyo_files::input::InputError;
use thermyo_files::output::OutputDir;
use thermyo_record::sinks::Sinks;

const MCAP: &str = "trace.mcap";

/// The user's wishes.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Logs {
    /// `trace.mcap`.
    pub mcap: bool,
    /// Datagrams.
    pub stream: Option<StreamTo>,
}

impl Logs {
    /// Whether there is a way to the address; for those who record later.
    ///
    /// # Errors
    /// Where there is none.
    pub fn check(&self) -> Result<(), InputError> {
        self.open_stream().map(drop)
    }

    /// Begins them, beside a trace in that folder.
    ///
    /// # Errors
    /// When a file cannot be made, or there is no way to the address.
    pub fn open(&self, out: &mut OutputDir) -> Result<Sinks, InputError> {
        let mut sinks = Sinks::default();
        if let Some(stream) = self.open_stream()? {
            sinks.add(stream);
        }
        if self.mcap {
            let file = out.file(MCAP)?;
            sinks.add(McapLog::new(file).map_err(|error| out.unwritable(MCAP, &error))?);
        }
        Ok(sinks)
    }

    fn open_stream(&self) -> Result<Option<Stream>, InputError> {
        let Some(to) = &self.stream else { return Ok(None) };
        let no_way = |error| InputError::output(Path::new(&to.to_string()), &error);
        Stream::open(to).map(Some).map_err(no_way)
    }
}
