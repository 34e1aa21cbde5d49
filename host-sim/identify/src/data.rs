//! Measurements to compare with the plant, and the recorded inputs that drove it.

use std::path::Path;
use thermyo_compute::math::{gaps, median_distance};
use thermyo_files::input::{InputError, Problem};
use thermyo_files::number::significant;
use thermyo_files::table::Table;
use thermyo_plant::Truth;
use thermyo_record::measured::{Column, Measured, TIME};
use thermyo_scenario::profile::{Profile, ProfileError};
use thermyo_scenario::{DriveKind, PlantKind, Scenario, Sensors};
use thermyo_setup::{Loaded, OBSERVABLE};
use thermyo_simulation::adc::OVERSAMPLING;

/// Relative change of volume above which the column describes a piston's stroke.
const STROKE: f64 = 1e-6;

/// Distance of two rows, in typical distances, above which the record has a hole.
const HOLE_ROWS: f64 = 20.0;

/// Longest typical distance of rows at which they resolve a muscle's motion \[s\].
const SLOWEST_S: f64 = 1.0;

/// Most rows without a pulse for which a valve pauses in its pulses, rather than waits, and fraction of pulses after such
/// a pause from which pulses are missing between the rows \[-\]. Assumptions.
const PAUSE_ROWS: usize = 3;
const OFTEN_PAUSED: f64 = 0.1;

/// LSBs of a raw code over a sensor's range.
const CODE_STEPS: f64 = 32_760.0;

/// A quantity in which plant and measurements are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Absolute pressure \[Pa\].
    Pressure,
    /// Muscle length \[m\].
    Length,
    /// Reading of the sensor in the gas \[K\].
    SensorGas,
    /// Reading of the sensor in the wall \[K\].
    SensorWall,
}

impl Quantity {
    fn of_column(name: &str) -> Option<Self> {
        let all = [Self::Pressure, Self::Length, Self::SensorGas, Self::SensorWall];
        OBSERVABLE.iter().zip(all).find(|(known, _)| **known == name).map(|(_, quantity)| quantity)
    }

    pub fn column(self) -> &'static str {
        OBSERVABLE[self as usize]
    }

    /// Value of the quantity in the plant. Pressure and length are compared without their sensors' lag, which is below
    /// a millisecond.
    pub fn of(self, truth: &Truth) -> f64 {
        match self {
            Self::Pressure => truth.pressure_pa,
            Self::Length => truth.length_m,
            Self::SensorGas => truth.sensor_gas_k,
            Self::SensorWall => truth.sensor_wall_k,
        }
    }

    /// Standard deviation of one measured value: noise, averaged over a code's conversions, and the
    /// LSB of the code.
    fn deviation(self, sensor: &Sensors) -> f64 {
        let sum = |digital| if digital { 1.0 } else { f64::from(OVERSAMPLING) };
        let conversions = f64::from(OVERSAMPLING);
        let of_gas = sum(sensor.gas_element().is_digital());
        let of_pressure = sum(sensor.pressure_part().is_digital());
        let gas_step_k = f64::from(sensor.gas_element().resolution_k()) / of_gas;
        let (noise, step, readings) = match self {
            Self::Pressure => {
                (sensor.pressure.noise_pa, sensor.pressure.range_pa / CODE_STEPS, of_pressure)
            }
            Self::Length => {
                (sensor.length.noise_m, sensor.length.range_m / CODE_STEPS, conversions)
            }
            Self::SensorGas => (sensor.gas.noise_k, gas_step_k, of_gas),
            // The wall's reading is recorded as a number, not as a code.
            Self::SensorWall => (sensor.wall.noise_k, gas_step_k, 1.0),
        };
        (noise / readings.sqrt()).hypot(step / 12.0_f64.sqrt())
    }
}

#[derive(Debug, Clone, PartialEq)]
pub struct Observed {
    pub quantity: Quantity,
    /// (time \[s\], value), times rising.
    pub points: Vec<(f64, f64)>,
    pub deviation: f64,
}

/// Recorded inputs of the plant: (time \[s\], inlet, outlet).
#[derive(Debug, Clone, PartialEq)]
pub enum Input {
    /// The scenario alone determines the drive: closed, discharging, filling.
    Scenario,
    /// Mean mass flows \[kg/s\] since the row before.
    Flows(Vec<(f64, [f64; 2])>),
    /// Duties of the valves, until the next row.
    Duties(Vec<(f64, [f64; 2])>),
    /// Pressure and length of a muscle of which only the gas sensor is compared.
    Given(Given),
}

/// Measurements of the gas, and the duties of the valves.
#[derive(Debug, Clone, PartialEq)]
pub struct Given {
    /// Absolute pressure \[Pa\].
    pub pressure: Profile,
    /// Length \[m\].
    pub length: Profile,
    /// Duties of inlet and outlet, until the next row.
    pub duties: Vec<(f64, [f64; 2])>,
    /// First reading of the gas sensor \[K\].
    pub sensor_k: f64,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Data {
    pub observed: Vec<Observed>,
    /// Recorded inputs of the plant.
    pub input: Input,
    /// A piston's volume over time \[m3\], where the data has it.
    pub volume: Option<Profile>,
    /// Typical distance of two rows \[s\].
    pub spacing_s: f64,
    /// Intervals without recorded inputs: from, to \[s\].
    pub holes: Vec<[f64; 2]>,
}

impl Data {
    /// Selects the columns of `measured` that a fit of `scenario` needs; `path` names them in
    /// messages.
    ///
    /// # Errors
    /// If required columns are missing or have too few values.
    pub fn new(measured: &Measured, path: &Path, scenario: &Scenario) -> Result<Self, InputError> {
        let columns = Columns { measured, path };
        let observed = observed(measured, path, scenario)?;
        let input = columns.input(scenario, &observed)?;
        columns.check_pulses(&input, scenario)?;
        let is_vessel = scenario.plant.kind == PlantKind::Vessel;
        let volume = measured.column("volume_m3");
        let volume = volume.filter(|column| is_vessel && varies(&column.points));
        let volume = volume.map(|column| columns.profile(&column.name)).transpose()?;
        let holes = recorded_holes(measured, path, &input, volume.as_ref())?;
        Ok(Self { spacing_s: spacing(&observed), observed, input, volume, holes })
    }

    /// The same, with the scenario's course of a piston's volume where the data has none.
    pub fn with_volume(mut self, loaded: &Loaded) -> Self {
        self.volume = self.volume.or_else(|| loaded.volume_profile.clone());
        self
    }

    /// Predictions less the measured values, column by column.
    pub fn less_measured(&self, mut predicted: Vec<f64>) -> Vec<f64> {
        let measured = self.observed.iter().flat_map(|observed| &observed.points);
        for (left, (_, value)) in predicted.iter_mut().zip(measured) {
            *left -= value;
        }
        predicted
    }

    /// Time of the last compared value \[s\].
    pub fn end_s(&self) -> f64 {
        self.observed
            .iter()
            .filter_map(|o| o.points.last())
            .fold(0.0, |end, point| end.max(point.0))
    }

    /// Number of measured values in all columns.
    pub fn values(&self) -> usize {
        self.observed.iter().map(|observed| observed.points.len()).sum()
    }
}

/// Whether a record has pressure and length of a muscle, which drive it if only its gas sensor is compared.
fn is_gauged(scenario: &Scenario, has: impl Fn(&str) -> bool) -> bool {
    scenario.plant.kind != PlantKind::Vessel && has("pressure_pa") && has("length_m")
}

/// Whether pressure and length drive a muscle: the record may then begin anywhere.
pub fn begins_anywhere(scenario: &Scenario, table: &Table) -> bool {
    let has = |name: &str| table.columns().iter().any(|column| column.name == name);
    let sensor_only = matches!(&scenario.identify.columns[..], [only] if only == OBSERVABLE[2]);
    scenario.drive.kind != DriveKind::Closed && sensor_only && is_gauged(scenario, has)
}

/// The columns that drive a plant; `path` names their file in messages.
struct Columns<'a> {
    measured: &'a Measured,
    path: &'a Path,
}

impl Columns<'_> {
    /// The columns that drive the plant which is compared with `observed`.
    fn input(&self, scenario: &Scenario, observed: &[Observed]) -> Result<Input, InputError> {
        let has = |name: &str| self.measured.column(name).is_some();
        let is_vessel = scenario.plant.kind == PlantKind::Vessel;
        let free = match scenario.drive.kind {
            DriveKind::Closed => true,
            DriveKind::Discharge | DriveKind::Fill => is_vessel,
            _ => false,
        };
        let fits_paths = scenario.identify.parameters.iter().any(|path| {
            path.starts_with("valve.") || path.starts_with("leak.") || path == "supply.pressure_pa"
        });
        let sensor_only = matches!(observed, [only] if only.quantity == Quantity::SensorGas);
        Ok(if free {
            Input::Scenario
        } else if sensor_only && is_gauged(scenario, has) {
            Input::Given(Given {
                pressure: self.profile("pressure_pa")?,
                length: self.profile("length_m")?,
                duties: self.pair(["duty_in", "duty_out"])?,
                sensor_k: observed[0].points[0].1,
            })
        } else if has("flow_in_kg_s") && !fits_paths {
            Input::Flows(self.pair(["flow_in_kg_s", "flow_out_kg_s"])?)
        } else {
            Input::Duties(self.pair(["duty_in", "duty_out"])?)
        })
    }

    /// Refuses duties that miss pulses: a valve that pulses in fewer than all periods looks shut where rows are further
    /// apart than a period.
    fn check_pulses(&self, input: &Input, scenario: &Scenario) -> Result<(), InputError> {
        let (Input::Duties(duties) | Input::Given(Given { duties, .. })) = input else {
            return Ok(());
        };
        let distance_s = median_distance(&duties.iter().map(|row| row.0).collect::<Vec<_>>());
        let period_s = scenario.pwm_period_s();
        if distance_s < 1.5 * period_s || !(pauses(duties, 0) || pauses(duties, 1)) {
            return Ok(());
        }
        let [distance_s, period_s] = [distance_s, period_s].map(|time_s| significant(time_s, 3));
        let why = format!(
            "rows are {distance_s} s apart, and pulses between them are missing: must be at most {period_s} s, a period \
             of valve.pwm_hz, where a valve does not pulse in each of them"
        );
        Err(self.unusable(TIME, &why))
    }

    fn unusable(&self, name: &str, why: &str) -> InputError {
        let (column, why) = (name.to_owned(), why.to_owned());
        InputError::file(self.path, Problem::UnusableColumn { column, why })
    }

    fn pair(&self, names: [&str; 2]) -> Result<Vec<(f64, [f64; 2])>, InputError> {
        let inlet = self.measured.needed(self.path, names[0])?;
        let outlet = self.measured.needed(self.path, names[1])?;
        if !times(&inlet.points).eq(times(&outlet.points)) {
            return Err(self.unusable(names[1], &format!("must be filled where {} is", names[0])));
        }
        let both = inlet.points.iter().zip(&outlet.points);
        Ok(both.map(|((time, inlet), (_, outlet))| (*time, [*inlet, *outlet])).collect())
    }

    fn profile(&self, name: &str) -> Result<Profile, InputError> {
        let Column { points, lines, .. } = self.measured.needed(self.path, name)?;
        Profile::new(points.clone()).map_err(|error| match error {
            ProfileError::NotIncreasing { row } => {
                let problem = Problem::Cell {
                    column: TIME.to_owned(),
                    value: format!("{:?}", points[row].0),
                    allowed: format!("later than the row before, where {name} drives the plant"),
                };
                InputError { line: lines.get(row).copied(), ..InputError::file(self.path, problem) }
            }
            error => self.unusable(name, &error.to_string()),
        })
    }
}

/// Whether a valve often pulses, is shut for a few rows, and pulses again, while the other one stays shut.
fn pauses(duties: &[(f64, [f64; 2])], valve: usize) -> bool {
    let pulses = |row: &(f64, [f64; 2])| row.1[valve] > 0.0 && row.1[valve] < 1.0;
    let (mut count, mut paused, mut shut_rows) = (0, 0, usize::MAX);
    for row in duties {
        if pulses(row) {
            count += 1;
            paused += usize::from((1..=PAUSE_ROWS).contains(&shut_rows));
            shut_rows = 0;
        } else if row.1 == [0.0; 2] {
            shut_rows = shut_rows.saturating_add(1);
        } else {
            shut_rows = usize::MAX;
        }
    }
    paused as f64 > OFTEN_PAUSED * f64::from(count)
}

fn varies(points: &[(f64, f64)]) -> bool {
    let first = points[0].1;
    points.iter().any(|point| (point.1 - first).abs() > STROKE * first.abs())
}

fn times(points: &[(f64, f64)]) -> impl Iterator<Item = f64> {
    points.iter().map(|(time_s, _)| *time_s)
}

/// The columns to compare: those in the scenario, or the usual ones.
fn observed(
    measured: &Measured,
    path: &Path,
    scenario: &Scenario,
) -> Result<Vec<Observed>, InputError> {
    let is_vessel = scenario.plant.kind == PlantKind::Vessel;
    let asked = &scenario.identify.columns;
    let named: Vec<&Column> = if asked.is_empty() {
        let usual = [Quantity::Pressure, Quantity::Length, Quantity::SensorGas];
        let usual = usual.into_iter().filter(|q| !(is_vessel && *q == Quantity::Length));
        usual.filter_map(|quantity| measured.column(quantity.column())).collect()
    } else {
        asked.iter().map(|name| measured.needed(path, name)).collect::<Result<_, _>>()?
    };
    let observed: Vec<Observed> = named
        .into_iter()
        .filter_map(|column| {
            let quantity = Quantity::of_column(&column.name)?;
            let deviation = quantity.deviation(&scenario.sensor);
            Some(Observed { quantity, points: column.points.clone(), deviation })
        })
        .collect();
    if observed.is_empty() {
        let column = OBSERVABLE[..3].join(" or ");
        return Err(InputError::file(path, Problem::NoValues { column }));
    }
    let points = observed.iter().map(|observed| observed.points.len()).sum();
    let parameters = scenario.identify.parameters.len();
    if points <= parameters {
        return Err(InputError::file(path, Problem::TooFewPoints { points, parameters }));
    }
    Ok(observed)
}

/// Holes in the record of the inputs; rows that are too far apart are an error.
fn recorded_holes(
    measured: &Measured,
    path: &Path,
    input: &Input,
    volume: Option<&Profile>,
) -> Result<Vec<[f64; 2]>, InputError> {
    let bridged = match input {
        Input::Given(Given { pressure, length, .. }) => vec![pressure, length],
        _ => volume.into_iter().collect(),
    };
    let mut recorded: Vec<Vec<f64>> =
        bridged.into_iter().map(|profile| times(profile.points()).collect()).collect();
    if matches!(input, Input::Flows(_) | Input::Duties(_)) {
        // Flows and duties hold over rows in which their cells are empty.
        let mut rows: Vec<f64> =
            measured.columns.iter().flat_map(|column| times(&column.points)).collect();
        rows.sort_by(f64::total_cmp);
        recorded.push(rows);
    }
    let slow = |times_s: &&Vec<f64>| median_distance(times_s) > SLOWEST_S;
    if let (Input::Given(_), Some(times_s)) = (input, recorded.iter().find(slow)) {
        let why = format!(
            "rows are {} s apart: must be at most {SLOWEST_S} s where pressure and length drive a muscle. Is it \
             in seconds?",
            significant(median_distance(times_s), 3)
        );
        let column = TIME.to_owned();
        return Err(InputError::file(path, Problem::UnusableColumn { column, why }));
    }
    let mut holes: Vec<[f64; 2]> = recorded.iter().flat_map(|times_s| holes(times_s)).collect();
    holes.sort_by(|a, b| a[0].total_cmp(&b[0]));
    holes.dedup();
    Ok(holes)
}

/// Median distance of two rows of the densest column \[s\].
fn spacing(observed: &[Observed]) -> f64 {
    let densest = observed.iter().max_by_key(|observed| observed.points.len());
    let points = densest.map_or(&[][..], |observed| &observed.points);
    median_distance(&times(points).collect::<Vec<_>>())
}

/// Gaps between these times that are much longer than usual.
fn holes(times_s: &[f64]) -> Vec<[f64; 2]> {
    gaps(times_s, HOLE_ROWS * median_distance(times_s)).collect()
}

/// Value at a time from rows that each hold until the next; `row` is where the last call stopped.
pub fn holding(rows: &[(f64, [f64; 2])], row: &mut usize, time_s: f64) -> [f64; 2] {
    *row += rows[*row + 1..].iter().take_while(|(time, _)| *time <= time_s).count();
    rows[*row].1
}
