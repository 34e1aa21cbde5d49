//! Readings of one muscle's force over gauge pressure and length.

use thermyo_files::input::{InputError, Instead, Problem, quoted};
use thermyo_files::table::Table;

/// Required columns.
pub const COLUMNS: [&str; 4] = ["rest_length_m", "gauge_pressure_pa", "length_m", "force_n"];
/// Optional column: the direction from which each reading was approached.
pub const DIRECTION: &str = "direction";
/// Forces up to this fraction of the largest count as slack.
pub const LOADED: f64 = 0.01;
/// Largest negative reading of a load cell, as a fraction of the largest force.
const BELOW_ZERO: f64 = 0.02;
/// A map with no gauge pressure above this one is in another unit \[Pa\].
const LEAST_PRESSURE_PA: f64 = 1.0e4;
/// Fewest loaded readings for an identification.
pub const FEWEST: usize = 5;
/// Relative difference up to which rest lengths count as equal.
const SAME_LENGTH: f64 = 1e-6;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Line in the file.
    pub line: u64,
    pub gauge_pressure_pa: f64,
    pub length_m: f64,
    pub force_n: f64,
    /// 1 after contracting, -1 after lengthening, 0 where unknown.
    pub direction: f64,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Readings {
    pub rest_length_m: f64,
    /// Readings with a force.
    pub loaded: Vec<Reading>,
    /// Readings without a force.
    pub slack: Vec<Reading>,
}

impl Readings {
    /// Tells a static map from a record over time.
    pub fn are_in(table: &Table) -> bool {
        table.columns().iter().any(|column| COLUMNS[..2].contains(&column.name.as_str()))
    }

    /// Reads a table. Rows without a force have not been measured yet.
    ///
    /// # Errors
    /// For missing or unknown columns, impossible values, and more than one muscle.
    pub fn of(table: &Table) -> Result<Self, InputError> {
        Self::beside(table, None)
    }

    /// Reads a table to compare these readings with.
    ///
    /// # Errors
    /// As [`Readings::of`], and where it is of another muscle, or no reading is loaded.
    pub fn to_compare(&self, table: &Table) -> Result<Self, InputError> {
        let others = Self::beside(table, Some(self))?;
        if others.loaded.is_empty() {
            let why = "there is nothing to compare with".to_owned();
            return Err(table.header_error(Problem::TooFewLoaded { found: 0, fewest: 1, why }));
        }
        Ok(others)
    }

    fn beside(table: &Table, fitted: Option<&Self>) -> Result<Self, InputError> {
        let [rest, gauge, length, force] = COLUMNS.map(|name| table.column(name));
        let (rest, gauge, length, force) = (rest?, gauge?, length?, force?);
        let known = || COLUMNS.iter().chain([&DIRECTION]);
        let unknown =
            table.columns().iter().find(|column| !known().any(|name| *name == column.name));
        if let Some(column) = unknown {
            let instead = Instead::Known(known().map(|name| (*name).to_owned()).collect());
            let column = quoted(&column.name);
            return Err(table.header_error(Problem::UnknownColumn { column, instead }));
        }
        let directions = table.column(DIRECTION).ok();
        let first_m = rest.iter().flatten().next().copied().unwrap_or_default();
        let rest_length_m = fitted.map_or(first_m, |fitted| fitted.rest_length_m);
        let mut readings = Vec::new();
        for (row, force_n) in force.iter().enumerate() {
            let Some(force_n) = *force_n else { continue };
            let cell = |cells: &[Option<f64>], name: &str, [low, high]: [f64; 2], unit: &str| {
                let value = cells[row].filter(|value| (low..=high).contains(value));
                let allowed = || format!("a number from {low} to {high}{unit}");
                value.ok_or_else(|| table.cell_error(row, name, &allowed()))
            };
            let own_m = cell(rest, COLUMNS[0], [0.005, 10.0], " m")?;
            if (own_m / rest_length_m - 1.0).abs() > SAME_LENGTH {
                let one = match fitted {
                    Some(_) => format!("{rest_length_m}, as in the map that is fitted: one muscle"),
                    None => format!("{rest_length_m}, as above: one muscle a file"),
                };
                return Err(table.cell_error(row, COLUMNS[0], &one));
            }
            let range_m = [0.5 * rest_length_m, 1.1 * rest_length_m];
            let direction = match directions.and_then(|cells| cells[row]) {
                None => 0.0,
                Some(direction) if [-1.0, 0.0, 1.0].contains(&direction) => direction,
                Some(_) => return Err(table.cell_error(row, DIRECTION, "1, -1 or 0")),
            };
            readings.push(Reading {
                line: table.line(row),
                gauge_pressure_pa: cell(gauge, COLUMNS[1], [0.0, 1.0e7], " Pa")?,
                length_m: cell(length, COLUMNS[2], range_m, " m")?,
                force_n,
                direction,
            });
        }
        let largest_n = largest_n(&readings).max(fitted.map_or(0.0, Self::largest_n));
        let possible_n = -BELOW_ZERO * largest_n..=1.0e6;
        let impossible = |cell: &Option<f64>| cell.is_some_and(|n| !possible_n.contains(&n));
        if let Some(row) = force.iter().position(impossible) {
            return Err(table.cell_error(
                row,
                COLUMNS[3],
                "a number from -2 % of the largest to 1e6 N",
            ));
        }
        in_pascals(table, gauge, force)?;
        let (loaded, slack) =
            readings.into_iter().partition(|reading| reading.force_n > LOADED * largest_n);
        Ok(Self { rest_length_m, loaded, slack })
    }

    /// Largest force \[N\].
    pub fn largest_n(&self) -> f64 {
        largest_n(&self.loaded)
    }

    /// Contraction of a reading \[-\].
    pub fn contraction(&self, reading: &Reading) -> f64 {
        1.0 - reading.length_m / self.rest_length_m
    }

    /// Readings after contracting and after lengthening can be distinguished.
    pub fn go_both_ways(&self) -> bool {
        [1.0, -1.0].iter().all(|way| self.loaded.iter().any(|reading| reading.direction == *way))
    }
}

fn largest_n(readings: &[Reading]) -> f64 {
    readings.iter().map(|reading| reading.force_n).fold(0.0, f64::max)
}

/// Refuses gauge pressures that are all too small to be in Pa.
fn in_pascals(
    table: &Table,
    gauge: &[Option<f64>],
    force: &[Option<f64>],
) -> Result<(), InputError> {
    let measured = (0..table.rows()).filter(|row| force[*row].is_some());
    let pressures = measured.filter_map(|row| Some((row, gauge[row]?)));
    let largest = pressures.max_by(|(_, a), (_, b)| a.total_cmp(b));
    let Some((row, pressure)) = largest.filter(|(_, pressure)| *pressure < LEAST_PRESSURE_PA)
    else {
        return Ok(());
    };
    let unit = match pressure {
        ..1.5 => "MPa",
        ..100.0 => "bar",
        _ => "kPa",
    };
    let allowed = format!("in Pa, and at least {LEAST_PRESSURE_PA} somewhere: is this {unit}?");
    Err(table.cell_error(row, COLUMNS[1], &allowed))
}
