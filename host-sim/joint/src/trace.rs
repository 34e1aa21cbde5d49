//! `joint_trace.csv`: one row per logged step, of a run or of a board.

use crate::rig::{Inputs, Row};
use model_core::joint::{JointConfig, JointSetPoint, JointTelemetry, Motion};
use std::io::{self, Write};
use thermyo_plant::Truth;
use thermyo_plant::joint::JointTruth;
use thermyo_protocol::Status;
use thermyo_record::board_trace::{Recorder, status_cells};
use thermyo_record::trace::{flag, names};
use thermyo_scenario::short;

pub const FILE: &str = "joint_trace.csv";

/// Whether a column is the core's output, and its cell in a row.
type Cell = (bool, fn(&Row) -> f64);
/// A cell of muscle a, 0, or b, 1.
type OfMuscle = fn(&Row, usize) -> f64;

const OUTPUT: bool = true;
const OTHER: bool = false;

/// Columns of the joint, and of either muscle: those of muscle a, then those of muscle b.
macro_rules! columns {
    ($(
        joint { $($joint:literal, $output:ident, $cell:expr;)* }
        muscles { $($muscle:literal, $of_core:ident, $of_muscle:expr;)* }
    )*) => {
        [$(
            $(($joint, ($output, $cell)),)*
            $((concat!("a_", $muscle), ($of_core, |row| { let of: OfMuscle = $of_muscle; of(row, 0) })),)*
            $((concat!("b_", $muscle), ($of_core, |row| { let of: OfMuscle = $of_muscle; of(row, 1) })),)*
        )*]
    };
}

/// The columns, in order; those with `a_` and `b_` are of one muscle. `thermyo replay` needs those from
/// `step` on.
const CELLS: [(&str, Cell); 70] = columns! {
    joint {
        "time_s", OTHER, |row| row.time_s;
        "angle_rad", OTHER, |row| row.truth.angle_rad;
        "angle_reference_rad", OTHER, |row| wanted(row)[0];
        "stiffness_n_m_rad", OTHER, |row| row.stiffness_n_m_rad;
        "stiffness_reference_n_m_rad", OTHER, |row| wanted(row)[1];
        "torque_n_m", OTHER, |row| row.truth.torque_n_m;
        "speed_rad_s", OTHER, |row| row.truth.speed_rad_s;
        "load_n_m", OTHER, |row| row.inputs.load_n_m;
        "measured_angle_rad", OUTPUT, |row| row.telemetry.angle_rad.into();
        "estimated_speed_rad_s", OUTPUT, |row| row.telemetry.speed_rad_s.into();
        "estimated_torque_n_m", OUTPUT, |row| row.telemetry.torque_n_m.into();
        "estimated_stiffness_n_m_rad", OUTPUT, |row| row.telemetry.stiffness_n_m_rad.into();
        "disturbance_n_m", OUTPUT, |row| row.telemetry.disturbance_n_m.into();
        "mode", OUTPUT, |row| f64::from(row.telemetry.mode as u8);
        "limited", OUTPUT, |row| flag(row.telemetry.limited);
        "faults", OUTPUT, |row| row.telemetry.faults.0.into();
    }
    muscles {
        "pressure_pa", OTHER, |row, i| row.truth.muscles[i].pressure_pa;
        "length_m", OTHER, |row, i| row.truth.muscles[i].length_m;
        "tension_n", OTHER, |row, i| row.truth.tension_n[i];
        "gas_temperature_k", OTHER, |row, i| row.truth.muscles[i].gas_temperature_k;
        "wall_temperature_k", OTHER, |row, i| row.truth.muscles[i].wall_temperature_k;
        "sensor_gas_k", OTHER, |row, i| row.sensor_gas_k[i];
        "estimate_k", OUTPUT, |row, i| row.telemetry.muscles[i].estimate.gas_k.into();
        "estimate_sd_k", OUTPUT, |row, i| row.telemetry.muscles[i].estimate.gas_sd_k.into();
        "duty_in", OUTPUT, |row, i| row.telemetry.muscles[i].command.inlet.share().into();
        "duty_out", OUTPUT, |row, i| row.telemetry.muscles[i].command.outlet.share().into();
        "faults", OUTPUT, |row, i| row.telemetry.muscles[i].faults.0.into();
    }
    joint {
        "step", OTHER, |row| row.telemetry.step().into();
        "emergency_stop", OTHER, |row| flag(row.telemetry.sample().emergency_stop);
        "heard", OTHER, |row| flag(row.telemetry.sample().heard);
        "flooded", OTHER, |row| flag(row.telemetry.sample().flooded);
        "missed_steps", OTHER, |row| row.telemetry.sample().missed_steps.into();
        "code_angle", OTHER, |row| row.telemetry.sample().angle.0.into();
        "reference_rad", OUTPUT, |row| row.telemetry.reference_rad.into();
        "set_point_kind", OUTPUT, |row| kind_and_values(row.telemetry.set_point).0.into();
        "set_point_1", OTHER, |row| kind_and_values(row.telemetry.set_point).1[0].into();
        "set_point_2", OTHER, |row| kind_and_values(row.telemetry.set_point).1[1].into();
        "set_point_3", OTHER, |row| kind_and_values(row.telemetry.set_point).1[2].into();
        "set_point_4", OTHER, |row| kind_and_values(row.telemetry.set_point).1[3].into();
    }
    muscles {
        "measured_pressure_pa", OUTPUT, |row, i| row.telemetry.muscles[i].pressure_pa.into();
        "measured_length_m", OUTPUT, |row, i| row.telemetry.muscles[i].length_m.into();
        "wall_estimate_k", OUTPUT, |row, i| row.telemetry.muscles[i].estimate.wall_k.into();
        "sensor_estimate_k", OUTPUT, |row, i| row.telemetry.muscles[i].estimate.sensor_k.into();
        "mass_estimate_kg", OUTPUT, |row, i| row.telemetry.muscles[i].estimate.mass_kg.into();
        "heat_scale", OUTPUT, |row, i| row.telemetry.muscles[i].estimate.heat_scale.into();
        "sensor_lag_s", OUTPUT, |row, i| row.telemetry.muscles[i].estimate.sensor_lag_s.into();
        "estimate_valid", OUTPUT, |row, i| flag(row.telemetry.muscles[i].estimate.valid);
        "code_pressure", OTHER, |row, i| row.telemetry.muscles[i].sample.pressure.to_bits().into();
        "code_gas", OTHER, |row, i| row.telemetry.muscles[i].sample.gas.to_bits().into();
    }
};

/// Names of the columns.
pub const COLUMNS: [&str; CELLS.len()] = names(&CELLS);

/// The angle \[rad\] and stiffness \[N m/rad\] of a row's set point.
fn wanted(row: &Row) -> [f64; 2] {
    row.wanted().unwrap_or([f64::NAN; 2])
}

/// Columns that only a board's record has, after [`COLUMNS`].
const BOARD_COLUMNS: [&str; 4] = ["armed_pa", "restarts", "starts", "config_checksum"];

/// All columns of a board's record.
pub fn board_columns() -> Vec<&'static str> {
    [&COLUMNS[..], &BOARD_COLUMNS].concat()
}

/// Whether a column is the core's output, which a replay has to reproduce.
pub fn is_output(column: &str) -> bool {
    CELLS.iter().any(|(name, (output, _))| *output && *name == column)
}

/// Number and values of a set point: angle, speed, acceleration and stiffness; torque and stiffness; pressures;
/// inlets and outlets.
fn kind_and_values(set_point: JointSetPoint) -> (u8, [f32; 4]) {
    match set_point {
        JointSetPoint::Vent => (0, [0.0; 4]),
        JointSetPoint::Duty { inlet: [inlet_a, inlet_b], outlet: [outlet_a, outlet_b] } => {
            (1, [inlet_a, inlet_b, outlet_a, outlet_b])
        }
        JointSetPoint::Pressures { pressure_pa: [a, b] } => (2, [a, b, 0.0, 0.0]),
        JointSetPoint::Torque { torque_n_m, stiffness_n_m_rad } => {
            (3, [torque_n_m, stiffness_n_m_rad, 0.0, 0.0])
        }
        JointSetPoint::Angle(Motion {
            angle_rad,
            speed_rad_s,
            acceleration_rad_s2,
            stiffness_n_m_rad,
        }) => (4, [angle_rad, speed_rad_s, acceleration_rad_s2, stiffness_n_m_rad]),
        JointSetPoint::Lock => (5, [0.0; 4]),
    }
}

/// Largest number of a set point.
pub const LAST_KIND: u8 = 5;

pub fn set_point(kind: u8, values: [f32; 4]) -> JointSetPoint {
    let [first, second, third, fourth] = values;
    match kind {
        1 => JointSetPoint::Duty { inlet: [first, second], outlet: [third, fourth] },
        2 => JointSetPoint::Pressures { pressure_pa: [first, second] },
        3 => JointSetPoint::Torque { torque_n_m: first, stiffness_n_m_rad: second },
        4 => JointSetPoint::Angle(Motion {
            angle_rad: first,
            speed_rad_s: second,
            acceleration_rad_s2: third,
            stiffness_n_m_rad: fourth,
        }),
        5 => JointSetPoint::Lock,
        _ => JointSetPoint::Vent,
    }
}

impl Row {
    /// The row of a board's telemetry, with its readings in place of the plant; unknown values are NaN.
    pub fn of_board(time_s: f64, config: &JointConfig, telemetry: &JointTelemetry) -> Self {
        let unknown = f64::NAN;
        let muscles = telemetry.muscles.map(|muscle| Truth {
            time_s,
            pressure_pa: muscle.pressure_pa.into(),
            length_m: muscle.length_m.into(),
            gas_temperature_k: unknown,
            wall_temperature_k: unknown,
            ..Truth::default()
        });
        let truth = JointTruth {
            angle_rad: telemetry.angle_rad.into(),
            speed_rad_s: telemetry.speed_rad_s.into(),
            torque_n_m: telemetry.torque_n_m.into(),
            tension_n: [unknown; 2],
            muscles,
        };
        let reading =
            |i: usize| config.muscles[i].sensing().gas_k(telemetry.muscles[i].sample.gas).into();
        Self {
            time_s,
            truth,
            stiffness_n_m_rad: telemetry.stiffness_n_m_rad.into(),
            inputs: Inputs { set_point: telemetry.set_point, load_n_m: unknown, torn: [false; 2] },
            set_point: telemetry.set_point,
            telemetry: *telemetry,
            sensor_gas_k: [reading(0), reading(1)],
        }
    }

    /// The cells, in the order of [`COLUMNS`].
    pub fn cells(&self) -> Vec<f64> {
        CELLS.iter().map(|(_, (_, cell))| cell(self)).collect()
    }
}

/// Writes one row of a board's record; an empty `status` leaves its columns empty.
///
/// # Errors
/// Error of the file, or of an output beside it.
pub fn record<W: Write>(
    recorder: &mut Recorder<W>,
    config: &JointConfig,
    status: Option<&Status>,
    telemetry: &JointTelemetry,
) -> io::Result<Row> {
    let [a, _] = &config.muscles;
    let time_s = recorder.time_s(telemetry.step(), short(a.step_s));
    let row = Row::of_board(time_s, config, telemetry);
    let cells: Vec<f64> = row.cells().into_iter().chain(status_cells(status)).collect();
    recorder.push(&cells)?;
    Ok(row)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_point_reads_back() {
        let motion = Motion {
            angle_rad: 0.1,
            speed_rad_s: -2.0,
            acceleration_rad_s2: 3.0,
            stiffness_n_m_rad: 14.0,
        };
        for asked in [
            JointSetPoint::Vent,
            JointSetPoint::Duty { inlet: [0.1, 0.2], outlet: [0.3, 0.4] },
            JointSetPoint::Pressures { pressure_pa: [2.0e5, 2.5e5] },
            JointSetPoint::Torque { torque_n_m: -1.0, stiffness_n_m_rad: 9.0 },
            JointSetPoint::Angle(motion),
            JointSetPoint::Lock,
        ] {
            let (kind, values) = kind_and_values(asked);
            assert_eq!(set_point(kind, values), asked);
        }
    }

    #[test]
    fn every_output_is_a_column() {
        let outputs = COLUMNS.iter().filter(|column| is_output(column)).count();
        assert_eq!(outputs, 10 + 2 * 13);
    }
}
