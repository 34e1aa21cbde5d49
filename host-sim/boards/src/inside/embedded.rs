//! The archive in this build.

use super::archive;
use std::env;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use thermyo_simulation::board::BoardError;

const ARCHIVE: &[u8] = include_bytes!(env!("THERMYO_INSIDE"));

pub fn file(name: &str) -> Option<Vec<u8>> {
    Some(archive::file(ARCHIVE, name).expect("the archive is whole and complete"))
}

/// Folder with the built-in emulator scripts and firmware images, unpacked into the user's cache if
/// they are missing there or differ.
pub fn emulator() -> Result<Option<PathBuf>, BoardError> {
    let not_unpacked = |folder: &Path, reason: String| BoardError::NotUnpacked {
        folder: folder.to_path_buf(),
        reason,
    };
    let cache = cache().ok_or_else(|| {
        not_unpacked(Path::new("the user's cache"), "there is no home folder".to_owned())
    })?;
    // Each version has a folder of its own.
    let mut hasher = DefaultHasher::new();
    ARCHIVE.hash(&mut hasher);
    let folder = cache.join(format!("{}-{:016x}", env!("CARGO_PKG_VERSION"), hasher.finish()));
    archive::unpack(ARCHIVE, &folder).map_err(|error| not_unpacked(&folder, error.to_string()))?;
    Ok(Some(folder.join(archive::UNPACKED)))
}

/// The user's cache folder. Others could put scripts into the folder for temporary files.
fn cache() -> Option<PathBuf> {
    let given = env::var_os("XDG_CACHE_HOME").map(PathBuf::from).filter(|path| path.is_absolute());
    let system = if cfg!(windows) {
        env::var_os("LOCALAPPDATA").map(PathBuf::from)
    } else {
        let below = if cfg!(target_os = "macos") { "Library/Caches" } else { ".cache" };
        env::home_dir().filter(|home| home.is_absolute()).map(|home| home.join(below))
    };
    Some(given.or(system)?.join("thermyo"))
}
