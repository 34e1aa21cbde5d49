//! Tables: random bytes, and damaged records of runs.

use crate::any::{self, Choices, byte};
use crate::scenarios::assert_names_place;
use arbitrary::Unstructured;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use tempfile::TempDir;
use thermyo_files::table::Table;
use thermyo_identify::Data;
use thermyo_record::measured::Measured;
use thermyo_record::trace::COLUMNS;
use thermyo_runs::replay;
use thermyo_setup::Loaded;

const FILE: &str = "nowhere/data.csv";
const MOST_CELLS: usize = 200;

/// Scenarios that differ in their data: a muscle by flows, by duties, by its gas sensor alone;
/// vessels.
static SCENARIOS: LazyLock<Vec<Loaded>> = LazyLock::new(|| {
    [
        "",
        "[identify]\nparameters = [\"valve.conductance_m3_s_pa\"]\n",
        "[identify]\nparameters = [\"heat.scale\"]\ncolumns = [\"sensor_gas_k\"]\n",
        "[plant]\nkind = \"vessel\"\nmodel = \"lumped\"\n[drive]\nkind = \"discharge\"\n",
        "[plant]\nkind = \"vessel\"\nmodel = \"lumped\"\n[drive]\nkind = \"closed\"\n",
    ]
    .map(|text| thermyo_setup::parse(text, Path::new("own.toml")).expect("it holds"))
    .into()
});

/// Path of a record with its scenario beside it.
static RUN: LazyLock<(TempDir, PathBuf)> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("scenario.toml"), "").expect("it is written");
    let trace = folder.path().join("trace.csv");
    (folder, trace)
});

/// Reads a table; returns 1.
pub fn run(bytes: &[u8]) -> u64 {
    let mut bytes = Unstructured::new(bytes);
    let scenario = any::one_of(&mut bytes, &SCENARIOS);
    let cut = bytes.whole(16) as usize;
    let content = match byte(&mut bytes) % 4 {
        0 => bytes.take_rest().to_vec(),
        _ => made(&mut bytes),
    };
    let table = Table::parse_record(&content, Path::new(FILE));
    cut_anywhere(&content[..cut % (content.len() + 1)], table.as_ref().ok());
    if let Ok(text) = str::from_utf8(&content) {
        whole(text, table.as_ref().ok());
    }
    match table {
        Ok(table) => used(&table, scenario),
        Err(error) => assert_names_place(&error, FILE),
    }
    1
}

/// Checks that the beginning of a record contains the beginning of its rows.
fn cut_anywhere(beginning: &[u8], whole: Option<&Table>) {
    let table = match Table::parse_record(beginning, Path::new(FILE)) {
        Ok(table) => table,
        Err(error) => return assert_names_place(&error, FILE),
    };
    let Some(whole) = whole else { return };
    let what = || format!("{}", beginning.escape_ascii());
    assert!(table.rows() <= whole.rows(), "{} rows of {}: {}", table.rows(), whole.rows(), what());
    for (part, column) in table.columns().iter().zip(whole.columns()) {
        assert_eq!(part.name, column.name);
        assert_eq!(part.cells, column.cells[..table.rows()]);
    }
}

/// Checks that a table read as a whole is the same record, without damage.
fn whole(text: &str, record: Option<&Table>) {
    match Table::parse(text, Path::new(FILE)) {
        Ok(table) => {
            let rows = table.columns().iter().all(|column| column.cells.len() == table.rows());
            assert!(rows && table.rows() > 0 && table.damage().is_none());
            // An unterminated last line counts here, but not in a record.
            if text.ends_with('\n') {
                assert_eq!(Some(table.columns()), record.map(Table::columns));
            }
        }
        Err(error) => assert_names_place(&error, FILE),
    }
}

/// Reads the table as measurement and as record.
fn used(table: &Table, scenario: &Loaded) {
    if let Some(damage) = table.damage() {
        assert!(!damage.to_string().contains(char::is_control), "{damage}");
    }
    match Measured::new(table, &COLUMNS) {
        Ok(measured) => match Data::new(&measured, Path::new(FILE), &scenario.plant) {
            Ok(data) => {
                assert!(data.values() > 0 && data.end_s().is_finite() && data.spacing_s > 0.0);
                let above = |deviation: f64| deviation.is_finite() && deviation > 0.0;
                assert!(data.observed.iter().all(|observed| above(observed.deviation)));
            }
            Err(error) => assert_names_place(&error, FILE),
        },
        Err(error) => assert_names_place(&error, FILE),
    }
    match replay::read_record(&RUN.1, table) {
        Ok(record) => {
            let part = record.part;
            assert_eq!(part.before + record.rows.len() + part.after, table.rows());
        }
        Err(error) => assert_names_place(&error, FILE),
    }
}

/// A table of valid columns, with some invalid cells.
fn made(bytes: &mut Unstructured) -> Vec<u8> {
    const ENDS: [&str; 4] = ["\n", "\r\n", "\n\n", " \n"];
    const WRONG: [&[u8]; 12] = [
        b"nan", b"1e999", b"\"", b"\"1\n\"", b",", b"\xff", b"\0", b"\r", b"1,1", b"x", b"-0",
        b"\n",
    ];
    let end = *any::one_of(bytes, &ENDS);
    let names: Vec<&str> = match byte(bytes) % 4 {
        // All columns of a record.
        0 => COLUMNS.to_vec(),
        _ => std::iter::once("time_s")
            .chain((0..byte(bytes) % 6).map(|_| *any::one_of(bytes, &COLUMNS)))
            .collect(),
    };
    let mut content = names.join(",").into_bytes();
    content.extend_from_slice(end.as_bytes());
    let mut cells = 0;
    while !bytes.is_empty() && cells < MOST_CELLS {
        for (i, name) in names.iter().enumerate() {
            let separator = if i == 0 { "" } else { "," };
            content.extend_from_slice(separator.as_bytes());
            let row = cells / names.len();
            match (byte(bytes), *name) {
                (255, _) => content.extend_from_slice(any::one_of::<&[u8]>(bytes, &WRONG)),
                (240..255, _) => {}
                (0..200, "time_s" | "step") => {
                    content.extend_from_slice(row.to_string().as_bytes())
                }
                (0..160, "pressure_pa") => content.extend_from_slice(b"2e5"),
                (0..160, "sensor_gas_k" | "sensor_wall_k") => content.extend_from_slice(b"298"),
                (160..180, _) => {
                    let number = f64::from_bits(bytes.whole(64));
                    content.extend_from_slice(number.to_string().as_bytes());
                }
                (byte, _) => {
                    content.extend_from_slice(format!("{}", f32::from(byte) / 64.0).as_bytes())
                }
            }
        }
        cells += names.len();
        content.extend_from_slice(end.as_bytes());
    }
    content
}
