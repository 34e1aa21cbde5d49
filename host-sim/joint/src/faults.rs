//! Faults of both muscles and of the joint, by name.

use model_core::Faults;
use model_core::joint::{JointFaults, JointTelemetry};
use model_core::safety::supervisor::VENTING;

/// Names of the faults that vent; none if the joint may be armed.
pub fn venting(telemetry: &JointTelemetry) -> Option<String> {
    named(telemetry.muscles.map(|muscle| muscle.faults.of(VENTING)), telemetry.faults)
}

/// Faults of the muscles and of the joint, each with its muscle or "joint".
pub fn named(muscles: [Faults; 2], joint: JointFaults) -> Option<String> {
    let [a, b] = muscles.map(|faults| faults.to_string());
    let all = [("muscle a", a), ("muscle b", b), ("joint", joint.to_string())];
    let held = all.into_iter().filter(|(_, faults)| !faults.is_empty());
    let texts: Vec<String> = held.map(|(of, faults)| format!("{of}: {faults}")).collect();
    (!texts.is_empty()).then(|| texts.join("; "))
}
