//! `trace.csv`: one row per logged step, streamed while the run goes on.

use model_core::{Sample, Telemetry};
use thermyo_plant::Truth;

/// The columns, in order. Scripts rely on the first fifteen; `thermyo replay` and the report need
/// the rest.
pub const COLUMNS: [&str; 37] = [
    "time_s",
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
    "estimate_sd_k",
    "duty_in",
    "duty_out",
    "model_k",
    "model_sensor_k",
    "wall_estimate_k",
    "sensor_estimate_k",
    "mass_estimate_kg",
    "heat_scale",
    "sensor_lag_s",
    "set_point",
    "measured_pressure_pa",
    "measured_length_m",
    "step",
    "code_pressure",
    "code_gas",
    "code_length",
    "emergency_stop",
    "heard",
    "flooded",
    "missed_steps",
    "faults",
    "estimate_valid",
    "mode",
    "limited",
];

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
    /// Reading of the gas sensor with its noise \[K\].
    pub sensor_gas_k: f64,
    /// Reading of the wall sensor with its noise \[K\].
    pub sensor_wall_k: f64,
    /// Gas temperature of the forward model \[K\].
    pub model_k: f64,
    /// Sensor temperature of the forward model \[K\].
    pub model_sensor_k: f64,
    /// The set point in its own unit; 0 where the drive has none.
    pub set_point: f64,
    /// The core's output for this step's sample.
    pub telemetry: Telemetry,
}

impl Row {
    /// The cells, in the order of [`COLUMNS`].
    pub fn cells(&self) -> [f64; COLUMNS.len()] {
        let Self { truth, telemetry, .. } = self;
        let estimate = &telemetry.estimate;
        let Sample { pressure, gas, length, emergency_stop, heard, flooded, missed_steps } =
            telemetry.sample;
        let flag = |flag: bool| f64::from(u8::from(flag));
        [
            truth.time_s,
            truth.pressure_pa,
            truth.volume_m3,
            truth.length_m,
            truth.mass_kg,
            truth.flow_in_kg_s,
            truth.flow_out_kg_s,
            truth.gas_temperature_k,
            truth.wall_temperature_k,
            self.sensor_gas_k,
            self.sensor_wall_k,
            f64::from(estimate.gas_k),
            f64::from(estimate.gas_sd_k),
            f64::from(telemetry.command.inlet.share()),
            f64::from(telemetry.command.outlet.share()),
            self.model_k,
            self.model_sensor_k,
            f64::from(estimate.wall_k),
            f64::from(estimate.sensor_k),
            f64::from(estimate.mass_kg),
            f64::from(estimate.heat_scale),
            f64::from(estimate.sensor_lag_s),
            self.set_point,
            f64::from(telemetry.pressure_pa),
            f64::from(telemetry.length_m),
            f64::from(telemetry.step),
            f64::from(pressure.to_bits()),
            f64::from(gas.to_bits()),
            f64::from(length.0),
            flag(emergency_stop),
            flag(heard),
            flag(flooded),
            f64::from(missed_steps),
            f64::from(telemetry.faults.0),
            flag(estimate.valid),
            f64::from(telemetry.mode as u8),
            flag(telemetry.limited),
        ]
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
