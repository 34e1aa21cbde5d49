//! Files of an archive, read and unpacked.

use std::io::{Cursor, Read};
use std::path::Path;
use std::sync::Mutex;
use std::{fs, io, process};
use zip::ZipArchive;

/// Prefix of the files that Node.js needs unpacked.
pub(super) const UNPACKED: &str = "emulator/";

pub(super) fn file(archive: &[u8], name: &str) -> io::Result<Vec<u8>> {
    let mut archive = ZipArchive::new(Cursor::new(archive))?;
    let mut content = Vec::new();
    archive.by_name(name)?.read_to_end(&mut content)?;
    Ok(content)
}

/// Unpacks everything below [`UNPACKED`]. Each file appears complete: other processes may read it.
pub(super) fn unpack(archive: &[u8], folder: &Path) -> io::Result<()> {
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
        assert_eq!(file(&archive, "library.so").unwrap(), b"library");
        assert!(file(&archive, "library").is_err());
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
