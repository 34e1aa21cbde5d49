//! The readings: one muscle's force over gauge pressure and length.

use crate::files::input::{InputError, Instead, Problem, quoted};
use crate::files::table::Table;

/// The columns that have to be there.
pub const COLUMNS: [&str; 4] = ["rest_length_m", "gauge_pressure_pa", "length_m", "force_n"];
/// Where it is there: how each reading was come to.
pub const DIRECTION: &str = "direction";
/// Forces up to this share of the largest are those of a slack muscle.
pub const LOADED: f64 = 0.01;
/// Fewest loaded readings that a muscle is identified from.
pub const FEWEST: usize = 5;
/// Relative difference up to which rest lengths are one.
const SAME_LENGTH: f64 = 1e-6;

/// One reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Gauge pressure \[Pa\].
    pub gauge_pressure_pa: f64,
    /// Length \[m\].
    pub length_m: f64,
    /// Force \[N\].
    pub force_n: f64,
    /// 1 where it had contracted before, -1 where it had lengthened, 0 where nobody knows.
    pub direction: f64,
}

/// The readings of one muscle.
#[derive(Debug, Clone, PartialEq)]
pub struct Readings {
    /// Its length at rest \[m\].
    pub rest_length_m: f64,
    /// Those at which it pulled.
    pub loaded: Vec<Reading>,
    /// How many found it slack.
    pub slack: usize,
}

impl Readings {
    /// Whether a table is a static map, and not a record over time.
    pub fn are_in(table: &Table) -> bool {
        table.columns().iter().any(|column| column.name == COLUMNS[1])
    }

    /// Those of a table. Rows without a force have not been measured yet.
    ///
    /// # Errors
    /// For columns that are missing or unknown, values that cannot be, and more than one muscle.
    pub fn of(table: &Table) -> Result<Self, InputError> {
        let known = || COLUMNS.iter().chain([&DIRECTION]);
        let unknown =
            table.columns().iter().find(|column| !known().any(|name| *name == column.name));
        if let Some(column) = unknown {
            let instead = Instead::Known(known().map(|name| (*name).to_owned()).collect());
            let column = quoted(&column.name);
            return Err(table.header_error(Problem::UnknownColumn { column, instead }));
        }
        let [rest, gauge, length, force] = COLUMNS.map(|name| table.column(name));
        let (rest, gauge, length, force) = (rest?, gauge?, length?, force?);
        let directions = table.column(DIRECTION).ok();
        let rest_length_m = rest.iter().flatten().next().copied().unwrap_or_default();
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
                let one = format!("{rest_length_m}, as above: one muscle a file");
                return Err(table.cell_error(row, COLUMNS[0], &one));
            }
            let range_m = [0.5 * rest_length_m, 1.1 * rest_length_m];
            if !(0.0..=1.0e6).contains(&force_n) {
                return Err(table.cell_error(row, COLUMNS[3], "a number from 0 to 1e6 N"));
            }
            let direction = match directions.and_then(|cells| cells[row]) {
                None => 0.0,
                Some(direction) if [-1.0, 0.0, 1.0].contains(&direction) => direction,
                Some(_) => return Err(table.cell_error(row, DIRECTION, "1, -1 or 0")),
            };
            readings.push(Reading {
                gauge_pressure_pa: cell(gauge, COLUMNS[1], [0.0, 1.0e7], " Pa")?,
                length_m: cell(length, COLUMNS[2], range_m, " m")?,
                force_n,
                direction,
            });
        }
        let least_n = LOADED * largest_n(&readings);
        let all = readings.len();
        let loaded: Vec<Reading> =
            readings.into_iter().filter(|reading| reading.force_n > least_n).collect();
        Ok(Self { rest_length_m, slack: all - loaded.len(), loaded })
    }

    /// Largest force \[N\].
    pub fn largest_n(&self) -> f64 {
        largest_n(&self.loaded)
    }

    /// Contraction of a reading \[-\].
    pub fn contraction(&self, reading: &Reading) -> f64 {
        1.0 - reading.length_m / self.rest_length_m
    }

    /// Whether they tell what was come to by contracting from what was by lengthening.
    pub fn go_both_ways(&self) -> bool {
        [1.0, -1.0].iter().all(|way| self.loaded.iter().any(|reading| reading.direction == *way))
    }
}

fn largest_n(readings: &[Reading]) -> f64 {
    readings.iter().map(|reading| reading.force_n).fold(0.0, f64::max)
}
