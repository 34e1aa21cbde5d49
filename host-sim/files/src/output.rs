//! The output folder of a command. Results appear in it all at once, and none is overwritten,
//! except the pages of `thermyo playground`.
//!
//! ```text
//! DIR/                 the last result
//! DIR/unfinished-N/    an unfinished result; its trace is whole up to the last row
//! DIR/earlier-N/       earlier content of DIR
//! ```

use crate::input::{InputError, Problem};
use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

/// Files that commands write: those of one result stay together.
const RESULTS: [&str; 23] = [
    "summary.json",
    "report.html",
    "trace.csv",
    "trace.mcap",
    "joint_trace.csv",
    "scenario.toml",
    "scenario_load.csv",
    "scenario_profile.csv",
    "scenario_radius.csv",
    "scenario_table.csv",
    "scenario_table_b.csv",
    "scenario_volume.csv",
    "config.json",
    "profile.csv",
    "motion.csv",
    "sweep.csv",
    "study.json",
    "tuned.toml",
    "identified.toml",
    "fit.svg",
    "map.svg",
    "stops.svg",
    "motion.svg",
];

/// Files of which every published result has at least one.
const SIGNS: [&str; 3] = ["summary.json", "report.html", "config.json"];

/// A scenario as it lies in a result.
#[derive(Debug)]
pub struct Recorded {
    /// Names its tables without a folder.
    pub text: String,
    /// The tables: names in the result, and the files.
    pub tables: Vec<(&'static str, PathBuf)>,
}

/// Gives the tables that keys name their names in a result; returns these with the files. Keys of one entry that name
/// the same file as the first of them get the same name.
pub fn name_tables<'a>(
    keys: impl IntoIterator<Item = (&'static str, Vec<&'a mut Option<PathBuf>>)>,
) -> Vec<(&'static str, PathBuf)> {
    let named = keys.into_iter().filter_map(|(name, mut keys)| {
        let file = keys.first()?.as_ref()?.clone();
        for key in keys.iter_mut().filter(|key| key.as_ref() == Some(&file)) {
            **key = Some(name.into());
        }
        Some((name, file))
    });
    named.collect()
}

/// Whether a new result in this folder would move the file: it has the name of a result there.
pub fn would_move(folder: &Path, file: &Path) -> bool {
    let beside = file.parent().filter(|parent| !parent.as_os_str().is_empty());
    let [beside, folder] =
        [beside.unwrap_or(Path::new(".")), folder].map(|path| path.canonicalize().ok());
    let named = RESULTS.into_iter().any(|name| file.ends_with(name));
    named && beside.is_some() && beside == folder
}

/// The folder for the results of one command. Until [`OutputDir::publish`] they lie in a folder
/// within it, which is removed if this is dropped first.
#[derive(Debug)]
pub struct OutputDir {
    path: PathBuf,
    /// Folders that did not exist before, innermost first.
    created: Vec<PathBuf>,
    /// Folder of the unfinished results, created with the first file: a command that is killed
    /// before that leaves no empty folder.
    unfinished: PathBuf,
    begun: bool,
    files: Vec<&'static str>,
    kept: bool,
}

impl OutputDir {
    /// Opens the folder, creating it if it does not exist.
    ///
    /// # Errors
    /// As [`Self::open`], and if a file of the user has the name of a result, which would move it.
    pub fn create(path: &Path) -> Result<Self, InputError> {
        let there = |name: &str| path.join(name).exists();
        match RESULTS.into_iter().find(|name| there(name)) {
            Some(name) if !SIGNS.into_iter().any(there) => {
                Err(InputError::file(&path.join(name), Problem::NoResult))
            }
            _ => Self::open(path),
        }
    }

    /// As [`Self::create`], for files whose names do not occur in results.
    ///
    /// # Errors
    /// If it cannot be created or written, so that a long run does not fail at its end.
    pub fn open(path: &Path) -> Result<Self, InputError> {
        let created: Vec<PathBuf> = path
            .ancestors()
            .take_while(|folder| !folder.as_os_str().is_empty() && !folder.exists())
            .map(Path::to_path_buf)
            .collect();
        let tried = fs::create_dir_all(path)
            .and_then(|()| new_folder(path, "unfinished"))
            .and_then(fs::remove_dir);
        match tried {
            Ok(()) => Ok(Self {
                path: path.to_path_buf(),
                created,
                // A name that no folder has.
                unfinished: path.join("unfinished-0"),
                begun: false,
                files: Vec::new(),
                kept: false,
            }),
            Err(error) => {
                remove_empty(&created);
                Err(InputError::folder(path, &error))
            }
        }
    }

    /// Folders within `path` with unfinished results, in order.
    pub fn unfinished(path: &Path) -> Vec<PathBuf> {
        let number = |entry: &fs::DirEntry| {
            let name = entry.file_name();
            name.to_str()?.strip_prefix("unfinished-")?.parse::<u64>().ok()
        };
        let entries = fs::read_dir(path).into_iter().flatten().filter_map(Result::ok);
        let mut found: Vec<(u64, PathBuf)> =
            entries.filter_map(|entry| Some((number(&entry)?, entry.path()))).collect();
        found.sort();
        found.into_iter().map(|(_, folder)| folder).collect()
    }

    /// Continues in an unfinished folder, which stays until it is published.
    pub fn reopen(path: &Path, unfinished: PathBuf) -> Self {
        let there = |name: &&str| unfinished.join(name).exists();
        let files = RESULTS.into_iter().filter(there).collect();
        let path = path.to_path_buf();
        Self { path, created: Vec::new(), unfinished, begun: true, files, kept: true }
    }

    /// Keeps the unfinished folder even if this is dropped.
    pub fn keep(&mut self) {
        self.kept = true;
    }

    /// The folder of the results before they are published; it exists from the first file on.
    pub fn place(&self) -> &Path {
        &self.unfinished
    }

    /// The folder of the results after they are published.
    pub fn path(&self) -> &Path {
        &self.path
    }

    pub fn file(&mut self, name: &'static str) -> Result<File, InputError> {
        self.add(name)?;
        File::create(self.unfinished.join(name)).map_err(|error| self.unwritable(name, &error))
    }

    /// Writes a whole file. It replaces a file that this command wrote before, which stays until
    /// then.
    pub fn text(&mut self, name: &'static str, text: &str) -> Result<(), InputError> {
        self.add(name)?;
        let (new, whole) =
            (self.unfinished.join(format!("{name}.new")), self.unfinished.join(name));
        let written = fs::write(&new, text).and_then(|()| fs::rename(&new, whole));
        written.map_err(|error| self.unwritable(name, &error))
    }

    /// Writes `scenario.toml` and copies its tables, so that the result can be moved and read anywhere.
    pub fn scenario(&mut self, scenario: &Recorded) -> Result<(), InputError> {
        for (name, table) in &scenario.tables {
            self.add(name)?;
            fs::copy(table, self.unfinished.join(name))
                .map_err(|error| self.unwritable(name, &error))?;
        }
        self.text("scenario.toml", &scenario.text)
    }

    fn add(&mut self, name: &'static str) -> Result<(), InputError> {
        if !self.begun {
            let made = new_folder(&self.path, "unfinished");
            self.unfinished = made.map_err(|error| self.unwritable(name, &error))?;
            self.begun = true;
        }
        if !self.files.contains(&name) {
            self.files.push(name);
        }
        Ok(())
    }

    /// The error for a file of this folder that cannot be written.
    pub fn unwritable(&self, name: &str, error: &io::Error) -> InputError {
        InputError::output(&self.path.join(name), error)
    }

    /// Publishes the results. Returns the new place of an earlier result.
    ///
    /// # Errors
    /// If the system refuses; both results then still exist.
    pub fn publish(mut self) -> Result<Option<PathBuf>, InputError> {
        self.kept = true;
        let earlier = self.put_aside()?;
        self.put()?;
        Ok(earlier)
    }

    /// Publishes the results in place of earlier ones that can be computed again.
    pub fn replace(mut self) -> Result<(), InputError> {
        self.kept = true;
        self.put()
    }

    fn put(&self) -> Result<(), InputError> {
        for name in &self.files {
            fs::rename(self.unfinished.join(name), self.path.join(name))
                .map_err(|error| self.unwritable(name, &error))?;
        }
        // Other files in the folder are the user's.
        let _ = fs::remove_dir(&self.unfinished);
        Ok(())
    }

    /// Moves the results of an earlier command.
    fn put_aside(&self) -> Result<Option<PathBuf>, InputError> {
        let plots = self.files.iter().filter(|name| !RESULTS.contains(name));
        let there = |name: &&&str| fs::symlink_metadata(self.path.join(name)).is_ok();
        let names: Vec<&&str> = RESULTS.iter().chain(plots).filter(there).collect();
        if names.is_empty() {
            return Ok(None);
        }
        let unwritable = |error: io::Error| InputError::output(&self.path, &error);
        let earlier = new_folder(&self.path, "earlier").map_err(unwritable)?;
        for name in names {
            fs::rename(self.path.join(name), earlier.join(name)).map_err(unwritable)?;
        }
        Ok(Some(earlier))
    }

    /// Keeps the unfinished result: a recording cannot be repeated.
    pub fn leave(mut self) -> PathBuf {
        self.kept = true;
        self.unfinished.clone()
    }
}

impl Drop for OutputDir {
    fn drop(&mut self) {
        if !self.kept {
            // A folder that cannot be removed stays: an error cannot be reported from here.
            let _ = fs::remove_dir_all(&self.unfinished);
            remove_empty(&self.created);
        }
    }
}

/// Creates the first folder `NAME-1`, `NAME-2` ... that does not exist.
fn new_folder(parent: &Path, name: &str) -> io::Result<PathBuf> {
    let mut number = 1_u64;
    loop {
        let folder = parent.join(format!("{name}-{number}"));
        match fs::create_dir(&folder) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => number += 1,
            made => return made.map(|()| folder),
        }
    }
}

/// Removes folders, innermost first, as long as they are empty: their content would be the user's.
fn remove_empty(folders: &[PathBuf]) {
    for folder in folders {
        if fs::remove_dir(folder).is_err() {
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    fn result(folder: &Path, files: &[&'static str], text: &str) -> Option<PathBuf> {
        let mut out = OutputDir::create(folder).unwrap();
        for name in files {
            out.text(name, text).unwrap();
        }
        out.publish().unwrap()
    }

    #[test]
    fn an_earlier_result_moves_as_a_whole_and_what_is_not_ours_stays() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("a/b");
        assert_eq!(result(&folder, &["summary.json", "scenario.toml", "trace.csv"], "first"), None);
        fs::write(folder.join("notes.txt"), "mine").unwrap();
        let earlier = result(&folder, &["report.html", "trace.csv", "plot.svg"], "second");
        assert_eq!(earlier, Some(folder.join("earlier-1")));
        let earlier = result(&folder, &["sweep.csv", "plot.svg"], "third");
        assert_eq!(earlier, Some(folder.join("earlier-2")));
        assert_eq!(
            names(&folder),
            ["earlier-1", "earlier-2", "notes.txt", "plot.svg", "sweep.csv"]
        );
        assert_eq!(
            names(&folder.join("earlier-1")),
            ["scenario.toml", "summary.json", "trace.csv"]
        );
        assert_eq!(names(&folder.join("earlier-2")), ["plot.svg", "report.html", "trace.csv"]);
        for (file, text) in [
            ("earlier-1/trace.csv", "first"),
            ("earlier-2/trace.csv", "second"),
            ("earlier-2/plot.svg", "second"),
            ("plot.svg", "third"),
        ] {
            assert_eq!(fs::read_to_string(folder.join(file)).unwrap(), text, "{file}");
        }
    }

    #[test]
    fn files_of_the_user_with_names_of_results_are_not_moved() {
        let place = tempfile::tempdir().unwrap();
        fs::write(place.path().join("scenario.toml"), "mine").unwrap();
        let refused = OutputDir::create(place.path()).unwrap_err().to_string();
        assert!(refused.contains("scenario.toml: belongs to no earlier result"), "{refused}");
        assert_eq!(names(place.path()), ["scenario.toml"]);
    }

    #[test]
    fn what_is_killed_before_its_first_file_leaves_no_empty_folder() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("out");
        let mut killed = OutputDir::create(&folder).unwrap();
        killed.keep();
        drop(killed);
        assert_eq!(names(&folder), [""; 0]);
    }

    #[test]
    fn what_fails_leaves_the_earlier_result_and_what_is_killed_a_trace() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("out");
        result(&folder, &["summary.json"], "first");
        let mut failing = OutputDir::create(&folder).unwrap();
        failing.text("summary.json", "half").unwrap();
        // Two simultaneous commands get two folders.
        let mut killed = OutputDir::create(&folder).unwrap();
        killed.text("trace.csv", "a\n1\n").unwrap();
        drop(failing);
        let left = killed.leave();
        assert_eq!(left, folder.join("unfinished-2"));
        assert_eq!(names(&folder), ["summary.json", "unfinished-2"]);
        result(&folder, &["summary.json"], "second");
        assert_eq!(names(&folder), ["earlier-1", "summary.json", "unfinished-2"]);
        assert_eq!(fs::read_to_string(left.join("trace.csv")).unwrap(), "a\n1\n");
    }
}
