//! A scenario as `thermyo check` prints it: every key with its value and the allowed values.

use super::load::CONSTANT_HEAT;
use super::loaded::Loaded;
use super::tree::{same, value};
use super::warnings::{model_is_unused, unused_tables};
use std::fmt::Write;
use thermyo_files::output::{Recorded, name_tables};
use thermyo_scenario::Scenario;
use thermyo_scenario::schema::{Allowed, DIMENSIONS, FAULTS, Key, TABLES, Table};
use toml::Value;

/// Keys of a table of which one that differs has others written with it: table, causes, and keys written with them.
const TOGETHER: [(&str, &[&str], &[&str]); 2] = [
    // The core is configured with all dimensions or none: a single one would change the others.
    ("muscle", &DIMENSIONS, &DIMENSIONS),
    // A file with coefficients of a constant heat transfer has to name the model.
    ("heat", &CONSTANT_HEAT, &["model"]),
];

/// The scenario as it lies in a result.
pub fn recorded(loaded: &Loaded) -> Recorded {
    let mut own = loaded.clone();
    let Loaded { plant, believed, .. } = &mut own;
    let tables = name_tables([
        (
            "scenario_volume.csv",
            vec![&mut plant.vessel.volume_csv, &mut believed.vessel.volume_csv],
        ),
        ("scenario_table.csv", vec![&mut plant.table.csv, &mut believed.table.csv]),
        (
            "scenario_profile.csv",
            vec![&mut plant.drive.profile_csv, &mut believed.drive.profile_csv],
        ),
    ]);
    Recorded { text: render(&own), tables }
}

/// The scenario as TOML with all defaults filled in; reading it back gives the same scenario to
/// the bit.
pub fn render(loaded: &Loaded) -> String {
    let plant = loaded.plant.to_table();
    let believed = loaded.believed.to_table();
    let unused = unused_tables(loaded);
    let defaults = Scenario::default().to_table();
    let is_default = |path: &str, key: &Key| {
        same(value(&plant, path, key.name), value(&defaults, path, key.name))
    };
    let mut text = String::new();
    for table in TABLES {
        for path in paths(table, &loaded.plant) {
            let why = unused.iter().find(|(name, _)| *name == path).map(|(_, why)| why);
            // Unused tables with default values stay comments, so that the printed scenario runs
            // without a warning.
            let left_out = why.is_some() && table.keys.iter().all(|key| is_default(&path, key));
            let lines = table
                .keys
                .iter()
                .map(|key| {
                    let line = key_line(key, value(&plant, &path, key.name));
                    let model = path == "plant" && key.name == "model";
                    let comment = left_out || (model && model_is_unused(&loaded.plant));
                    if comment && !line.starts_with('#') { format!("# {line}") } else { line }
                })
                .collect::<String>();
            let meaning = match why {
                Some(why) => format!("{}; not used: {why}", table.meaning),
                None => table.meaning.to_owned(),
            };
            push_table(&mut text, &path, &meaning, &lines);
        }
    }
    for table in TABLES {
        let differs = |key: &&Key| {
            !same(value(&plant, table.name, key.name), value(&believed, table.name, key.name))
        };
        let named_with = |key: &Key| {
            TOGETHER.iter().any(|(name, causes, keys)| {
                *name == table.name
                    && keys.contains(&key.name)
                    && table
                        .keys
                        .iter()
                        .any(|cause| causes.contains(&cause.name) && differs(&cause))
            })
        };
        let lines = table
            .keys
            .iter()
            .filter(|key| differs(key) || named_with(key))
            .map(|key| key_line(key, value(&believed, table.name, key.name)))
            .collect::<String>();
        if !lines.is_empty() {
            let name = format!("believed.{}", table.name);
            push_table(&mut text, &name, "what the core is configured with instead", &lines);
        }
    }
    text
}

/// Paths of a table in the scenario: one, or one for each window of faults.
fn paths(table: &Table, scenario: &Scenario) -> Vec<String> {
    if table.name == FAULTS {
        scenario.faults.windows().map(|(path, _)| path).collect()
    } else {
        vec![table.name.to_owned()]
    }
}

fn push_table(text: &mut String, name: &str, meaning: &str, lines: &str) {
    let gap = if text.is_empty() { "" } else { "\n" };
    // Writing into a string cannot fail.
    let _ = write!(text, "{gap}[{name}]  # {meaning}\n{lines}");
}

fn key_line(key: &Key, value: Option<&Value>) -> String {
    let comment = key.comment();
    match value {
        // Rust's shortest text that reads back to the same number is also TOML.
        Some(Value::Float(number)) if key.core => {
            format!("{} = {:?}  # {comment}\n", key.name, *number as f32)
        }
        Some(Value::Float(number)) => format!("{} = {number:?}  # {comment}\n", key.name),
        Some(value) => format!("{} = {value}  # {comment}\n", key.name),
        None => {
            let missing =
                if matches!(key.allowed, Allowed::Csv { .. }) { "\"FILE.csv\"" } else { "NUMBER" };
            format!("# {} = {missing}  # {comment}\n", key.name)
        }
    }
}
