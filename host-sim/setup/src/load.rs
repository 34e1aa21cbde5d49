//! From a scenario file to the data of a run.

use super::loaded::Loaded;
use super::presets::{dimensions_of, preset, with_values};
use super::rules;
use super::warnings::warnings;
use std::path::{Path, PathBuf};
use thermyo_compute::math;
use thermyo_files::input::{InputError, Problem, read_text};
use thermyo_files::table::{Table as CsvTable, read_table};
use thermyo_plant::chamber;
use thermyo_plant::chamber::table;
use thermyo_plant::heat::inlet_diameter_m;
use thermyo_scenario::document::{Document, Entries, Entry};
use thermyo_scenario::fault_rules;
use thermyo_scenario::geometry::{Dimensions, Given};
use thermyo_scenario::profile::Profile;
use thermyo_scenario::schema::{Allowed, Limits, limits};
use thermyo_scenario::violation::{Fault, Violation, WrongCell};
use thermyo_scenario::{DriveKind, HeatModel, PlantKind, Scenario};
use toml::Value;

/// Share of a cylinder's friction that follows its pressure, if the file does not give it: an O-ring of
/// 25.7 mm has 4.7 N at 1 bar and 7.9 N at 7 bar (`docs/background/validation.md`).
const SEAL_FACTOR: f64 = 0.34;
/// Share of the force that the supply gives at rest length, up to which the observed load and the integral may go if
/// the file does not give their limit and this is more than the default. It is the nominal muscle's share: friction,
/// creep and loads of a muscle of 40 mm have errors of four times as many newtons.
const LOAD_SHARE: f64 = 0.15;
/// Fraction of the length sensor's range that the longest length takes if the file does not give
/// the range.
const LENGTH_USE: f64 = 0.8;

/// Loads a scenario file. Paths of its CSV files are relative to its folder.
///
/// # Errors
/// In one line: file, line, key, the value and the allowed ones.
pub fn load(path: &Path) -> Result<Loaded, InputError> {
    parse(&read_text(path)?, path)
}

/// Loads a scenario file with its [`warnings`].
pub fn load_with_warnings(path: &Path) -> Result<(Loaded, Vec<InputError>), InputError> {
    parse_with_warnings(&read_text(path)?, path)
}

/// As [`parse`], with the [`warnings`].
pub fn parse_with_warnings(
    text: &str,
    origin: &Path,
) -> Result<(Loaded, Vec<InputError>), InputError> {
    let document = Document::parse(text, origin)?;
    let loaded = assemble(&document)?;
    let found = warnings(&document, &loaded);
    Ok((loaded, found))
}

/// Loads a scenario from its text. `origin` is its name in messages; CSV paths are relative to its
/// folder.
pub fn parse(text: &str, origin: &Path) -> Result<Loaded, InputError> {
    assemble(&Document::parse(text, origin)?)
}

/// As [`parse`], for a text whose sender may not read this machine's files.
///
/// # Errors
/// As [`load`]; any key with a file's path is refused.
pub fn parse_alone(text: &str, origin: &Path) -> Result<Loaded, InputError> {
    let document = Document::parse(text, origin)?;
    refuse_files(&document)?;
    assemble(&document)
}

/// Refuses a key with a file's path.
///
/// # Errors
/// For the first such key, with its line.
pub fn refuse_files(document: &Document) -> Result<(), InputError> {
    let mut entries = document.plant.iter().chain(document.believed.iter());
    match entries.find(|entry| matches!(entry.key.allowed, Allowed::Csv { .. })) {
        Some(entry) => {
            let problem = no_file(entry.path(), entry.written.clone());
            Err(at(entry, &document.origin, problem))
        }
        None => Ok(()),
    }
}

/// The message about a key with a file's path.
pub fn no_file(key: String, value: String) -> Problem {
    let allowed = "left out: a page's scenario may not name a file".to_owned();
    Problem::NotAllowed { key, value, allowed }
}

/// Loads the scenario of a record, which has the set points itself: the file of `drive.profile_csv` is not read.
///
/// # Errors
/// As [`load`].
pub fn load_recorded(path: &Path) -> Result<Loaded, InputError> {
    without_profile(&Document::parse(&read_text(path)?, path)?)
}

/// Fills in defaults, and applies the rules between keys.
pub fn assemble(document: &Document) -> Result<Loaded, InputError> {
    let mut loaded = without_profile(document)?;
    if let Some(entry) = document.plant.get("drive.profile_csv")
        && let Some(path) = entry.value.as_str()
    {
        let origin = &document.origin;
        let table = read_table(&beside(origin, path.as_ref()));
        let profile = table.and_then(|table| set_points_in(&table, &loaded.plant));
        loaded.drive_profile = Some(profile.map_err(|error| named(error, entry, origin))?);
    }
    Ok(loaded)
}

fn without_profile(document: &Document) -> Result<Loaded, InputError> {
    let Document { origin, plant: given, believed: overrides } = document;
    fault_rules::check_given(given).map_err(|found| blame(found, given, origin))?;
    let base = preset(&Scenario::default(), given, origin)?;
    let mut plant = overlaid(&base, given, origin)?;
    let dimensions = dimensions_of(given, &base);
    let dimensions = dimensions.resolved().map_err(|found| blame(found, given, origin))?;
    plant.muscle = dimensions.applied_to(&plant.muscle);
    let volumes = limits("vessel.volume_m3");
    let volume_csv = plant.vessel.volume_csv.as_deref();
    let volume_profile =
        profile(volume_csv, given.get("vessel.volume_csv"), (volumes, ""), origin)?;
    match (&plant.table.csv, given.get("table.csv")) {
        (Some(path), Some(entry)) => {
            plant.table_rows = rows(path, entry, table::wrong_cell, origin)?;
        }
        _ if plant.plant.kind == PlantKind::Table => {
            let why = "plant.kind = \"table\" needs it";
            return Err(blame(Violation::missing("table.csv", "plant.kind", why), given, origin));
        }
        _ => {}
    }
    fit_sizes(&mut plant, given, volume_profile.as_ref());
    start_fitted(&mut plant);
    check_heat(&plant, given).map_err(|found| blame(found, given, origin))?;
    rules::check_plant(&plant).map_err(|found| blame(found, given, origin))?;
    name_files_absolutely(&mut plant, given, origin)?;

    let base = preset(&plant, overrides, origin)?;
    let mut believed = overlaid(&base, overrides, origin)?;
    let threaded = given.get("muscle.thread_length_m").is_some();
    let dimensions = Given::of(overrides)
        .completed_from(Dimensions::of(&base.muscle), threaded)
        .resolved()
        .map_err(|found| blame(found, overrides, origin))?;
    believed.muscle = dimensions.applied_to(&believed.muscle);
    check_heat(&believed, overrides).map_err(|found| blame(found, overrides, origin))?;
    rules::check_believed(&believed).map_err(|found| blame(found, overrides, origin))?;
    Ok(Loaded { plant, believed, volume_profile, drive_profile: None, shut_s: Vec::new() })
}

/// Refuses a vessel, which a joint or a page cannot move.
///
/// # Errors
/// At the line of `plant.kind`.
pub fn refuse_vessel(document: &Document, loaded: &Loaded, place: &str) -> Result<(), InputError> {
    if loaded.plant.plant.kind != PlantKind::Vessel {
        return Ok(());
    }
    let problem = Problem::NotAllowed {
        key: "plant.kind".to_owned(),
        value: "\"vessel\"".to_owned(),
        allowed: format!("\"muscle\", \"cylinder\" or \"table\" {place}"),
    };
    let line = document.plant.get("plant.kind").and_then(|entry| entry.line);
    Err(InputError { file: document.origin.clone(), line, problem: Box::new(problem) })
}

/// Makes paths of files absolute, so that the scenario that `check` prints works in any folder.
fn name_files_absolutely(
    plant: &mut Scenario,
    given: &Entries,
    origin: &Path,
) -> Result<(), InputError> {
    for (path, found) in [
        (&mut plant.vessel.volume_csv, given.get("vessel.volume_csv")),
        (&mut plant.table.csv, given.get("table.csv")),
        (&mut plant.drive.profile_csv, given.get("drive.profile_csv")),
    ] {
        if let (Some(path), Some(entry)) = (path, found) {
            let file = beside(origin, path);
            let file = std::path::absolute(&file).unwrap_or(file);
            if file.to_str().is_none() {
                let problem = Problem::NotAllowed {
                    key: entry.path(),
                    value: entry.written.clone(),
                    allowed: "in a folder whose path is UTF-8 text".to_owned(),
                };
                return Err(at(entry, origin, problem));
            }
            *path = file;
        }
    }
    Ok(())
}

/// Starts the fit of an optional key from the value that applies if the key is left out.
fn start_fitted(plant: &mut Scenario) {
    let is_fitted = |path: &str| plant.identify.parameters.iter().any(|named| named == path);
    if is_fitted("plant.initial_gas_temperature_k") {
        let wall_k = plant.plant.initial_temperature_k;
        plant.plant.initial_gas_temperature_k.get_or_insert(wall_k);
    }
    if is_fitted("heat.inlet_diameter_m") {
        let path_m = inlet_diameter_m(plant);
        plant.heat.inlet_diameter_m.get_or_insert(path_m);
    }
}

/// Keys of `[heat]` that only a constant heat transfer has.
pub(crate) const CONSTANT_HEAT: [&str; 2] = ["inner_w_m2_k", "inner_per_flow"];

/// Refuses coefficients of a constant heat transfer in a file that does not name the model: the file was written when
/// that was the default.
fn check_heat(scenario: &Scenario, given: &Entries) -> Result<(), Violation> {
    let unnamed =
        scenario.heat.model == HeatModel::Correlation && given.get("heat.model").is_none();
    let mut keys = CONSTANT_HEAT.iter().map(|name| format!("heat.{name}"));
    match keys.find(|key| unnamed && given.get(key).is_some()) {
        Some(key) => {
            let why = format!(
                "\"constant\" goes with {key}; \"correlation\", the default, with heat.scale"
            );
            Err(Violation::missing("heat.model", &key, &why))
        }
        None => Ok(()),
    }
}

fn overlaid(base: &Scenario, entries: &Entries, origin: &Path) -> Result<Scenario, InputError> {
    let paths: Vec<(String, Value)> =
        entries.iter().map(|entry| (entry.path(), entry.value.clone())).collect();
    with_values(base, paths.iter().map(|(path, value)| (path.as_str(), value.clone())), origin)
}

/// Sizes that follow from others if the file does not give them.
fn fit_sizes(plant: &mut Scenario, given: &Entries, volume: Option<&Profile>) {
    let longest_m = match chamber::of(plant) {
        Some(chamber) => {
            if given.get("controller.load_limit_n").is_none() {
                let gauge_pa = plant.supply.pressure_pa - plant.ambient.pressure_pa;
                let force_n = gauge_pa * chamber.force_area(chamber.rest_length()).abs();
                let limit_n = &mut plant.controller.load_limit_n;
                let most_n = limits("controller.load_limit_n").max;
                *limit_n = limit_n.max((LOAD_SHARE * force_n) as f32).min(most_n as f32);
            }
            chamber.lengths()[1]
        }
        None => {
            let volumes = volume.map_or(&[][..], Profile::points).iter().map(|point| point.1);
            let largest_m3 = volumes.reduce(f64::max).unwrap_or(plant.vessel.volume_m3);
            let sized = volume.is_some() || given.get("vessel.volume_m3").is_some();
            if sized && given.get("vessel.characteristic_length_m").is_none() {
                // Edge of a cube of this volume.
                plant.vessel.characteristic_length_m = math::cbrt(largest_m3);
            }
            largest_m3 / plant.vessel.section_m2()
        }
    };
    if plant.plant.kind == PlantKind::Cylinder && given.get("friction.pressure_factor").is_none() {
        plant.friction.pressure_factor = SEAL_FACTOR;
    }
    if given.get("sensor.length.range_m").is_none() {
        let range = &mut plant.sensor.length.range_m;
        *range = range.max(longest_m / LENGTH_USE).min(limits("sensor.length.range_m").max);
    }
}

fn blame(violation: Violation, entries: &Entries, origin: &Path) -> InputError {
    let key = entries.full_path(&violation.path);
    let mut entry = entries.get(&violation.path);
    let problem = match violation.fault {
        Fault::NotAllowed { value, allowed } => {
            let value = match entry {
                Some(entry) => entry.written.clone(),
                None => {
                    // The conflicting key may be in the file.
                    entry = paths_in(&allowed).find_map(|path| entries.get(path));
                    format!("{value} (not given)")
                }
            };
            Problem::NotAllowed { key, value, allowed }
        }
        Fault::Missing { for_path, why } => {
            entry = entries.get(&for_path);
            Problem::Missing { key, why }
        }
    };
    match entry {
        Some(entry) => at(entry, origin, problem),
        None => InputError::file(origin, problem),
    }
}

/// Paths of keys in a text, in order of appearance.
pub fn paths_in(text: &str) -> impl Iterator<Item = &str> {
    let is_path = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '.';
    text.split(move |c| !is_path(c)).filter(|word| word.contains('.'))
}

fn at(entry: &Entry, origin: &Path, problem: Problem) -> InputError {
    InputError { file: origin.to_path_buf(), line: entry.line, problem: Box::new(problem) }
}

/// Resolves a path relative to the folder of `origin`.
fn beside(origin: &Path, path: &Path) -> PathBuf {
    origin.parent().unwrap_or(Path::new("")).join(path)
}

/// The numbers in columns of a table, by row. `wrong` finds the first cell that is not allowed, and returns the allowed
/// values.
///
/// # Errors
/// For a missing column, and for that cell.
pub fn numbers_in<const N: usize>(
    table: &CsvTable,
    columns: [&str; N],
    wrong: impl Fn(&[[f64; N]]) -> Option<WrongCell>,
) -> Result<Vec<[f64; N]>, InputError> {
    let mut rows = vec![[0.0; N]; table.rows()];
    for (i, column) in columns.iter().enumerate() {
        let numbers = table.filled(column)?;
        rows.iter_mut().zip(numbers).for_each(|(row, number)| row[i] = number);
    }
    match wrong(&rows) {
        Some(cell) => Err(table.cell_error(cell.row, columns[cell.column], &cell.allowed)),
        None => Ok(rows),
    }
}

/// The numbers in the CSV file of an entry.
fn rows<const N: usize>(
    path: &Path,
    entry: &Entry,
    wrong: impl Fn(&[[f64; N]]) -> Option<WrongCell>,
    origin: &Path,
) -> Result<Vec<[f64; N]>, InputError> {
    let Allowed::Csv { columns } = entry.key.allowed else { return Ok(Vec::new()) };
    let Ok(columns) = columns.try_into() else { return Ok(Vec::new()) };
    let table = read_table(&beside(origin, path));
    table.and_then(|table| numbers_in(&table, columns, wrong)).map_err(|e| named(e, entry, origin))
}

/// If the file as a whole is wrong, the path may be the mistake.
fn named(error: InputError, entry: &Entry, origin: &Path) -> InputError {
    if error.line.is_some() {
        return error;
    }
    at(entry, origin, Problem::Reference { key: entry.path(), file: error })
}

/// The profile in the CSV file of an entry, with values within `allowed`.
fn profile(
    path: Option<&Path>,
    entry: Option<&Entry>,
    allowed: (Limits, &str),
    origin: &Path,
) -> Result<Option<Profile>, InputError> {
    let (Some(path), Some(entry)) = (path, entry) else { return Ok(None) };
    let Allowed::Csv { columns: [.., column] } = entry.key.allowed else { return Ok(None) };
    let table = read_table(&beside(origin, path));
    let profile = table.and_then(|table| profile_in(&table, column, allowed));
    profile.map(Some).map_err(|error| named(error, entry, origin))
}

/// The set points in a table, in its column `value` or that of the drive's quantity, within the scenario's limits.
///
/// # Errors
/// [`InputError`] names the first cell that is not allowed.
pub fn set_points_in(table: &CsvTable, scenario: &Scenario) -> Result<Profile, InputError> {
    let has = |name: &str| table.columns().iter().any(|column| column.name == name);
    let quantity = SET_POINT_COLUMNS.iter().find(|(_, kind)| *kind == scenario.drive.kind);
    let named = quantity.map(|(name, _)| *name).filter(|name| has(name) || !has("value"));
    let column = named.unwrap_or("value");
    profile_in(table, column, rules::set_points(scenario))
}

/// Columns that may stand for `value`, and the drive of each.
pub const SET_POINT_COLUMNS: [(&str, DriveKind); 4] = [
    ("pressure_pa", DriveKind::Pressure),
    ("contraction", DriveKind::Contraction),
    ("flow_kg_s", DriveKind::MassFlow),
    ("duty", DriveKind::Duty),
];

/// A column of a table over `time_s`, with values within `allowed`, for the reason given with it.
///
/// # Errors
/// [`InputError`] names the first cell that is not allowed, or is not later than the one before.
pub fn profile_in(
    table: &CsvTable,
    column: &str,
    (allowed, why): (Limits, &str),
) -> Result<Profile, InputError> {
    let separator = if why.is_empty() { "" } else { ", " };
    let wrong = |rows: &[[f64; 2]]| {
        let earlier = (1..rows.len()).find(|row| rows[*row][0] <= rows[row - 1][0]);
        if let Some(row) = earlier {
            let allowed = format!("above {:?}, the time of the row before", rows[row - 1][0]);
            return Some(WrongCell { row, column: 0, allowed });
        }
        let row = rows.iter().position(|[_, value]| !allowed.contains(*value))?;
        Some(WrongCell { row, column: 1, allowed: format!("{allowed}{separator}{why}") })
    };
    let rows = numbers_in(table, ["time_s", column], wrong)?;
    Profile::new(rows.into_iter().map(|[time, value]| (time, value)).collect())
        .map_err(|error| table.header_error(Problem::Unreadable(error.to_string())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_profile_without_its_column_is_asked_for_the_one_of_its_drive() {
        let mut scenario = Scenario::default();
        for (kind, column) in SET_POINT_COLUMNS.map(|(column, kind)| (kind, column)) {
            scenario.drive.kind = kind;
            let table = CsvTable::parse("time_s,pressure_kpa\n0,150\n", "p.csv".as_ref()).unwrap();
            let error = set_points_in(&table, &scenario).unwrap_err().to_string();
            let expected =
                format!("p.csv: column {column} is missing; the file has time_s, pressure_kpa");
            assert_eq!(error, expected);
        }
    }
}
