//! Tables of numbers: CSV files whose first line names the columns.

use crate::input::{InputError, Problem, quoted, read_text};
use std::path::{Path, PathBuf};

/// A table of numbers, by column. Cells may be empty.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    file: PathBuf,
    columns: Vec<Column>,
    /// The line of each row in the file.
    lines: Vec<u64>,
}

/// One column.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Its name.
    pub name: String,
    /// Its cells, one per row.
    pub cells: Vec<Option<f64>>,
}

/// Reads a CSV file: comma-separated, the first line names the columns. A byte order mark, CRLF,
/// blanks around cells and blank lines are tolerated.
///
/// # Errors
/// When the file cannot be read; for columns without a name or of one name, rows that are too long
/// or too short, and cells that are neither empty nor a finite number; without any row.
pub fn read_table(path: &Path) -> Result<Table, InputError> {
    Table::parse(&read_text(path)?, path)
}

impl Table {
    /// Reads a table's text; `file` is what messages call it.
    ///
    /// # Errors
    /// As [`read_table`].
    pub fn parse(text: &str, file: &Path) -> Result<Self, InputError> {
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .trim(csv::Trim::All)
            .from_reader(text.as_bytes());
        let mut record = csv::StringRecord::new();
        let mut lines = LineCounter { text: text.as_bytes(), offset: 0, line: 1 };
        let mut table = Self { file: file.to_path_buf(), columns: Vec::new(), lines: Vec::new() };
        loop {
            let start = reader.position().byte() as usize;
            match reader.read_record(&mut record) {
                Ok(true) => {}
                Ok(false) => break,
                // The text is UTF-8 and rows may be of any length: nothing is left to fail.
                Err(error) => {
                    let problem = Problem::Unreadable(error.to_string());
                    return Err(InputError::file(file, problem));
                }
            }
            if record.iter().all(str::is_empty) {
                continue;
            }
            let line = lines.of_record(start);
            let added = if table.columns.is_empty() {
                table.add_header(&record)
            } else {
                table.add_row(&record, line)
            };
            added.map_err(|problem| InputError::line(file, line, problem))?;
        }
        if table.columns.is_empty() {
            return Err(InputError::file(file, Problem::NoHeader));
        }
        if table.lines.is_empty() {
            return Err(InputError::file(file, Problem::NoRows));
        }
        Ok(table)
    }

    fn add_header(&mut self, record: &csv::StringRecord) -> Result<(), Problem> {
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

    fn add_row(&mut self, record: &csv::StringRecord, line: u64) -> Result<(), Problem> {
        if record.len() != self.columns.len() {
            return Err(Problem::CellCount { found: record.len(), expected: self.columns.len() });
        }
        for (column, cell) in self.columns.iter_mut().zip(record) {
            let number = match cell {
                "" => None,
                cell => match cell.parse::<f64>() {
                    Ok(number) if number.is_finite() => Some(number),
                    _ => {
                        return Err(Problem::Cell {
                            column: quoted(&column.name),
                            value: quoted(cell),
                            allowed: "a finite number".to_owned(),
                        });
                    }
                },
            };
            column.cells.push(number);
        }
        self.lines.push(line);
        Ok(())
    }

    /// The columns, in order of the file.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// How many rows there are; at least one.
    pub fn rows(&self) -> usize {
        self.lines.len()
    }

    /// The cells of a column that has to be there.
    ///
    /// # Errors
    /// When there is no such column.
    pub fn column(&self, name: &str) -> Result<&[Option<f64>], InputError> {
        match self.columns.iter().find(|column| column.name == name) {
            Some(column) => Ok(&column.cells),
            None => Err(self.header_error(Problem::MissingColumn { column: name.to_owned() })),
        }
    }

    /// The numbers of a column that has to be there in every row.
    ///
    /// # Errors
    /// When there is no such column, or a cell of it is empty.
    pub fn filled(&self, name: &str) -> Result<Vec<f64>, InputError> {
        self.column(name)?
            .iter()
            .enumerate()
            .map(|(row, cell)| cell.ok_or_else(|| self.cell_error(row, name, "a number")))
            .collect()
    }

    /// A problem with the names of the columns.
    pub fn header_error(&self, problem: Problem) -> InputError {
        InputError::file(&self.file, problem)
    }

    /// A problem with one cell; rows count from zero.
    pub fn cell_error(&self, row: usize, column: &str, allowed: &str) -> InputError {
        let cells = self.columns.iter().find(|known| known.name == column);
        let value = cells.and_then(|known| known.cells.get(row).copied().flatten());
        let problem = Problem::Cell {
            column: quoted(column),
            value: value.map_or_else(|| "(empty)".to_owned(), |number| format!("{number:?}")),
            allowed: allowed.to_owned(),
        };
        InputError::line(&self.file, self.lines.get(row).copied().unwrap_or_default(), problem)
    }
}

/// Counts lines up to growing offsets.
struct LineCounter<'a> {
    text: &'a [u8],
    offset: usize,
    line: u64,
}

impl LineCounter<'_> {
    /// The line of the record that the reader has begun at `start`: it skips blank lines first.
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
            ("\na,b,a\n1,2,3\n", "t.csv:2: column a appears twice"),
            ("a,b\n1,2\n\n3\n", "t.csv:4: 1 cells in this row: must be 2, one per column"),
            ("a,b\n1,2\n3,4,5\n", "t.csv:3: 3 cells in this row: must be 2, one per column"),
            ("a,b\r\n1,2\r\n\r\n\r\n3,x\r\n", "t.csv:5: column b = x: must be a finite number"),
            ("a,b\n1,NaN\n", "t.csv:2: column b = NaN: must be a finite number"),
            ("a,b\n1,1e999\n", "t.csv:2: column b = 1e999: must be a finite number"),
        ] {
            assert_eq!(parse(text), Err(message.to_owned()), "{text:?}");
        }
        let table = parse("a,b\n1,2\n\n3,\n").unwrap();
        let missing = table.column("c").unwrap_err().to_string();
        assert_eq!(missing, "t.csv: column c is missing");
        let empty = table.filled("b").unwrap_err().to_string();
        assert_eq!(empty, "t.csv:4: column b = (empty): must be a number");
    }

    proptest! {
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
