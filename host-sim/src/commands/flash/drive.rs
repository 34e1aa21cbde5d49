//! The drive of a board in its boot loader.

use super::{FlashError, Model};
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use thermyo_files::input::InputError;

/// File that identifies such a drive.
const INFO: &str = "INFO_UF2.TXT";
/// Name of the written file; the boot loader accepts any.
const FILE: &str = "thermyo.uf2";

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Drive {
    pub path: PathBuf,
    pub model: Model,
}

impl Drive {
    /// The boot loader's drive mounted at a folder.
    pub fn at(path: &Path) -> Result<Self, FlashError> {
        let text = fs::read_to_string(path.join(INFO))
            .map_err(|_| FlashError::NoDrive { path: path.to_path_buf() })?;
        let id = text.lines().find_map(|line| line.strip_prefix("Board-ID:")).unwrap_or("").trim();
        let model = Model::ALL.into_iter().find(|model| model.board_id() == id);
        let model = model.ok_or_else(|| FlashError::UnknownBoard {
            path: path.to_path_buf(),
            id: id.to_owned(),
        })?;
        Ok(Self { path: path.to_path_buf(), model })
    }

    /// Writes a UF2 file. The board restarts after the last byte, and the drive disappears.
    pub fn write(&self, content: &[u8]) -> Result<(), FlashError> {
        let path = self.path.join(FILE);
        let written = File::create(&path)
            .and_then(|mut file| file.write_all(content).map(|()| file))
            .and_then(|file| file.sync_all());
        match written {
            Err(error) if self.path.join(INFO).exists() => {
                Err(InputError::output(&path, &error).into())
            }
            // The drive may disappear before the system has finished.
            _ => Ok(()),
        }
    }

    /// Whether a drive is mounted, rather than a folder with the same files.
    pub fn is_mounted(&self) -> bool {
        #[cfg(unix)]
        {
            use std::os::unix::fs::MetadataExt;
            let device = |path: &Path| fs::metadata(path).map(|data| data.dev()).ok();
            device(&self.path) != device(&self.path.join(".."))
        }
        #[cfg(not(unix))]
        {
            self.path.parent().is_none()
        }
    }
}

/// The drives among these folders.
pub fn find(folders: &[PathBuf]) -> Vec<Drive> {
    folders.iter().filter_map(|folder| Drive::at(folder).ok()).collect()
}

/// Folders at which drives are mounted.
pub fn mounts() -> Vec<PathBuf> {
    if cfg!(target_os = "linux") {
        let mounts = fs::read_to_string("/proc/self/mounts").unwrap_or_default();
        return mounts.lines().filter_map(fat_mount).collect();
    }
    if cfg!(windows) {
        return ('A'..='Z').map(|letter| PathBuf::from(format!("{letter}:\\"))).collect();
    }
    let volumes = fs::read_dir("/Volumes").into_iter().flatten();
    volumes.filter_map(|entry| Some(entry.ok()?.path())).collect()
}

/// Mount point of a FAT in a line of Linux's list of mounts. Other file systems are skipped: they
/// cannot be such a drive, and may hang.
fn fat_mount(line: &str) -> Option<PathBuf> {
    let mut fields = line.split(' ').skip(1);
    let folder = fields.next()?;
    let fat = fields.next().is_some_and(|kind| ["vfat", "msdos"].contains(&kind));
    // proc(5): characters that would end a field are written in octal.
    fat.then(|| folder.replace("\\040", " ").replace("\\011", "\t").into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mounts_of_a_fat_are_looked_at_and_no_others() {
        for (line, expected) in [
            ("/dev/sdb1 /media/me/RPI-RP2 vfat rw,nosuid 0 0", Some("/media/me/RPI-RP2")),
            ("/dev/sdb1 /media/my\\040self/RP2350 vfat rw 0 0", Some("/media/my self/RP2350")),
            ("server:/home /home nfs4 rw 0 0", None),
            ("", None),
        ] {
            assert_eq!(fat_mount(line), expected.map(PathBuf::from), "{line}");
        }
    }
}
