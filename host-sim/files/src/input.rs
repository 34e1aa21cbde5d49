//! Faults of a user's input in one line: file, line, key, value found, allowed values.

use super::shipped;
use std::fmt;
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// A file that cannot be used. Its `Display` is one line:
/// `scenario.toml:12: muscle.zones = -3: must be a whole number from 1 to 64`.
#[derive(Debug, thiserror::Error)]
pub struct InputError {
    /// The file, as the user named it.
    pub file: PathBuf,
    /// The line, from 1, if the problem has one.
    pub line: Option<u64>,
    /// The problem. Boxed, so that a `Result` stays small.
    pub problem: Box<Problem>,
}

/// The problem. The texts follow the file's name and the line.
#[derive(Debug, thiserror::Error)]
pub enum Problem {
    #[error("no such file{}", near.as_ref().map_or_else(String::new, |near| format!("; did you mean {}?", near.display())))]
    NotFound { near: Option<PathBuf> },
    #[error("is a folder; a file is needed")]
    IsFolder,
    #[error("is a file; a folder is needed")]
    IsFile,
    /// A pipe or device: it has no end or cannot be read twice.
    #[error("is a pipe or a device; a regular file is needed")]
    NotRegular,
    /// "-", as other programs name their standard input.
    #[error("standard input is not read: name a file")]
    StandardInput,
    /// TOML in place of a table.
    #[error("is TOML: must be a CSV file, whose first line names the columns")]
    NotCsv,
    /// A readable file that cannot be used.
    #[error("{0}")]
    Unusable(String),
    #[error("has more than {most} bytes: must be at most {} MiB", most >> 20)]
    TooLarge { most: u64 },
    /// The system refuses to read.
    #[error("cannot be read: {0}")]
    Unreadable(String),
    /// The system refuses to write.
    #[error("cannot be written: {0}")]
    Unwritable(String),
    /// The file exists and would be overwritten.
    #[error("exists already, and is left as it is; give another name")]
    Exists,
    /// A file with the name of a result, in a folder without a result.
    #[error(
        "belongs to no earlier result, and this one would move it: give another folder, --out DIR"
    )]
    NoResult,
    /// Another process is at work in the folder.
    #[error("another thermyo is at work in it: wait for it, or choose another folder")]
    AtWork,
    /// The folder belongs to another sweep.
    #[error("is damaged ({0}): run that shard again, into another folder")]
    DamagedStudy(String),
    /// A damaged line in a sweep's table.
    #[error("{}", damaged_line(*more))]
    DamagedRow {
        /// Number of damaged lines below it.
        more: usize,
    },
    /// A table whose columns do not match the sweep beside it.
    #[error("is damaged, or an older program wrote it: the columns must be {columns}")]
    OtherColumns { columns: String },
    #[error("is not UTF-8 text")]
    NotUtf8,
    /// UTF-16 text, as spreadsheets save it by "Unicode text".
    #[error("is UTF-16 text: must be UTF-8")]
    Utf16,
    /// The file of a spreadsheet program (.xlsx, .ods, .xls), or another archive.
    #[error(
        "is a spreadsheet or an archive: must be text; export the sheet as CSV (UTF-8, with commas)"
    )]
    Spreadsheet,
    #[error("is an MCAP file: name the CSV file beside it")]
    Mcap,
    /// The parser's message.
    #[error("not valid TOML: {0}")]
    Syntax(String),
    #[error("unknown key {key}; {instead}")]
    UnknownKey {
        key: String,
        /// The correct name, or the allowed ones.
        instead: Instead,
    },
    #[error("unknown table [{table}]; {instead}")]
    UnknownTable {
        table: String,
        /// The correct name, or the allowed ones.
        instead: Instead,
    },
    /// A value where a table belongs.
    #[error("{table} = {value}: must be a table, [{table}]")]
    NotATable {
        table: String,
        /// The value found instead.
        value: String,
    },
    /// A value of the wrong type, out of range, or inconsistent with another one.
    #[error("{key} = {value}: must be {allowed}")]
    NotAllowed { key: String, value: String, allowed: String },
    /// A key that does not take a number.
    #[error("{key} takes no number: it is {allowed}")]
    NotANumber { key: String, allowed: String },
    /// A missing value that others require.
    #[error("{key} is missing: {why}")]
    Missing {
        key: String,
        /// The key that requires it.
        why: String,
    },
    /// A key that the core does not have.
    #[error("{key}: the core does not know of it, so that it cannot believe otherwise")]
    NotBelieved { key: String },
    /// A key names a file that cannot be opened.
    #[error("{key}: {file}")]
    Reference { key: String, file: InputError },
    /// A table that plant and core do not use.
    #[error("[{table}] is not used: {why}")]
    UnusedTable {
        table: String,
        /// The value that causes this.
        why: &'static str,
    },
    /// A valid value with an unwanted consequence.
    #[error("{key} = {value}: {why}")]
    NoSense { key: String, value: String, why: String },
    #[error("is empty; the first line must name the columns")]
    NoHeader,
    #[error("has no row below the names of the columns")]
    NoRows,
    #[error("{found} in the first line: must be the names of the columns")]
    NotNames { found: String },
    #[error("column {position} has no name")]
    UnnamedColumn {
        /// Number of the column, from 1.
        position: usize,
    },
    #[error("column {column} appears twice")]
    DuplicateColumn { column: String },
    #[error("unknown column {column}; {instead}")]
    UnknownColumn {
        column: String,
        /// The correct name, or the allowed ones.
        instead: Instead,
    },
    #[error("column {column} is missing; the file has {there}")]
    MissingColumn { column: String, there: String },
    /// A table with other separators, as spreadsheets of some countries write it.
    #[error("cells are separated by {found}: must be commas, and numbers need a decimal point")]
    Separator { found: &'static str },
    /// A row with twice as many cells as there are columns.
    #[error(
        "{found} cells in this row: must be {expected}, one per column; are these decimal commas? \
         Numbers need a decimal point"
    )]
    DecimalCommas { found: usize, expected: usize },
    /// A title in the cells above the names.
    #[error(
        "has words in place of numbers: if these are the names of the columns, they must be in the first line"
    )]
    NamesBelow,
    /// Times without measured values.
    #[error("has no column to compare beside {time}; known here: {}", known.join(", "))]
    NothingToCompare {
        time: &'static str,
        /// Columns that can be compared.
        known: Vec<String>,
    },
    /// A required column without any value.
    #[error("column {column} is missing, or empty in every row")]
    NoValues { column: String },
    /// A column with inconsistent values.
    #[error("column {column}: {why}")]
    UnusableColumn {
        column: String,
        /// The requirement that they do not meet.
        why: String,
    },
    /// Fewer measured values than parameters.
    #[error("{points} measured values: must be more than the {parameters} parameters to fit")]
    TooFewPoints {
        /// Number of measured values in the compared columns.
        points: usize,
        parameters: usize,
    },
    /// A record with stops, whose values come from each stop by itself, and another one to compare it with.
    #[error(
        "has stops, which are not fitted to a course that another record could be compared with: identify the other record \
         too, and compare the values"
    )]
    StopsAlone,
    /// A static map with too few loaded readings.
    #[error(
        "{found} {} with a force above 1 % of the largest: must be at least {fewest}; {why}",
        if *found == 1 { "reading" } else { "readings" }
    )]
    TooFewLoaded {
        found: usize,
        fewest: usize,
        /// Purpose of the readings, or advice.
        why: String,
    },
    /// A muscle whose force would rise as it contracts.
    #[error(
        "column direction seems the wrong way round: friction would be {friction_n:.1} N. 1 is come to by \
         contracting, -1 by lengthening"
    )]
    Backwards { friction_n: f64 },
    /// A folder without the required measurements.
    #[error(
        "there is no muscle_static/*.csv, gas_spring/upper_2022-01-28.csv, hyddown/air_discharge.csv, dynamic/*.csv \
         or motion/*.csv in it; docs/background/validation.md lists their sources"
    )]
    NoTruth,
    /// A file that ends within a line: the rest of the value is unknown.
    #[error("the last line has no end: it may be cut")]
    CutLine,
    /// Quotation marks without an end: they may enclose the rest of the file.
    #[error("a quotation mark is not closed")]
    OpenQuote,
    /// A row that is longer or shorter than the header.
    #[error("{found} cells in this row: must be {expected}, one per column")]
    CellCount { found: usize, expected: usize },
    /// A cell with a wrong value.
    #[error("column {column} = {value}: must be {allowed}")]
    Cell {
        column: String,
        /// The value as written in the file.
        value: String,
        allowed: String,
    },
}

fn damaged_line(more: usize) -> String {
    match more {
        0 => "does not match its checksum".to_owned(),
        1 => "does not match its checksum, nor does a line below it".to_owned(),
        more => format!("does not match its checksum, nor do {more} lines below it"),
    }
}

/// Suggestion in place of an unknown name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Instead {
    /// Names that the user may have meant.
    Near(Vec<String>),
    /// All possible names, as none is similar.
    Known(Vec<String>),
}

impl fmt::Display for Instead {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Near(names) => write!(f, "did you mean {}?", names.join(" or ")),
            Self::Known(names) if names.is_empty() => f.write_str("nothing is known here"),
            Self::Known(names) => write!(f, "known here: {}", names.join(", ")),
        }
    }
}

impl InputError {
    pub fn file(file: &Path, problem: Problem) -> Self {
        Self { file: file.to_path_buf(), line: None, problem: Box::new(problem) }
    }

    pub fn line(file: &Path, line: u64, problem: Problem) -> Self {
        Self { file: file.to_path_buf(), line: Some(line), problem: Box::new(problem) }
    }

    pub fn folder(path: &Path, error: &io::Error) -> Self {
        match path.ancestors().find(|part| part.exists()) {
            Some(there) if !there.is_dir() => Self::file(there, Problem::IsFile),
            _ => Self::output(path, error),
        }
    }

    pub fn output(file: &Path, error: &io::Error) -> Self {
        Self::file(file, Problem::Unwritable(error.to_string()))
    }
}

impl fmt::Display for InputError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:", self.file.display())?;
        if let Some(line) = self.line {
            write!(f, "{line}:")?;
        }
        write!(f, " {}", self.problem)
    }
}

/// Largest size of a table or a record: an hour of every step has about 1.3e9 bytes.
const LARGEST_TABLE: u64 = 2 << 30;
/// Largest size of a scenario or another text file of keys.
const LARGEST_TEXT: u64 = 16 << 20;

/// Reads a whole table or record. A missing file that is [shipped] comes from the program.
///
/// # Errors
/// If it is missing, no regular file, larger than 2 GiB or unreadable.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, InputError> {
    read_at_most(path, LARGEST_TABLE)
}

/// Reads a whole text file of at most 16 MiB, as [`read_bytes`], without its byte order mark.
pub fn read_text(path: &Path) -> Result<String, InputError> {
    let bytes = read_at_most(path, LARGEST_TEXT)?;
    if let Some(problem) = not_text(&bytes) {
        return Err(InputError::file(path, problem));
    }
    match String::from_utf8(bytes) {
        Ok(text) => Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text)),
        Err(error) => {
            let valid = error.utf8_error().valid_up_to();
            let line = line_of(&error.as_bytes()[..valid]);
            Err(InputError::line(path, line, Problem::NotUtf8))
        }
    }
}

fn read_at_most(path: &Path, most: u64) -> Result<Vec<u8>, InputError> {
    if let Some(text) = shipped::instead_of(path) {
        return Ok(text.into());
    }
    let because = |problem| InputError::file(path, problem);
    let unreadable = |error: io::Error| {
        because(match error.kind() {
            io::ErrorKind::NotFound => Problem::NotFound { near: similar(path) },
            _ => Problem::Unreadable(error.to_string()),
        })
    };
    if path.as_os_str() == "-" {
        return Err(because(Problem::StandardInput));
    }
    // Checked before opening: opening a pipe waits until something is written to it.
    let about = fs::metadata(path).map_err(unreadable)?;
    if about.is_dir() {
        return Err(because(Problem::IsFolder));
    }
    if !about.is_file() {
        return Err(because(Problem::NotRegular));
    }
    if about.len() > most {
        return Err(because(Problem::TooLarge { most }));
    }
    let mut bytes = Vec::with_capacity(about.len() as usize);
    // The file may grow while it is read.
    let read = File::open(path).and_then(|file| file.take(most + 1).read_to_end(&mut bytes));
    read.map_err(unreadable)?;
    if bytes.len() as u64 > most {
        return Err(because(Problem::TooLarge { most }));
    }
    // Lines that end with CR alone, as spreadsheets save them in "CSV (Macintosh)".
    if !bytes.contains(&b'\n') {
        bytes.iter_mut().filter(|byte| **byte == b'\r').for_each(|byte| *byte = b'\n');
    }
    Ok(bytes)
}

/// The file beside `path`, or the shipped scenario, of which its name may be a misspelling.
fn similar(path: &Path) -> Option<PathBuf> {
    let name = path.file_name()?.to_str()?;
    let folder = path.parent()?;
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let files = fs::read_dir(here).into_iter().flatten().flatten();
    let files = files.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_file()));
    let mut names: Vec<String> =
        files.filter_map(|entry| entry.file_name().into_string().ok()).collect();
    names.sort();
    let beside = nearest(name, names.iter().map(String::as_str)).map(|near| folder.join(near));
    let of_shipped = ["", "scenarios"].map(Path::new).contains(&folder);
    beside.or_else(|| {
        let near = nearest(name, shipped::names().filter(|_| of_shipped))?;
        Some(Path::new("scenarios").join(near))
    })
}

/// The problem of bytes whose beginning shows that they are not UTF-8 text.
pub(crate) fn not_text(bytes: &[u8]) -> Option<Problem> {
    const ZIP: &[u8] = b"PK\x03\x04";
    const OLD_EXCEL: &[u8] = &[0xd0, 0xcf, 0x11, 0xe0];
    const MCAP: &[u8] = b"\x89MCAP0\r\n";
    if bytes.starts_with(ZIP) || bytes.starts_with(OLD_EXCEL) {
        return Some(Problem::Spreadsheet);
    }
    if bytes.starts_with(MCAP) {
        return Some(Problem::Mcap);
    }
    is_utf16(bytes).then_some(Problem::Utf16)
}

/// Whether bytes are UTF-16: they begin with a byte order mark, or one byte of each of the first
/// two letters is zero, as in Latin text.
pub fn is_utf16(bytes: &[u8]) -> bool {
    const UTF16_LE: [bool; 4] = [false, true, false, true];
    const UTF16_BE: [bool; 4] = [true, false, true, false];
    match bytes {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => true,
        [a, b, c, d, ..] => matches!([*a, *b, *c, *d].map(|byte| byte == 0), UTF16_LE | UTF16_BE),
        _ => false,
    }
}

/// Checks that a file does not exist, before long work begins.
pub fn is_new(path: &Path) -> Result<(), InputError> {
    if path.exists() { Err(InputError::file(path, Problem::Exists)) } else { Ok(()) }
}

/// Writes a file that does not exist yet, and creates its folder. A partly written file is removed.
pub fn write_new(path: &Path, content: impl AsRef<[u8]>) -> Result<(), InputError> {
    is_new(path)?;
    let mut options = fs::OpenOptions::new();
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let written = folder
        .map_or(Ok(()), fs::create_dir_all)
        .and_then(|()| options.write(true).create_new(true).open(path))
        .and_then(|mut file| {
            let written = file.write_all(content.as_ref());
            written.or_else(|error| fs::remove_file(path).and(Err(error)))
        });
    written.map_err(|error| InputError::output(path, &error))
}

/// The line, from 1, that begins after `before`.
pub fn line_of(before: &[u8]) -> u64 {
    1 + before.iter().filter(|byte| **byte == b'\n').count() as u64
}

/// Starts of the lines of a text, so that finding many positions does not count from the start each time.
#[derive(Debug)]
pub struct Lines {
    starts: Vec<usize>,
}

impl Lines {
    pub fn of(text: &str) -> Self {
        let ends = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n');
        Self { starts: ends.map(|(end, _)| end + 1).collect() }
    }

    /// The line, from 1, of a byte of the text.
    pub fn line_at(&self, offset: usize) -> u64 {
        1 + self.starts.partition_point(|start| *start <= offset) as u64
    }
}

/// A piece of the user's text, shortened for quoting in a one-line message.
pub fn quoted(text: &str) -> String {
    const LONGEST: usize = 60;
    let mut quoted = String::new();
    for (count, c) in text.trim().chars().enumerate() {
        if count == LONGEST {
            quoted.push_str("...");
            break;
        }
        if c.is_control() { quoted.extend(c.escape_default()) } else { quoted.push(c) }
    }
    quoted
}

/// The name among `known` of which `word` may be a misspelling: a few letters off, or without the unit.
pub fn nearest<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // Three letters in ten may be wrong, and at least one in words of any length.
    let most = (word.chars().count() * 3 / 10).max(1);
    let word = word.to_lowercase();
    known
        .into_iter()
        .filter_map(|name| {
            let without_unit = word.len() >= 3 && name.starts_with(&word);
            let distance = strsim::damerau_levenshtein(&word, name);
            (without_unit || distance <= most).then_some((distance.min(most), name))
        })
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_one_line() {
        let problem = Problem::NotAllowed {
            key: "muscle.zones".into(),
            value: quoted("-3"),
            allowed: "a whole number from 1 to 64".into(),
        };
        let error = InputError::line(Path::new("scenario.toml"), 12, problem);
        assert_eq!(
            error.to_string(),
            "scenario.toml:12: muscle.zones = -3: must be a whole number from 1 to 64"
        );
        let missing = InputError::file(Path::new("a.csv"), Problem::NotFound { near: None });
        assert_eq!(missing.to_string(), "a.csv: no such file");
    }

    #[test]
    fn quotes_stay_short_and_on_the_line() {
        assert_eq!(quoted(" a\nb\u{1b} "), "a\\nb\\u{1b}");
        assert_eq!(quoted(&"x".repeat(1000)).len(), 63);
    }

    #[test]
    fn only_regular_files_up_to_a_size_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scenario.toml");
        let file = File::create(&path).unwrap();
        file.set_len(LARGEST_TEXT).unwrap();
        assert_eq!(read_text(&path).unwrap().len() as u64, LARGEST_TEXT);
        file.set_len(LARGEST_TEXT + 1).unwrap();
        let said = read_text(&path).unwrap_err().to_string();
        let expected = "has more than 16777216 bytes: must be at most 16 MiB";
        assert_eq!(said, format!("{}: {expected}", path.display()));
        assert_eq!(read_bytes(&path).unwrap().len() as u64, LARGEST_TEXT + 1);
        file.set_len(LARGEST_TABLE + 1).unwrap();
        let said = read_bytes(&path).unwrap_err().to_string();
        assert!(said.ends_with("must be at most 2048 MiB"), "{said}");
        let said = read_bytes(folder.path()).unwrap_err().to_string();
        assert!(said.ends_with("is a folder; a file is needed"), "{said}");
    }

    #[test]
    fn a_byte_is_on_the_line_that_counting_gives() {
        let text = "\na\r\n\nbc\n";
        let lines = Lines::of(text);
        for offset in 0..=text.len() {
            assert_eq!(lines.line_at(offset), line_of(&text.as_bytes()[..offset]), "byte {offset}");
        }
    }

    #[test]
    fn a_lone_carriage_return_ends_a_line_where_no_line_feed_does() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        for (text, read) in [("a\r1\r", "a\n1\n"), ("a\r\n1\r2", "a\r\n1\r2")] {
            fs::write(&path, text).unwrap();
            assert_eq!(read_text(&path).unwrap(), read);
        }
    }

    #[test]
    fn slips_are_recognised() {
        let known = ["duration_s", "step_s", "seed", "pressure_pa"];
        for (word, name) in [
            ("duration", Some("duration_s")),
            ("pressure", Some("pressure_pa")),
            ("Seed", Some("seed")),
            ("setp_s", Some("step_s")),
            ("sede", Some("seed")),
            ("colour", None),
            ("", None),
        ] {
            assert_eq!(nearest(word, known), name, "{word}");
        }
    }
}
