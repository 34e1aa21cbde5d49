//! The experiment that separates slip and creep: a profile of pressure.

use std::path::Path;
use thermyo_files::input::{InputError, Problem};
use thermyo_scenario::{PlantKind, Scenario};
use thermyo_setup::{Loaded, highest_pa};

/// Rest before and between the parts, with the muscle vented \[s\].
const REST_S: f64 = 5.0;
/// Lowest and highest level, as shares of the pressures \[-\].
const LOW: f64 = 0.25;
const HIGH: f64 = 0.9;
/// Shortest time of a change of pressure: no step, since a record could not resolve it \[s\].
const CHANGE_S: f64 = 0.2;

struct Part {
    why: &'static str,
    /// Time since the part's start \[s\], share of the pressures \[-\].
    points: Vec<(f64, f64)>,
}

/// A staircase of holds, each of this duration.
fn stairs(levels: &[f64], hold_s: f64) -> Vec<(f64, f64)> {
    let mut points = vec![(0.0, 0.0)];
    let mut time_s = 0.0;
    for level in levels {
        points.push((time_s + CHANGE_S, *level));
        time_s += CHANGE_S + hold_s;
        points.push((time_s, *level));
    }
    points
}

/// Small reversals about a level, each larger than the one before it.
fn reversals(level: f64, leg_s: f64) -> Vec<(f64, f64)> {
    let mut points = vec![(0.0, 0.0), (1.0, level), (3.0, level)];
    let mut time_s = 3.0;
    for amplitude in [0.02, 0.04, 0.07, 0.1, 0.15] {
        for sign in [1.0, -1.0, 1.0, -1.0] {
            time_s += leg_s;
            points.push((time_s, level + sign * amplitude));
        }
    }
    points
}

fn parts() -> [Part; 4] {
    let mut both = reversals(LOW, 0.4);
    let until_s = both.last().map_or(0.0, |point| point.0) + 1.0;
    both.extend(reversals(0.75, 0.4).into_iter().map(|(time_s, level)| (until_s + time_s, level)));
    [
        Part {
            why: "small fast reversals, low and high: slip builds up over its way before creep can follow, \
                  which gives slip_stiffness_n_m and slip_force_n, and low against high its \
                  slip_pressure_factor",
            points: both,
        },
        Part {
            why: "large triangles, fast and slow: the loop that is left when the speed falls is slip, what \
                  grows with the speed is creep_fast_n_m over creep_fast_s",
            points: vec![
                (0.0, 0.0),
                (1.5, HIGH),
                (3.0, 0.0),
                (4.5, HIGH),
                (6.0, 0.0),
                (18.0, HIGH),
                (30.0, 0.0),
            ],
        },
        Part {
            why: "a staircase of short holds: after each step length goes on by creep_fast, and slip does not",
            points: stairs(&[0.3, 0.5, 0.7, 0.9, 0.7, 0.5, 0.3, 0.0], 4.0),
        },
        Part {
            why: "two long holds: what still moves after seconds is creep_slow_n_m over creep_slow_s",
            points: stairs(&[0.8, 0.4], 75.0),
        },
    ]
}

/// Set points up to a pressure \[s, Pa\], and the reason for each part.
pub fn profile(scenario: &Scenario, highest_pa: f64) -> (Vec<(f64, f64)>, Vec<String>) {
    let ambient_pa = scenario.ambient.pressure_pa;
    let mut profile = vec![(0.0, ambient_pa)];
    let mut reasons = Vec::new();
    let mut begins_s = REST_S;
    for Part { why, points } in parts() {
        let mut ends_s = begins_s;
        for (time_s, share) in points {
            ends_s = begins_s + time_s;
            profile.push((ends_s, ambient_pa + share * (highest_pa - ambient_pa)));
        }
        reasons.push(format!("{begins_s:.0} to {ends_s:.0} s: {why}"));
        profile.push((ends_s + 1.0, ambient_pa));
        begins_s = ends_s + 1.0 + REST_S;
    }
    (profile, reasons)
}

/// A profile `time_s,pressure_pa` for `drive.profile_csv`, and the reason for each part.
///
/// # Errors
/// If the scenario is no muscle, or its supply is not above ambient.
pub fn plan(loaded: &Loaded, config: &Path) -> Result<(String, Vec<String>), InputError> {
    let scenario = &loaded.plant;
    let highest_pa = highest_pa(scenario);
    check_plan(scenario, highest_pa, config)?;
    let (profile, mut reasons) = profile(scenario, highest_pa);
    let row = |(time_s, pressure_pa): &(f64, f64)| format!("{time_s:.2},{pressure_pa:.0}\n");
    let text = "time_s,pressure_pa\n".to_owned() + &profile.iter().map(row).collect::<String>();
    reasons.push(
        "free of load, or under one that does not change; length and pressure at 50 rows a second or more, \
         without a gap; vented for some minutes before"
            .to_owned(),
    );
    Ok((text, reasons))
}

/// # Errors
/// If the scenario is no muscle, or the pressure is not above ambient.
pub fn check_plan(scenario: &Scenario, highest_pa: f64, config: &Path) -> Result<(), InputError> {
    check_muscle(scenario, config)?;
    if highest_pa <= scenario.ambient.pressure_pa {
        let value = format!("{:?}", scenario.supply.pressure_pa);
        return Err(refused(config, "supply.pressure_pa", value, "above ambient.pressure_pa"));
    }
    Ok(())
}

/// # Errors
/// If the scenario is no muscle.
pub fn check_muscle(scenario: &Scenario, config: &Path) -> Result<(), InputError> {
    let kind = scenario.plant.kind;
    if kind == PlantKind::Muscle {
        return Ok(());
    }
    let allowed = "\"muscle\" for a record of motion";
    Err(refused(config, "plant.kind", format!("{:?}", kind.word()), allowed))
}

pub(super) fn refused(config: &Path, key: &str, value: String, allowed: &str) -> InputError {
    let (key, allowed) = (key.to_owned(), allowed.to_owned());
    InputError::file(config, Problem::NotAllowed { key, value, allowed })
}
