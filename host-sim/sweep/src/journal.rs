//! Finished points, kept in the results folder until all are there, so that a killed sweep can continue.
//!
//! ```text
//! DIR/unfinished-N/study.json      label: only the same sweep continues from it
//!                  scenario.toml   ... in full
//!                  sweep.csv       a row per point that is done, in the order in which they were done
//!                  begun.txt       a line per point that was begun; locked by the running process
//! ```

use super::study::Label;
use super::{Point, Study};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use thermyo_files::input::{InputError, Problem, read_bytes, read_text};
use thermyo_files::output::OutputDir;

const LABEL: &str = "study.json";
const SCENARIO: &str = "scenario.toml";
const TABLE: &str = "sweep.csv";
const BEGUN: &str = "begun.txt";
/// Largest number of points that a message lists.
const MOST_NAMED: usize = 3;

#[derive(Debug)]
pub struct Journal {
    out: OutputDir,
    table: Mutex<File>,
    begun: Mutex<File>,
}

/// State found in the folder.
#[derive(Debug, Default)]
pub struct Kept {
    pub rows: Vec<Point>,
    /// Points that were begun but not finished when the sweep ended.
    pub died: Vec<usize>,
    /// Damage of the table; its points are run again.
    pub damage: Option<InputError>,
}

impl Kept {
    /// Message to the user, if earlier points were found.
    pub fn text(&self, study: &Study) -> Option<String> {
        if self.rows.is_empty() && self.died.is_empty() && self.damage.is_none() {
            return None;
        }
        let mut text =
            format!("{} of {} points were done and are kept", self.rows.len(), study.own().len());
        if !self.died.is_empty() {
            text += &format!("; at work when it ended: {}", named(study, &self.died));
        }
        if let Some(damage) = &self.damage {
            text += &format!("; what is damaged is run again: {damage}");
        }
        Some(text)
    }
}

/// The first of these points with their values.
fn named(study: &Study, points: &[usize]) -> String {
    let one = |point: &usize| format!("point {} ({})", point + 1, study.values_text(*point));
    let first: Vec<String> = points.iter().take(MOST_NAMED).map(one).collect();
    match points.len().saturating_sub(MOST_NAMED) {
        0 => first.join(", "),
        more => format!("{} and {more} more", first.join(", ")),
    }
}

impl Journal {
    /// Continues this study's sweep in the folder, or begins one.
    ///
    /// # Errors
    /// If the folder cannot be written, or another process runs the same study in it.
    pub fn open(folder: &Path, study: &Study) -> Result<(Self, Kept), InputError> {
        let label = study.label();
        // A folder with a damaged label belongs to an unknown study, not to this one.
        let same =
            |place: &PathBuf| read_label(place).is_ok_and(|found| found.as_ref() == Some(&label));
        if let Some(unfinished) = OutputDir::unfinished(folder).into_iter().find(same) {
            return Self::resume(folder, unfinished, study);
        }
        let Table { rows, damage } = match same(&folder.to_path_buf()) {
            true => Table::read(folder, study),
            false => Table::default(),
        };
        let mut out = OutputDir::create(folder)?;
        out.keep();
        out.text(SCENARIO, &study.scenario)?;
        out.text(TABLE, &table(study, &rows))?;
        let begun = lock(out.place())?;
        // Written last: a folder without a label belongs to no study.
        out.text(LABEL, &study.label_text())?;
        let table = append(&out.place().join(TABLE))?;
        let journal = Self { out, table: Mutex::new(table), begun: Mutex::new(begun) };
        Ok((journal, Kept { rows, died: Vec::new(), damage }))
    }

    fn resume(
        folder: &Path,
        unfinished: PathBuf,
        study: &Study,
    ) -> Result<(Self, Kept), InputError> {
        let begun = lock(&unfinished)?;
        let Table { rows, damage } = Table::read(&unfinished, study);
        let done: BTreeSet<usize> = rows.iter().map(|row| row.point).collect();
        let text = fs::read_to_string(unfinished.join(BEGUN)).unwrap_or_default();
        let numbers = text.lines().filter_map(|line| line.parse::<usize>().ok()?.checked_sub(1));
        let died: BTreeSet<usize> = numbers.filter(|point| !done.contains(point)).collect();
        let mut out = OutputDir::reopen(folder, unfinished);
        // Drops a truncated row.
        out.text(TABLE, &table(study, &rows))?;
        let table = append(&out.place().join(TABLE))?;
        let journal = Self { out, table: Mutex::new(table), begun: Mutex::new(begun) };
        Ok((journal, Kept { rows, died: died.into_iter().collect(), damage }))
    }

    /// Records that a point begins.
    pub fn begin(&self, point: usize) -> io::Result<()> {
        write(&self.begun, &format!("{}\n", point + 1))
    }

    /// Records a finished point.
    pub fn add(&self, study: &Study, row: &Point) -> io::Result<()> {
        write(&self.table, &(study.csv_row(row) + "\n"))
    }

    /// Folder of the unfinished results.
    pub fn place(&self) -> &Path {
        self.out.place()
    }

    /// Closes the journal when all points are done; files written into the folder now are published
    /// with it.
    pub fn close(self) -> OutputDir {
        // The other files are closed before the folder moves.
        let Self { out, .. } = self;
        let _ = fs::remove_file(out.place().join(BEGUN));
        out
    }
}

/// Writes in one call: a killed process leaves whole lines, or truncates only the last one.
fn write(file: &Mutex<File>, line: &str) -> io::Result<()> {
    file.lock().unwrap_or_else(PoisonError::into_inner).write_all(line.as_bytes())
}

fn append(file: &Path) -> Result<File, InputError> {
    let opened = OpenOptions::new().append(true).create(true).open(file);
    opened.map_err(|error| InputError::output(file, &error))
}

/// Locks the folder: two processes in it would do everything twice.
fn lock(unfinished: &Path) -> Result<File, InputError> {
    let file = append(&unfinished.join(BEGUN))?;
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Err(InputError::file(unfinished, Problem::AtWork)),
        // Some file systems have no locks.
        Ok(()) | Err(TryLockError::Error(_)) => Ok(file),
    }
}

/// Label of a folder's results; none if there is no label.
fn read_label(folder: &Path) -> Result<Option<Label>, InputError> {
    let file = folder.join(LABEL);
    if !file.exists() {
        return Ok(None);
    }
    serde_json::from_str(&read_text(&file)?)
        .map(Some)
        .map_err(|error| damaged(&file, &error.to_string()))
}

fn damaged(label: &Path, why: &str) -> InputError {
    InputError::file(label, Problem::DamagedStudy(why.to_owned()))
}

fn table(study: &Study, rows: &[Point]) -> String {
    let mut text = study.csv_header() + "\n";
    for row in rows {
        text = text + &study.csv_row(row) + "\n";
    }
    text
}

#[derive(Default)]
struct Table {
    /// Intact rows of this study, each once.
    rows: Vec<Point>,
    damage: Option<InputError>,
}

impl Table {
    /// A last row without its end was truncated by a kill, and does not count as damage.
    fn read(folder: &Path, study: &Study) -> Self {
        let file = folder.join(TABLE);
        let bytes = match read_bytes(&file) {
            Ok(bytes) => bytes,
            Err(error) => return Self { rows: Vec::new(), damage: Some(error) },
        };
        let text = String::from_utf8_lossy(&bytes);
        let mut lines = (1..).zip(text.split_inclusive('\n'));
        let columns = study.csv_header();
        if lines.next().and_then(|(_, line)| line.strip_suffix('\n')) != Some(columns.as_str()) {
            let problem = Problem::OtherColumns { columns };
            return Self { rows: Vec::new(), damage: Some(InputError::line(&file, 1, problem)) };
        }
        let whole = lines.filter_map(|(number, line)| Some((number, line.strip_suffix('\n')?)));
        let (mut seen, mut rows, mut damaged) = (BTreeSet::new(), Vec::new(), Vec::new());
        for (number, line) in whole {
            match study.read_row(line) {
                Some(row) if seen.insert(row.point) => rows.push(row),
                Some(_) => {}
                None => damaged.push(number),
            }
        }
        let damage = damaged.first().map(|line| {
            InputError::line(&file, *line, Problem::DamagedRow { more: damaged.len() - 1 })
        });
        Self { rows, damage }
    }
}

/// Reason why folders cannot be merged.
#[derive(Debug, thiserror::Error)]
pub enum MergeError {
    #[error("--merge {0}: no folder of a sweep: it has no {LABEL}, nor has an unfinished-N in it")]
    NoSweep(String),
    #[error(
        "--merge {0}: not the same sweep as in {1}: program, scenario, --vary and --lhs must be the same"
    )]
    Other(String, String),
    #[error(
        "--merge {0}: point {1} has another result than in a folder before it: they cannot both be right"
    )]
    Conflict(String, usize),
    #[error(
        "{count} of {of} points are missing: {named}; run the shards again that are not finished"
    )]
    Missing {
        /// Number of missing points.
        count: usize,
        /// Number of all points.
        of: usize,
        /// The first missing points with their values.
        named: String,
    },
    #[error("{0}; run that shard again: what is whole is kept")]
    Damaged(InputError),
    #[error(transparent)]
    Input(#[from] InputError),
}

/// All points of the whole sweep, in order, from the folders of its shards, finished or not.
pub fn merge(folders: &[PathBuf]) -> Result<(Study, Vec<Point>), MergeError> {
    let mut whole: Option<(Label, Study)> = None;
    let mut rows: BTreeMap<usize, Point> = BTreeMap::new();
    for folder in folders {
        let name = folder.display().to_string();
        let places = [vec![folder.clone()], OutputDir::unfinished(folder)].concat();
        let labelled = |place: PathBuf| Ok(read_label(&place)?.map(|label| (place, label)));
        let found = places.into_iter().filter_map(|place| labelled(place).transpose());
        let found = found.collect::<Result<Vec<(PathBuf, Label)>, InputError>>()?;
        if found.is_empty() {
            return Err(MergeError::NoSweep(name));
        }
        let mut used = false;
        for (place, mut label) in found {
            // The label of the whole sweep, without a shard.
            label.shard.clear();
            if whole.is_none() {
                let scenario = read_text(&place.join(SCENARIO))?;
                let study = Study::of_label(&label, scenario);
                let study =
                    study.map_err(|error| damaged(&place.join(LABEL), &error.to_string()))?;
                whole = Some((label.clone(), study));
            }
            let Some((_, study)) = whole.as_ref().filter(|(of, _)| *of == label) else { continue };
            used = true;
            let table = Table::read(&place, study);
            if let Some(damage) = table.damage {
                return Err(MergeError::Damaged(damage));
            }
            for row in table.rows {
                let text = study.csv_row(&row);
                let before = rows.entry(row.point).or_insert(row);
                if study.csv_row(before) != text {
                    return Err(MergeError::Conflict(name, before.point + 1));
                }
            }
        }
        if !used {
            return Err(MergeError::Other(name, folders[0].display().to_string()));
        }
    }
    let Some((_, study)) = whole else { return Err(MergeError::NoSweep(String::new())) };
    let missing: Vec<usize> = study.own().into_iter().filter(|p| !rows.contains_key(p)).collect();
    if !missing.is_empty() {
        let (count, of) = (missing.len(), study.plan.points());
        return Err(MergeError::Missing { count, of, named: named(&study, &missing) });
    }
    Ok((study, rows.into_values().collect()))
}
