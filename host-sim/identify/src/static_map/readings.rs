//! Readings of one muscle's force over gauge pressure and length.

use std::collections::{HashMap, HashSet};
use thermyo_files::input::{InputError, Instead, Problem, quoted};
use thermyo_files::table::Table;
use thermyo_record::measured::{question_of_highest, unit_of_length};

pub const COLUMNS: [&str; 4] = ["rest_length_m", "gauge_pressure_pa", "length_m", "force_n"];
/// Optional column: the direction from which each reading was approached.
pub const DIRECTION: &str = "direction";
/// Forces up to this fraction of the largest count as slack.
pub const LOADED: f64 = 0.01;
/// Largest negative reading of a load cell, as a fraction of the largest force.
const BELOW_ZERO: f64 = 0.02;
/// Least gauge pressure that a map must contain: a map without one is in another unit \[Pa\].
const LEAST_PRESSURE_PA: f64 = 1.0e4;
/// Column of absolute pressures, as in a record over time.
const ABSOLUTE: &str = "pressure_pa";
/// Fewest loaded readings for an identification.
pub const FEWEST: usize = 5;
/// Relative difference up to which rest lengths count as equal.
const SAME_LENGTH: f64 = 1e-6;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    pub line: u64,
    pub gauge_pressure_pa: f64,
    pub length_m: f64,
    pub force_n: f64,
    /// 1 after contracting, -1 after lengthening, 0 where unknown.
    pub direction: f64,
}

/// Bits of a number: equal numbers have equal bits, -0 and 0 too.
fn bits(number: f64) -> u64 {
    (number + 0.0).to_bits()
}

impl Reading {
    /// Bits of a reading's values; a copy of its line has the same.
    fn bits(&self) -> [u64; 4] {
        let Self { gauge_pressure_pa, length_m, force_n, direction, .. } = *self;
        [gauge_pressure_pa, length_m, force_n, direction].map(bits)
    }
}

#[derive(Debug, Clone, PartialEq)]
pub struct Readings {
    pub rest_length_m: f64,
    pub loaded: Vec<Reading>,
    /// Readings without a force.
    pub slack: Vec<Reading>,
    /// Lines that repeat an earlier line to the last digit, each with that line: copies, not readings.
    pub copies: Vec<[u64; 2]>,
}

impl Readings {
    /// Distinguishes a static map from a record over time.
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
    /// As [`Readings::of`], and if the table is of another muscle, or no reading is loaded.
    pub fn to_compare(&self, table: &Table) -> Result<Self, InputError> {
        let others = Self::beside(table, Some(self))?;
        if others.loaded.is_empty() {
            let why = "there is nothing to compare with".to_owned();
            return Err(table.header_error(Problem::TooFewLoaded { found: 0, fewest: 1, why }));
        }
        Ok(others)
    }

    fn beside(table: &Table, fitted: Option<&Self>) -> Result<Self, InputError> {
        refuse_absolute_column(table)?;
        let [rest, gauge, length, force] = COLUMNS.map(|name| table.column(name));
        let (rest, gauge, length, force) = (rest?, gauge?, length?, force?);
        refuse_unknown(table)?;
        let directions = table.column(DIRECTION).ok();
        let first_m = rest.iter().flatten().next().copied().unwrap_or_default();
        let rest_length_m = fitted.map_or(first_m, |fitted| fitted.rest_length_m);
        let mut readings: Vec<Reading> = Vec::new();
        let mut lines = HashMap::new();
        let mut copies = Vec::new();
        for (row, force_n) in force.iter().enumerate() {
            let Some(force_n) = *force_n else { continue };
            let cell = |cells: &[Option<f64>], name: &str, [low, high]: [f64; 2], unit: &str| {
                let value = cells[row].filter(|value| (low..=high).contains(value));
                let allowed = || {
                    let length = cells[row].filter(|_| unit == " m");
                    let meant = length.and_then(|length| unit_of_length(length, [low, high]));
                    let meant = meant.map_or_else(String::new, |unit| format!(": is this {unit}?"));
                    format!("a number from {low} to {high}{unit}{meant}")
                };
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
            let reading = Reading {
                line: table.line(row),
                gauge_pressure_pa: cell(gauge, COLUMNS[1], [0.0, 1.0e7], " Pa")?,
                length_m: cell(length, COLUMNS[2], range_m, " m")?,
                force_n,
                direction,
            };
            let first = *lines.entry(reading.bits()).or_insert(reading.line);
            if first == reading.line {
                readings.push(reading);
            } else {
                copies.push([reading.line, first]);
            }
        }
        let largest_n = largest_n(&readings).max(fitted.map_or(0.0, Self::largest_n));
        possible_forces(table, force, largest_n)?;
        in_pascals(table, gauge, force)?;
        let (loaded, slack) =
            readings.into_iter().partition(|reading| reading.force_n > LOADED * largest_n);
        Ok(Self { rest_length_m, loaded, slack, copies })
    }

    pub fn largest_n(&self) -> f64 {
        largest_n(&self.loaded)
    }

    /// Number of pairs of pressure and length with a force.
    pub fn places(&self) -> usize {
        let at = |reading: &Reading| [reading.gauge_pressure_pa, reading.length_m].map(bits);
        self.loaded.iter().map(at).collect::<HashSet<_>>().len()
    }

    pub fn contraction(&self, reading: &Reading) -> f64 {
        1.0 - reading.length_m / self.rest_length_m
    }

    /// Whether there are readings after contracting and after lengthening.
    pub fn go_both_ways(&self) -> bool {
        [1.0, -1.0].iter().all(|way| self.loaded.iter().any(|reading| reading.direction == *way))
    }
}

/// Refuses absolute pressures in the place of gauge pressures.
fn refuse_absolute_column(table: &Table) -> Result<(), InputError> {
    let has = |name: &str| table.columns().iter().any(|column| column.name == name);
    if has(COLUMNS[1]) || !has(ABSOLUTE) {
        return Ok(());
    }
    let why = format!(
        "is absolute, and a static map has gauge pressures: subtract the ambient one, and name it {}",
        COLUMNS[1]
    );
    Err(table.header_error(Problem::UnusableColumn { column: ABSOLUTE.to_owned(), why }))
}

/// Refuses a column that a static map does not have.
fn refuse_unknown(table: &Table) -> Result<(), InputError> {
    let known = || COLUMNS.iter().chain([&DIRECTION]);
    let unknown = table.columns().iter().find(|column| !known().any(|name| *name == column.name));
    let Some(column) = unknown else { return Ok(()) };
    let instead = Instead::Known(known().map(|name| (*name).to_owned()).collect());
    let column = quoted(&column.name);
    Err(table.header_error(Problem::UnknownColumn { column, instead }))
}

fn largest_n(readings: &[Reading]) -> f64 {
    readings.iter().map(|reading| reading.force_n).fold(0.0, f64::max)
}

/// Refuses forces far below zero.
fn possible_forces(table: &Table, force: &[Option<f64>], largest_n: f64) -> Result<(), InputError> {
    let possible_n = -BELOW_ZERO * largest_n..=1.0e6;
    let impossible = |cell: &Option<f64>| cell.is_some_and(|n| !possible_n.contains(&n));
    let Some(row) = force.iter().position(impossible) else { return Ok(()) };
    Err(table.cell_error(row, COLUMNS[3], "a number from -2 % of the largest to 1e6 N"))
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
    let question = question_of_highest(pressure);
    let allowed = format!("in Pa, and at least {LEAST_PRESSURE_PA} somewhere: {question}");
    Err(table.cell_error(row, COLUMNS[1], &allowed))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn copies_count_once_and_repeated_places_as_one() {
        let rows = ["132500,0.25,84.83", "132500,0.25,84.83", "132500,0.25,84.9", "132500,0.24,40"];
        let text =
            rows.iter().fold(COLUMNS.join(",") + "\n", |text, row| text + "0.25," + row + "\n");
        let readings = Readings::of(&Table::parse(&text, "m.csv".as_ref()).unwrap()).unwrap();
        assert_eq!(readings.copies, [[3, 2]]);
        assert_eq!((readings.loaded.len(), readings.places()), (3, 2));
    }

    /// A spreadsheet that rounds -0.04 kPa writes "-0.0".
    #[test]
    fn a_rounded_negative_zero_is_zero() {
        assert_eq!(super::bits(-0.0), super::bits(0.0));
        assert_ne!(super::bits(-1.0), super::bits(1.0));
    }
}
