//! A pair of muscles against each other, shut off: predicts motion and pressures from the commanded force alone.
//!
//! ```text
//! F - F_0 = K x + z,   z' = s x', |z| <= F_s         x = (L_2 - L_1)/2
//! p_i = p_i0 + g_i x                                 closed gas: g = n p (-dV/dL)/V
//! ```
//!
//! K is the stiffness of both muscles and their gas; over 0.1 % of the length all of it is linear. The slip includes
//! the gear's friction.

use nalgebra::{DMatrix, DVector};
use thermyo_files::input::{InputError, Problem as InputProblem};
use thermyo_files::table::Table;
use thermyo_fit::search::{self, LeastSquares, central_slopes};
use thermyo_record::measured::{check_distances, check_pressures, check_rising, unit_of_length};

const COLUMNS: [&str; 6] =
    ["time_s", "force_command_n", "length_1_m", "length_2_m", "pressure_1_pa", "pressure_2_pa"];
/// Last part of the record, which is not fitted \[s\].
const HELD_OUT_S: f64 = 9.0;
const FEWEST: usize = 10;
/// Largest distance of the record's rows \[s\].
const MOST_S: f64 = 0.2;
/// Plausible lengths of such muscles \[m\].
const LENGTHS_M: [f64; 2] = [0.01, 2.0];
/// Step of the differences.
const DIFFERENCE: f64 = 1.0e-4;

/// Coefficients of determination for the part that was not fitted, and the values found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// Displacement, first and second pressure \[-\].
    pub r2: [f64; 3],
    /// The same for a pair without friction \[-\].
    pub frictionless_r2: [f64; 3],
    pub slip_n: f64,
    pub slip_n_m: f64,
    pub stiffness_n_m: f64,
}

struct Problem<'a> {
    forces: &'a [f64],
    ways: &'a [f64],
    /// Whether slip's force and stiffness are searched.
    slips: bool,
}

/// ln K, offset over 10 N, ln F_s, ln s.
const START: [f64; 4] = [11.5, 0.0, 3.0, 12.5];

impl Problem<'_> {
    fn values(&self, place: &DVector<f64>) -> [f64; 4] {
        let slip = |i: usize| if self.slips { place[i].exp() } else { 0.0 };
        [place[0].exp(), 10.0 * place[1], slip(2), slip(3)]
    }

    fn ways(&self, place: &DVector<f64>, forces: &[f64]) -> Vec<f64> {
        let [stiffness, offset, limit, slip] = self.values(place);
        let mut slider = 0.0;
        let way = |force: &f64| {
            let free = force - offset;
            // Stuck, or sliding one way or the other.
            let stuck = (free + slip * slider) / (stiffness + slip);
            let held = slip * (stuck - slider);
            if held.abs() <= limit {
                return stuck;
            }
            let sliding = (free - limit.copysign(held)) / stiffness;
            slider = if slip > 0.0 { sliding - limit.copysign(held) / slip } else { sliding };
            sliding
        };
        forces.iter().map(way).collect()
    }
}

impl LeastSquares for Problem<'_> {
    fn weighted(&self, place: &DVector<f64>) -> DVector<f64> {
        let ways = self.ways(place, self.forces);
        let left = ways.iter().zip(self.ways).map(|(way, is)| 1.0e4 * (way - is));
        // Without slip its two variables stay at their start.
        let idle = place.iter().zip(START).map(|(place, start)| 1.0e-3 * (place - start));
        DVector::from_vec(left.chain(idle).collect())
    }

    fn slopes(&self, place: &DVector<f64>, _: &DVector<f64>) -> DMatrix<f64> {
        central_slopes(place, DIFFERENCE, |_| DIFFERENCE, |place| self.weighted(place))
    }
}

/// Fits all but the last part of a record, and compares with that part.
///
/// # Errors
/// For missing columns, empty cells, times that do not rise, other units, constant pressures, and a record without a
/// part to fit.
pub fn pair(table: &Table, ambient_pa: f64) -> Result<Pair, InputError> {
    let [times, forces, first, second, pressure_1, pressure_2] =
        COLUMNS.map(|name| table.filled(name));
    let (times, forces) = (times?, forces?);
    check_rising(table, &times)?;
    check_distances(table, &times, (MOST_S, "which shows slip"))?;
    let (first, second) =
        (lengths(table, COLUMNS[2], first?)?, lengths(table, COLUMNS[3], second?)?);
    let pressures = [pressure_1?, pressure_2?];
    for column in &COLUMNS[4..] {
        check_pressures(table, column, ambient_pa)?;
    }
    let ways: Vec<f64> =
        first.iter().zip(&second).map(|(first, second)| 0.5 * (second - first)).collect();
    let end_s = times.last().copied().unwrap_or_default();
    let cut = times.partition_point(|time| *time < end_s - HELD_OUT_S);
    if cut < FEWEST {
        let why = format!(
            "{cut} rows before its last {HELD_OUT_S:?} s, which are compared: must be {FEWEST} or more"
        );
        let column = COLUMNS[0].to_owned();
        return Err(table.header_error(InputProblem::UnusableColumn { column, why }));
    }
    for (column, cells) in COLUMNS[4..].iter().zip(&pressures) {
        if cells[cut..].iter().all(|cell| *cell == cells[cut]) {
            let why = format!("is the same in its last {HELD_OUT_S:?} s, which are compared");
            let column = (*column).to_owned();
            return Err(table.header_error(InputProblem::UnusableColumn { column, why }));
        }
    }
    let of = |slips: bool| {
        let problem = Problem { forces: &forces[..cut], ways: &ways[..cut], slips };
        let place = search::minimize(&problem, DVector::from_row_slice(&START), 1.0e-10, 200).place;
        let predicted = problem.ways(&place, &forces);
        let [one, two] = [0, 1].map(|i: usize| {
            let (offset, slope) = line(&predicted[..cut], &pressures[i][..cut]);
            let found: Vec<f64> = predicted[cut..].iter().map(|way| offset + slope * way).collect();
            determined(&found, &pressures[i][cut..])
        });
        (problem.values(&place), [determined(&predicted[cut..], &ways[cut..]), one, two])
    };
    let ([stiffness_n_m, _, slip_n, slip_n_m], r2) = of(true);
    Ok(Pair { r2, frictionless_r2: of(false).1, slip_n, slip_n_m, stiffness_n_m })
}

/// Refuses lengths that are in another unit.
fn lengths(table: &Table, column: &str, cells: Vec<f64>) -> Result<Vec<f64>, InputError> {
    let [low, high] = LENGTHS_M;
    match cells.iter().position(|length_m| !(low..=high).contains(length_m)) {
        Some(row) => {
            let unit = unit_of_length(cells[row], LENGTHS_M);
            let unit = unit.map_or_else(String::new, |unit| format!(": is this {unit}?"));
            let allowed = format!("a length from {low} to {high} m{unit}");
            Err(table.cell_error(row, column, &allowed))
        }
        None => Ok(cells),
    }
}

/// Offset and slope of the line through points.
fn line(x: &[f64], y: &[f64]) -> (f64, f64) {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (x0, y0) = (mean(x), mean(y));
    let product: f64 = x.iter().zip(y).map(|(x, y)| (x - x0) * (y - y0)).sum();
    let square: f64 = x.iter().map(|x| (x - x0).powi(2)).sum();
    let slope = product / square;
    (y0 - slope * x0, slope)
}

/// Coefficient of determination.
fn determined(found: &[f64], measured: &[f64]) -> f64 {
    let mean = measured.iter().sum::<f64>() / measured.len() as f64;
    let left: f64 = found.iter().zip(measured).map(|(f, m)| (f - m).powi(2)).sum();
    let all: f64 = measured.iter().map(|m| (m - mean).powi(2)).sum();
    1.0 - left / all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A pair generated by the law itself: 40 N of slip, 150 kN/m.
    #[test]
    fn a_pair_is_found() {
        let known = DVector::from_row_slice(&[1.5e5_f64.ln(), 0.5, 40.0_f64.ln(), 4.0e5_f64.ln()]);
        let forces: Vec<f64> = (0..3000).map(|i| 140.0 * (0.006 * f64::from(i)).sin()).collect();
        let ways = Problem { forces: &[], ways: &[], slips: true }.ways(&known, &forces);
        let mut text = COLUMNS.join(",") + "\n";
        for (i, (force, way)) in forces.iter().zip(&ways).enumerate() {
            let time_s = 0.01 * i as f64;
            let (first, second) = (0.2 - way, 0.2 + way);
            let (p1, p2) = (4.7e5 - 1.1e7 * way, 4.6e5 + 1.2e7 * way);
            text += &format!("{time_s},{force},{first},{second},{p1},{p2}\n");
        }
        let found = pair(&Table::parse(&text, "pair.csv".as_ref()).unwrap(), 1.0e5).unwrap();
        assert!(found.r2.iter().all(|r2| *r2 > 0.9999), "{found:?}");
        assert!((found.slip_n / 40.0 - 1.0).abs() < 1e-2, "{found:?}");
        assert!((found.stiffness_n_m / 1.5e5 - 1.0).abs() < 1e-2, "{found:?}");
        assert!(found.frictionless_r2.iter().all(|r2| (0.5..0.97).contains(r2)), "{found:?}");
    }

    /// R2 hides a wrong unit of the pressures and, nearly, of one of the lengths.
    #[test]
    fn a_pair_in_other_units_is_refused() {
        let refused = |changed: usize, change: &dyn Fn(f64) -> f64| {
            let mut text = COLUMNS.join(",") + "\n";
            for i in 0..3000 {
                let swing = (0.006 * f64::from(i)).sin();
                let row =
                    [0.01 * f64::from(i), 140.0 * swing, 0.2 - 1e-3 * swing, 0.2 + 1e-3 * swing]
                        .into_iter()
                        .chain([-1.0, 1.0].map(|sign| 4.7e5 + 1e4 * sign * swing));
                let cells: Vec<String> = row
                    .enumerate()
                    .map(|(column, cell)| {
                        if column == changed { change(cell) } else { cell }.to_string()
                    })
                    .collect();
                text += &(cells.join(",") + "\n");
            }
            pair(&Table::parse(&text, "pair.csv".as_ref()).unwrap(), 1.0e5).unwrap_err().to_string()
        };
        for (column, unit, end) in [
            (0, 1000.0, "is this ms, or are rows left out?"),
            (
                2,
                1000.0,
                "column length_1_m = 200.0: must be a length from 0.01 to 2 m: is this mm?",
            ),
            (3, -1.0, "column length_2_m = -0.2: must be a length from 0.01 to 2 m"),
            (4, 1e-3, "is this kPa?"),
            (5, -1.0, "is its sign reversed?"),
            (5, 1e-5, "is this bar?"),
        ] {
            let error = refused(column, &|cell| unit * cell);
            assert!(error.ends_with(end), "{error}");
        }
        let constant = refused(5, &|_| 4.7e5);
        let expected =
            "pair.csv: column pressure_2_pa: is the same in its last 9.0 s, which are compared";
        assert_eq!(constant, expected);
    }
}
