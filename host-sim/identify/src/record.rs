//! Identification from any kind of table: a record over time, with stops or of motion, or a static map.

use super::data::{Data, begins_anywhere};
use super::motion;
use super::static_map::{self, Readings};
use super::valves;
use super::{Identified, IdentifyError, identify, page};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;
use thermyo_compute::parallel::Watch;
use thermyo_files::input::{InputError, Problem};
use thermyo_files::table::Table;
use thermyo_fit::Fitted;
use thermyo_fit::stops::{LENGTHS, PRESSURES};
use thermyo_record::board_trace::every_column;
use thermyo_record::measured::{Measured, check_possible, check_pressures, ordered};
use thermyo_scenario::PlantKind;
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;

fn named<K: AsRef<str>>(parameters: &BTreeMap<K, Fitted>) -> Vec<(&str, &Fitted)> {
    parameters.iter().map(|(path, fitted)| (path.as_ref(), fitted)).collect()
}

#[derive(Debug)]
pub enum Found {
    Record(Identified),
    Map(static_map::Identified),
    Stops(thermyo_fit::stops::Identified),
    Motion(motion::Identified),
}

/// Columns that a record may have in addition to those of a trace: a reference sensor, its deviation.
const REFERENCE: [&str; 2] = ["reference_gas_k", "reference_sd_k"];

/// Every column that some kind of table has.
pub fn known_columns() -> Vec<&'static str> {
    let map = static_map::COLUMNS.iter().chain([&static_map::DIRECTION]);
    every_column().into_iter().chain(REFERENCE).chain(map.copied()).collect()
}

/// Identifies from a table; `against` is a table of the same kind that the fit does not use. `config`
/// and `data` name the files in messages.
///
/// # Errors
/// As [`identify`] and [`static_map::identify`], and if a record with stops is to be compared.
pub fn identify_table(
    loaded: &Loaded,
    config: &Path,
    table: &Table,
    data: &Path,
    against: Option<&Table>,
    watch: &dyn Watch,
) -> Result<Found, IdentifyError> {
    refuse_joint(table)?;
    if Readings::are_in(table) {
        let readings = Readings::of(table)?;
        let against = against.map(|other| readings.to_compare(other)).transpose()?;
        let found = static_map::identify(loaded, readings, against.as_ref(), config, data)?;
        return whole(Found::Map(found), watch);
    }
    if motion::is_asked_for(loaded) {
        let found = motion::identify(loaded, config, table, against, watch)?;
        return whole(Found::Motion(found), watch);
    }
    check(loaded, table)?;
    if thermyo_fit::stops::are_asked_for(loaded, table) {
        if against.is_some() {
            return Err(InputError::file(data, Problem::StopsAlone).into());
        }
        check_possible(table, true)?;
        return whole(Found::Stops(thermyo_fit::stops::identify(loaded, table, data)?), watch);
    }
    // A record that cannot be compared is refused before the search, which takes minutes.
    let against = against.map(|other| to_compare(loaded, table, other)).transpose()?;
    let mut found = identify(loaded, config, &measured(loaded, table)?, data, watch)?;
    if let Some(other) = &against {
        found.compare(other, watch);
    }
    Ok(Found::Record(found))
}

fn refuse_joint(table: &Table) -> Result<(), InputError> {
    let why =
        "is the record of a joint, and the scenario is of one muscle: must be that of the joint";
    match table.column("angle_rad") {
        Ok(_) => Err(table.header_error(Problem::Unusable(why.to_owned()))),
        Err(_) => Ok(()),
    }
}

/// Refuses a record over time that cannot be of the scenario's plant.
fn check(loaded: &Loaded, table: &Table) -> Result<(), InputError> {
    ordered(table)?;
    let config_of_core = core_config(&loaded.believed);
    valves::check(table, &config_of_core)?;
    if loaded.plant.plant.kind != PlantKind::Vessel {
        let ambient_pa = loaded.plant.ambient.pressure_pa;
        PRESSURES.iter().try_for_each(|column| check_pressures(table, column, ambient_pa))?;
    }
    if loaded.plant.plant.kind == PlantKind::Muscle {
        let rest_m = loaded.plant.muscle.rest_length_m;
        LENGTHS.iter().try_for_each(|column| motion::check_lengths(table, column, rest_m))?;
    }
    if begins_anywhere(&loaded.plant, table) || thermyo_fit::stops::would_do(loaded) {
        motion::check_pace(table, &loaded.plant)?;
        valves::check_pace(table, &config_of_core)?;
    }
    Ok(())
}

fn measured(loaded: &Loaded, table: &Table) -> Result<Measured, InputError> {
    let known = [every_column(), REFERENCE.to_vec()].concat();
    if begins_anywhere(&loaded.plant, table) {
        Measured::since_first(table, &known)
    } else {
        Measured::new(table, &known)
    }
}

/// The data of a record to compare with what is fitted to `table`.
fn to_compare(loaded: &Loaded, table: &Table, other: &Table) -> Result<Data, InputError> {
    if begins_anywhere(&loaded.plant, table) != begins_anywhere(&loaded.plant, other) {
        let why = "only one of the two records has pressure_pa and length_m, which then drive the plant: \
                   must be both or none";
        return Err(other.header_error(Problem::Unusable(why.to_owned())));
    }
    check(loaded, other)?;
    let data = Data::new(&measured(loaded, other)?, other.file(), &loaded.plant)?;
    Ok(data.with_volume(loaded))
}

/// The result of a search in one part, unless it was stopped.
fn whole(found: Found, watch: &dyn Watch) -> Result<Found, IdentifyError> {
    if watch.stopped() {
        return Err(IdentifyError::Stopped { finished: 0, starts: 1, csv: String::new() });
    }
    Ok(found)
}

impl Found {
    /// The values found, by their keys.
    pub fn values(&self) -> Vec<(&str, &Fitted)> {
        match self {
            Self::Record(found) => named(&found.findings.parameters),
            Self::Map(found) => named(&found.findings.parameters),
            Self::Stops(found) => named(&found.findings.parameters),
            Self::Motion(found) => named(&found.findings.parameters),
        }
    }

    /// Remarks on what the data leave open.
    pub fn remarks(&self) -> &[String] {
        match self {
            Self::Record(found) => &found.findings.remarks,
            Self::Map(found) => &found.findings.remarks,
            Self::Stops(found) => &found.findings.remarks,
            Self::Motion(found) => &found.findings.remarks,
        }
    }

    /// Content of `summary.json`.
    pub fn findings(&self) -> impl Serialize {
        #[derive(Serialize)]
        #[serde(untagged)]
        enum Either<'a> {
            Record(&'a super::Findings),
            Map(&'a static_map::Findings),
            Stops(&'a thermyo_fit::stops::Findings),
            Motion(&'a motion::Findings),
        }
        match self {
            Self::Record(found) => Either::Record(&found.findings),
            Self::Map(found) => Either::Map(&found.findings),
            Self::Stops(found) => Either::Stops(&found.findings),
            Self::Motion(found) => Either::Motion(&found.findings),
        }
    }

    pub fn scenario(&self) -> &Loaded {
        match self {
            Self::Record(found) => &found.scenario,
            Self::Map(found) => &found.scenario,
            Self::Stops(found) => &found.scenario,
            Self::Motion(found) => &found.scenario,
        }
    }

    /// Content of `report.html`.
    pub fn page(&self, title: &str) -> String {
        match self {
            Self::Record(found) => page(found, title),
            Self::Map(found) => static_map::page(found, title),
            Self::Stops(found) => found.page(title),
            Self::Motion(found) => motion::page(found, title),
        }
    }

    /// A drawing for documents: file name and text.
    pub fn plot(&self, title: &str) -> (&'static str, String) {
        match self {
            Self::Record(found) => ("fit.svg", page::plot(found, title)),
            Self::Map(found) => ("map.svg", static_map::plot(found, title)),
            Self::Stops(found) => ("stops.svg", found.plot(title)),
            Self::Motion(found) => ("motion.svg", motion::plot(found, title)),
        }
    }

    /// Figures as lines for a terminal.
    pub fn text(&self) -> String {
        match self {
            Self::Record(found) => found.findings.text(),
            Self::Map(found) => found.findings.text(),
            Self::Stops(found) => found.findings.text(),
            Self::Motion(found) => found.findings.text(),
        }
    }

    /// Reason why the values are not reliable, if there is one.
    pub fn failed(&self) -> Option<String> {
        match self {
            Self::Record(found) => found.findings.failed(),
            Self::Map(found) => found.findings.failed(),
            Self::Stops(found) => found.findings.failed(),
            Self::Motion(found) => found.findings.failed(),
        }
    }
}
