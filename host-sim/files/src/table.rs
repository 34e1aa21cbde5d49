//! Tables of numbers: CSV files whose first line names the columns.

use crate::input::{InputError, Problem, line_of, not_text, quoted, read_bytes};
use std::fmt;
use std::path::{Path, PathBuf};

/// A table of numbers, by column. Cells may be empty.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    file: PathBuf,
    columns: Vec<Column>,
    lines: Vec<u64>,
    damage: Option<Damage>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    pub name: String,
    /// Cells, one per row.
    pub cells: Vec<Option<f64>>,
}

/// End of a damaged record, and the reason. Its `Display` is one line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Damage {
    /// File, line and problem.
    what: String,
    rows: usize,
    /// Number of lines after the damaged one, without blank ones.
    behind: usize,
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rows = if self.rows == 1 { "row" } else { "rows" };
        write!(f, "{}; read up to there: {} {rows}", self.what, self.rows)?;
        match self.behind {
            0 => Ok(()),
            1 => f.write_str(", without the line behind it"),
            lines => write!(f, ", without the {lines} lines behind it"),
        }
    }
}

/// A row that cannot be used.
enum Bad {
    /// A line that is not a row.
    Damage(Problem),
    /// A row with an impossible value.
    Value(Problem),
}

/// Reads a CSV file: comma-separated, the first line names the columns. A byte order mark, CRLF,
/// blanks around cells and blank lines are tolerated.
///
/// # Errors
/// If the file cannot be read; for unnamed columns or two of one name, rows that are too long or too short, and cells
/// that are neither empty nor a finite number; for no row at all.
pub fn read_table(path: &Path) -> Result<Table, InputError> {
    Table::undamaged(Table::rows_of(&read_bytes(path)?, path)?)
}

/// Reads a CSV file that a program recorded, as [`read_table`]. A damaged file is read up to the
/// first line that is not a row: see [`Table::damage`].
///
/// # Errors
/// As [`read_table`], but for damage only if no row precedes it.
pub fn read_record(path: &Path) -> Result<Table, InputError> {
    Table::parse_record(&read_bytes(path)?, path)
}

/// As [`read_record`], but damage is an error.
///
/// # Errors
/// As [`read_table`], and for an unterminated last line.
pub fn read_whole(path: &Path) -> Result<Table, InputError> {
    Table::undamaged(Table::recorded(&read_bytes(path)?, path)?)
}

/// Reads a CSV file as [`read_record`] if its column names are those of a record, else as [`read_table`]: in a table
/// made by hand a fault is a mistake, not a power cut, and an unterminated last line is a row.
pub fn read_either(path: &Path, made_by_hand: fn(&Table) -> bool) -> Result<Table, InputError> {
    Table::parse_either(&read_bytes(path)?, path, made_by_hand)
}

impl Table {
    /// As [`read_either`], from the content of a file; `file` is its name in messages.
    pub fn parse_either(
        bytes: &[u8],
        file: &Path,
        made_by_hand: fn(&Self) -> bool,
    ) -> Result<Self, InputError> {
        let mut lines = bytes.split(|byte| *byte == b'\n');
        let first = lines.find(|line| !line.trim_ascii().is_empty()).unwrap_or_default();
        let names = Self::rows_of(first, file);
        if names.is_ok_and(|(names, _)| made_by_hand(&names)) {
            return Self::undamaged(Self::rows_of(bytes, file)?);
        }
        Self::parse_record(bytes, file)
    }

    /// Parses a table; `file` is its name in messages.
    pub fn parse(text: &str, file: &Path) -> Result<Self, InputError> {
        Self::undamaged(Self::rows_of(text.as_bytes(), file)?)
    }

    fn undamaged((table, damage): (Self, Option<InputError>)) -> Result<Self, InputError> {
        damage.map_or_else(|| table.with_rows(), Err)
    }

    /// Parses as much of a record as can be read; `file` is its name in messages.
    pub fn parse_record(bytes: &[u8], file: &Path) -> Result<Self, InputError> {
        let (mut table, damage) = Self::recorded(bytes, file)?;
        let Some(damage) = damage else { return table.with_rows() };
        if table.lines.is_empty() {
            return Err(damage);
        }
        let line = damage.line.and_then(|line| usize::try_from(line).ok()).unwrap_or_default();
        let behind = bytes
            .split(|byte| *byte == b'\n')
            .skip(line)
            .filter(|line| !line.trim_ascii().is_empty())
            .count();
        table.damage = Some(Damage { what: damage.to_string(), rows: table.rows(), behind });
        Ok(table)
    }

    /// As [`Self::rows_of`], but an unterminated last line is not a row.
    fn recorded(bytes: &[u8], file: &Path) -> Result<(Self, Option<InputError>), InputError> {
        is_text(bytes, file)?;
        // A truncated number is still a number, so only a terminated line counts.
        let whole =
            bytes.iter().rposition(|byte| matches!(byte, b'\n' | b'\r')).map_or(0, |i| i + 1);
        let (whole, rest) = bytes.split_at(whole);
        let cut = || InputError::line(file, line_of(whole), Problem::CutLine);
        let cut = (!rest.trim_ascii().is_empty()).then(cut);
        let (table, damage) = Self::rows_of(whole, file)?;
        Ok((table, damage.or(cut)))
    }

    /// The rows up to the first line that is not one, and the problem of that line.
    fn rows_of(bytes: &[u8], file: &Path) -> Result<(Self, Option<InputError>), InputError> {
        is_text(bytes, file)?;
        if file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml")) {
            return Err(InputError::file(file, Problem::NotCsv));
        }
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .trim(csv::Trim::All)
            .from_reader(bytes);
        let mut record = csv::StringRecord::new();
        let mut lines = LineCounter { text: bytes, offset: 0, line: 1 };
        let mut table =
            Self { file: file.to_path_buf(), columns: Vec::new(), lines: Vec::new(), damage: None };
        loop {
            let start = reader.position().byte() as usize;
            let read = reader.read_record(&mut record);
            let line = lines.of_record(start);
            let added = match read {
                Ok(false) => return Ok((table, None)),
                Ok(true) if open_to_the_end(bytes, start, reader.position()) => {
                    Err(Bad::Damage(Problem::OpenQuote))
                }
                Ok(true) if record.iter().all(str::is_empty) => continue,
                Ok(true) if table.columns.is_empty() => {
                    let below = bytes.get(reader.position().byte() as usize..);
                    table.add_header(&record, below.unwrap_or_default()).map_err(Bad::Value)
                }
                Ok(true) => table.add_row(&record, line),
                // Rows may have any length, and bytes in memory can always be read: there is no other error.
                Err(_) => Err(Bad::Damage(Problem::NotUtf8)),
            };
            match added {
                Ok(()) => {}
                Err(Bad::Damage(problem)) => {
                    return Ok((table, Some(InputError::line(file, line, problem))));
                }
                Err(Bad::Value(problem)) => return Err(InputError::line(file, line, problem)),
            }
        }
    }

    fn with_rows(self) -> Result<Self, InputError> {
        if self.columns.is_empty() {
            return Err(self.header_error(Problem::NoHeader));
        }
        if self.lines.is_empty() {
            return Err(self.header_error(Problem::NoRows));
        }
        Ok(self)
    }

    /// `below`: the bytes behind the first line.
    fn add_header(&mut self, record: &csv::StringRecord, below: &[u8]) -> Result<(), Problem> {
        if let Some(found) = other_separator(record) {
            return Err(Problem::Separator { found });
        }
        let first = record.iter().next().unwrap_or_default();
        if first.starts_with(['#', '<', '{'])
            || is_title(record, below)
            || record.iter().all(|name| name.parse::<f64>().is_ok())
        {
            return Err(Problem::NotNames { found: quoted(first) });
        }
        // A single column cannot be read over time.
        if record.len() == 1 && first.split_whitespace().count() > 1 {
            return Err(Problem::Separator { found: "blanks" });
        }
        for (i, name) in record.iter().enumerate() {
            if name.is_empty() {
                return Err(Problem::UnnamedColumn { position: i + 1 });
            }
            if self.columns.iter().any(|column| column.name == name) {
                return Err(Problem::DuplicateColumn { column: quoted(name) });
            }
            self.columns.push(Column { name: name.to_owned(), cells: Vec::new() });
        }
        Ok(())
    }

    fn add_row(&mut self, record: &csv::StringRecord, line: u64) -> Result<(), Bad> {
        if let Some(found) = other_separator(record) {
            return Err(Bad::Value(Problem::Separator { found }));
        }
        let (found, expected) = (record.len(), self.columns.len());
        if found != expected {
            let blanks = || {
                let cells: Vec<&str> = record.iter().flat_map(str::split_whitespace).collect();
                let numbers = cells.iter().all(|cell| cell.parse::<f64>().is_ok());
                (found == 1 && cells.len() == expected && numbers).then_some("blanks")
            };
            return Err(match blanks() {
                Some(found) => Bad::Value(Problem::Separator { found }),
                None if self.lines.is_empty()
                    && record.iter().all(|cell| cell.parse::<f64>().is_err()) =>
                {
                    Bad::Value(Problem::NamesBelow)
                }
                // Only numbers, some of them split into two cells.
                None if (expected + 1..=2 * expected).contains(&found)
                    && record.iter().all(|cell| cell.parse::<f64>().is_ok()) =>
                {
                    Bad::Damage(Problem::DecimalCommas { found, expected })
                }
                None => Bad::Damage(Problem::CellCount { found, expected }),
            });
        }
        let numbers: Vec<Option<f64>> = self
            .columns
            .iter()
            .zip(record)
            .map(|(column, cell)| {
                let problem = |allowed: &str| Problem::Cell {
                    column: quoted(&column.name),
                    value: quoted(cell),
                    allowed: allowed.to_owned(),
                };
                match cell.parse::<f64>() {
                    _ if cell.is_empty() => Ok(None),
                    Ok(number) if number.is_finite() => Ok(Some(number)),
                    Ok(_) => Err(Bad::Value(problem("a finite number"))),
                    Err(_) if cell.replacen(',', ".", 1).parse::<f64>().is_ok() => {
                        Err(Bad::Value(problem("a number with a decimal point")))
                    }
                    Err(_) => Err(Bad::Damage(problem("a finite number"))),
                }
            })
            .collect::<Result<_, _>>()?;
        for (column, number) in self.columns.iter_mut().zip(numbers) {
            column.cells.push(number);
        }
        self.lines.push(line);
        Ok(())
    }

    /// Damage at which a record of [`read_record`] ended early.
    pub fn damage(&self) -> Option<&Damage> {
        self.damage.as_ref()
    }

    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Number of rows, at least one.
    pub fn rows(&self) -> usize {
        self.lines.len()
    }

    /// Line of a row in the file; rows count from zero.
    pub fn line(&self, row: usize) -> u64 {
        self.lines.get(row).copied().unwrap_or_default()
    }

    pub fn column(&self, name: &str) -> Result<&[Option<f64>], InputError> {
        match self.columns.iter().find(|column| column.name == name) {
            Some(column) => Ok(&column.cells),
            None => {
                let there = quoted_list(self.columns.iter().map(|column| column.name.as_str()));
                let column = name.to_owned();
                Err(self.header_error(Problem::MissingColumn { column, there }))
            }
        }
    }

    /// Numbers of a required column without empty cells.
    pub fn filled(&self, name: &str) -> Result<Vec<f64>, InputError> {
        self.column(name)?
            .iter()
            .enumerate()
            .map(|(row, cell)| cell.ok_or_else(|| self.cell_error(row, name, "a number")))
            .collect()
    }

    /// Whole numbers of a required column without empty cells, 0 to `most`.
    ///
    /// # Errors
    /// As [`Self::filled`], and for a cell with any other number.
    pub fn whole(&self, name: &str, most: u32) -> Result<Vec<u32>, InputError> {
        let allowed = || format!("a whole number from 0 to {most}");
        let whole = |(row, number): (usize, f64)| {
            let is_whole = number.fract() == 0.0 && (0.0..=f64::from(most)).contains(&number);
            is_whole.then_some(number as u32).ok_or_else(|| self.cell_error(row, name, &allowed()))
        };
        self.filled(name)?.into_iter().enumerate().map(whole).collect()
    }

    pub fn file(&self) -> &Path {
        &self.file
    }

    pub fn header_error(&self, problem: Problem) -> InputError {
        InputError::file(&self.file, problem)
    }

    /// The error for one cell; rows count from zero.
    pub fn cell_error(&self, row: usize, column: &str, allowed: &str) -> InputError {
        let cells = self.columns.iter().find(|known| known.name == column);
        let value = cells.and_then(|known| known.cells.get(row).copied().flatten());
        let problem = Problem::Cell {
            column: quoted(column),
            value: value.map_or_else(|| "(empty)".to_owned(), |number| format!("{number:?}")),
            allowed: allowed.to_owned(),
        };
        InputError::line(&self.file, self.line(row), problem)
    }
}

/// The separator of a line that has no commas.
fn other_separator(record: &csv::StringRecord) -> Option<&'static str> {
    [(';', "semicolons"), ('\t', "tabs"), ('|', "bars")]
        .into_iter()
        .find(|(separator, _)| record.iter().any(|cell| cell.contains(*separator)))
        .map(|(_, name)| name)
}

fn is_text(bytes: &[u8], file: &Path) -> Result<(), InputError> {
    not_text(bytes).map_or(Ok(()), |problem| Err(InputError::file(file, problem)))
}

/// Whether the first line is a title above the names: its only text is one cell of several words, and the line below it
/// does not consist of numbers between blanks.
fn is_title(record: &csv::StringRecord, below: &[u8]) -> bool {
    let mut texts = record.iter().filter(|cell| !cell.is_empty());
    let (Some(text), None) = (texts.next(), texts.next()) else { return false };
    if text.split_whitespace().count() < 2 {
        return false;
    }
    let next = below.split(|byte| *byte == b'\n').find(|line| !line.trim_ascii().is_empty());
    let next = String::from_utf8_lossy(next.unwrap_or_default());
    let of_numbers = next.split_whitespace().all(|word| word.parse::<f64>().is_ok());
    record.len() > 1 || (!next.is_empty() && !of_numbers)
}

/// The first few names, for a message.
fn quoted_list<'a>(names: impl Iterator<Item = &'a str>) -> String {
    const MOST: usize = 6;
    let mut names: Vec<String> = names.take(MOST + 1).map(quoted).collect();
    if names.len() > MOST {
        names[MOST] = "...".to_owned();
    }
    names.join(", ")
}

/// Whether the record that begins at `start` ends within quotation marks at the end of the text.
fn open_to_the_end(text: &[u8], start: usize, end: &csv::Position) -> bool {
    let record = text.get(start..).unwrap_or_default();
    end.byte() as usize >= text.len()
        && record.iter().filter(|byte| **byte == b'"').count() % 2 == 1
}

/// Line numbers at growing offsets.
struct LineCounter<'a> {
    text: &'a [u8],
    offset: usize,
    line: u64,
}

impl LineCounter<'_> {
    /// Line of the record that begins at `start`; the reader skips preceding blank lines.
    fn of_record(&mut self, start: usize) -> u64 {
        let rest = self.text.get(start..).unwrap_or_default();
        let blank = rest.iter().take_while(|byte| matches!(byte, b'\r' | b'\n')).count();
        let end = (start + blank).min(self.text.len());
        let passed = self.text.get(self.offset..end).unwrap_or_default();
        self.line += passed.iter().filter(|byte| **byte == b'\n').count() as u64;
        self.offset = end;
        self.line
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SEMICOLONS: &str = "t.csv:1: cells are separated by semicolons: must be commas, and numbers \
                              need a decimal point";
    const TITLE: &str =
        "t.csv:1: Muscle 3 of Monday in the first line: must be the names of the columns";
    const BELOW: &str = "t.csv:2: has words in place of numbers: if these are the names of the columns, they must be in \
                         the first line";
    const TABS: &str =
        "t.csv:1: cells are separated by tabs: must be commas, and numbers need a decimal point";

    fn parse(text: &str) -> Result<Table, String> {
        Table::parse(text, "t.csv".as_ref()).map_err(|error| error.to_string())
    }

    #[test]
    fn tolerates_what_spreadsheets_write() {
        let table = parse(
            "\r\ntime_s, p\r\n0,\"1.5\"\r\n\r\n , \r\n1e-3,\r\n,,\n".trim_end_matches(",,\n"),
        )
        .unwrap();
        assert_eq!(table.rows(), 2);
        assert_eq!(table.column("time_s").unwrap(), [Some(0.0), Some(0.001)]);
        assert_eq!(table.column("p").unwrap(), [Some(1.5), None]);
    }

    #[test]
    fn says_what_is_wrong_and_where() {
        for (text, message) in [
            ("", "t.csv: is empty; the first line must name the columns"),
            ("\n\r\n", "t.csv: is empty; the first line must name the columns"),
            ("a,b\n", "t.csv: has no row below the names of the columns"),
            ("a,,c\n1,2,3\n", "t.csv:1: column 2 has no name"),
            ("time_s,\n1,\n", "t.csv:1: column 2 has no name"),
            ("\na,b,a\n1,2,3\n", "t.csv:2: column a appears twice"),
            ("a,b\n1,2\n\n3\n", "t.csv:4: 1 cells in this row: must be 2, one per column"),
            ("a,b\n1,2\n3,4,x\n", "t.csv:3: 3 cells in this row: must be 2, one per column"),
            (
                "a,b\n0,5,1\n",
                "t.csv:2: 3 cells in this row: must be 2, one per column; are these decimal \
                 commas? Numbers need a decimal point",
            ),
            (
                "a|b\n1|2\n",
                "t.csv:1: cells are separated by bars: must be commas, and numbers need a decimal point",
            ),
            (
                "a b\n1 2\n",
                "t.csv:1: cells are separated by blanks: must be commas, and numbers need a decimal point",
            ),
            (
                "<!doctype html>\n<p>1,2,3\n",
                "t.csv:1: <!doctype html> in the first line: must be the names of the columns",
            ),
            ("{\n", "t.csv:1: { in the first line: must be the names of the columns"),
            // A title that a spreadsheet writes above the table.
            ("Muscle 3 of Monday\ntime_s,p\n0,1\n", TITLE),
            ("Muscle 3 of Monday,\ntime_s,p\n0,1\n", TITLE),
            ("Muscle 3 of Monday\r\n\r\ntime_s;p\r\n0;1\r\n", TITLE),
            ("Muscle 3 of Monday\ntime_s p\n0 1\n", TITLE),
            ("Muscle 3, Monday\ntime_s,p,f\n0,1,2\n", BELOW),
            ("Muscle\ntime_s,p,f\n0,1,2\n", BELOW),
            ("0,1e5\n1,2e5\n", "t.csv:1: 0 in the first line: must be the names of the columns"),
            (
                "# by hand, a\na,b\n1,2\n",
                "t.csv:1: # by hand in the first line: must be the names of the columns",
            ),
            ("a,b\r\n1,2\r\n\r\n\r\n3,x\r\n", "t.csv:5: column b = x: must be a finite number"),
            ("a,b\n1,NaN\n", "t.csv:2: column b = NaN: must be a finite number"),
            ("a,b\n1,1e999\n", "t.csv:2: column b = 1e999: must be a finite number"),
            ("time_s;p\n0,5;1,5\n", SEMICOLONS),
            ("time_s\tp\n0\t1\n", TABS),
            (
                "a,b\n1;2\n",
                "t.csv:2: cells are separated by semicolons: must be commas, and numbers need a \
                 decimal point",
            ),
            // Decimal commas between semicolons can make as many cells as there are columns.
            (
                "a,b,c\n0,5;1,5\n",
                "t.csv:2: cells are separated by semicolons: must be commas, and numbers need a \
                 decimal point",
            ),
            (
                "a,b\n1 2.5\n",
                "t.csv:2: cells are separated by blanks: must be commas, and numbers need a \
                 decimal point",
            ),
            (
                "a,b\n0,5,1,5\n",
                "t.csv:2: 4 cells in this row: must be 2, one per column; are these decimal \
                 commas? Numbers need a decimal point",
            ),
            ("a,b\n1,\"2,5\"\n", "t.csv:2: column b = 2,5: must be a number with a decimal point"),
        ] {
            assert_eq!(parse(text), Err(message.to_owned()), "{text:?}");
        }
        let table = parse("a,b\n1,2\n\n3,\n").unwrap();
        let missing = table.column("c").unwrap_err().to_string();
        assert_eq!(missing, "t.csv: column c is missing; the file has a, b");
        let empty = table.filled("b").unwrap_err().to_string();
        assert_eq!(empty, "t.csv:4: column b = (empty): must be a number");
    }

    /// The message used to be "not UTF-8 text".
    #[test]
    fn the_file_of_another_program_is_named() {
        let sheet = "a spreadsheet or an archive: must be text; export the sheet as CSV (UTF-8, with commas)";
        for (bytes, what) in [
            (&b"PK\x03\x04\x14\0\x06\0\x08\0\xe9"[..], sheet),
            (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1\0\0", sheet),
            (b"\x89MCAP0\r\n\x01", "an MCAP file: name the CSV file beside it"),
        ] {
            assert_eq!(record(bytes), Err(format!("t.csv: is {what}")));
        }
    }

    #[test]
    fn text_of_two_bytes_a_letter_is_named() {
        for (mark, order) in [
            (&[0xff, 0xfe][..], u16::to_le_bytes as fn(u16) -> [u8; 2]),
            (&[], u16::to_le_bytes),
            (&[0xfe, 0xff], u16::to_be_bytes),
        ] {
            let letters = "time_s,pressure_pa\n0,1e5\n".encode_utf16().flat_map(order);
            let bytes: Vec<u8> = mark.iter().copied().chain(letters).collect();
            let message = "t.csv: is UTF-16 text: must be UTF-8".to_owned();
            assert_eq!(record(&bytes), Err(message.clone()));
            // Without the mark the bytes can be read as text.
            if let Ok(text) = str::from_utf8(&bytes) {
                assert_eq!(parse(text), Err(message));
            }
        }
    }

    fn record(bytes: &[u8]) -> Result<(usize, Option<String>), String> {
        Table::parse_record(bytes, "t.csv".as_ref())
            .map(|table| (table.rows(), table.damage().map(Damage::to_string)))
            .map_err(|error| error.to_string())
    }

    #[test]
    fn a_record_is_read_up_to_the_damage() {
        for (bytes, rows, behind, message) in [
            // A killed program leaves this: the number may be truncated.
            (&b"a,b\n1,2\n3,4"[..], 1, 0, "t.csv:3: the last line has no end: it may be cut"),
            (b"a,b\n1,2\n3,4\n5", 2, 0, "t.csv:4: the last line has no end: it may be cut"),
            (
                b"a,b\n1,2\n3\n5,6\n",
                1,
                1,
                "t.csv:3: 1 cells in this row: must be 2, one per column",
            ),
            (
                b"a,b\n1,2\n3,4,x\n5,6",
                1,
                1,
                "t.csv:3: 3 cells in this row: must be 2, one per column",
            ),
            (b"a,b\n1,2\n3,x\n5,6\n", 1, 1, "t.csv:3: column b = x: must be a finite number"),
            (b"a,b\n1,2\n3,4\n5,\xff6\n", 2, 0, "t.csv:4: is not UTF-8 text"),
            (
                b"a,b\n1,2\n3,\0\0\n",
                1,
                0,
                "t.csv:3: column b = \\u{0}\\u{0}: must be a finite number",
            ),
            // A block of zeros in place of the text, to the end of the file.
            (b"a,b\n1,2\n3,4\n\0\0\0\0", 2, 0, "t.csv:4: the last line has no end: it may be cut"),
            (
                b"a,b\n1,2\n3,4\n\0\0\0\0\n",
                2,
                0,
                "t.csv:4: 1 cells in this row: must be 2, one per column",
            ),
            // A quotation mark that encloses the rest.
            (b"a,b\n1,2\n3,\"4\n5,6\n7,8\n", 1, 2, "t.csv:3: a quotation mark is not closed"),
            // The text after it may be truncated.
            (b"a,b\n1,2\n3,\"\n", 1, 0, "t.csv:3: a quotation mark is not closed"),
        ] {
            let count = if rows == 1 { "1 row".to_owned() } else { format!("{rows} rows") };
            let behind = match behind {
                0 => String::new(),
                1 => ", without the line behind it".to_owned(),
                lines => format!(", without the {lines} lines behind it"),
            };
            let said = format!("{message}; read up to there: {count}{behind}");
            assert_eq!(record(bytes), Ok((rows, Some(said))), "{}", bytes.escape_ascii());
        }
        // A fit to such a record reports how much of it was used.
        let behind = "t.csv:3: column b = x: must be a finite number; read up to there: 1 row, without the 3 lines \
                      behind it";
        assert_eq!(record(b"a,b\n1,2\n3,x\n5,6\n\n7,8\n9"), Ok((1, Some(behind.to_owned()))));
        let whole = b"\xef\xbb\xbfa,b\r\n1,2\r\n\r\n3,4\r\n \t";
        assert_eq!(record(whole), Ok((2, None)));
    }

    #[test]
    fn a_record_without_a_row_before_the_damage_is_refused() {
        for (bytes, message) in [
            (&b""[..], "t.csv: is empty; the first line must name the columns"),
            (b"a,b\n", "t.csv: has no row below the names of the columns"),
            (b"a,b", "t.csv:1: the last line has no end: it may be cut"),
            (b"a,b\n1,2", "t.csv:2: the last line has no end: it may be cut"),
            (b"\xff\xfea\n1\n", "t.csv: is UTF-16 text: must be UTF-8"),
            (b"\xe9,a\n1,2\n", "t.csv:1: is not UTF-8 text"),
            (b"\x8f\x00\x12\xd3\n1,2\n", "t.csv:1: is not UTF-8 text"),
            (
                b"a,b\n1;2\n3;4\n",
                "t.csv:2: cells are separated by semicolons: must be commas, and numbers need a \
                 decimal point",
            ),
            // An impossible value is not damage.
            (b"a,b\n1,2\n3,NaN\n", "t.csv:3: column b = NaN: must be a finite number"),
            (b"a,b\n1,2\n3,1e999\n", "t.csv:3: column b = 1e999: must be a finite number"),
        ] {
            assert_eq!(record(bytes), Err(message.to_owned()), "{}", bytes.escape_ascii());
        }
    }

    #[test]
    fn missing_files_and_folders_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let absent = folder.path().join("absent.csv");
        for read in [read_table, read_record] {
            let message = read(&absent).unwrap_err().to_string();
            assert_eq!(message, format!("{}: no such file", absent.display()));
            let message = read(folder.path()).unwrap_err().to_string();
            let expected = format!("{}: is a folder; a file is needed", folder.path().display());
            assert_eq!(message, expected);
        }
    }

    proptest! {
        #[test]
        fn no_record_panics_and_a_cut_one_keeps_every_whole_row(
            rows in 1_usize..20, cut in 0_usize..400, flipped in 0_usize..400, byte in any::<u8>(),
        ) {
            let mut bytes = b"time_s,x\n".to_vec();
            for row in 0..rows {
                bytes.extend(format!("{row},{}\n", row * 12_345).bytes());
            }
            bytes.truncate(cut);
            let whole = bytes.iter().filter(|byte| **byte == b'\n').count().saturating_sub(1);
            if let Ok((found, damage)) = record(&bytes) {
                prop_assert_eq!(found, whole);
                prop_assert_eq!(damage.is_some(), bytes.last() != Some(&b'\n'));
            } else {
                prop_assert_eq!(whole, 0);
            }
            if let Some(at) = bytes.get_mut(flipped) {
                *at = byte;
            }
            if let Err(message) = record(&bytes) {
                prop_assert!(message.lines().count() == 1);
            }
        }

        #[test]
        fn no_text_panics(text in "[a-z0-9,.\"\r\n \u{feff}-]{0,60}|\\PC{0,40}") {
            if let Err(message) = parse(&text) {
                prop_assert!(message.starts_with("t.csv:") && message.lines().count() == 1);
            }
        }

        #[test]
        fn numbers_come_back_to_the_bit(numbers in proptest::collection::vec(
            (any::<f64>().prop_filter("finite", |x| x.is_finite()), any::<bool>()), 1..20,
        )) {
            let mut text = "row,x".to_owned();
            for (row, (number, given)) in numbers.iter().enumerate() {
                text += &if *given { format!("\n{row},{number:?}") } else { format!("\n{row},") };
            }
            let table = parse(&text).unwrap();
            let expected: Vec<Option<u64>> =
                numbers.iter().map(|(x, given)| given.then_some(x.to_bits())).collect();
            let found: Vec<Option<u64>> =
                table.column("x").unwrap().iter().map(|cell| cell.map(f64::to_bits)).collect();
            prop_assert_eq!(found, expected);
        }
    }
}
