//! The `.fmu` file: a zip archive.

use super::{library, zip};
use std::path::{Path, PathBuf};
use thermyo_cosimulation::Kind;
use thermyo_cosimulation::description::{LIBRARY, describe};
use thermyo_cosimulation::model::{Model, ModelError};
use thermyo_cosimulation::scenario::Scenario;
use thermyo_files::input::{InputError, read_bytes};

/// The archive of a scenario, with the shared library of this platform.
pub fn archive(
    scenario: &Scenario,
    kind: Kind,
    name: &str,
    library: &[u8],
) -> Result<Vec<u8>, ModelError> {
    let description = describe(&Model::new(scenario.clone(), kind)?, name)?;
    let mut files = vec![("modelDescription.xml".to_owned(), description.into_bytes())];
    files.extend(resources(scenario, kind)?);
    let binary = format!("binaries/{}/{LIBRARY}{}", library::platform(), library::suffix());
    files.push((binary, library.to_vec()));
    Ok(zip::stored(&files))
}

/// The scenario, and the tables that it names.
fn resources(scenario: &Scenario, kind: Kind) -> Result<Vec<(String, Vec<u8>)>, InputError> {
    let mut scenario = scenario.clone();
    let mut files = Vec::new();
    for (name, paths) in scenario.files() {
        let Some(path) = paths.first().and_then(|path| path.as_ref()) else { continue };
        files.push((format!("resources/{name}"), read_bytes(path)?));
        for path in paths {
            *path = Some(PathBuf::from(name));
        }
    }
    let file = Path::new("resources").join(kind.scenario_file());
    files.push((file.to_string_lossy().replace('\\', "/"), scenario.render().into_bytes()));
    Ok(files)
}
