//! A joint's telemetry as text.

use model_core::joint::{JointMode, JointTelemetry};
use thermyo_files::units::UnitSystem;
use thermyo_joint::named;

pub fn faults(telemetry: &JointTelemetry) -> Option<String> {
    named(telemetry.muscles.map(|muscle| muscle.faults), telemetry.faults)
}

pub fn line(telemetry: &JointTelemetry, units: UnitSystem) -> String {
    let [a, b] = telemetry.muscles.map(|muscle| units.text(muscle.pressure_pa.into(), "Pa", 1));
    let mode = JointMode::NAMES.iter().find(|(mode, _)| *mode == telemetry.mode);
    format!(
        "{:.2} deg, {:.2} N m, {:.1} N m/rad, {a} and {b}, {}{}",
        f64::from(telemetry.angle_rad).to_degrees(),
        telemetry.torque_n_m,
        telemetry.stiffness_n_m_rad,
        mode.map_or("", |(_, name)| name),
        if telemetry.limited { ", limited" } else { "" },
    )
}
