//! What is wrong with a user's input, said in one line: file, line, key, value found, what is
//! allowed.

use super::shipped;
use std::fmt;
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// A file that cannot be used as it is. Its `Display` is one line:
/// `scenario.toml:12: muscle.zones = -3: must be a whole number from 1 to 64`.
#[derive(Debug, thiserror::Error)]
pub struct InputError {
    /// The file, as the user named it.
    pub file: PathBuf,
    /// The line, from 1, where one is to blame.
    pub line: Option<u64>,
    /// What is wrong there. Boxed, so that a `Result` stays small.
    pub problem: Box<Problem>,
}

/// What is wrong. The texts follow the file's name and the line.
#[derive(Debug, thiserror::Error)]
pub enum Problem {
    /// The file does not exist.
    #[error("no such file")]
    NotFound,
    /// A folder is not a file.
    #[error("is a folder; a file is needed")]
    IsFolder,
    /// A file is no folder.
    #[error("is a file; a folder is needed")]
    IsFile,
    /// Nothing that has an end and can be read twice.
    #[error("is a pipe or a device; a regular file is needed")]
    NotRegular,
    /// It would fill the memory.
    #[error("has more than {most} bytes: must be at most {} MiB", most >> 20)]
    TooLarge {
        /// Bytes that it may have.
        most: u64,
    },
    /// The system refuses to read.
    #[error("cannot be read: {0}")]
    Unreadable(String),
    /// The system refuses to write.
    #[error("cannot be written: {0}")]
    Unwritable(String),
    /// The file is there, and would be lost.
    #[error("exists already, and is left as it is; give another name")]
    Exists,
    /// Somebody else has it.
    #[error("another thermyo is at work in it: wait for it, or choose another folder")]
    AtWork,
    /// What a folder of a sweep says of itself.
    #[error("says no sweep ({0}): run that shard again, into another folder")]
    DamagedStudy(String),
    /// A line of a sweep's table that is not as it was written.
    #[error("{}", damaged_line(*more))]
    DamagedRow {
        /// Lines below it that are damaged too.
        more: usize,
    },
    /// A table whose columns are not those of the sweep beside it.
    #[error("is damaged, or an older program wrote it: the columns must be {columns}")]
    OtherColumns {
        /// Their names.
        columns: String,
    },
    /// Bytes that are no text.
    #[error("is not UTF-8 text")]
    NotUtf8,
    /// Text of two bytes a letter, as spreadsheets save it by "Unicode text".
    #[error("is UTF-16 text: must be UTF-8")]
    Utf16,
    /// The parser's own words.
    #[error("not valid TOML: {0}")]
    Syntax(String),
    /// A key that no table has.
    #[error("unknown key {key}; {instead}")]
    UnknownKey {
        /// Its whole path.
        key: String,
        /// What to write instead.
        instead: Instead,
    },
    /// A table that no scenario has.
    #[error("unknown table [{table}]; {instead}")]
    UnknownTable {
        /// Its whole path.
        table: String,
        /// What to write instead.
        instead: Instead,
    },
    /// A value where a table belongs.
    #[error("{table} = {value}: must be a table, [{table}]")]
    NotATable {
        /// The table's path.
        table: String,
        /// What is there instead.
        value: String,
    },
    /// A value of the wrong type, out of range, or at odds with another one.
    #[error("{key} = {value}: must be {allowed}")]
    NotAllowed {
        /// Its whole path.
        key: String,
        /// As it is written in the file.
        value: String,
        /// What it may be.
        allowed: String,
    },
    /// A key that takes no number, where one is given.
    #[error("{key} takes no number: it is {allowed}")]
    NotANumber {
        /// Its whole path.
        key: String,
        /// What it may be.
        allowed: String,
    },
    /// A value that others make necessary.
    #[error("{key} is missing: {why}")]
    Missing {
        /// Its whole path.
        key: String,
        /// What needs it.
        why: String,
    },
    /// Something that the core is never configured with.
    #[error("{key}: the core does not know of it, so that it cannot believe otherwise")]
    NotBelieved {
        /// Its whole path.
        key: String,
    },
    /// A key names a file that cannot be opened.
    #[error("{key}: {file}")]
    Reference {
        /// The key.
        key: String,
        /// What is wrong with the file.
        file: InputError,
    },
    /// A table of keys that nothing looks at.
    #[error("[{table}] is not used: {why}")]
    UnusedTable {
        /// Its whole path.
        table: String,
        /// The value that decides so.
        why: &'static str,
    },
    /// A value that is allowed, and of which nothing good follows.
    #[error("{key} = {value}: {why}")]
    NoSense {
        /// Its whole path.
        key: String,
        /// As it is written in the file.
        value: String,
        /// What follows.
        why: String,
    },
    /// A table without its first line.
    #[error("is empty; the first line must name the columns")]
    NoHeader,
    /// A table without rows.
    #[error("has no row below the names of the columns")]
    NoRows,
    /// A first line that is no names.
    #[error("{found} in the first line: must be the names of the columns")]
    NotNames {
        /// What stands there.
        found: String,
    },
    /// A column without a name.
    #[error("column {position} has no name")]
    UnnamedColumn {
        /// From 1.
        position: usize,
    },
    /// Two columns of one name.
    #[error("column {column} appears twice")]
    DuplicateColumn {
        /// The name.
        column: String,
    },
    /// A column that nothing is known about.
    #[error("unknown column {column}; {instead}")]
    UnknownColumn {
        /// The name.
        column: String,
        /// What to write instead.
        instead: Instead,
    },
    /// A column that has to be there.
    #[error("column {column} is missing; the file has {there}")]
    MissingColumn {
        /// The name.
        column: String,
        /// The columns that the file has instead.
        there: String,
    },
    /// A table of another kind, as spreadsheets of some countries write it.
    #[error("cells are separated by {found}: must be commas, and numbers need a decimal point")]
    Separator {
        /// What stands between the cells.
        found: &'static str,
    },
    /// A row with twice as many cells as there are columns.
    #[error(
        "{found} cells in this row: must be {expected}, one per column; are these decimal commas? \
         Numbers need a decimal point"
    )]
    DecimalCommas {
        /// How many cells the row has.
        found: usize,
        /// How many columns there are.
        expected: usize,
    },
    /// Times without anything measured.
    #[error("has no column to compare beside {time}; known here: {}", known.join(", "))]
    NothingToCompare {
        /// The column of times.
        time: &'static str,
        /// Columns that can be compared.
        known: Vec<String>,
    },
    /// A column that is needed and says nothing.
    #[error("column {column} is missing, or empty in every row")]
    NoValues {
        /// The name.
        column: String,
    },
    /// A column whose values cannot be used together.
    #[error("column {column}: {why}")]
    UnusableColumn {
        /// The name.
        column: String,
        /// What they would have to be.
        why: String,
    },
    /// Less is measured than is asked for.
    #[error("{points} measured values: must be more than the {parameters} parameters to fit")]
    TooFewPoints {
        /// Measured values in the columns that are compared.
        points: usize,
        /// Parameters to fit.
        parameters: usize,
    },
    /// A record over time, where a static map is needed.
    #[error("is no static map: there is no other one to compare it with")]
    NoMap,
    /// A static map that hardly pulls.
    #[error(
        "{found} {} with a force above 1 % of the largest: must be at least {fewest}; {why}",
        if *found == 1 { "reading" } else { "readings" }
    )]
    TooFewLoaded {
        /// Loaded readings.
        found: usize,
        /// Fewest.
        fewest: usize,
        /// What they are for, or what to do.
        why: String,
    },
    /// A muscle that would pull more while it contracts.
    #[error(
        "column direction seems the wrong way round: friction would be {friction_n:.1} N. 1 is come to by \
         contracting, -1 by lengthening"
    )]
    Backwards {
        /// What the readings say \[N\].
        friction_n: f64,
    },
    /// A folder of what others have measured that has nothing of it.
    #[error(
        "there is no muscle_static/*.csv, gas_spring/upper_2022-01-28.csv or hyddown/air_discharge.csv in it; \
         docs/background/validation.md says where they are from"
    )]
    NoTruth,
    /// A file that ends within a line: what it would have said cannot be known.
    #[error("the last line has no end: it may be cut")]
    CutLine,
    /// Quotation marks without an end: what is within may be the rest of the file.
    #[error("a quotation mark is not closed")]
    OpenQuote,
    /// A row that is longer or shorter than the first line.
    #[error("{found} cells in this row: must be {expected}, one per column")]
    CellCount {
        /// How many cells the row has.
        found: usize,
        /// How many columns there are.
        expected: usize,
    },
    /// A cell with a wrong value.
    #[error("column {column} = {value}: must be {allowed}")]
    Cell {
        /// The column's name.
        column: String,
        /// As it is written in the file.
        value: String,
        /// What it may be.
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

/// What to write in place of an unknown name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Instead {
    /// Names that the user may have meant.
    Near(Vec<String>),
    /// Nothing is near: all names that are possible in this place.
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
    /// A problem of a whole file.
    pub fn file(file: &Path, problem: Problem) -> Self {
        Self { file: file.to_path_buf(), line: None, problem: Box::new(problem) }
    }

    /// A problem of one line, counted from 1.
    pub fn line(file: &Path, line: u64, problem: Problem) -> Self {
        Self { file: file.to_path_buf(), line: Some(line), problem: Box::new(problem) }
    }

    /// A folder that cannot be made.
    pub fn folder(path: &Path, error: &io::Error) -> Self {
        match path.ancestors().find(|part| part.exists()) {
            Some(there) if !there.is_dir() => Self::file(there, Problem::IsFile),
            _ => Self::output(path, error),
        }
    }

    /// A file that cannot be written.
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

/// Most bytes of a table or a record: an hour of every step has some 1.3e9.
const LARGEST_TABLE: u64 = 2 << 30;
/// Most bytes of a scenario or another text of keys.
const LARGEST_TEXT: u64 = 16 << 20;

/// Reads a whole table or record; of the [shipped] ones what the program has, where they are not there.
///
/// # Errors
/// When it is missing, no regular file, larger than 2 GiB or unreadable.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, InputError> {
    read_at_most(path, LARGEST_TABLE)
}

/// Reads a whole text of keys, of 16 MiB at most, as [`read_bytes`]. A byte order mark at its start is dropped.
///
/// # Errors
/// As [`read_bytes`], and when it is not UTF-8.
pub fn read_text(path: &Path) -> Result<String, InputError> {
    let bytes = read_at_most(path, LARGEST_TEXT)?;
    if is_utf16(&bytes) {
        return Err(InputError::file(path, Problem::Utf16));
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
            io::ErrorKind::NotFound => Problem::NotFound,
            _ => Problem::Unreadable(error.to_string()),
        })
    };
    // Before it is opened: opening a pipe waits until something is written to it.
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
    // It may grow while it is read.
    let read = File::open(path).and_then(|file| file.take(most + 1).read_to_end(&mut bytes));
    read.map_err(unreadable)?;
    if bytes.len() as u64 > most { Err(because(Problem::TooLarge { most })) } else { Ok(bytes) }
}

/// Whether bytes are text of two bytes a letter: by their byte order mark, or because of the first two letters one byte
/// each is zero, as of every Latin one.
pub fn is_utf16(bytes: &[u8]) -> bool {
    const UTF16_LE: [bool; 4] = [false, true, false, true];
    const UTF16_BE: [bool; 4] = [true, false, true, false];
    match bytes {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => true,
        [a, b, c, d, ..] => matches!([*a, *b, *c, *d].map(|byte| byte == 0), UTF16_LE | UTF16_BE),
        _ => false,
    }
}

/// Whether there is no such file: what takes long asks before it begins.
///
/// # Errors
/// When it exists.
pub fn is_new(path: &Path) -> Result<(), InputError> {
    if path.exists() { Err(InputError::file(path, Problem::Exists)) } else { Ok(()) }
}

/// Writes a file that does not exist yet, and the folder that it is in.
///
/// # Errors
/// When it exists, or cannot be written.
pub fn write_new(path: &Path, content: impl AsRef<[u8]>) -> Result<(), InputError> {
    is_new(path)?;
    let mut options = std::fs::OpenOptions::new();
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let written = folder
        .map_or(Ok(()), std::fs::create_dir_all)
        .and_then(|()| options.write(true).create_new(true).open(path))
        .and_then(|mut file| file.write_all(content.as_ref()));
    written.map_err(|error| InputError::output(path, &error))
}

/// The line, from 1, in which what follows `before` begins.
pub fn line_of(before: &[u8]) -> u64 {
    1 + before.iter().filter(|byte| **byte == b'\n').count() as u64
}

/// Where the lines of a text begin, so that many places in it are found without counting from its start each time.
#[derive(Debug)]
pub struct Lines {
    starts: Vec<usize>,
}

impl Lines {
    /// The lines of a text.
    pub fn of(text: &str) -> Self {
        let ends = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n');
        Self { starts: ends.map(|(end, _)| end + 1).collect() }
    }

    /// The line, from 1, of a byte of the text.
    pub fn line_at(&self, offset: usize) -> u64 {
        1 + self.starts.partition_point(|start| *start <= offset) as u64
    }
}

/// A piece of the user's text, fit to be quoted within one line of a message.
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

/// The name among `known` that `word` may be a slip of: a few letters off, or the name without its
/// unit.
pub fn nearest<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // Three letters in ten may be wrong; words of any length may have one wrong.
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
        let missing = InputError::file(Path::new("a.csv"), Problem::NotFound);
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
