//! Accuracy of the estimate on a real muscle: a recording of a board, with a fast reference sensor
//! in the gas. `docs/how-to/measure-your-muscle.md` describes how to record one.

use super::{CaseFigures, Figure};
use thermyo_compute::math;
use thermyo_files::input::{InputError, Problem};
use thermyo_files::table::Table;
use thermyo_record::measured::{TIME, check_distances, check_rising};
use thermyo_scenario::schema::Limits;

/// Column of the reference sensor, and the optional one of its standard deviation.
const REFERENCE: &str = "reference_gas_k";
const REFERENCE_SD: &str = "reference_sd_k";
const SETTLING_S: f64 = 10.0;
/// Largest usual distance of rows, a fifth of the fastest recorded stroke \[s\].
const MOST_DISTANCE_S: f64 = 0.2;
/// Rows with a reference that figures require: they give a share of rows to within some per cent.
const FEWEST_ROWS: u32 = 50;
/// Largest RMS error \[K\], and least fraction of the rows within two stated deviations: the targets of
/// the simulation. One record repeats its errors, so that all of its rows may lie within.
const ERROR_K: f64 = 0.5;
const LEAST_WITHIN: f64 = 0.85;
/// Possible gas temperatures; degrees Celsius are out of range.
const POSSIBLE: Limits = Limits { min: 100.0, max: 1000.0, unit: "K" };

/// Evaluates a recording read from `trace.csv`; `reference_lag_s` is the lag of the reference
/// sensor.
///
/// # Errors
/// If a column is missing or has impossible values, times are in another unit, or the reference has fewer than 50
/// values after the first ten seconds.
pub fn evaluate(recording: &Table, reference_lag_s: f64) -> Result<CaseFigures, InputError> {
    let times_s = recording.filled(TIME)?;
    check_rising(recording, &times_s)?;
    if times_s.len() >= FEWEST_ROWS as usize {
        check_distances(recording, &times_s, (MOST_DISTANCE_S, "to show a stroke"))?;
    }
    let temperatures_k = |name: &str| -> Result<&[Option<f64>], InputError> {
        let cells = recording.column(name)?;
        let wrong = cells.iter().position(|k| k.is_some_and(|k| !POSSIBLE.contains(k)));
        match wrong {
            Some(row) => Err(recording.cell_error(row, name, &POSSIBLE.to_string())),
            None => Ok(cells),
        }
    };
    let reference_k = temperatures_k(REFERENCE)?;
    temperatures_k("estimate_k")?;
    temperatures_k("sensor_gas_k")?;
    let [estimate_k, sensor_k, sd_k] =
        ["estimate_k", "sensor_gas_k", "estimate_sd_k"].map(|name| recording.filled(name));
    let (estimate_k, sensor_k, sd_k) = (estimate_k?, sensor_k?, sd_k?);
    if let Some(row) = sd_k.iter().position(|sd_k| *sd_k < 0.0) {
        return Err(recording.cell_error(row, "estimate_sd_k", "a number from 0 on"));
    }
    let reference_sd_k = of_reference(recording)?;
    let lagged_k = lagged(&times_s, &estimate_k, reference_lag_s);
    let from_s = times_s[0] + SETTLING_S;
    let (mut rows, mut square, mut bare_square, mut sum, mut worst_k, mut within) =
        (0_u32, 0.0, 0.0, 0.0, 0.0_f64, 0_u32);
    for row in 0..times_s.len() {
        let Some(reference_k) = reference_k[row].filter(|_| times_s[row] >= from_s) else {
            continue;
        };
        let error_k = lagged_k[row] - reference_k;
        rows += 1;
        square += error_k * error_k;
        bare_square += (sensor_k[row] - reference_k).powi(2);
        sum += error_k;
        worst_k = worst_k.max(error_k.abs());
        let own_sd_k = reference_sd_k.get(row).copied().flatten().unwrap_or(0.0);
        within += u32::from(error_k.abs() <= 2.0 * sd_k[row].hypot(own_sd_k));
    }
    let unusable = |why: String| {
        recording.header_error(Problem::UnusableColumn { column: REFERENCE.to_owned(), why })
    };
    if rows > 0 && bare_square == 0.0 {
        return Err(unusable("is the sensor's own reading: must be another sensor's".to_owned()));
    }
    if rows < FEWEST_ROWS {
        let why =
            format!("must have {FEWEST_ROWS} values or more from {from_s} s on, and has {rows}");
        return Err(unusable(why));
    }
    let rows = f64::from(rows);
    let (rms_k, bare_k) = ((square / rows).sqrt(), (bare_square / rows).sqrt());
    Ok(CaseFigures {
        case: format!("recording, {rows} rows"),
        figures: vec![
            Figure::at_most("error_k", rms_k, ERROR_K),
            Figure::at_least("within_2sd", f64::from(within) / rows, LEAST_WITHIN),
            // The estimate must not be worse than the bare sensor.
            Figure::at_most("times_bare", rms_k / bare_k, 1.0),
            Figure::shown("bare_k", bare_k),
            Figure::shown("mean_error_k", sum / rows),
            Figure::shown("worst_k", worst_k),
            Figure::shown("reference_lag_s", reference_lag_s),
        ],
    })
}

/// Standard deviations of the reference, if the recording has them.
fn of_reference(recording: &Table) -> Result<Vec<Option<f64>>, InputError> {
    let has_them = recording.columns().iter().any(|column| column.name == REFERENCE_SD);
    if !has_them {
        return Ok(Vec::new());
    }
    let sds_k = recording.column(REFERENCE_SD)?;
    match sds_k.iter().position(|sd_k| sd_k.is_some_and(|sd_k| sd_k < 0.0)) {
        Some(row) => Err(recording.cell_error(row, REFERENCE_SD, "a number from 0 on")),
        None => Ok(sds_k.to_vec()),
    }
}

/// Exact response of a sensor with this lag to values that are linear between rows: it stays behind a ramp by its lag,
/// and approaches this state as exp(-t/lag).
fn lagged(times_s: &[f64], values: &[f64], lag_s: f64) -> Vec<f64> {
    let mut reading = values[0];
    let mut readings = vec![reading];
    for row in 1..values.len() {
        let step_s = times_s[row] - times_s[row - 1];
        let behind = lag_s * (values[row] - values[row - 1]) / step_s;
        let left = if lag_s > 0.0 { math::exp(-step_s / lag_s) } else { 0.0 };
        reading = values[row] - behind + left * (reading - values[row - 1] + behind);
        readings.push(reading);
    }
    readings
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLUMNS: &str = "time_s,estimate_k,estimate_sd_k,sensor_gas_k,reference_gas_k\n";

    fn judged(rows: &str, lag_s: f64) -> Result<Vec<f64>, String> {
        let table = Table::parse(&format!("{COLUMNS}{rows}"), "trace.csv".as_ref()).unwrap();
        let line = evaluate(&table, lag_s).map_err(|error| error.to_string())?;
        Ok(line.figures.iter().map(|figure| figure.value).collect())
    }

    #[test]
    fn errors_count_from_ten_seconds_on_where_there_is_a_reference() {
        let block = ["301,0.5,303,300", "299,0.4,297,", "297,1,300,298", "301,2,296,300"];
        let later: String = (0..80)
            .map(|row| format!("{:.1},{}\n", 15.0 + 0.1 * f64::from(row), block[row as usize % 4]))
            .collect();
        let rows = format!("5,300,0.1,280,300\n14.9,310,0.1,280,300\n{later}");
        let figures = judged(&rows, 0.0).unwrap();
        let expected =
            [1.0, 1.0, 1.0 / (29.0_f64 / 3.0).sqrt(), (29.0_f64 / 3.0).sqrt(), 1.0 / 3.0, 1.0, 0.0];
        for (figure, expected) in figures.iter().zip(expected) {
            assert!((figure - expected).abs() < 1e-12, "{figures:?}");
        }
        let invalid = rows.replace(",297,1,", ",297,0.49,");
        assert!((judged(&invalid, 0.0).unwrap()[1] - 2.0 / 3.0).abs() < 1e-12);
    }

    /// A record is overconfident if too few rows lie within two deviations.
    #[test]
    fn a_record_within_two_deviations_is_good_and_an_overconfident_one_is_not() {
        let missed = |sd_k: f64| {
            let row = |i: u32| {
                format!(
                    "{},300,{sd_k},290,{}\n",
                    0.2 * f64::from(i),
                    300.0 + 0.1 * f64::from(i % 4)
                )
            };
            let rows: String = (0..100).map(row).collect();
            let table = Table::parse(&format!("{COLUMNS}{rows}"), "trace.csv".as_ref()).unwrap();
            let figures = evaluate(&table, 0.0).unwrap().figures;
            let missed = figures.into_iter().filter(|figure| !figure.holds());
            missed.map(|figure| figure.name).collect::<Vec<_>>()
        };
        assert_eq!(missed(0.2), [""; 0]);
        assert_eq!(missed(0.1), ["within_2sd"]);
    }

    /// A ramp of 2 K/s is read 0.05 s late: 0.1 K less; a rest is read as it is.
    #[test]
    fn the_reference_is_compared_with_what_it_would_read() {
        let rows: String = (0..3000)
            .map(|row| {
                let time_s = 0.01 * f64::from(row);
                let read_k = 298.0 + 2.0 * (time_s - 15.0).max(0.0);
                let late_k = 298.0 + 2.0 * (time_s - 15.05).max(0.0);
                format!("{time_s},{read_k},0.2,290,{late_k}\n")
            })
            .collect();
        let [without_k, with_k] = [0.0, 0.05].map(|lag_s| judged(&rows, lag_s).unwrap()[0]);
        assert!((without_k - 0.1 * 0.75_f64.sqrt()).abs() < 1e-3, "{without_k} K");
        assert!(with_k < 0.005, "{with_k} K");
    }

    #[test]
    fn a_record_in_milliseconds_is_refused() {
        let rows: String = (0..60).map(|row| format!("{row},300,0.1,290,300\n")).collect();
        assert_eq!(
            judged(&rows, 0.0).unwrap_err(),
            "trace.csv:3: column time_s = 1.0: must be at most 0.200 s after the row before it, to show a stroke: is \
             this ms, or are rows left out?"
        );
    }

    #[test]
    fn unusable_recordings_are_named() {
        for (rows, expected) in [
            (
                "0,300,0.1,300,25.2\n",
                "trace.csv:2: column reference_gas_k = 25.2: must be a number from 100 to 1000 K",
            ),
            (
                "0,300,0.1,300,300\n0,300,0.1,300,300\n",
                "trace.csv:3: column time_s = 0.0: must be later than the row before it, at 0.0 s",
            ),
            (
                "0,300,-1,300,300\n",
                "trace.csv:2: column estimate_sd_k = -1.0: must be a number from 0 on",
            ),
            ("0,,0.1,300,300\n", "trace.csv:2: column estimate_k"),
            (
                "0,300,0.1,300,300\n20,300,0.1,300,\n",
                "trace.csv: column reference_gas_k: must have 50 values or more from 10 s on, and has 0",
            ),
            (
                "0,300,0.1,300,300\n20,300,0.1,299,300.1\n",
                "trace.csv: column reference_gas_k: must have 50 values or more from 10 s on, and has 1",
            ),
            (
                "0,300,0.1,300,300\n20,301,0.1,300,300\n",
                "trace.csv: column reference_gas_k: is the sensor's own reading: must be another sensor's",
            ),
        ] {
            let error = judged(rows, 0.0).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
        let text = "time_s,estimate_k,estimate_sd_k,sensor_gas_k,reference_gas_k,reference_sd_k\n0,300,1,300,300,-1\n";
        let table = Table::parse(text, "trace.csv".as_ref()).unwrap();
        let error = evaluate(&table, 0.0).unwrap_err().to_string();
        let expected = "trace.csv:2: column reference_sd_k = -1.0: must be a number from 0 on";
        assert_eq!(error, expected);
    }
}
