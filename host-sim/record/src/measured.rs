//! Measurements to compare with a run (`--measured`): time_s and any columns of the trace.

use std::path::Path;
use thermyo_compute::math::usual_distance;
use thermyo_files::input::{InputError, Instead, Problem, nearest, quoted};
use thermyo_files::number::{short, significant};
use thermyo_files::table::Table;
use thermyo_scenario::profile::LEAST_DISTANCE_S;
use thermyo_scenario::schema::Limits;

pub const TIME: &str = "time_s";

/// Limits of plausible values: beyond them the unit is wrong or a wire is broken.
const POSSIBLE: [(&str, Limits); 10] = [
    (TIME, Limits { min: 0.0, max: 1.0e6, unit: "s" }),
    ("pressure_pa", Limits { min: 1.0e3, max: 1.0e8, unit: "Pa" }),
    ("volume_m3", Limits { min: 1.0e-9, max: 1.0e6, unit: "m3" }),
    ("length_m", Limits { min: 1.0e-4, max: 20.0, unit: "m" }),
    ("sensor_gas_k", Limits { min: 100.0, max: 1000.0, unit: "K" }),
    ("sensor_wall_k", Limits { min: 100.0, max: 1000.0, unit: "K" }),
    ("gas_temperature_k", Limits { min: 100.0, max: 1000.0, unit: "K" }),
    ("wall_temperature_k", Limits { min: 100.0, max: 1000.0, unit: "K" }),
    ("duty_in", Limits { min: 0.0, max: 1.0, unit: "" }),
    ("duty_out", Limits { min: 0.0, max: 1.0, unit: "" }),
];

/// Share of the ambient pressure below which pressures must be gauge pressures, since no muscle goes that low \[-\].
pub const NOT_ABSOLUTE: f64 = 0.8;
/// Pressure that a record must exceed at least once; otherwise it is in another unit \[Pa\].
pub const LEAST_PRESSURE_PA: f64 = 2.0e4;
/// Upper limit, as for `supply.pressure_pa` \[Pa\].
const MOST_PRESSURE_PA: f64 = 3.0e6;
/// Rounding of the distances of times in the file, at most \[-\].
const ROUNDING: f64 = 1.0e-3;

/// Refuses gauge pressures.
fn check_absolute(
    table: &Table,
    column: &str,
    cells: &[Option<f64>],
    ambient_pa: f64,
) -> Result<(), InputError> {
    let least_pa = NOT_ABSOLUTE * ambient_pa;
    match cells.iter().position(|cell| cell.is_some_and(|pressure| pressure < least_pa)) {
        Some(row) => {
            let allowed = format!(
                "absolute, and no less than {least_pa:.0} Pa, 80 % of ambient.pressure_pa = {ambient_pa:?}: is this gauge \
                 pressure? Add the ambient one; at altitude set that key"
            );
            Err(table.cell_error(row, column, &allowed))
        }
        None => Ok(()),
    }
}

/// The unit of a measured length, if it is in range in that unit.
pub fn unit_of_length(length: f64, [low, high]: [f64; 2]) -> Option<&'static str> {
    let units = [(1e-3, "mm"), (1e-2, "cm")];
    units.iter().find(|(metres, _)| (low..=high).contains(&(metres * length))).map(|unit| unit.1)
}

/// The question about a muscle's highest pressure if the number is this small.
pub fn question_of_highest(pressure: f64) -> &'static str {
    match pressure {
        ..0.0 => "is its sign reversed?",
        ..2.0 => "is this MPa?",
        ..50.0 => "is this bar?",
        ..450.0 => "is this kPa, or psi?",
        ..3000.0 => "is this kPa?",
        _ => "is this mbar?",
    }
}

/// Refuses pressures of a muscle that are in another unit, impossible ones, and gauge pressures, if the table has the
/// column.
///
/// # Errors
/// With the line of the highest pressure, or of the first gauge pressure.
pub fn check_pressures(table: &Table, column: &str, ambient_pa: f64) -> Result<(), InputError> {
    let Some(own) = table.columns().iter().find(|own| own.name == column) else { return Ok(()) };
    let rows = own.cells.iter().enumerate();
    let pressures = rows.filter_map(|(row, cell)| Some((row, (*cell)?)));
    let highest = pressures.max_by(|(_, a), (_, b)| a.total_cmp(b));
    let is_usual = |pressure: f64| (LEAST_PRESSURE_PA..=MOST_PRESSURE_PA).contains(&pressure);
    let Some((row, pressure)) = highest.filter(|(_, pressure)| !is_usual(*pressure)) else {
        return check_absolute(table, column, &own.cells, ambient_pa);
    };
    if pressure > MOST_PRESSURE_PA {
        let allowed = format!("at most {MOST_PRESSURE_PA:?} Pa");
        return Err(table.cell_error(row, column, &allowed));
    }
    let question = question_of_highest(pressure);
    let allowed =
        format!("absolute and in Pa, and at least {LEAST_PRESSURE_PA} somewhere: {question}");
    Err(table.cell_error(row, column, &allowed))
}

/// Refuses values that cannot have been measured; times may have any value if the record may begin anywhere.
///
/// # Errors
/// With the line of the first such value in a column.
pub fn check_possible(table: &Table, anywhere: bool) -> Result<(), InputError> {
    for column in table.columns().iter().filter(|own| !(anywhere && own.name == TIME)) {
        let Some((name, limits)) = POSSIBLE.iter().find(|(name, _)| *name == column.name) else {
            continue;
        };
        let possible = |cell: &Option<f64>| cell.is_none_or(|value| limits.contains(value));
        if let Some(row) = column.cells.iter().position(|cell| !possible(cell)) {
            return Err(table.cell_error(row, name, &limits.to_string()));
        }
    }
    Ok(())
}

/// Times, one per row, that do not fall.
///
/// # Errors
/// For missing times, and with the first line whose time is before the preceding row's.
pub fn ordered(table: &Table) -> Result<Vec<f64>, InputError> {
    let times = table.filled(TIME)?;
    match times.windows(2).position(|pair| pair[1] < pair[0]) {
        Some(row) => {
            let allowed = format!("at least {:?}, the time of the row before", times[row]);
            Err(table.cell_error(row + 1, TIME, &allowed))
        }
        None => Ok(times),
    }
}

/// Refuses times that do not rise.
///
/// # Errors
/// With the first such line.
pub fn check_rising(table: &Table, times: &[f64]) -> Result<(), InputError> {
    match times.windows(2).position(|pair| pair[1] <= pair[0]) {
        Some(row) => {
            let allowed = format!("later than the row before it, at {:?} s", times[row]);
            Err(table.cell_error(row + 1, TIME, &allowed))
        }
        None => Ok(()),
    }
}

/// Refuses times in ms or min, and rows too far apart, judged by their usual distance: at most `most_s`, for which
/// `why` is the reason.
///
/// # Errors
/// With the first row that is too far from the preceding one, or too close to it.
pub fn check_distances(
    table: &Table,
    times: &[f64],
    (most_s, why): (f64, &str),
) -> Result<(), InputError> {
    let usual_s = usual_distance(times);
    let longest_s = (1.0 + ROUNDING) * most_s;
    let (is_wrong, allowed): (&dyn Fn(f64) -> bool, String) = if usual_s > longest_s {
        let most = significant(most_s, 3);
        let allowed = format!(
            "at most {most} s after the row before it, {why}: is this ms, or are rows left out?"
        );
        (&|distance_s| distance_s > longest_s, allowed)
    } else if usual_s < LEAST_DISTANCE_S {
        let allowed = format!(
            "at least {LEAST_DISTANCE_S} s after the row before it: is this min or h? Leave out rows of a faster record"
        );
        (&|distance_s| distance_s < LEAST_DISTANCE_S, allowed)
    } else {
        return Ok(());
    };
    match times.windows(2).position(|pair| is_wrong(pair[1] - pair[0])) {
        Some(row) => Err(table.cell_error(row + 1, TIME, &allowed)),
        None => Ok(()),
    }
}

/// Distance of rows, and length, from which a record may be in milliseconds \[s\].
const DOUBTFUL_ROWS_S: f64 = 1.0;
const DOUBTFUL_LENGTH_S: f64 = 3600.0;

/// A question about the unit of times that last for hours. A slow logger's times do so too.
pub fn doubt(table: &Table) -> Option<InputError> {
    let times = table.filled(TIME).ok()?;
    let (usual_s, last_s) = (usual_distance(&times), since_s(*times.last()?, times[0]));
    (usual_s >= (1.0 - ROUNDING) * DOUBTFUL_ROWS_S && last_s >= DOUBTFUL_LENGTH_S).then(|| {
        let why =
            format!("it lasts {} s, with {} s a row: is it in ms?", short(last_s), short(usual_s));
        table.header_error(Problem::UnusableColumn { column: TIME.to_owned(), why })
    })
}

/// Time since the first row, to the nanosecond, so that its rounding has no effect \[s\].
pub fn since_s(time_s: f64, first_s: f64) -> f64 {
    ((time_s - first_s) * 1.0e9).round() / 1.0e9
}

fn unknown(name: &str, known: &[&str]) -> Problem {
    let instead = match nearest(name, known.iter().copied()) {
        Some(name) => Instead::Near(vec![name.to_owned()]),
        None => Instead::Known(known.iter().map(|name| (*name).to_owned()).collect()),
    };
    Problem::UnknownColumn { column: quoted(name), instead }
}

/// The error of a table; if a cell of an unknown column is wrong, the error of that column: a lab's own column may
/// contain text.
pub fn of_unknown_column(error: InputError, known: &[&str]) -> InputError {
    match &*error.problem {
        Problem::Cell { column, .. } if column != TIME && !known.contains(&column.as_str()) => {
            InputError::file(&error.file, unknown(column, known))
        }
        _ => error,
    }
}

#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// Columns with at least one value, in the file's order.
    pub columns: Vec<Column>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    pub name: String,
    /// (time \[s\], value); times do not fall.
    pub points: Vec<(f64, f64)>,
    /// Line of each point, if it is from a file.
    pub lines: Vec<u64>,
}

impl Measured {
    /// Reads the column time_s of a table and any of the `known` columns; cells may be empty.
    ///
    /// # Errors
    /// For an unknown column, for times that are missing or fall, and for implausible values.
    pub fn new(table: &Table, known: &[&str]) -> Result<Self, InputError> {
        Self::read(table, known, false)
    }

    /// As [`Self::new`], with times since the first row, which may be at any time.
    pub fn since_first(table: &Table, known: &[&str]) -> Result<Self, InputError> {
        Self::read(table, known, true)
    }

    /// The column of this name, if it has a value.
    pub fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|column| column.name == name)
    }

    /// As [`Self::column`], for a required column of the file at `path`.
    ///
    /// # Errors
    /// If it is missing, or empty.
    pub fn needed(&self, path: &Path, name: &str) -> Result<&Column, InputError> {
        let problem = || Problem::NoValues { column: name.to_owned() };
        self.column(name).ok_or_else(|| InputError::file(path, problem()))
    }

    fn read(table: &Table, known: &[&str], anywhere: bool) -> Result<Self, InputError> {
        table.column(TIME)?;
        for column in table.columns() {
            if column.name != TIME && !known.contains(&column.name.as_str()) {
                return Err(table.header_error(unknown(&column.name, known)));
            }
        }
        let times = ordered(table)?;
        let first_s = times.first().copied().unwrap_or_default();
        check_possible(table, anywhere)?;
        let since = |time: &f64| if anywhere { since_s(*time, first_s) } else { *time };
        let columns = table
            .columns()
            .iter()
            .filter(|column| column.name != TIME)
            .map(|column| {
                let cells = times.iter().zip(&column.cells).enumerate();
                let filled = cells.filter_map(|(row, (time, cell))| {
                    Some(((since(time), (*cell)?), table.line(row)))
                });
                let (points, lines) = filled.unzip();
                Column { name: column.name.clone(), points, lines }
            })
            .filter(|column| !column.points.is_empty())
            .collect();
        Ok(Self { columns })
    }

    /// The part that can be compared with a run of this length, in `comparable` columns, and the number of the table's
    /// rows after its end.
    ///
    /// # Errors
    /// If nothing remains.
    pub fn within_run(
        mut self,
        table: &Table,
        comparable: &[&str],
        duration_s: f64,
    ) -> Result<(Self, usize), InputError> {
        let times = table.filled(TIME)?;
        let late = times.iter().filter(|time| **time > duration_s).count();
        if late == times.len() {
            let allowed = format!("at most {duration_s:?} s somewhere: that is the run's end");
            return Err(table.cell_error(0, TIME, &allowed));
        }
        self.columns.retain_mut(|column| {
            let inside = column.points.partition_point(|(time_s, _)| *time_s <= duration_s);
            column.points.truncate(inside);
            column.lines.truncate(inside);
            comparable.contains(&column.name.as_str()) && !column.points.is_empty()
        });
        if self.columns.is_empty() {
            let known = comparable.iter().map(|name| (*name).to_owned()).collect();
            return Err(table.header_error(Problem::NothingToCompare { time: TIME, known }));
        }
        Ok((self, late))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOWN: [&str; 4] = ["time_s", "pressure_pa", "sensor_gas_k", "length_m"];

    fn read(text: &str) -> Result<Measured, String> {
        Table::parse(text, "m.csv".as_ref())
            .and_then(|table| Measured::new(&table, &KNOWN))
            .map_err(|error| error.to_string())
    }

    #[test]
    fn each_column_has_its_own_times() {
        let text =
            "sensor_gas_k,time_s,pressure_pa,length_m\n,0.2,768830,\n285.9,3.58,,\n,3.58,5e5,\n";
        let column = |name: &str, points: &[(f64, f64)], lines: &[u64]| Column {
            name: name.to_owned(),
            points: points.to_vec(),
            lines: lines.to_vec(),
        };
        let columns = vec![
            column("sensor_gas_k", &[(3.58, 285.9)], &[3]),
            column("pressure_pa", &[(0.2, 768_830.0), (3.58, 5e5)], &[2, 4]),
        ];
        assert_eq!(read(text), Ok(Measured { columns }));
    }

    #[test]
    fn rows_that_last_for_hours_raise_a_question() {
        let asked = |text: &str| {
            doubt(&Table::parse(text, "m.csv".as_ref()).unwrap()).map(|error| error.to_string())
        };
        let rows = |distance_s: f64, number: u32| {
            let times = (0..=number).map(|row| format!("{}\n", distance_s * f64::from(row)));
            format!("time_s\n{}", times.collect::<String>())
        };
        let question = "m.csv: column time_s: it lasts 4000 s, with 10 s a row: is it in ms?";
        assert_eq!(asked(&rows(10.0, 400)).as_deref(), Some(question));
        assert!(asked(&rows(10.0, 300)).is_none());
        assert!(asked(&rows(0.5, 8000)).is_none());
        assert!(asked("length_m\n0.3\n").is_none());
    }

    #[test]
    fn what_a_run_cannot_be_compared_with_is_said() {
        let within = |text: &str| {
            let table = Table::parse(text, "m.csv".as_ref()).unwrap();
            Measured::new(&table, &KNOWN)
                .and_then(|measured| measured.within_run(&table, &["pressure_pa"], 10.0))
                .map(|(measured, late)| (measured.columns.len(), late))
                .map_err(|error| error.to_string())
        };
        assert_eq!(within("time_s,pressure_pa,sensor_gas_k\n0,1e5,300\n11,1e5,300\n"), Ok((1, 1)));
        let late = "m.csv:2: column time_s = 500.0: must be at most 10.0 s somewhere: that is the run's end";
        assert_eq!(within("time_s,pressure_pa\n500,1e5\n"), Err(late.to_owned()));
        let alone = "m.csv: has no column to compare beside time_s; known here: pressure_pa";
        assert_eq!(within("time_s\n0\n"), Err(alone.to_owned()));
        assert_eq!(within("time_s,sensor_gas_k\n0,300\n"), Err(alone.to_owned()));
        assert_eq!(within("time_s,pressure_pa\n0,\n12,1e5\n"), Err(alone.to_owned()));
    }

    #[test]
    fn text_in_an_unknown_column_is_an_unknown_column() {
        let said = |text: &str| {
            let error = Table::parse(text, "m.csv".as_ref()).unwrap_err();
            of_unknown_column(error, &KNOWN).to_string()
        };
        let unknown = "m.csv: unknown column operator; \
             known here: time_s, pressure_pa, sensor_gas_k, length_m";
        assert_eq!(said("time_s,pressure_pa,operator\n0,1e5,me\n"), unknown);
        let cell = "m.csv:2: column pressure_pa = high: must be a finite number";
        assert_eq!(said("time_s,pressure_pa\n0,high\n"), cell);
    }

    #[test]
    fn a_record_may_begin_anywhere() {
        let read = |first_s: f64| {
            let row = |i: i32| format!("{},{}\n", first_s + 0.02 * f64::from(i), 200_000 + i);
            let text = "time_s,pressure_pa\n".to_owned() + &(0..9).map(row).collect::<String>();
            Measured::since_first(&Table::parse(&text, "m.csv".as_ref()).unwrap(), &KNOWN).unwrap()
        };
        let usual = read(0.0);
        assert_eq!(usual.columns[0].points[3], (0.06, 200_003.0));
        assert!([-5.0, 1.0, 1.0e5].iter().all(|first_s| read(*first_s) == usual));
    }

    #[test]
    fn times_in_another_unit_are_refused() {
        let checked = |distance_s: f64| {
            let row = |i: u32| format!("{}\n", distance_s * f64::from(i));
            let text = "time_s\n".to_owned() + &(0..9).map(row).collect::<String>();
            let table = Table::parse(&text, "m.csv".as_ref()).unwrap();
            let times = table.filled(TIME).unwrap();
            check_distances(&table, &times, (0.2, "for creep")).map_err(|error| error.to_string())
        };
        assert_eq!((checked(0.02), checked(0.001)), (Ok(()), Ok(())));
        let ms = "m.csv:3: column time_s = 20.0: must be at most 0.200 s after the row before it, for creep: is this \
                  ms, or are rows left out?";
        assert_eq!(checked(20.0), Err(ms.to_owned()));
        assert!(
            checked(4.0).unwrap_err().starts_with("m.csv:3: column time_s = 4.0: must be at most")
        );
        let minutes = checked(0.02 / 60.0).unwrap_err();
        assert!(
            minutes
                .contains("must be at least 0.0004 s after the row before it: is this min or h?"),
            "{minutes}"
        );
    }

    #[test]
    fn gauge_pressures_are_refused() {
        let checked = |text: &str| {
            let table = Table::parse(text, "m.csv".as_ref()).unwrap();
            check_pressures(&table, "pressure_pa", 1.0e5).map_err(|error| error.to_string())
        };
        let gauge = "m.csv:3: column pressure_pa = 0.0: must be absolute, and no less than 80000 Pa, 80 % of \
             ambient.pressure_pa = 100000.0: is this gauge pressure? Add the ambient one; at altitude set that key";
        assert_eq!(checked("time_s,pressure_pa\n0,2e5\n1,0\n"), Err(gauge.to_owned()));
        assert_eq!(checked("time_s,pressure_pa\n0,2e5\n1,\n2,1e5\n"), Ok(()));
        assert_eq!(checked("time_s,length_m\n0,0.2\n"), Ok(()));
        let reversed = checked("time_s,pressure_pa\n0,-2e5\n1,-1e5\n").unwrap_err();
        assert!(reversed.ends_with("is its sign reversed?"), "{reversed}");
    }

    #[test]
    fn says_what_is_wrong_and_where() {
        for (text, message) in [
            (
                "time_s,presure_pa\n0,1\n",
                "m.csv: unknown column presure_pa; did you mean pressure_pa?",
            ),
            ("time_s,pressure\n0,1\n", "m.csv: unknown column pressure; did you mean pressure_pa?"),
            (
                "time_s,colour\n0,1\n",
                "m.csv: unknown column colour; \
                 known here: time_s, pressure_pa, sensor_gas_k, length_m",
            ),
            ("pressure_pa\n1\n", "m.csv: column time_s is missing; the file has pressure_pa"),
            ("t,colour\n0,1\n", "m.csv: column time_s is missing; the file has t, colour"),
            ("time_s,pressure_pa\n0,1\n,2\n", "m.csv:3: column time_s = (empty): must be a number"),
            (
                "time_s,pressure_pa\n0,1\n2,2\n\n1,3\n",
                "m.csv:5: column time_s = 1.0: must be at least 2.0, the time of the row before",
            ),
            (
                "time_s,sensor_gas_k\n0,298\n1,\n2,25.3\n",
                "m.csv:4: column sensor_gas_k = 25.3: must be a number from 100 to 1000 K",
            ),
            (
                "time_s,pressure_pa\n0,5.2\n",
                "m.csv:2: column pressure_pa = 5.2: must be a number from 1000 to 1e8 Pa",
            ),
            (
                "time_s,pressure_pa\n-1,1e5\n",
                "m.csv:2: column time_s = -1.0: must be a number from 0 to 1e6 s",
            ),
        ] {
            assert_eq!(read(text), Err(message.to_owned()), "{text:?}");
        }
    }
}
