//! The output folder of a run: a file appears in it whole or not at all.

use crate::input::InputError;
use std::fs;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// A folder that the results of one run go to. Files are written beside their names and renamed
/// only by [`OutputDir::publish`]; dropped before that, nothing is left.
#[derive(Debug)]
pub struct OutputDir {
    path: PathBuf,
    /// Folders that did not exist before, innermost first.
    created: Vec<PathBuf>,
    pending: Vec<(NamedTempFile, &'static str)>,
    published: bool,
}

/// A file that is being written.
pub type OutputFile = BufWriter<NamedTempFile>;

impl OutputDir {
    /// Opens the folder, creating it where it does not exist.
    ///
    /// # Errors
    /// When it cannot be created or written.
    pub fn create(path: &Path) -> Result<Self, InputError> {
        let created: Vec<PathBuf> = path
            .ancestors()
            .take_while(|folder| !folder.as_os_str().is_empty() && !folder.exists())
            .map(Path::to_path_buf)
            .collect();
        let dir = Self { path: path.to_path_buf(), created, pending: Vec::new(), published: false };
        fs::create_dir_all(path).map_err(|error| InputError::output(path, &error))?;
        // Found out now, not after a long run.
        dir.file()?;
        Ok(dir)
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Begins a file.
    ///
    /// # Errors
    /// When the folder cannot be written.
    pub fn file(&self) -> Result<OutputFile, InputError> {
        tempfile::Builder::new()
            .prefix(".thermyo-")
            .tempfile_in(&self.path)
            .map(|file| BufWriter::with_capacity(1 << 16, file))
            .map_err(|error| InputError::output(&self.path, &error))
    }

    /// Keeps a finished file for [`OutputDir::publish`].
    ///
    /// # Errors
    /// When its last bytes cannot be written.
    pub fn keep(&mut self, file: OutputFile, name: &'static str) -> Result<(), InputError> {
        let file = file
            .into_inner()
            .map_err(|error| InputError::output(&self.path.join(name), error.error()))?;
        self.pending.push((file, name));
        Ok(())
    }

    /// Writes a whole text and keeps it for [`OutputDir::publish`].
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn keep_text(&mut self, name: &'static str, text: &str) -> Result<(), InputError> {
        let mut file = self.file()?;
        file.write_all(text.as_bytes())
            .map_err(|error| InputError::output(&self.path.join(name), &error))?;
        self.keep(file, name)
    }

    /// Gives all kept files their names.
    ///
    /// # Errors
    /// When a name is taken by a folder, or the disk refuses.
    pub fn publish(mut self) -> Result<(), InputError> {
        for (file, name) in self.pending.drain(..) {
            let target = self.path.join(name);
            let failed = |error: &std::io::Error| InputError::output(&target, error);
            let file = file.persist(&target).map_err(|error| failed(&error.error))?;
            #[cfg(unix)]
            {
                use std::os::unix::fs::PermissionsExt;
                // Temporary files are private; results are as public as any new file.
                file.set_permissions(fs::Permissions::from_mode(0o644))
                    .map_err(|error| failed(&error))?;
            }
            #[cfg(not(unix))]
            drop(file);
        }
        self.published = true;
        Ok(())
    }
}

impl Drop for OutputDir {
    fn drop(&mut self) {
        if !self.published {
            self.pending.clear();
            for folder in &self.created {
                // Only an empty folder goes; anything else in it is not ours.
                if fs::remove_dir(folder).is_err() {
                    break;
                }
            }
        }
    }
}
