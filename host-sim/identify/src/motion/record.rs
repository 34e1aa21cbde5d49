//! A record of motion: length and pressure over time, and the force if there is a load cell.

use thermyo_compute::math::usual_distance;
use thermyo_files::input::{InputError, Problem};
use thermyo_files::number::significant;
use thermyo_files::table::Table;
use thermyo_plant::chamber;
use thermyo_record::measured::{
    check_distances, check_pressures, check_rising, since_s, unit_of_length,
};
use thermyo_scenario::{PlantKind, Scenario};

pub const LENGTH: &str = "length_m";
/// Required columns, and the optional one.
const COLUMNS: [&str; 3] = ["time_s", LENGTH, "pressure_pa"];
const FORCE: &str = "force_n";
/// Distance to the row before, in usual distances, from which a row is behind a gap ...
const GAP_ROWS: f64 = 20.0;
/// ... unless the distance is shorter than this \[s\].
const LEAST_GAP_S: f64 = 0.1;
/// Distance of rows above which they show no slip and no fast creep \[s\].
const MOST_DISTANCE_S: f64 = 0.2;
/// Largest plausible speed of a muscle, as a share of its rest length per second \[1/s\]: an empty one with wide valves
/// takes 50 ms for 30 %.
const MOST_SPEED_PER_S: f64 = 10.0;
/// Rows over which a speed is taken, so that noise does not count.
const SPEED_ROWS: usize = 5;
/// Lengths of a muscle, share of its rest length \[-\].
const LENGTHS: [f64; 2] = [0.5, 1.1];
/// Change of length, as a share of the rest length, above which a muscle counts as moving \[-\].
pub const MOVES: f64 = 0.01;
/// Correlation of length and pressure above which a sign is reversed.
const REVERSED: f64 = 0.5;
/// Most negative reading of a load cell, share of the largest force \[-\].
const BELOW_ZERO: f64 = 0.05;
/// Factor on ambient pressure below which a muscle counts as vented \[-\].
const VENTED: f64 = 1.2;
/// Factor on ambient pressure which no vented muscle is below; weather makes a few percent \[-\].
const BELOW_AMBIENT: f64 = 0.9;
/// Distance of the longest length from that at rest, from which a remark names it, share of the rest length \[-\].
const OFF_REST: f64 = 0.02;
const FEWEST: usize = 50;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    pub time_s: f64,
    pub length_m: f64,
    pub pressure_pa: f64,
    /// Measured force, or the load's if no column has it \[N\].
    pub force_n: f64,
    /// Number of rows of the file that this one stands for.
    pub weight: f64,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    pub rows: Vec<Row>,
    pub has_force: bool,
}

impl Record {
    /// Reads a table for a scenario's muscle.
    ///
    /// # Errors
    /// For missing columns, impossible values, gaps, wrong units and reversed signs, with their line.
    pub fn of(table: &Table, scenario: &Scenario) -> Result<Self, InputError> {
        let [times, lengths, pressures] = COLUMNS.map(|name| table.filled(name));
        let (times, lengths, pressures) = (times?, lengths?, pressures?);
        let has_force = table.columns().iter().any(|column| column.name == FORCE);
        let forces = has_force.then(|| table.filled(FORCE)).transpose()?;
        if times.len() < FEWEST {
            let why = format!("{} rows: must be {FEWEST} or more of a motion", times.len());
            let column = COLUMNS[0].to_owned();
            return Err(table.header_error(Problem::UnusableColumn { column, why }));
        }
        check_times(table, &times)?;
        check_lengths(table, COLUMNS[1], scenario.muscle.rest_length_m)?;
        check_speeds(table, &times, &lengths, scenario.muscle.rest_length_m)?;
        check_pressures(table, COLUMNS[2], scenario.ambient.pressure_pa)?;
        match &forces {
            Some(forces) => check_forces(table, forces)?,
            None => check_sign(table, &lengths, &pressures, scenario.muscle.rest_length_m)?,
        }
        let load_n = load_n(scenario);
        let rows = (0..times.len()).map(|i| Row {
            time_s: since_s(times[i], times[0]),
            length_m: lengths[i],
            pressure_pa: pressures[i],
            force_n: forces.as_ref().map_or(load_n, |forces| forces[i]),
            weight: 1.0,
        });
        Ok(Self { rows: rows.collect(), has_force })
    }

    /// The rows under the scenario's load, which may be searched, if no column has the force.
    pub fn loaded(&self, scenario: &Scenario) -> Vec<Row> {
        let load_n = load_n(scenario);
        let force_n = |row: &Row| if self.has_force { row.force_n } else { load_n };
        self.rows.iter().map(|row| Row { force_n: force_n(row), ..*row }).collect()
    }

    /// Speeds, from the rows before and after each \[m/s\].
    pub fn speeds_m_s(&self) -> Vec<f64> {
        let last = self.rows.len().saturating_sub(1);
        let speed = |i: usize| {
            let (before, after) = (&self.rows[i.saturating_sub(1)], &self.rows[(i + 1).min(last)]);
            (after.length_m - before.length_m) / (after.time_s - before.time_s).max(1.0e-9)
        };
        (0..self.rows.len()).map(speed).collect()
    }

    /// Way between the shortest and the longest length \[m\].
    pub fn stroke_m(&self) -> f64 {
        span(self.rows.iter().map(|row| row.length_m))
    }

    pub fn longest_m(&self) -> f64 {
        self.rows.iter().map(|row| row.length_m).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Remarks on offsets of pressure and length, which a fit takes for another bladder and slack.
    pub fn doubts(&self, scenario: &Scenario) -> Vec<String> {
        let (ambient_pa, rest_m) = (scenario.ambient.pressure_pa, scenario.muscle.rest_length_m);
        let lowest_pa = self.rows.iter().map(|row| row.pressure_pa).fold(f64::INFINITY, f64::min);
        let longest_m = self.longest_m();
        let mut doubts = Vec::new();
        if lowest_pa > VENTED * ambient_pa {
            doubts.push(format!(
                "pressure_pa is taken as absolute, which no row of a vented muscle shows, the lowest being \
                 {lowest_pa:.0} Pa: gauge pressures give another bladder and slack"
            ));
        } else if !self.has_force && (longest_m - rest_m).abs() > OFF_REST * rest_m {
            doubts.push(format!(
                "the largest length_m, {} m, is {:.1} mm off muscle.rest_length_m = {rest_m:?}, though the muscle was \
                 vented: an offset gives another slack",
                significant(longest_m, 4),
                1000.0 * (longest_m - rest_m)
            ));
        }
        if lowest_pa < BELOW_AMBIENT * ambient_pa {
            doubts.push(format!(
                "the lowest pressure_pa, {lowest_pa:.0} Pa, is below ambient.pressure_pa = {ambient_pa:?}: an offset \
                 gives another bladder; at altitude set that key"
            ));
        }
        doubts
    }

    /// Whether the muscle moves by enough to compare lengths.
    pub fn moves(&self, rest_m: f64) -> bool {
        self.stroke_m() > MOVES * rest_m
    }

    pub fn largest_n(&self) -> f64 {
        self.rows.iter().map(|row| row.force_n).fold(0.0, f64::max)
    }

    /// At most `most` rows, concentrated on the motion: each stands for the rows since the one before it.
    pub fn thinned(&self, most: usize) -> Self {
        let spans = [
            span(self.rows.iter().map(|row| row.length_m)),
            span(self.rows.iter().map(|row| row.pressure_pa)),
            span(self.rows.iter().map(|row| row.force_n)),
        ];
        let of = |row: &Row| [row.length_m, row.pressure_pa, row.force_n];
        let (mut share, mut longest_s) = (0.002, 0.2);
        loop {
            let mut rows = Vec::new();
            let mut rest = self.rows.as_slice();
            while let Some(first) = rest.first() {
                let is_near = |row: &&Row| {
                    row.time_s - first.time_s < longest_s
                        && (0..3).all(|i| (of(row)[i] - of(first)[i]).abs() <= share * spans[i])
                };
                let (near, after) = rest.split_at(rest.iter().take_while(is_near).count());
                rows.push(mean(near));
                rest = after;
            }
            if rows.len() <= most {
                return Self { rows, has_force: self.has_force };
            }
            share *= 1.5;
            longest_s *= 1.5;
        }
    }
}

/// Force of the scenario's load, which may be a weight \[N\].
fn load_n(scenario: &Scenario) -> f64 {
    chamber::of(scenario).map_or(0.0, |muscle| thermyo_plant::load_n(scenario, muscle.as_ref()))
}

/// One row for several, without most of their noise.
fn mean(rows: &[Row]) -> Row {
    let weight = rows.len() as f64;
    let of = |value: fn(&Row) -> f64| rows.iter().map(value).sum::<f64>() / weight;
    Row {
        time_s: of(|row| row.time_s),
        length_m: of(|row| row.length_m),
        pressure_pa: of(|row| row.pressure_pa),
        force_n: of(|row| row.force_n),
        weight,
    }
}

fn span(values: impl Iterator<Item = f64> + Clone) -> f64 {
    values.clone().fold(f64::NEG_INFINITY, f64::max) - values.fold(f64::INFINITY, f64::min)
}

/// Index of the largest value.
fn largest(values: &[f64]) -> usize {
    (0..values.len()).max_by(|a, b| values[*a].total_cmp(&values[*b])).unwrap_or(0)
}

/// Checks that times rise without gaps: slip and creep within a gap would be unknown.
fn check_times(table: &Table, times: &[f64]) -> Result<(), InputError> {
    check_rising(table, times)?;
    check_distances(table, times, (MOST_DISTANCE_S, "as slip and creep need"))?;
    let longest_s = (GAP_ROWS * usual_distance(times)).max(LEAST_GAP_S);
    match times.windows(2).position(|pair| pair[1] - pair[0] > longest_s) {
        Some(row) => {
            let allowed = format!(
                "within {} s of the row before it, as the others are: what slips and creeps in a gap is \
                 unknown; cut the record there",
                significant(longest_s, 3)
            );
            Err(table.cell_error(row + 1, COLUMNS[0], &allowed))
        }
        None => Ok(()),
    }
}

/// Refuses lengths that the muscle cannot have, if the table has the column.
pub fn check_lengths(table: &Table, column: &str, rest_m: f64) -> Result<(), InputError> {
    let Some(own) = table.columns().iter().find(|own| own.name == column) else { return Ok(()) };
    let [low, high] = LENGTHS.map(|share| share * rest_m);
    let cells = own.cells.iter().enumerate().filter_map(|(row, cell)| Some((row, (*cell)?)));
    let mut outside = cells.filter(|(_, length)| !(low..=high).contains(length));
    let Some((row, length)) = outside.next() else { return Ok(()) };
    let first = length.abs();
    let (smallest, largest) = outside
        .map(|(_, length)| length.abs())
        .fold((first, first), |(least, most), size| (least.min(size), most.max(size)));
    let unit = match unit_of_length(length, [low, high]) {
        Some(unit) => format!(": is this {unit}?"),
        None if (low..=high).contains(&-length) => ": is its sign reversed?".to_owned(),
        // No muscle's lengths differ by this much, in any unit.
        None if first < low || smallest * high < largest * low => {
            ": is this a contraction, or a stroke?".to_owned()
        }
        None => String::new(),
    };
    let allowed =
        format!("a length from {low} to {high} m, by muscle.rest_length_m = {rest_m:?}{unit}");
    Err(table.cell_error(row, column, &allowed))
}

/// Refuses a record in minutes of a muscle that pressure and length drive; its columns may have times of their own.
pub fn check_pace(table: &Table, scenario: &Scenario) -> Result<(), InputError> {
    let [times, lengths, _] = COLUMNS.map(|name| table.filled(name));
    let (Ok(times), Ok(lengths)) = (times, lengths) else { return Ok(()) };
    check_rising(table, &times)?;
    check_distances(table, &times, (f64::INFINITY, ""))?;
    match scenario.plant.kind {
        PlantKind::Muscle => check_speeds(table, &times, &lengths, scenario.muscle.rest_length_m),
        _ => Ok(()),
    }
}

/// Refuses speeds that no muscle reaches, as of a record in minutes.
fn check_speeds(
    table: &Table,
    times: &[f64],
    lengths: &[f64],
    rest_m: f64,
) -> Result<(), InputError> {
    let most_m_s = MOST_SPEED_PER_S * rest_m;
    let rows = times.len().saturating_sub(SPEED_ROWS);
    let fast = |row: &usize| {
        let way_m = (lengths[row + SPEED_ROWS] - lengths[*row]).abs();
        way_m > most_m_s * (times[row + SPEED_ROWS] - times[*row])
    };
    match (0..rows).find(fast) {
        Some(row) => {
            let allowed = format!(
                "a time at which the muscle moves by no more than {} m/s, {MOST_SPEED_PER_S} times \
                 muscle.rest_length_m in a second: is this min or h?",
                significant(most_m_s, 3)
            );
            Err(table.cell_error(row + SPEED_ROWS, COLUMNS[0], &allowed))
        }
        None => Ok(()),
    }
}

fn check_forces(table: &Table, forces: &[f64]) -> Result<(), InputError> {
    let largest_n = forces[largest(forces)].max(0.0);
    if largest_n == 0.0 && forces.iter().all(|force| *force == 0.0) {
        let allowed = "above 0 somewhere: is the load cell connected? Leave the column out of a record without one: the \
                       load is then the scenario's";
        return Err(table.cell_error(0, FORCE, allowed));
    }
    match forces.iter().position(|force| *force < -BELOW_ZERO * largest_n) {
        Some(row) => {
            let allowed = "a pull, positive, with a zero off by 5 % of the largest at most: is its sign reversed?";
            Err(table.cell_error(row, FORCE, allowed))
        }
        None => Ok(()),
    }
}

/// Refuses a muscle that is not shorter where its pressure is higher.
fn check_sign(
    table: &Table,
    lengths: &[f64],
    pressures: &[f64],
    rest_m: f64,
) -> Result<(), InputError> {
    if span(lengths.iter().copied()) < MOVES * rest_m {
        let why = format!(
            "it moves by less than {} % of muscle.rest_length_m, and force_n is missing: nothing shows slip and creep",
            100.0 * MOVES
        );
        let column = COLUMNS[1].to_owned();
        return Err(table.header_error(Problem::UnusableColumn { column, why }));
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let means = [mean(lengths), mean(pressures)];
    let product = |a: &[f64], b: &[f64], [a0, b0]: [f64; 2]| -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - a0) * (b - b0)).sum()
    };
    let [l0, p0] = means;
    let correlation = product(lengths, pressures, means)
        / (product(lengths, lengths, [l0, l0]) * product(pressures, pressures, [p0, p0])).sqrt();
    if correlation > REVERSED {
        let row = largest(pressures);
        let allowed = "shorter where the pressure is higher: is its sign reversed?";
        return Err(table.cell_error(row, COLUMNS[1], allowed));
    }
    Ok(())
}
