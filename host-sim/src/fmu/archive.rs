//! The `.fmu` file: a zip archive.

use super::{library, zip};
use std::path::{Path, PathBuf};
use thermyo_cosimulation::Kind;
use thermyo_cosimulation::description::{LIBRARY, describe};
use thermyo_cosimulation::model::{Model, ModelError};
use thermyo_files::input::{InputError, read_bytes};
use thermyo_setup::{Loaded, render};

/// The archive of a scenario, with the shared library of this platform.
pub fn archive(
    loaded: &Loaded,
    kind: Kind,
    name: &str,
    library: &[u8],
) -> Result<Vec<u8>, ModelError> {
    let description = describe(&Model::new(loaded.clone(), kind)?, name)?;
    let mut files = vec![("modelDescription.xml".to_owned(), description.into_bytes())];
    files.extend(resources(loaded, kind)?);
    let binary = format!("binaries/{}/{LIBRARY}{}", library::platform(), library::suffix());
    files.push((binary, library.to_vec()));
    Ok(zip::stored(&files))
}

/// The scenario, and the tables that it names.
fn resources(loaded: &Loaded, kind: Kind) -> Result<Vec<(String, Vec<u8>)>, InputError> {
    let mut loaded = loaded.clone();
    let mut files = Vec::new();
    let mut moved = |path: &mut Option<PathBuf>, believed: &mut Option<PathBuf>, name: &str| {
        if let Some(path) = path {
            files.push((format!("resources/{name}"), read_bytes(path)?));
            *path = PathBuf::from(name);
            *believed = Some(path.clone());
        }
        Ok::<(), InputError>(())
    };
    let (plant, believed) = (&mut loaded.plant, &mut loaded.believed);
    moved(&mut plant.vessel.volume_csv, &mut believed.vessel.volume_csv, "volume.csv")?;
    moved(&mut plant.drive.profile_csv, &mut believed.drive.profile_csv, "profile.csv")?;
    moved(&mut plant.table.csv, &mut believed.table.csv, "table.csv")?;
    let scenario = Path::new("resources").join(kind.scenario_file());
    files.push((scenario.to_string_lossy().replace('\\', "/"), render(&loaded).into_bytes()));
    Ok(files)
}
