//! Stops in a record: where the duties of both valves are zero for long enough.

use model_core::{Config, Faults};
use std::ops::Range;
use thermyo_files::input::InputError;
use thermyo_files::table::Table;

/// Shortest stop that counts \[s\]: shorter pauses belong to pressure control.
pub const SHORTEST_S: f64 = 5.0;

/// Inflow before the stop is the mean over this time \[s\].
const INFLOW_S: f64 = 0.3;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    pub time_s: f64,
    /// Measured absolute pressure \[Pa\].
    pub pressure_pa: f64,
    pub length_m: f64,
    pub sensor_k: f64,
    pub estimate_k: Option<f64>,
    pub estimate_sd_k: Option<f64>,
    /// The core's estimate of the mean wall temperature \[K\].
    pub wall_k: Option<f64>,
    pub mass_kg: Option<f64>,
    /// Temperature of a simulated plant \[K\].
    pub truth_k: Option<f64>,
    /// Faults that the core reports, if known.
    pub faults: Faults,
    /// Code of the gas sensor, if known.
    pub gas_code: Option<f64>,
    /// Whether both duties are zero.
    pub shut: bool,
}

#[derive(Debug, Clone, PartialEq, Default)]
pub struct Rows {
    pub rows: Vec<Row>,
}

/// Rows during which both valves are shut.
#[derive(Debug, Clone, PartialEq)]
pub struct Hold {
    /// Time at which both valves are shut \[s\].
    pub shut_s: f64,
    /// Mean inflow before that time \[kg/s\], if known.
    pub inflow_kg_s: Option<f64>,
    pub rows: Range<usize>,
}

/// Columns of measurements; a simulated trace has the plant's own values in the second ones.
pub const PRESSURES: [&str; 2] = ["measured_pressure_pa", "pressure_pa"];
pub const LENGTHS: [&str; 2] = ["measured_length_m", "length_m"];

/// Whether a table is a record with at least one stop, judged by its columns.
pub fn are_in(table: &Table, config: &Config) -> bool {
    Rows::of(table).is_ok_and(|rows| !holds(&rows.rows, config).is_empty())
}

impl Rows {
    /// The rows of a record.
    ///
    /// # Errors
    /// For a missing column, or an empty cell in a measured column.
    pub fn of(table: &Table) -> Result<Self, InputError> {
        let has = |name: &str| table.columns().iter().any(|column| column.name == name);
        let measured = |names: [&'static str; 2]| {
            let filled = |name| table.filled(name).ok().filter(|_| has(name));
            filled(names[0]).map_or_else(|| table.filled(names[1]), Ok)
        };
        let time_s = table.filled("time_s")?;
        let (pressure_pa, length_m) = (measured(PRESSURES)?, measured(LENGTHS)?);
        let sensor_k = table.filled("sensor_gas_k")?;
        let (inlet, outlet) = (table.filled("duty_in")?, table.filled("duty_out")?);
        let maybe = |name: &str| {
            let cells = if has(name) { table.column(name).ok() } else { None };
            cells.map_or_else(|| vec![None; time_s.len()], <[Option<f64>]>::to_vec)
        };
        let [estimate_k, estimate_sd_k, wall_k] =
            ["estimate_k", "estimate_sd_k", "wall_estimate_k"].map(maybe);
        let (truth_k, mass_kg) = (maybe("gas_temperature_k"), maybe("mass_estimate_kg"));
        let (faults, gas_code) = (maybe("faults"), maybe("code_gas"));
        let rows = (0..time_s.len()).map(|i| Row {
            time_s: time_s[i],
            pressure_pa: pressure_pa[i],
            length_m: length_m[i],
            sensor_k: sensor_k[i],
            estimate_k: estimate_k[i],
            estimate_sd_k: estimate_sd_k[i],
            wall_k: wall_k[i],
            mass_kg: mass_kg[i],
            truth_k: truth_k[i],
            faults: Faults(faults[i].unwrap_or_default() as u32),
            gas_code: gas_code[i],
            shut: inlet[i] == 0.0 && outlet[i] == 0.0,
        });
        Ok(Self { rows: rows.collect() })
    }
}

/// Time from a duty's change to zero until the valves are shut \[s\]: the pulse of the period
/// before may have begun late.
fn closing_s(config: &Config) -> f64 {
    let period_s = f64::from(config.pwm_period_steps) * f64::from(config.step_s);
    period_s + f64::from(config.valve.dead_time_s) + f64::from(config.valve.switch_time_s)
}

pub fn holds(rows: &[Row], config: &Config) -> Vec<Hold> {
    let mut found = Vec::new();
    let mut from = 0;
    while from < rows.len() {
        let shut = rows[from..].iter().take_while(|row| row.shut).count();
        if shut == 0 {
            from += 1;
            continue;
        }
        let end = from + shut;
        let shut_s = rows[from].time_s + closing_s(config);
        let first = from + rows[from..end].iter().take_while(|row| row.time_s < shut_s).count();
        if first < end && rows[end - 1].time_s - rows[first].time_s >= SHORTEST_S {
            let inflow_kg_s = inflow_kg_s(rows, from);
            found.push(Hold { shut_s: rows[first].time_s, inflow_kg_s, rows: first..end });
        }
        from = end;
    }
    found
}

/// Mean inflow before a stop \[kg/s\], from the estimated mass.
fn inflow_kg_s(rows: &[Row], first: usize) -> Option<f64> {
    let at = rows.get(first)?;
    let before = rows[..first].iter().rfind(|row| row.time_s <= at.time_s - INFLOW_S)?;
    Some((at.mass_kg? - before.mass_kg?) / (at.time_s - before.time_s))
}
