//! What tests of whole runs share.

use host_sim::board::CoreBoard;
use host_sim::files::trace::Row;
use host_sim::scenario;
use host_sim::simulation::run;
use std::path::Path;

/// The rows of a scenario that can be run, with the core in this process.
pub fn rows(text: &str) -> Vec<Row> {
    let loaded = scenario::parse(text, Path::new("scenario.toml")).unwrap();
    let mut rows = Vec::new();
    let mut keep = |row: &Row| {
        rows.push(*row);
        Ok(())
    };
    run::run(&loaded, &mut CoreBoard::default(), None, &mut keep).unwrap();
    rows
}
