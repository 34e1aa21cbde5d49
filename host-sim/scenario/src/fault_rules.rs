//! Rules for the windows of faults: what belongs together, what the plant has, what overlaps.

use super::document::{Entries, Entry};
use super::schema::{FAULTS, is_fault_window, limits};
use super::tables::{DriveKind, FaultWindow, NEEDED, PlantKind, Scenario};
use super::violation::{Violation, within};

/// Checks that what drifts or leaks is given with its number.
///
/// # Errors
/// The first one without.
pub fn check_given(entries: &Entries) -> Result<(), Violation> {
    for Entry { table: path, key, value, .. } in entries.iter() {
        let is_window = path == FAULTS || is_fault_window(path);
        for [line, fault, needed] in NEEDED {
            let needed = format!("{path}.{needed}");
            let says_so = is_window && key.name == line && value.as_str() == Some(fault);
            if says_so && entries.get(&needed).is_none() {
                let line = format!("{path}.{line}");
                let why = format!("{line} = \"{fault}\" needs it");
                return Err(Violation::missing(&needed, &line, &why));
            }
        }
    }
    Ok(())
}

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
    within(&until, window.until_s, (window.from_s, latest), &why)
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
