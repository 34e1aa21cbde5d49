//! The schema of a scenario: unit, allowed values and meaning of every key.
//!
//! Validation, suggestions and the comments of `thermyo check` use it; `declare.rs` generates it,
//! with the structs and their defaults. Either no range is wider than the core's
//! (`model_core::config::Config::check`), or `thermyo_setup::core_config` narrows the core's value:
//! a scenario that passes here runs.

pub use super::key::{Allowed, Key, Limits, Table};
pub use super::tables::TABLES;

/// Keys of the dimensions in `[muscle]`: two pairs, each with the rest length. Either pair follows
/// from the other.
pub const DIMENSIONS: [&str; 5] =
    ["thread_length_m", "turns", "rest_length_m", "diameter_m", "braid_angle_deg"];

/// The table of a path. Further windows of faults have the keys of `[faults]`.
pub fn table(path: &str) -> Option<&'static Table> {
    let name = if is_fault_window(path) { FAULTS } else { path };
    TABLES.iter().find(|table| table.name == name)
}

/// The table of the first window of faults.
pub const FAULTS: &str = "faults";
/// Prefix of the paths of further windows.
pub const FAULT_WINDOWS: &str = "faults.";

/// Whether `path` is a further window of faults, `faults.NAME`. NAME is a bare key of TOML and not
/// a key of `[faults]`.
pub fn is_fault_window(path: &str) -> bool {
    let bare = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    path.strip_prefix(FAULT_WINDOWS)
        .is_some_and(|name| !name.is_empty() && name.chars().all(bare) && key(path).is_none())
}

/// The key of this path, such as "muscle.zones", with its table.
pub fn key(path: &str) -> Option<(&'static Table, &'static Key)> {
    let (table_path, name) = path.rsplit_once('.')?;
    let table = table(table_path)?;
    Some((table, table.keys.iter().find(|key| key.name == name)?))
}

/// # Panics
/// If the path is not a number: a fault of this program, not of a scenario.
pub fn limits(path: &str) -> Limits {
    match key(path).map(|(_, key)| key.allowed) {
        Some(Allowed::Real(limits)) => limits,
        _ => panic!("{path} is not a number of the schema"),
    }
}

/// Prefixes of keys that describe how a quantity is recorded.
const OF_RECORDING: [&str; 4] = ["noise_", "range_", "gain", "offset_"];
/// Limits of a number that can be fitted, by its path.
pub fn fittable(path: &str) -> Option<Limits> {
    let (table, key) = key(path)?;
    // The dimensions follow from each other.
    let excluded = OF_RECORDING.iter().any(|start| key.name.starts_with(start))
        || (table.name == "muscle" && DIMENSIONS.contains(&key.name));
    match key.allowed {
        Allowed::Real(limits) if table.physical && !excluded => Some(limits),
        _ => None,
    }
}

pub fn fittable_paths() -> impl Iterator<Item = String> {
    TABLES
        .iter()
        .flat_map(|table| table.keys.iter().map(|key| format!("{}.{}", table.name, key.name)))
        .filter(|path| fittable(path).is_some())
}

/// Whether `path` is a table, or holds tables only, such as `sensor`.
pub fn is_table(path: &str) -> bool {
    TABLES.iter().any(|table| {
        table.name.strip_prefix(path).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scenario;
    use std::collections::BTreeSet;

    fn tables(path: &str, table: &toml::Table, found: &mut BTreeSet<String>) {
        for (name, value) in table {
            match value.as_table() {
                Some(table) if path.is_empty() => tables(name, table, found),
                Some(table) => tables(&format!("{path}.{name}"), table, found),
                None => drop(found.insert(path.to_owned())),
            }
        }
    }

    #[test]
    fn every_table_of_the_scenario_is_listed() {
        let mut found = BTreeSet::new();
        tables("", &toml::Table::try_from(Scenario::default()).unwrap(), &mut found);
        let listed: Vec<String> = TABLES.iter().map(|table| table.name.to_owned()).collect();
        assert_eq!(listed.iter().cloned().collect::<BTreeSet<_>>(), found);
        assert_eq!(listed.len(), found.len(), "a table is listed twice");
    }
}
