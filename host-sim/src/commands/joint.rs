//! A joint's telemetry as text.

use model_core::Faults;
use model_core::joint::{JointFaults, JointMode, JointTelemetry};
use thermyo_files::units::UnitSystem;

/// Faults of the muscles and of the joint, each with its place.
pub fn named(muscles: [Faults; 2], joint: JointFaults) -> Option<String> {
    let [a, b] = muscles.map(|faults| faults.to_string());
    let all = [("muscle a", a), ("muscle b", b), ("joint", joint.to_string())];
    let held = all.into_iter().filter(|(_, faults)| !faults.is_empty());
    let texts: Vec<String> = held.map(|(of, faults)| format!("{of}: {faults}")).collect();
    (!texts.is_empty()).then(|| texts.join("; "))
}

/// Every fault that is shown.
pub fn faults(telemetry: &JointTelemetry) -> Option<String> {
    named(telemetry.muscles.map(|muscle| muscle.faults), telemetry.faults)
}

/// The joint in one line.
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
