//! A chamber with measured volume and elastic force over its length, such as a bellows.
//!
//! Interpolates between the rows by cubics. Each slope is the mean of the neighbouring slopes,
//! limited so that nothing overshoots (Fritsch and Carlson, SIAM J. Numer. Anal. 17, 1980). Beyond
//! the rows it continues linearly, so that a solver finds its way back; a run that stays there
//! ends.

use super::{Chamber, LARGEST_LOAD_N};
use model_core::physics::chamber::ChamberConfig;
use model_core::physics::chamber::table::{self as configured, MOST_ROWS};
use std::f64::consts::PI;
use thermyo_compute::math;
use thermyo_scenario::ChamberTable as Table;
use thermyo_scenario::WrongCell;

/// The first inconsistent cell: lengths and forces must rise, volumes rise or fall.
pub fn wrong_cell(rows: &[[f64; 3]]) -> Option<WrongCell> {
    let wrong = |row, column, allowed: String| Some(WrongCell { row, column, allowed });
    let [least, most] = [3, MOST_ROWS];
    if rows.len() > most || rows.len() < least {
        let row = rows.len().min(most + 1).saturating_sub(1);
        return wrong(row, 0, format!("the last one of {least} to {most} rows"));
    }
    let falls = rows[1][1] < rows[0][1];
    for (row, &[length_m, volume_m3, force_n]) in rows.iter().enumerate() {
        if !(0.001..=10.0).contains(&length_m) {
            return wrong(row, 0, "a number from 0.001 to 10 m".to_owned());
        }
        if !(1.0e-8..=1.0).contains(&volume_m3) {
            return wrong(row, 1, "a number from 1e-8 to 1 m3".to_owned());
        }
        if force_n.is_nan() || force_n.abs() > 1.0e6 {
            return wrong(row, 2, "a number from -1e6 to 1e6 N".to_owned());
        }
        let Some(&[length_0, volume_0, force_0]) = row.checked_sub(1).map(|before| &rows[before])
        else {
            continue;
        };
        if length_m < length_0 + 1.0e-4 {
            return wrong(row, 0, "above that of the row before by 0.1 mm".to_owned());
        }
        let change = (volume_m3 / volume_0 - 1.0) * if falls { -1.0 } else { 1.0 };
        if change < 1.0e-5 {
            let way = if falls { "below" } else { "above" };
            return wrong(
                row,
                1,
                format!("{way} that of the row before, as in the first two rows"),
            );
        }
        if force_n < force_0 {
            return wrong(row, 2, "no less than that of the row before".to_owned());
        }
    }
    None
}

/// Value and slope over the length at one row.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Knot {
    value: f64,
    slope: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    lengths: [f64; MOST_ROWS],
    volumes: [Knot; MOST_ROWS],
    forces: [Knot; MOST_ROWS],
    count: usize,
    rest_length_m: f64,
    zones: usize,
}

/// Knots through the values at these lengths.
fn knots(lengths: &[f64], values: impl Fn(usize) -> f64) -> [Knot; MOST_ROWS] {
    let mut knots = [Knot::default(); MOST_ROWS];
    let last = lengths.len() - 1;
    let secant = |i: usize| (values(i + 1) - values(i)) / (lengths[i + 1] - lengths[i]);
    for (i, knot) in knots.iter_mut().enumerate().take(lengths.len()) {
        let slope = if i == 0 {
            // The slope of the parabola through the first three rows.
            1.5 * secant(0) - 0.5 * secant(1)
        } else if i == last {
            1.5 * secant(last - 1) - 0.5 * secant(last - 2)
        } else {
            let (before, after) = (lengths[i] - lengths[i - 1], lengths[i + 1] - lengths[i]);
            (after * secant(i - 1) + before * secant(i)) / (before + after)
        };
        *knot = Knot { value: values(i), slope };
    }
    for i in 0..last {
        let secant = secant(i);
        for end in [i, i + 1] {
            if knots[end].slope * secant <= 0.0 {
                knots[end].slope = 0.0;
            }
        }
        if secant != 0.0 {
            let [alpha, beta] = [knots[i].slope / secant, knots[i + 1].slope / secant];
            let radius = math::hypot(alpha, beta);
            if radius > 3.0 {
                knots[i].slope *= 3.0 / radius;
                knots[i + 1].slope *= 3.0 / radius;
            }
        }
    }
    knots
}

impl Measured {
    /// Chamber of a scenario's checked table and rows; one litre without rows.
    pub fn of(table: &Table, rows: &[[f64; 3]]) -> Self {
        let unknown = [[0.1, 1.0e-3, 0.0], [0.2, 2.0e-3, 0.0], [0.3, 3.0e-3, 0.0]];
        let rows = if wrong_cell(rows).is_none() { rows } else { &unknown };
        let mut lengths = [0.0; MOST_ROWS];
        lengths.iter_mut().zip(rows).for_each(|(length, row)| *length = row[0]);
        let known = &lengths[..rows.len()];
        let volumes = knots(known, |i| rows[i][1] + table.dead_volume_m3);
        let forces = knots(known, |i| rows[i][2]);
        let mut measured = Self {
            lengths,
            volumes,
            forces,
            count: rows.len(),
            rest_length_m: 0.0,
            zones: table.zones,
        };
        measured.rest_length_m = table.rest_length_m.unwrap_or_else(|| measured.free_length());
        measured
    }

    /// Length at which the force is 0, or the end nearest to it.
    fn free_length(&self) -> f64 {
        let [mut low, mut high] = self.range();
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.elastic(middle) < 0.0 { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }

    /// Value, slope and curvature at a length.
    fn at(&self, knots: &[Knot; MOST_ROWS], length: f64) -> [f64; 3] {
        let known = &self.lengths[..self.count];
        let beyond = |i: usize| {
            let Knot { value, slope } = knots[i];
            [value + slope * (length - known[i]), slope, 0.0]
        };
        let last = self.count - 1;
        if length <= known[0] {
            return beyond(0);
        }
        if length >= known[last] {
            return beyond(last);
        }
        // A length that diverged to NaN lies behind no row.
        let i = known.partition_point(|start| *start <= length).saturating_sub(1);
        let (from, to) = (knots[i], knots[i + 1]);
        let width = known[i + 1] - known[i];
        let t = (length - known[i]) / width;
        // Hermite's basis.
        let (one, two) = (from.value, to.value);
        let value = (1.0 + 2.0 * t) * (1.0 - t) * (1.0 - t) * one
            + t * (1.0 - t) * (1.0 - t) * width * from.slope
            + t * t * (3.0 - 2.0 * t) * two
            + t * t * (t - 1.0) * width * to.slope;
        let slope = 6.0 * t * (1.0 - t) * (two - one) / width
            + (1.0 - t) * (1.0 - 3.0 * t) * from.slope
            + t * (3.0 * t - 2.0) * to.slope;
        let curvature = (6.0 - 12.0 * t) * (two - one) / (width * width)
            + ((6.0 * t - 4.0) * from.slope + (6.0 * t - 2.0) * to.slope) / width;
        [value, slope, curvature]
    }
}

impl Chamber for Measured {
    fn rest_length(&self) -> f64 {
        self.rest_length_m
    }

    fn lengths(&self) -> [f64; 2] {
        self.range()
    }

    fn range(&self) -> [f64; 2] {
        [self.lengths[0], self.lengths[self.count - 1]]
    }

    /// No limits are known.
    fn stops(&self) -> [f64; 2] {
        [f64::NEG_INFINITY, f64::INFINITY]
    }

    /// The table's elasticity holds it in both directions.
    fn loads(&self) -> [f64; 2] {
        [-LARGEST_LOAD_N, LARGEST_LOAD_N]
    }

    fn volume(&self, length: f64) -> f64 {
        self.at(&self.volumes, length)[0]
    }

    fn force_area(&self, length: f64) -> f64 {
        -self.at(&self.volumes, length)[1]
    }

    fn force_area_slope(&self, length: f64) -> f64 {
        -self.at(&self.volumes, length)[2]
    }

    fn elastic(&self, length: f64) -> f64 {
        self.at(&self.forces, length)[0]
    }

    fn elastic_slope(&self, length: f64) -> f64 {
        self.at(&self.forces, length)[1]
    }

    /// The surface of a smooth tube of this volume and length, with its ends; `heat.scale` allows
    /// for folds.
    fn surface(&self, length: f64) -> f64 {
        let diameter = self.diameter(length);
        PI * diameter * (length + 0.5 * diameter)
    }

    fn diameter(&self, length: f64) -> f64 {
        (4.0 * self.volume(length) / (PI * length)).sqrt()
    }

    fn zones(&self) -> usize {
        self.zones
    }

    fn configured(&self, tube_m3: f64) -> ChamberConfig {
        let mut rows = [configured::Row::default(); MOST_ROWS];
        for (i, row) in rows.iter_mut().enumerate().take(self.count) {
            *row = configured::Row {
                length_m: self.lengths[i] as f32,
                volume_m3: (self.volumes[i].value + tube_m3) as f32,
                force_n: self.forces[i].value as f32,
            };
        }
        ChamberConfig::Table(configured::Table {
            rows,
            count: self.count as u8,
            rest_length_m: self.rest_length_m as f32,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: [[f64; 3]; 4] = [
        [0.08, 1.0e-4, -80.0],
        [0.10, 1.4e-4, 80.0],
        [0.11, 1.58e-4, 200.0],
        [0.13, 1.9e-4, 500.0],
    ];

    #[test]
    fn slopes_are_those_of_the_values() {
        let measured = Measured::of(&Table::default(), &ROWS);
        for length in [0.07, 0.081, 0.095, 0.0999, 0.1001, 0.12, 0.129, 0.14] {
            let h = 1.0e-6;
            let slope =
                |value: &dyn Fn(f64) -> f64| (value(length + h) - value(length - h)) / (2.0 * h);
            let close =
                |found: f64, expected: f64| (found - expected).abs() < 1e-5 * expected.abs() + 1e-7;
            assert!(
                close(measured.force_area(length), -slope(&|l| measured.volume(l))),
                "{length}"
            );
            assert!(close(measured.force_area_slope(length), slope(&|l| measured.force_area(l))));
            assert!(close(measured.elastic_slope(length), slope(&|l| measured.elastic(l))));
            assert!(measured.force_area(length) < 0.0, "it lengthens");
        }
        for [length_m, volume_m3, force_n] in ROWS {
            assert!((measured.volume(length_m) / volume_m3 - 1.0).abs() < 1e-12);
            assert!((measured.elastic(length_m) - force_n).abs() < 1e-9);
        }
        assert!(measured.elastic(measured.rest_length()).abs() < 1e-6, "free at rest");
    }

    #[test]
    fn rows_that_are_no_chamber_are_named() {
        assert_eq!(wrong_cell(&ROWS), None);
        for (row, column, value) in [
            (2, 0, 0.1),
            (1, 1, 1.0e-4),
            (3, 1, 1.5e-4),
            (2, 2, 70.0),
            (0, 2, f64::NAN),
            (1, 0, 0.0),
        ] {
            let mut rows = ROWS;
            rows[row][column] = value;
            let found = wrong_cell(&rows).unwrap();
            assert_eq!((found.row, found.column), (row, column), "{found:?}");
        }
        assert!(wrong_cell(&ROWS[..2]).is_some() && wrong_cell(&[]).is_some());
    }
}
