//! Whatever the table of data is: a record over time, or a static map.

use super::static_map::{self, Readings};
use super::{Identified, IdentifyError, identify, page};
use serde::Serialize;
use std::path::Path;
use thermyo_compute::parallel::Watch;
use thermyo_compute::stop;
use thermyo_files::input::{InputError, Problem};
use thermyo_files::table::Table;
use thermyo_record::board_trace::every_column;
use thermyo_record::measured::Measured;
use thermyo_setup::Loaded;

/// What either kind gives.
#[derive(Debug)]
pub enum Found {
    /// From a record.
    Record(Identified),
    /// From a static map.
    Map(static_map::Identified),
}

/// Identifies from a table, `against` a static map that the fit has not seen; `config` and `data` are what
/// messages call the files.
///
/// # Errors
/// As [`identify`] and [`static_map::identify`], and where a record is to be compared with a map.
pub fn identify_table(
    loaded: &Loaded,
    config: &Path,
    table: &Table,
    data: &Path,
    against: Option<&Table>,
    watch: &dyn Watch,
) -> Result<Found, IdentifyError> {
    if Readings::are_in(table) {
        let readings = Readings::of(table)?;
        let against = against.map(|other| readings.to_compare(other)).transpose()?;
        let found = static_map::identify(loaded, readings, against.as_ref(), config, data)?;
        if stop::is_requested() {
            // Its searches are one piece of work, done within a second.
            return Err(IdentifyError::Stopped { finished: 0, starts: 1, csv: String::new() });
        }
        return Ok(Found::Map(found));
    }
    if against.is_some() {
        return Err(InputError::file(data, Problem::NoMap).into());
    }
    let measured = Measured::new(table, &every_column())?;
    identify(loaded, config, &measured, data, watch).map(Found::Record)
}

impl Found {
    /// `summary.json`.
    pub fn findings(&self) -> impl Serialize {
        #[derive(Serialize)]
        #[serde(untagged)]
        enum Either<'a> {
            Record(&'a super::Findings),
            Map(&'a static_map::Findings),
        }
        match self {
            Self::Record(found) => Either::Record(&found.findings),
            Self::Map(found) => Either::Map(&found.findings),
        }
    }

    /// The scenario with what was found.
    pub fn scenario(&self) -> &Loaded {
        match self {
            Self::Record(found) => &found.scenario,
            Self::Map(found) => &found.scenario,
        }
    }

    /// `report.html`.
    pub fn page(&self, title: &str) -> String {
        match self {
            Self::Record(found) => page(found, title),
            Self::Map(found) => static_map::page(found, title),
        }
    }

    /// A drawing for documents: its file's name, and its text.
    pub fn plot(&self, title: &str) -> (&'static str, String) {
        match self {
            Self::Record(found) => ("fit.svg", page::plot(found, title)),
            Self::Map(found) => ("map.svg", static_map::plot(found, title)),
        }
    }

    /// The figures, as lines for a terminal.
    pub fn text(&self) -> String {
        match self {
            Self::Record(found) => found.findings.text(),
            Self::Map(found) => found.findings.text(),
        }
    }

    /// Why the values are not to be relied on, if they are not.
    pub fn failed(&self) -> Option<String> {
        match self {
            Self::Record(found) => found.findings.failed(),
            Self::Map(found) => found.findings.failed(),
        }
    }
}
