//! Shared by tests of whole runs.

use std::path::Path;
use thermyo_record::trace::Row;
use thermyo_simulation::run;

/// The rows of a valid scenario, with the core in this process.
pub fn rows(text: &str) -> Vec<Row> {
    let loaded = thermyo_setup::parse(text, Path::new("scenario.toml")).unwrap();
    run::rows(&loaded).unwrap()
}
