//! A joint's telemetry as text.

use model_core::joint::JointTelemetry;
use thermyo_files::units::UnitSystem;
use thermyo_joint::named;

pub fn faults(telemetry: &JointTelemetry) -> Option<String> {
    named(telemetry.muscles.map(|muscle| muscle.faults), telemetry.faults)
}

pub fn line(telemetry: &JointTelemetry, units: UnitSystem) -> String {
    let [a, b] = telemetry.muscles.map(|muscle| units.text(muscle.pressure_pa.into(), "Pa", 1));
    format!(
        "{:.2} deg, {:.2} N m, {:.1} N m/rad, {a} and {b}, {}{}",
        f64::from(telemetry.angle_rad).to_degrees(),
        telemetry.torque_n_m,
        telemetry.stiffness_n_m_rad,
        telemetry.mode.name(),
        if telemetry.limited { ", limited" } else { "" },
    )
}
