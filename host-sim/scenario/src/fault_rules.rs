//! Rules for windows of faults: required numbers, parts that the plant has, overlaps.

use super::document::{Entries, Entry};
use super::schema::{FAULTS, is_fault_window, limits};
use super::tables::{DriveKind, FaultWindow, NEEDED, PlantKind, Scenario};
use super::violation::{Violation, within};
use std::collections::{BTreeMap, BTreeSet};

/// Checks that faults with a number have it.
pub fn check_given(entries: &Entries) -> Result<(), Violation> {
    let given: BTreeSet<(&str, &str)> =
        entries.iter().map(|entry| (entry.table.as_str(), entry.key.name)).collect();
    for Entry { table: path, key, value, .. } in entries.iter() {
        let is_window = path == FAULTS || is_fault_window(path);
        for [line, fault, needed] in NEEDED {
            let says_so = is_window && key.name == line && value.as_str() == Some(fault);
            if says_so && !given.contains(&(path.as_str(), needed)) {
                let (needed, line) = (format!("{path}.{needed}"), format!("{path}.{line}"));
                let why = format!("{line} = \"{fault}\" needs it");
                return Err(Violation::missing(&needed, &line, &why));
            }
        }
    }
    Ok(())
}

/// Checks every window, and every pair of them.
pub fn check(scenario: &Scenario) -> Result<(), Violation> {
    let windows: Vec<(String, &FaultWindow)> = scenario.faults.windows().collect();
    let mut taken = Taken::default();
    for (i, (path, window)) in windows.iter().enumerate() {
        check_alone(path, window)?;
        check_plant_has(path, window, scenario)?;
        if !taken.take(window) {
            for (earlier_path, earlier) in &windows[..i] {
                check_pair((earlier_path, earlier), (path, window))?;
            }
        }
    }
    Ok(())
}

/// Times at which each part already has a fault. Comparing every pair of windows would take hours
/// for the number of windows that a file of some megabytes can hold.
#[derive(Default)]
struct Taken {
    /// End of each window by part, and by the bits of its start, which sort as the starts do, since
    /// none is negative.
    ends_s: BTreeMap<&'static str, BTreeMap<u64, f64>>,
}

impl Taken {
    /// Adds the window. Returns whether all of its parts are free of faults in that time.
    fn take(&mut self, window: &FaultWindow) -> bool {
        let FaultWindow { from_s, until_s, .. } = *window;
        if from_s >= until_s {
            return true;
        }
        // -0.0 becomes 0.0.
        let bits = |time_s: f64| (time_s + 0.0).to_bits();
        window.broken().all(|key| {
            let ends_s = self.ends_s.entry(key).or_default();
            let before = ends_s.range(..bits(until_s)).next_back();
            let free = before.is_none_or(|(_, end_s)| *end_s <= from_s);
            ends_s.insert(bits(from_s), until_s);
            free
        })
    }
}

fn check_alone(path: &str, window: &FaultWindow) -> Result<(), Violation> {
    let until = format!("{path}.until_s");
    let latest = limits(&until).max;
    let why = format!("not before {path}.from_s");
    within(&until, window.until_s, (window.from_s, latest), &why)
}

/// A vessel has a nozzle, or nothing, in place of valves if its drive requires that.
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

#[cfg(test)]
mod tests {
    use super::*;
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::{Rng, SeedableRng};

    /// The same check over all pairs.
    fn by_pairs(scenario: &Scenario) -> Result<(), String> {
        let windows: Vec<(String, &FaultWindow)> = scenario.faults.windows().collect();
        for (i, (path, window)) in windows.iter().enumerate() {
            for (earlier_path, earlier) in &windows[..i] {
                let found = check_pair((earlier_path, earlier), (path, window));
                found.map_err(|found| format!("{found:?}"))?;
            }
        }
        Ok(())
    }

    #[test]
    fn overlaps_are_those_that_comparing_every_pair_finds() {
        let mut generator = Xoshiro256PlusPlus::seed_from_u64(5);
        let mut below = |end: u64| generator.next_u64() % end;
        let mut overlapping = 0;
        for _ in 0..3000 {
            let mut scenario = Scenario::default();
            let longest = 1 + below(20);
            for name in 0..1 + below(8) {
                let from_s = if below(9) == 0 { -0.0 } else { below(60) as f64 };
                let window = FaultWindow {
                    emergency_stop: below(2) == 0,
                    board_restart: below(4) == 0,
                    leak_conductance_m3_s_pa: below(2) as f64,
                    from_s,
                    until_s: from_s + below(longest) as f64,
                    ..FaultWindow::default()
                };
                scenario.faults.named.insert(name.to_string(), window);
            }
            let found = check(&scenario).map_err(|found| format!("{found:?}"));
            overlapping += u32::from(found.is_err());
            assert_eq!(found, by_pairs(&scenario), "{:?}", scenario.faults);
        }
        assert!((500..2500).contains(&overlapping), "{overlapping} of 3000");
    }
}
