//! Presets in a file: the file's own keys override their values.

use std::path::Path;
use thermyo_files::input::{InputError, Problem};
use thermyo_scenario::document::Entries;
use thermyo_scenario::geometry::{Dimensions, Given};
use thermyo_scenario::preset::Preset;
use thermyo_scenario::{Muscle, Scenario, at_rest};
use toml::{Table, Value};

pub fn presets_of(entries: &Entries) -> impl Iterator<Item = &'static Preset> {
    entries.iter().filter(|entry| entry.key.name == "preset").filter_map(|entry| {
        let word = entry.value.as_str()?;
        Preset::of(&entry.table, word)
    })
}

pub fn preset(base: &Scenario, entries: &Entries, origin: &Path) -> Result<Scenario, InputError> {
    let values = presets_of(entries).flat_map(|preset| &preset.values);
    let mut preset =
        with_values(base, values.map(|(path, value)| (path.as_str(), value.clone())), origin)?;
    if presets_of(entries).any(|preset| preset.table == "muscle") {
        let Muscle { rest_length_m, diameter_m, braid_angle_deg, .. } = preset.muscle;
        preset.muscle = at_rest(&preset.muscle, rest_length_m, diameter_m, braid_angle_deg);
    }
    Ok(preset)
}

/// The scenario with these values at their paths.
pub fn with_values<'a>(
    base: &Scenario,
    values: impl IntoIterator<Item = (&'a str, Value)>,
    origin: &Path,
) -> Result<Scenario, InputError> {
    // Schema and structs are one declaration, so an entry that passed the schema fits the struct.
    // Faults that need a number have one.
    let internal = |error: String| InputError::file(origin, Problem::Syntax(error));
    let mut tree = base.to_table();
    for (path, value) in values {
        let (tables, key) = path.rsplit_once('.').unwrap_or(("", path));
        let mut table = &mut tree;
        for name in tables.split('.') {
            let next = table.entry(name).or_insert_with(|| Value::Table(Table::new()));
            table = next.as_table_mut().ok_or_else(|| internal(format!("{name} is no table")))?;
        }
        table.insert(key.to_owned(), value);
    }
    Scenario::from_toml(Value::Table(tree)).map_err(|error| internal(error.message().to_owned()))
}

/// Dimensions of a muscle in entries, completed from their preset if they name one.
pub fn dimensions_of(entries: &Entries, base: &Scenario) -> Given {
    let given = Given::of(entries);
    if presets_of(entries).any(|preset| preset.table == "muscle") {
        given.completed_from(Dimensions::of(&base.muscle), false)
    } else {
        given
    }
}
