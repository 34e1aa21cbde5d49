//! `joint_trace.csv`: one row per logged step.

use crate::rig::Row;

/// The columns, in order; those with `a_` and `b_` are of one muscle.
pub const COLUMNS: [&str; 38] = [
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
];

impl Row {
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
        cells
    }
}
