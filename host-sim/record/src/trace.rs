//! `trace.csv`: one row per logged step, streamed while the run goes on.

use model_core::Telemetry;
use thermyo_plant::Truth;

/// A column, and its cell in a row.
type Column = (&'static str, fn(&Row) -> f64);

/// The columns, in order. Scripts rely on the first fifteen; `thermyo replay` and the report need
/// the rest.
const CELLS: [Column; 37] = [
    ("time_s", |row| row.truth.time_s),
    ("pressure_pa", |row| row.truth.pressure_pa),
    ("volume_m3", |row| row.truth.volume_m3),
    ("length_m", |row| row.truth.length_m),
    ("mass_kg", |row| row.truth.mass_kg),
    ("flow_in_kg_s", |row| row.truth.flow_in_kg_s),
    ("flow_out_kg_s", |row| row.truth.flow_out_kg_s),
    ("gas_temperature_k", |row| row.truth.gas_temperature_k),
    ("wall_temperature_k", |row| row.truth.wall_temperature_k),
    ("sensor_gas_k", |row| row.sensor_gas_k),
    ("sensor_wall_k", |row| row.sensor_wall_k),
    ("estimate_k", |row| f64::from(row.telemetry.estimate.gas_k)),
    ("estimate_sd_k", |row| f64::from(row.telemetry.estimate.gas_sd_k)),
    ("duty_in", |row| f64::from(row.telemetry.command.inlet.share())),
    ("duty_out", |row| f64::from(row.telemetry.command.outlet.share())),
    ("model_k", |row| row.model_k),
    ("model_sensor_k", |row| row.model_sensor_k),
    ("wall_estimate_k", |row| f64::from(row.telemetry.estimate.wall_k)),
    ("sensor_estimate_k", |row| f64::from(row.telemetry.estimate.sensor_k)),
    ("mass_estimate_kg", |row| f64::from(row.telemetry.estimate.mass_kg)),
    ("heat_scale", |row| f64::from(row.telemetry.estimate.heat_scale)),
    ("sensor_lag_s", |row| f64::from(row.telemetry.estimate.sensor_lag_s)),
    ("set_point", |row| row.set_point),
    ("measured_pressure_pa", |row| f64::from(row.telemetry.pressure_pa)),
    ("measured_length_m", |row| f64::from(row.telemetry.length_m)),
    ("step", |row| f64::from(row.telemetry.step)),
    ("code_pressure", |row| f64::from(row.telemetry.sample.pressure.to_bits())),
    ("code_gas", |row| f64::from(row.telemetry.sample.gas.to_bits())),
    ("code_length", |row| f64::from(row.telemetry.sample.length.0)),
    ("emergency_stop", |row| flag(row.telemetry.sample.emergency_stop)),
    ("heard", |row| flag(row.telemetry.sample.heard)),
    ("flooded", |row| flag(row.telemetry.sample.flooded)),
    ("missed_steps", |row| f64::from(row.telemetry.sample.missed_steps)),
    ("faults", |row| f64::from(row.telemetry.faults.0)),
    ("estimate_valid", |row| flag(row.telemetry.estimate.valid)),
    ("mode", |row| f64::from(row.telemetry.mode as u8)),
    ("limited", |row| flag(row.telemetry.limited)),
];

/// Names of the columns.
pub const COLUMNS: [&str; CELLS.len()] = names(&CELLS);

/// The names of columns, at compile time.
pub const fn names<T, const N: usize>(columns: &[(&'static str, T); N]) -> [&'static str; N] {
    let mut names = [""; N];
    let mut i = 0;
    while i < N {
        names[i] = columns[i].0;
        i += 1;
    }
    names
}

/// A cell that is 1 or 0.
pub fn flag(flag: bool) -> f64 {
    f64::from(u8::from(flag))
}

/// Quantities in which two records of the same time can be compared, without counts and flags.
pub const COMPARABLE: [&str; 20] = [
    "pressure_pa",
    "volume_m3",
    "length_m",
    "mass_kg",
    "flow_in_kg_s",
    "flow_out_kg_s",
    "gas_temperature_k",
    "wall_temperature_k",
    "sensor_gas_k",
    "sensor_wall_k",
    "estimate_k",
    "duty_in",
    "duty_out",
    "model_k",
    "model_sensor_k",
    "wall_estimate_k",
    "sensor_estimate_k",
    "mass_estimate_kg",
    "measured_pressure_pa",
    "measured_length_m",
];

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// The plant's state; its flows are means since the row before.
    pub truth: Truth,
    pub sensor_gas_k: f64,
    pub sensor_wall_k: f64,
    pub model_k: f64,
    pub model_sensor_k: f64,
    /// The set point in its own unit; 0 if the drive has none.
    pub set_point: f64,
    /// The core's output for this step's sample.
    pub telemetry: Telemetry,
}

impl Row {
    /// The cells, in the order of [`COLUMNS`].
    pub fn cells(&self) -> [f64; COLUMNS.len()] {
        CELLS.map(|(_, cell)| cell(self))
    }
}

/// Cells as a line of the file: every number is the shortest text that reads back to the same value, and NaN (unknown)
/// an empty cell.
pub fn cells_text(cells: impl IntoIterator<Item = f64>) -> String {
    let mut line = String::with_capacity(512);
    let mut buffer = zmij::Buffer::new();
    for (i, cell) in cells.into_iter().enumerate() {
        if i > 0 {
            line.push(',');
        }
        if !cell.is_nan() {
            let text = buffer.format(cell);
            line.push_str(text.strip_suffix(".0").unwrap_or(text));
        }
    }
    line
}
