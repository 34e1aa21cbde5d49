//! Rules for the windows of faults: what belongs together, what the plant has, what overlaps.

use super::schema::limits;
use super::tables::{ChannelFault, DriveKind, FaultWindow, PlantKind, Scenario, ValveFault};
use super::violation::{Violation, within};

/// Checks every window, and every pair of them.
///
/// # Errors
/// The first rule that does not hold.
pub fn check(scenario: &Scenario) -> Result<(), Violation> {
    let windows: Vec<(String, &FaultWindow)> = scenario.faults.windows().collect();
    for (i, (path, window)) in windows.iter().enumerate() {
        check_alone(path, window)?;
        check_plant_has(path, window, scenario)?;
        for (earlier_path, earlier) in &windows[..i] {
            check_pair((earlier_path, earlier), (path, window))?;
        }
    }
    Ok(())
}

fn check_alone(path: &str, window: &FaultWindow) -> Result<(), Violation> {
    let until = format!("{path}.until_s");
    let latest = limits(&until).max;
    let why = format!("not before {path}.from_s");
    within(&until, window.until_s, (window.from_s, latest), &why)?;
    let drifts = |fault| fault == ChannelFault::Drifting;
    let leaks = |fault| fault == ValveFault::Leaking;
    for (line, fault, needed, needs, given) in [
        (
            "pressure",
            "drifting",
            "pressure_drift_pa_s",
            drifts(window.pressure),
            window.pressure_drift_pa_s,
        ),
        ("gas", "drifting", "gas_drift_k_s", drifts(window.gas), window.gas_drift_k_s),
        ("length", "drifting", "length_drift_m_s", drifts(window.length), window.length_drift_m_s),
        ("inlet", "leaking", "inlet_leak", leaks(window.inlet), window.inlet_leak),
        ("outlet", "leaking", "outlet_leak", leaks(window.outlet), window.outlet_leak),
    ] {
        if needs && given.is_none() {
            let line = format!("{path}.{line}");
            let why = format!("{line} = \"{fault}\" needs it");
            return Err(Violation::missing(&format!("{path}.{needed}"), &line, &why));
        }
    }
    Ok(())
}

/// A vessel has a nozzle or nothing in place of valves, where its drive says so.
fn check_plant_has(path: &str, window: &FaultWindow, scenario: &Scenario) -> Result<(), Violation> {
    let (kind, lacking): (&str, &[&str]) = match (scenario.plant.kind, scenario.drive.kind) {
        (PlantKind::Vessel, DriveKind::Fill) => ("fill", &["inlet", "outlet"]),
        (PlantKind::Vessel, DriveKind::Discharge) => {
            ("discharge", &["inlet", "outlet", "supply_pressure_pa"])
        }
        (PlantKind::Vessel, DriveKind::Closed) => {
            ("closed", &["inlet", "outlet", "supply_pressure_pa"])
        }
        _ => return Ok(()),
    };
    match window.broken().find(|key| lacking.contains(key)) {
        Some(key) => {
            let what = if key == "supply_pressure_pa" { "supply" } else { "valves" };
            let allowed = format!("left out: a vessel with drive.kind = \"{kind}\" has no {what}");
            Err(Violation::value(&format!("{path}.{key}"), "a fault", allowed))
        }
        None => Ok(()),
    }
}

fn check_pair(
    (earlier_path, earlier): (&str, &FaultWindow),
    (path, window): (&str, &FaultWindow),
) -> Result<(), Violation> {
    let Some([from_s, until_s]) = window.shared_with(earlier) else { return Ok(()) };
    match window.broken().find(|key| earlier.broken().any(|other| other == *key)) {
        Some(key) => {
            let allowed = format!(
                "left out from {from_s} to {until_s} s: {earlier_path}.{key} is a fault there already"
            );
            Err(Violation::value(&format!("{path}.{key}"), "a fault", allowed))
        }
        None => Ok(()),
    }
}
