//! Shared by tests of whole runs.

use thermyo_record::trace::Row;
use thermyo_simulation::board::CoreBoard;

use std::path::Path;
use thermyo_simulation::run;

/// The rows of a valid scenario, with the core in this process.
pub fn rows(text: &str) -> Vec<Row> {
    let loaded = thermyo_setup::parse(text, Path::new("scenario.toml")).unwrap();
    let mut rows = Vec::new();
    let mut keep = |row: &Row| {
        rows.push(*row);
        Ok(())
    };
    run::run(&loaded, &mut CoreBoard::default(), None, &mut keep).unwrap();
    rows
}
