//! Warnings about values that a run cannot follow or that the estimate does not expect.

use super::loaded::Loaded;
use super::rules::highest_pa;
use super::unrest::{Unrest, WRONG_FLOW, fills, open_kg_s};
use crate::core_config::{core_config, pressure_limit_pa};
use thermyo_compute::math;
use thermyo_plant::chamber::{self, Chamber};
use thermyo_plant::load_n;
use thermyo_scenario::profile::Profile;
use thermyo_scenario::{DriveKind, GasElementKind, LoadKind, PlantKind, Scenario};

/// Standard deviations of the start by which the gas may be off: measured on `full` at 3 bar, 5 K off a wall with a
/// deviation of 3 K are within the stated deviation of the estimate, 10 K are not, and 15 K end in a fault \[-\].
const START_SDS: f64 = 2.0;

/// Warnings for a scenario of one chamber.
pub(super) fn unlikely(loaded: &Loaded) -> Vec<Unrest> {
    let plant = &loaded.plant;
    let all = [
        cold_sensor(plant),
        varying_lag(plant),
        starved_by_regulator(loaded),
        filled_too_far(loaded),
        out_of_reach(plant).or_else(|| too_heavy(plant)),
        late_profile(loaded),
        other_start(loaded),
    ];
    all.into_iter().flatten().collect()
}

/// The temperature at the start is outside the element's range.
fn cold_sensor(s: &Scenario) -> Option<Unrest> {
    let start_k = s.plant.initial_temperature_k;
    let (low_k, high_k) = (s.sensor.gas.range_min_k, s.sensor.gas.range_max_k);
    let is_resistor = s.sensor.gas.kind == GasElementKind::Pt1000;
    let (key, end_k, side) = match start_k {
        _ if !is_resistor || (low_k..=high_k).contains(&start_k) => return None,
        _ if start_k < low_k => ("sensor.gas.range_min_k", low_k, "above"),
        _ => ("sensor.gas.range_max_k", high_k, "below"),
    };
    let why = format!(
        "{side} plant.initial_temperature_k = {start_k:?}: the reading rests at the end of the range, and the core may vent \
         with a fault of that sensor"
    );
    Some((key, format!("{end_k:?}"), why))
}

/// The core's element has one lag, whatever the density.
fn varying_lag(s: &Scenario) -> Option<Unrest> {
    let exponent = s.sensor.gas.density_exponent;
    let estimated = chamber::of(s).is_some();
    (exponent > 0.0 && estimated).then(|| {
        let most = math::pow(s.supply.pressure_pa / s.ambient.pressure_pa, exponent);
        let why = format!(
            "the lag falls by up to {most:.1} times from ambient to supply.pressure_pa, and the core takes it for constant: \
             the estimate may be off by several K, and state too little"
        );
        ("sensor.gas.density_exponent", format!("{exponent:?}"), why)
    })
}

/// The regulator passes too little for the valve: the core takes its inlet for shut.
///
/// A choked valve behind a regulator with droop d passes m = m_v (1 - d m/P_s), so that m/m_v = 1/(1 + d m_v/P_s).
fn starved_by_regulator(loaded: &Loaded) -> Option<Unrest> {
    let s = &loaded.plant;
    let fills = fills(s) && s.moves_in_full();
    let believed_kg_s = open_kg_s(&loaded.believed, &core_config(&loaded.believed));
    let own_kg_s = open_kg_s(s, &core_config(s));
    let droop = s.supply.droop_pa_s_kg;
    let passed_kg_s = own_kg_s / (1.0 + droop * own_kg_s / s.supply.pressure_pa);
    (fills && droop > 0.0 && WRONG_FLOW * passed_kg_s < believed_kg_s).then(|| {
        let why = format!(
            "at this droop the regulator passes {:.1} g/s, below a quarter of the {:.1} g/s that the core expects of \
             valve.conductance_m3_s_pa, so that it takes the inlet for shut and vents with the fault \"no inflow\"",
            1e3 * passed_kg_s,
            1e3 * believed_kg_s
        );
        ("supply.droop_pa_s_kg", format!("{droop:?}"), why)
    })
}

/// An inlet that stays open fills to the supply's pressure.
fn filled_too_far(loaded: &Loaded) -> Option<Unrest> {
    let supply_pa = loaded.plant.supply.pressure_pa;
    let limit_pa = pressure_limit_pa(&loaded.believed);
    (loaded.plant.drive.kind == DriveKind::Fill && supply_pa > limit_pa).then(|| {
        let why = format!(
            "the inlet stays open: the gas goes on to supply.pressure_pa = {supply_pa:?}, and above {limit_pa:.0} Pa, by \
             sensor.pressure.range_pa, the core vents with the fault \"overpressure\", unless the run ends before"
        );
        ("drive.kind", "\"fill\"".to_owned(), why)
    })
}

/// The contraction takes more pressure than is available.
fn out_of_reach(s: &Scenario) -> Option<Unrest> {
    let driven = s.drive.kind == DriveKind::Contraction && s.drive.profile_csv.is_none();
    let moving = chamber::of(s).filter(|_| driven && s.load.kind != LoadKind::Isometric)?;
    let [low, high] = s.drive.extremes();
    let contraction = low.max(high);
    let needed_pa = needed_pa(s, moving.as_ref(), contraction)?;
    let most_pa = highest_pa(s);
    (needed_pa > most_pa).then(|| {
        let why = if needed_pa.is_finite() {
            format!(
                "by the static law a contraction of {contraction} takes {:.0} kPa at this load, above the {:.0} kPa of \
                 supply.pressure_pa and sensor.pressure.range_pa: it is not reached",
                1e-3 * needed_pa,
                1e-3 * most_pa
            )
        } else {
            format!("by the static law no pressure holds this load at a contraction of {contraction}")
        };
        let key = if s.drive.is_constant() { "drive.contraction" } else { "drive.amplitude" };
        let value = if s.drive.is_constant() { contraction } else { s.drive.amplitude };
        (key, format!("{value:?}"), why)
    })
}

/// The load takes more pressure than is available, even where the chamber pulls most.
fn too_heavy(s: &Scenario) -> Option<Unrest> {
    let moving = chamber::of(s).filter(|_| fills(s) && s.load.kind != LoadKind::Isometric)?;
    let needed_pa = needed_pa(s, moving.as_ref(), 0.0)?;
    let most_pa = highest_pa(s);
    // If no pressure is above ambient, nothing moves, whatever the load.
    (needed_pa > most_pa && most_pa > s.ambient.pressure_pa).then(|| {
        let needed = if needed_pa.is_finite() {
            format!("by the static law it takes {:.0} kPa at the rest length, above", 1e-3 * needed_pa)
        } else {
            "by the static law no pressure holds it at the rest length, not".to_owned()
        };
        let why = format!(
            "{needed} the {:.0} kPa of supply.pressure_pa and sensor.pressure.range_pa: it is never moved",
            1e-3 * most_pa
        );
        match s.load.kind {
            LoadKind::Mass => ("load.mass_kg", format!("{:?}", s.load.mass_kg), why),
            _ => ("load.force_n", format!("{:?}", s.load.force_n), why),
        }
    })
}

/// Largest contraction up to `most`, in whole percents, that the static law holds at the highest pressure less a tenth
/// of its gauge pressure, and whose gas does not vent a muscle that still rests; none if the load is not lifted \[-\].
pub fn contraction_held(s: &Scenario, most: f64) -> Option<f64> {
    let moving = chamber::of(s)?;
    let most_pa = s.ambient.pressure_pa + 0.9 * (highest_pa(s) - s.ambient.pressure_pa);
    // A load is slower than a valve: the gas for the goal first enters the volume at rest.
    let rest_m3 = moving.volume(moving.rest_length());
    let limit_pa = pressure_limit_pa(s);
    let vents = |needed_pa: f64, contraction: f64| {
        let grown = moving.volume(moving.rest_length() * (1.0 - contraction)) / rest_m3;
        (needed_pa * grown).min(s.supply.pressure_pa) > limit_pa
    };
    let held = |contraction: &f64| {
        let needed_pa = needed_pa(s, moving.as_ref(), *contraction);
        needed_pa.is_none_or(|needed_pa| needed_pa <= most_pa && !vents(needed_pa, *contraction))
    };
    let percents = (1..=(100.0 * most).round() as u32).rev();
    percents.map(|percent| f64::from(percent) / 100.0).find(held)
}

/// Pressure that holds the load at a contraction; infinite if the gas does not pull there \[Pa\].
fn needed_pa(s: &Scenario, moving: &dyn Chamber, contraction: f64) -> Option<f64> {
    let length_m = moving.rest_length() * (1.0 - contraction);
    let area_m2 = moving.force_area(length_m);
    // A cylinder pushes.
    let pull_n = load_n(s, moving) - moving.elastic(length_m);
    match s.plant.kind {
        PlantKind::Muscle if pull_n <= 0.0 => None,
        PlantKind::Muscle if area_m2 <= 0.0 => Some(f64::INFINITY),
        _ => Some(s.ambient.pressure_pa + pull_n / area_m2),
    }
}

/// The set points begin after the run, or have times in another unit.
fn late_profile(loaded: &Loaded) -> Option<Unrest> {
    let path = loaded.plant.drive.profile_csv.as_ref()?;
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let why = late(loaded.drive_profile.as_ref()?, loaded.plant.run.duration_s)?;
    Some(("drive.profile_csv", format!("{name:?}"), why))
}

/// Reason why the times of a profile do not suit a run that ends at `end_s`.
pub fn late(profile: &Profile, end_s: f64) -> Option<String> {
    let mut times_s = profile.points().iter().map(|(time_s, _)| *time_s);
    let (first_s, second_s) = (times_s.next()?, times_s.next());
    if first_s >= end_s {
        return Some(format!(
            "its first row, at {first_s:?} s, is not before the end of the run, run.duration_s = {end_s:?}: the set \
             point never changes"
        ));
    }
    let of_many = second_s.filter(|second_s| *second_s > end_s && times_s.next().is_some());
    let only = |_| {
        format!(
            "only its first row is before the end of the run, run.duration_s = {end_s:?}: is its time_s in ms?"
        )
    };
    of_many.map(only).or_else(|| profile.doubt())
}

/// The gas starts far from the start of the estimate.
fn other_start(loaded: &Loaded) -> Option<Unrest> {
    let s = &loaded.plant;
    let gas_k = s.plant.initial_gas_temperature_k?;
    let off_k = (gas_k - s.plant.initial_temperature_k).abs();
    let sd_k = f64::from(loaded.believed.estimator.initial_sd_k);
    (s.plant.kind != PlantKind::Vessel && off_k > START_SDS * sd_k).then(|| {
        let why = format!(
            "{off_k:.0} K off plant.initial_temperature_k, where the estimate starts with estimator.initial_sd_k = {sd_k:?}: \
             for tens of seconds it is off by more than it states, and may find a fault; a larger initial_sd_k lets it follow"
        );
        ("plant.initial_gas_temperature_k", format!("{gas_k:?}"), why)
    })
}

#[cfg(test)]
mod tests {
    use crate::{load_with_warnings, parse_with_warnings};
    use std::path::Path;

    fn warned(text: &str) -> Vec<String> {
        let (_, warnings) = parse_with_warnings(text, "s.toml".as_ref()).unwrap();
        warnings.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn what_a_run_cannot_follow_is_warned_of() {
        let full = "[plant]\nmodel = \"full\"\n";
        for (text, start) in [
            (
                "[plant]\ninitial_temperature_k = 253.15\n[ambient]\ntemperature_k = 253.15\n\
                 [supply]\ntemperature_k = 253.15\n",
                "s.toml: sensor.gas.range_min_k = 270.0: above plant.initial_temperature_k = 253.15",
            ),
            (
                "[plant]\nmodel = \"full\"\n[valve]\nconductance_m3_s_pa = 2e-7\n\
                 [tube]\nvolume_m3 = 2e-4\nconductance_m3_s_pa = 1.5e-6\n",
                "s.toml: supply.droop_pa_s_kg = 20000000.0: at this droop the regulator passes",
            ),
            (
                "[plant]\nmodel = \"full\"\n[load]\nkind = \"isotonic\"\nforce_n = 2000.0\n\
                 [drive]\nkind = \"contraction\"\ncontraction = 0.2\n",
                "s.toml:8: drive.contraction = 0.2: by the static law a contraction of 0.2 takes",
            ),
            (
                "[load]\nforce_n = 1e6\n",
                "s.toml:2: load.force_n = 1000000.0: by the static law it takes ",
            ),
            (
                "[load]\nkind = \"mass\"\nmass_kg = 500\n[drive]\nkind = \"pressure\"\n",
                "s.toml:3: load.mass_kg = 500.0: by the static law it takes ",
            ),
            (
                "[sensor.gas]\ndensity_exponent = 0.5\n",
                "s.toml:2: sensor.gas.density_exponent = 0.5: the lag falls by up to 2.6 times from ambient",
            ),
            (
                "[plant]\nmodel = \"full\"\ninitial_gas_temperature_k = 318.0\n",
                "s.toml:3: plant.initial_gas_temperature_k = 318.0: 20 K off",
            ),
        ] {
            let found = warned(text);
            assert!(found.len() == 1 && found[0].starts_with(start), "{text}: {found:?}");
        }
        for quiet in [
            "[load]\nforce_n = 400.0\n",
            "[load]\nforce_n = 1e6\n[drive]\nkind = \"closed\"\n",
            "[supply]\ntemperature_k = 273.0\n",
            "initial_gas_temperature_k = 303.0\n",
            "[valve]\nconductance_m3_s_pa = 1e-6\n",
            "[drive]\nkind = \"contraction\"\ncontraction = 0.1\n[load]\nkind = \"isotonic\"\nforce_n = 100.0\n",
        ] {
            assert_eq!(warned(&format!("{full}{quiet}")), [""; 0], "{quiet}");
        }
    }

    #[test]
    fn a_profile_that_begins_after_the_run_is_warned_of() {
        let name = format!("thermyo-late-{}.csv", std::process::id());
        let csv = std::env::temp_dir().join(name);
        std::fs::write(&csv, "time_s,pressure_pa\n10,2e5\n11,3e5\n").unwrap();
        let text = |duration_s: f64| {
            format!(
                "[run]\nduration_s = {duration_s:?}\n[drive]\nkind = \"pressure\"\nprofile_csv = {:?}\n",
                csv.display().to_string()
            )
        };
        let (early, late) = (warned(&text(20.0)), warned(&text(6.0)));
        // Times in ms used to give a run without a warning.
        std::fs::write(&csv, "time_s,pressure_pa\n0,2e5\n1000,3e5\n2000,2e5\n").unwrap();
        let (short, long) = (warned(&text(6.0)), warned(&text(3000.0)));
        std::fs::remove_file(&csv).unwrap();
        assert!(
            short.len() == 1
                && short[0].ends_with(
                    "only its first row is before the end of the run, run.duration_s = 6.0: is its \
                     time_s in ms?"
                ),
            "{short:?}"
        );
        assert!(
            long.len() == 1 && long[0].ends_with("its rows are 1000 s apart: is its time_s in ms?"),
            "{long:?}"
        );
        assert_eq!(early, [""; 0]);
        assert!(
            late.len() == 1 && late[0].starts_with("s.toml:5: drive.profile_csv = "),
            "{late:?}"
        );
        assert!(late[0].contains("its first row, at 10.0 s, is not before the end"), "{late:?}");
    }

    #[test]
    fn shipped_scenarios_are_not_warned_of() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios");
        for file in std::fs::read_dir(folder).unwrap() {
            let path = file.unwrap().path();
            // A joint has a loader of its own.
            if path.extension().is_none_or(|extension| extension != "toml") {
                continue;
            }
            if let Ok((_, warnings)) = load_with_warnings(&path) {
                assert!(warnings.is_empty(), "{warnings:?}");
            }
        }
    }
}
