//! Files inside a release build that a checkout builds or fetches: the emulator's scripts and the
//! firmware's images (`emulator/`), the browser's module, the shared library of a unit.
//!
//! Feature `release` embeds the archive that `THERMYO_INSIDE` names at compile time; `.ci/dist.py`
//! makes it. Without the feature there is no archive, and the checkout is used.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::{env, fs, io, process};
use thermyo_simulation::board::BoardError;
use zip::ZipArchive;

#[cfg(feature = "release")]
const ARCHIVE: Option<&[u8]> = Some(include_bytes!(env!("THERMYO_INSIDE")));
#[cfg(not(feature = "release"))]
const ARCHIVE: Option<&[u8]> = None;

/// Node.js needs these as files.
const UNPACKED: &str = "emulator/";

/// A built-in file; `None` in a checkout.
pub fn file(name: &str) -> Option<Vec<u8>> {
    let mut archive = ZipArchive::new(Cursor::new(ARCHIVE?)).expect("an archive is inside");
    let mut file = archive.by_name(name).expect("the archive is complete");
    let mut content = Vec::new();
    file.read_to_end(&mut content).expect("the archive is whole");
    Some(content)
}

/// Folder with the built-in emulator scripts and firmware images, unpacked into the user's cache if
/// they are missing there or differ; `None` in a checkout.
pub fn emulator() -> Result<Option<PathBuf>, BoardError> {
    let Some(archive) = ARCHIVE else { return Ok(None) };
    let not_unpacked = |folder: &Path, reason: String| BoardError::NotUnpacked {
        folder: folder.to_path_buf(),
        reason,
    };
    let cache = cache().ok_or_else(|| {
        not_unpacked(Path::new("the user's cache"), "there is no home folder".to_owned())
    })?;
    // Each version has a folder of its own.
    let mut hasher = DefaultHasher::new();
    archive.hash(&mut hasher);
    let folder = cache.join(format!("{}-{:016x}", env!("CARGO_PKG_VERSION"), hasher.finish()));
    unpack(archive, &folder).map_err(|error| not_unpacked(&folder, error.to_string()))?;
    Ok(Some(folder.join(UNPACKED)))
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

/// Unpacks everything below [`UNPACKED`]. Each file appears complete: other processes may read it.
fn unpack(archive: &[u8], folder: &Path) -> io::Result<()> {
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let _guard = ONE_AT_A_TIME.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let mut archive = ZipArchive::new(Cursor::new(archive))?;
    for index in 0..archive.len() {
        let mut file = archive.by_index(index)?;
        let Some(name) = file.enclosed_name().filter(|name| name.starts_with(UNPACKED)) else {
            continue;
        };
        let mut content = Vec::new();
        file.read_to_end(&mut content)?;
        let path = folder.join(name);
        if fs::read(&path).is_ok_and(|there| there == content) {
            continue;
        }
        let part = path.with_extension(format!("{}.part", process::id()));
        fs::create_dir_all(path.parent().unwrap_or(folder))?;
        fs::write(&part, content)?;
        fs::rename(&part, &path)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;
    use zip::ZipWriter;
    use zip::write::SimpleFileOptions;

    #[test]
    fn what_is_unpacked_is_mended() {
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        for (name, content) in [
            ("emulator/board.mjs", "board"),
            ("emulator/node_modules/chip/index.js", "chip"),
            ("library.so", "library"),
        ] {
            zip.start_file(name, SimpleFileOptions::default()).unwrap();
            zip.write_all(content.as_bytes()).unwrap();
        }
        let archive = zip.finish().unwrap().into_inner();
        let cache = tempfile::tempdir().unwrap();
        let folder = cache.path().join("a/b");
        let chip = folder.join("emulator/node_modules/chip/index.js");
        for damage in [None, Some(""), Some("chap")] {
            if let Some(damage) = damage {
                fs::write(&chip, damage).unwrap();
                fs::remove_file(folder.join("emulator/board.mjs")).unwrap();
            }
            unpack(&archive, &folder).unwrap();
            assert_eq!(fs::read_to_string(&chip).unwrap(), "chip");
            assert_eq!(fs::read_to_string(folder.join("emulator/board.mjs")).unwrap(), "board");
            assert!(!folder.join("library.so").exists());
            assert_eq!(fs::read_dir(folder.join("emulator")).unwrap().count(), 2);
        }
        assert!(unpack(&archive[..archive.len() / 2], &folder).is_err());
        fs::write(cache.path().join("file"), "").unwrap();
        assert!(unpack(&archive, &cache.path().join("file")).is_err());
    }
}
