//! Values of a joint from a record of its motion, such as that of a drive, instead of an experiment.

use super::experiment::{MOST_LOST, Record, filled, sliding_rad_s};
use super::findings::{self, Estimate};
use super::{Refusal, Values, adopt};
use crate::tune::{Parameter, SLIDING_M_S};
use model_core::joint::JointConfig;
use serde::Serialize;
use std::collections::BTreeMap;
use thermyo_files::input::{InputError, Problem};
use thermyo_files::number::significant;
use thermyo_files::table::Table;
use thermyo_joint::JointLoaded;
use thermyo_record::measured::{
    LEAST_PRESSURE_PA, NOT_ABSOLUTE, check_distances, question_of_highest,
};

/// Largest plausible angle of a joint, below a turn either way \[rad\].
const MOST_RAD: f64 = 6.3;
/// Highest absolute pressure of a filled muscle \[Pa\].
const MOST_PA: f64 = 2.0e6;
/// Distance of two rows above which there is a gap \[s\].
const GAP_S: f64 = 0.1;
/// Columns of muscle a's pressure.
const PRESSURE_A: [&str; 2] = ["a_measured_pressure_pa", "a_pressure_pa"];
/// Column of this project's own records, whose pressures are absolute.
const OWN: &str = "a_code_pressure";
/// Factor on ambient pressure below which both muscles count as vented \[-\].
const VENTED: f64 = 1.2;

/// Distance of the delays that are tried, in steps, and their number either way.
const TRIED_STEPS: i32 = 10;
const MOST_TRIED: i32 = 6;
/// Delay below which nothing is made of it \[s\]; share of the squares that are left, above which it shows nothing \[-\].
const LEAST_DELAY_S: f64 = 4.0e-3;
const SAME_LEFT: f64 = 0.8;

/// Reason why a record gives no values.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Refused(#[from] Refusal),
}

/// Values of a joint from its record.
#[derive(Debug)]
pub struct Identified {
    pub values: Values,
    pub scenario: JointLoaded,
    /// Gaps, and pressures that nothing shows to be absolute.
    pub warnings: Vec<InputError>,
    pub(super) estimate: Estimate,
    pub(super) records: Vec<Record>,
    /// Remark on a delay between angle and pressures.
    delay: Option<String>,
}

impl Identified {
    /// Reason why the values are not reliable, if there is one.
    pub fn failed(&self) -> Option<String> {
        self.delay.clone().or_else(|| self.values.failed())
    }

    pub fn text(&self) -> String {
        let Values { duration_s, torque_rms_n_m, residual_rms_n_m, .. } = self.values;
        let windows = self.estimate.fitted.points.len();
        format!(
            "{duration_s:.1} s of motion, {windows} intervals of even sliding: torque of the muscles {torque_rms_n_m:.3} \
             N m (RMS), {residual_rms_n_m:.3} N m of it is left\n{}",
            self.values.table()
        )
    }

    /// Content of `summary.json`: values by their keys, as those of a muscle.
    pub fn findings(&self) -> impl Serialize {
        let Values { duration_s, highest_pa, torque_rms_n_m, residual_rms_n_m, .. } = self.values;
        let found = self.values.parameters.iter().map(|parameter| {
            let Parameter { path, before, after: value, standard_error, unit, ref remark } =
                *parameter;
            (path, Found { value, standard_error, unit, before, remark })
        });
        Findings {
            duration_s,
            highest_pa,
            parameters: found.collect(),
            open: &self.values.open,
            torque_rms_n_m,
            rmse: Rmse { torque_n_m: residual_rms_n_m },
            remarks: self.failed().into_iter().collect(),
        }
    }
}

#[derive(Serialize)]
struct Findings<'a> {
    duration_s: f64,
    highest_pa: f64,
    parameters: BTreeMap<&'static str, Found<'a>>,
    open: &'a [&'static str],
    torque_rms_n_m: f64,
    rmse: Rmse,
    /// Reasons why the values are not reliable.
    remarks: Vec<String>,
}

#[derive(Serialize)]
struct Found<'a> {
    value: f64,
    standard_error: Option<f64>,
    unit: &'static str,
    before: f64,
    remark: &'a str,
}

#[derive(Serialize)]
struct Rmse {
    torque_n_m: f64,
}

/// Fits inertia, gravity, friction and mid-lengths to a record: columns of `joint_trace.csv`, or `time_s`, `angle_rad`,
/// `a_pressure_pa` and `b_pressure_pa` alone.
///
/// # Errors
/// A column that is missing or holds impossible measurements, with its line; a motion that shows too little.
pub fn identify(loaded: &JointLoaded, table: &Table) -> Result<Identified, RecordError> {
    let config = loaded.config();
    let rows = read(&config, table)?;
    let warnings = gaps(table).into_iter().chain(never_vents(&config, table, &rows)).collect();
    let records = filled(&rows);
    let estimate = findings::estimate(loaded, sliding_rad_s(&config, SLIDING_M_S), &records)?;
    let scenario = adopt(loaded, &estimate.parameters(loaded))?;
    let values = Values::new(loaded, &estimate, &records);
    let delay = delay(loaded, &records, values.residual_rms_n_m);
    Ok(Identified { values, scenario, warnings, estimate, records, delay })
}

/// Names the delay of the pressures, or of the angle, with which the balance of torques leaves least, unless it leaves
/// nearly as little without.
fn delay(loaded: &JointLoaded, records: &[Record], rms_n_m: f64) -> Option<String> {
    let sliding_rad_s = sliding_rad_s(&loaded.config(), SLIDING_M_S);
    let left = |steps: i32| {
        let found = findings::estimate(loaded, sliding_rad_s, &earlier(records, steps));
        found.map_or(f64::INFINITY, |estimate| estimate.fitted.rms_n_m.powi(2))
    };
    let own = rms_n_m * rms_n_m;
    let (earlier, later) = (left(-TRIED_STEPS), left(TRIED_STEPS));
    let way = if later < earlier { 1 } else { -1 };
    // Three neighbours of which the middle one, in the end, leaves least.
    let mut squares = [later.max(earlier), own, later.min(earlier)];
    let mut tried = 1;
    while squares[2] < squares[1] && tried < MOST_TRIED {
        tried += 1;
        squares = [squares[1], squares[2], left(way * tried * TRIED_STEPS)];
    }
    let [before, least, after] = squares;
    // The vertex of the parabola through them.
    let bend = before - 2.0 * least + after;
    let vertex = if bend.is_finite() && bend > 0.0 { 0.5 * (before - after) / bend } else { 0.0 };
    let steps = f64::from(way * TRIED_STEPS) * (f64::from(tried - 1) + vertex);
    let delay_s = steps * loaded.muscles[0].plant.run.step_s;
    if delay_s.abs() < LEAST_DELAY_S || least > SAME_LEFT * own {
        return None;
    }
    let pair = ["the pressures seem", "the angle seems"];
    let [late, than] = if delay_s > 0.0 { [pair[0], "angle"] } else { [pair[1], "pressures"] };
    Some(format!(
        "{late} {:.0} ms later than the {than}: with all read at one time {} N m of torque would be left instead of {}, \
         and the values differ",
        1e3 * delay_s.abs(),
        significant(least.sqrt(), 2),
        significant(rms_n_m, 2)
    ))
}

/// Records with the pressures of so many steps later.
fn earlier(records: &[Record], steps: i32) -> Vec<Record> {
    let last = records.len().saturating_sub(1);
    let shifted = |(i, record): (usize, &Record)| {
        let from = i.saturating_add_signed(steps as isize).min(last);
        Record { pressure_pa: records[from].pressure_pa, ..*record }
    };
    records.iter().enumerate().map(shifted).collect()
}

/// The other unit or zero that explains a wrong pressure, judged by the highest of its column.
fn pressure_unit(highest: f64) -> String {
    match highest {
        ..LEAST_PRESSURE_PA => format!(": {}", question_of_highest(highest)),
        ..=MOST_PA => ": is this gauge pressure?".to_owned(),
        _ => String::new(),
    }
}

/// A column, by the first of its names that the table has; `unit` explains a wrong value, judged by the highest.
fn column<'a>(
    table: &'a Table,
    names: [&'static str; 2],
    ([least, most], what, unit): ([f64; 2], &str, fn(f64) -> String),
) -> Result<&'a [Option<f64>], InputError> {
    let has = |name: &&&str| table.columns().iter().any(|column| column.name == **name);
    let name = names.iter().find(has).unwrap_or(&names[1]);
    let cells = table.column(name)?;
    let wrong = cells.iter().position(|cell| cell.is_some_and(|at| !(least..=most).contains(&at)));
    match wrong {
        Some(row) => {
            let highest = cells.iter().flatten().copied().fold(f64::NEG_INFINITY, f64::max);
            let allowed = format!("{what}{}", unit(highest));
            Err(table.cell_error(row, name, &allowed))
        }
        None => Ok(cells),
    }
}

/// A column that may be missing.
fn spare<'a>(table: &'a Table, name: &str) -> Option<&'a [Option<f64>]> {
    let column = table.columns().iter().find(|column| column.name == name)?;
    Some(&column.cells)
}

fn warning(table: &Table, row: usize, column: &str, value: f64, why: String) -> InputError {
    let key = format!("column {column}");
    let problem = Problem::NoSense { key, value: format!("{value:?}"), why };
    InputError { line: Some(table.line(row)), ..table.header_error(problem) }
}

/// A warning about the first gap; gaps end the motion on either side.
fn gaps(table: &Table) -> Option<InputError> {
    let times = table.filled("time_s").ok()?;
    let distance_s = |row: &usize| times[*row] - times[row - 1];
    let gaps: Vec<usize> = (1..times.len()).filter(|row| distance_s(row) > GAP_S).collect();
    let (first, others) = gaps.split_first()?;
    let gap_s = significant(distance_s(first), 3);
    let others = match others.len() {
        0 => String::new(),
        count => format!(", as {count} more are"),
    };
    let why = format!("{gap_s} s after the row before it{others}: no interval across a gap counts");
    Some(warning(table, *first, "time_s", times[*first], why))
}

/// Gauge pressures fit as well as absolute ones, with another gravity: only a vented joint distinguishes them.
fn never_vents(config: &JointConfig, table: &Table, rows: &[Record]) -> Option<InputError> {
    let ambient_pa = f64::from(config.muscles[0].ambient.pressure_pa);
    let [measured, actual] = PRESSURE_A.map(|name| spare(table, name));
    // A program may have changed one of the columns.
    let apart = |(one, other): (&Option<f64>, &Option<f64>)| Some(((*one)? - (*other)?).abs());
    let pairs = measured.unwrap_or_default().iter().zip(actual.unwrap_or_default());
    let apart_pa: Vec<f64> = pairs.filter_map(apart).collect();
    let differ = apart_pa.iter().sum::<f64>() > 0.5 * ambient_pa * apart_pa.len() as f64;
    if spare(table, OWN).is_some() && !differ {
        return None;
    }
    // A gauge pressure of one muscle may be as low while the other one pulls.
    let higher_pa = rows.iter().map(|Record { pressure_pa: [a, b], .. }| a.max(*b));
    let least_pa = higher_pa.fold(f64::INFINITY, f64::min);
    let name = PRESSURE_A[usize::from(measured.is_none())];
    let cells = spare(table, name)?;
    (least_pa > VENTED * ambient_pa).then(|| {
        let why = "taken as absolute, which no row of a vented joint shows: gauge pressures give another gravity"
            .to_owned();
        warning(table, 0, name, cells[0].unwrap_or(least_pa), why)
    })
}

/// The rows that have angle and pressures.
fn read(config: &JointConfig, table: &Table) -> Result<Vec<Record>, InputError> {
    let step_s = f64::from(config.muscles[0].step_s);
    let time_s = table.filled("time_s")?;
    let angle = (
        [-MOST_RAD, MOST_RAD],
        "an angle from -6.3 to 6.3 rad",
        (|_| ": is this deg?".to_owned()) as fn(f64) -> _,
    );
    let angle_rad = column(table, ["measured_angle_rad", "angle_rad"], angle)?;
    let least_pa = NOT_ABSOLUTE * f64::from(config.muscles[0].ambient.pressure_pa);
    let absolute = format!("an absolute pressure from {least_pa:.0} to 2e6 Pa");
    let pressure = ([least_pa, MOST_PA], absolute.as_str(), pressure_unit as fn(f64) -> _);
    let pressures_pa = [
        column(table, PRESSURE_A, pressure)?,
        column(table, ["b_measured_pressure_pa", "b_pressure_pa"], pressure)?,
    ];
    let walls_k = ["a_wall_estimate_k", "b_wall_estimate_k"].map(|name| spare(table, name));
    let reference_rad = spare(table, "reference_rad");
    let at = |cells: Option<&[Option<f64>]>, row: usize| cells.and_then(|cells| cells[row]);
    let mut records: Vec<Record> = Vec::with_capacity(time_s.len());
    for (row, time) in time_s.iter().enumerate() {
        let since_s = time - time_s[0];
        let step = (since_s / step_s).round() as u32;
        if row > 0 && *time <= time_s[row - 1] {
            let allowed = format!("above {:?}, the time of the row before", time_s[row - 1]);
            return Err(table.cell_error(row, "time_s", &allowed));
        }
        let [Some(a_pa), Some(b_pa)] = pressures_pa.map(|cells| cells[row]) else { continue };
        let Some(angle_rad) = angle_rad[row] else { continue };
        if records.last().is_some_and(|before| before.step == step) {
            continue;
        }
        records.push(Record {
            step,
            time_s: since_s,
            angle_rad,
            reference_rad: at(reference_rad, row).unwrap_or(f64::NAN),
            pressure_pa: [a_pa, b_pa],
            wall_k: [0, 1].map(|i: usize| {
                let ambient_k = f64::from(config.muscles[i].ambient.temperature_k);
                at(walls_k[i], row).unwrap_or(ambient_k)
            }),
        });
    }
    let most_s = f64::from(MOST_LOST + 1) * step_s;
    check_distances(table, &time_s, (most_s, "for the inertia"))?;
    let spaced = |pair: &[Record]| pair[1].step - pair[0].step <= MOST_LOST + 1;
    let far = records.windows(2).filter(|pair| !spaced(pair)).count();
    if far > 0 && 2 * far >= records.len() {
        let allowed = format!("at most {most_s:.3} s after the row before, for the inertia");
        return Err(table.cell_error(1, "time_s", &allowed));
    }
    Ok(records)
}
