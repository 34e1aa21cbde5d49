//! `joint_trace.csv`: one row per logged step, of a run or of a board.

use crate::rig::{Inputs, Row};
use model_core::joint::{JointConfig, JointSetPoint, JointTelemetry, Motion};
use std::io::{self, Write};
use thermyo_plant::Truth;
use thermyo_plant::joint::JointTruth;
use thermyo_protocol::Status;
use thermyo_record::board_trace::{Recorder, status_cells};
use thermyo_scenario::short;

pub const FILE: &str = "joint_trace.csv";

/// The columns, in order; those with `a_` and `b_` are of one muscle. `thermyo replay` needs those from
/// `step` on.
pub const COLUMNS: [&str; 70] = [
    "time_s",
    "angle_rad",
    "angle_reference_rad",
    "stiffness_n_m_rad",
    "stiffness_reference_n_m_rad",
    "torque_n_m",
    "speed_rad_s",
    "load_n_m",
    "measured_angle_rad",
    "estimated_speed_rad_s",
    "estimated_torque_n_m",
    "estimated_stiffness_n_m_rad",
    "disturbance_n_m",
    "mode",
    "limited",
    "faults",
    "a_pressure_pa",
    "a_length_m",
    "a_tension_n",
    "a_gas_temperature_k",
    "a_wall_temperature_k",
    "a_sensor_gas_k",
    "a_estimate_k",
    "a_estimate_sd_k",
    "a_duty_in",
    "a_duty_out",
    "a_faults",
    "b_pressure_pa",
    "b_length_m",
    "b_tension_n",
    "b_gas_temperature_k",
    "b_wall_temperature_k",
    "b_sensor_gas_k",
    "b_estimate_k",
    "b_estimate_sd_k",
    "b_duty_in",
    "b_duty_out",
    "b_faults",
    "step",
    "emergency_stop",
    "heard",
    "flooded",
    "missed_steps",
    "code_angle",
    "reference_rad",
    "set_point_kind",
    "set_point_1",
    "set_point_2",
    "set_point_3",
    "set_point_4",
    "a_measured_pressure_pa",
    "a_measured_length_m",
    "a_wall_estimate_k",
    "a_sensor_estimate_k",
    "a_mass_estimate_kg",
    "a_heat_scale",
    "a_sensor_lag_s",
    "a_estimate_valid",
    "a_code_pressure",
    "a_code_gas",
    "b_measured_pressure_pa",
    "b_measured_length_m",
    "b_wall_estimate_k",
    "b_sensor_estimate_k",
    "b_mass_estimate_kg",
    "b_heat_scale",
    "b_sensor_lag_s",
    "b_estimate_valid",
    "b_code_pressure",
    "b_code_gas",
];

/// Columns that only a board's record has, after [`COLUMNS`].
const BOARD_COLUMNS: [&str; 4] = ["armed_pa", "restarts", "starts", "config_checksum"];

/// All columns of a board's record.
pub fn board_columns() -> Vec<&'static str> {
    [&COLUMNS[..], &BOARD_COLUMNS].concat()
}

/// Whether a column is the core's output, which a replay has to give again.
pub fn is_output(column: &str) -> bool {
    const OF_JOINT: [&str; 10] = [
        "measured_angle_rad",
        "estimated_speed_rad_s",
        "estimated_torque_n_m",
        "estimated_stiffness_n_m_rad",
        "disturbance_n_m",
        "mode",
        "limited",
        "faults",
        "reference_rad",
        "set_point_kind",
    ];
    const OF_MUSCLE: [&str; 13] = [
        "estimate_k",
        "estimate_sd_k",
        "duty_in",
        "duty_out",
        "faults",
        "measured_pressure_pa",
        "measured_length_m",
        "wall_estimate_k",
        "sensor_estimate_k",
        "mass_estimate_kg",
        "heat_scale",
        "sensor_lag_s",
        "estimate_valid",
    ];
    match column.strip_prefix("a_").or_else(|| column.strip_prefix("b_")) {
        Some(of_muscle) => OF_MUSCLE.contains(&of_muscle),
        None => OF_JOINT.contains(&column),
    }
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

/// The last number of a set point.
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
        let Self { truth, telemetry, .. } = self;
        let [angle_rad, stiffness_n_m_rad] = self.wanted().unwrap_or([f64::NAN; 2]);
        let mut cells = vec![
            self.time_s,
            truth.angle_rad,
            angle_rad,
            self.stiffness_n_m_rad,
            stiffness_n_m_rad,
            truth.torque_n_m,
            truth.speed_rad_s,
            self.inputs.load_n_m,
            f64::from(telemetry.angle_rad),
            f64::from(telemetry.speed_rad_s),
            f64::from(telemetry.torque_n_m),
            f64::from(telemetry.stiffness_n_m_rad),
            f64::from(telemetry.disturbance_n_m),
            f64::from(telemetry.mode as u8),
            f64::from(u8::from(telemetry.limited)),
            f64::from(telemetry.faults.0),
        ];
        for (i, muscle) in telemetry.muscles.iter().enumerate() {
            let plant = &truth.muscles[i];
            cells.extend([
                plant.pressure_pa,
                plant.length_m,
                truth.tension_n[i],
                plant.gas_temperature_k,
                plant.wall_temperature_k,
                self.sensor_gas_k[i],
                f64::from(muscle.estimate.gas_k),
                f64::from(muscle.estimate.gas_sd_k),
                f64::from(muscle.command.inlet.share()),
                f64::from(muscle.command.outlet.share()),
                f64::from(muscle.faults.0),
            ]);
        }
        cells.extend(raw_cells(telemetry));
        cells
    }
}

/// Raw sample, set point, and the outputs that only a replay needs.
fn raw_cells(telemetry: &JointTelemetry) -> Vec<f64> {
    let sample = telemetry.sample();
    let flag = |flag: bool| f64::from(u8::from(flag));
    let (kind, values) = kind_and_values(telemetry.set_point);
    let mut cells = vec![
        f64::from(telemetry.step()),
        flag(sample.emergency_stop),
        flag(sample.heard),
        flag(sample.flooded),
        f64::from(sample.missed_steps),
        f64::from(sample.angle.0),
        f64::from(telemetry.reference_rad),
        f64::from(kind),
    ];
    cells.extend(values.map(f64::from));
    for muscle in &telemetry.muscles {
        let estimate = &muscle.estimate;
        cells.extend([
            f64::from(muscle.pressure_pa),
            f64::from(muscle.length_m),
            f64::from(estimate.wall_k),
            f64::from(estimate.sensor_k),
            f64::from(estimate.mass_kg),
            f64::from(estimate.heat_scale),
            f64::from(estimate.sensor_lag_s),
            flag(estimate.valid),
            f64::from(muscle.sample.pressure.to_bits()),
            f64::from(muscle.sample.gas.to_bits()),
        ]);
    }
    cells
}

/// Writes one row of a board's record; an empty `status` leaves its columns empty.
///
/// # Errors
/// Of the file, or of what is recorded beside it.
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
