//! Dimensions of a scenario's chamber, its load, its valves and the ranges of its sensors, for comparison with another
//! scenario's.

use super::loaded::Loaded;
use super::tree::value;
use thermyo_scenario::{PlantKind, Scenario, number};
use toml::{Table, Value};

const COMMON: [&str; 7] = [
    "plant.kind",
    "valve.kind",
    "load.kind",
    "load.force_n",
    "load.mass_kg",
    "sensor.pressure.range_pa",
    "sensor.length.range_m",
];
const MUSCLE: [&str; 3] = ["muscle.rest_length_m", "muscle.diameter_m", "muscle.braid_angle_deg"];
const CYLINDER: [&str; 4] =
    ["cylinder.acts", "cylinder.rest_length_m", "cylinder.stroke_m", "cylinder.area_m2"];
const TABLE: [&str; 1] = ["table.csv"];
/// Difference below which numbers belong to one muscle, measured twice \[-\].
const SAME: f64 = 0.1;

/// The hardware in a scenario's configuration of the core, as TOML.
pub fn hardware(loaded: &Loaded) -> String {
    let scenario = &loaded.believed;
    let own = match scenario.plant.kind {
        PlantKind::Muscle => &MUSCLE[..],
        PlantKind::Cylinder => &CYLINDER,
        PlantKind::Table => &TABLE,
        PlantKind::Vessel => &[],
    };
    let all = scenario.to_table();
    let entry = |path: &&str| {
        let (table, key) = path.rsplit_once('.')?;
        Some(((*path).to_owned(), value(&all, table, key)?.clone()))
    };
    COMMON.iter().chain(own).filter_map(entry).collect::<Table>().to_string()
}

/// Differences from such hardware, each as "key = own value, other value there".
pub fn differences(loaded: &Loaded, there: &str) -> Vec<String> {
    let (Ok(own), Ok(there)) = (hardware(loaded).parse::<Table>(), there.parse::<Table>()) else {
        return Vec::new();
    };
    let differs = |own: &Value, other: &Value| match (own.as_float(), other.as_float()) {
        (Some(own), Some(other)) => (own - other).abs() > SAME * own.abs().max(other.abs()),
        _ => own != other,
    };
    let one = |(key, own): (&String, &Value)| {
        let other = there.get(key)?;
        differs(own, other).then(|| format!("{key} = {own}, {other} there"))
    };
    own.iter().filter_map(one).collect()
}

/// Values that a calibration of a board finds.
const CALIBRATION: [&str; 6] = [
    "sensor.pressure.gain",
    "sensor.pressure.offset_pa",
    "sensor.length.gain",
    "sensor.length.offset_m",
    "sensor.gas.gain",
    "sensor.gas.offset_k",
];
/// A board's values are rounded to f32.
const ROUNDED: f64 = 1e-6;

/// Differences of a scenario's calibration from a board's, each as "key = own value, other value there".
pub fn calibrated_otherwise(own: &Scenario, there: &Scenario) -> Vec<String> {
    let differs = |path: &&'static str| {
        let [own, there] = [own, there].map(|scenario| number(scenario, path).unwrap_or_default());
        let apart = (own - there).abs() > ROUNDED * own.abs().max(there.abs());
        apart.then(|| format!("{path} = {own:?}, {there:?} there"))
    };
    CALIBRATION.iter().filter_map(differs).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn loaded(text: &str) -> Loaded {
        crate::parse(text, Path::new("s.toml")).unwrap()
    }

    #[test]
    fn valves_of_another_kind_are_named() {
        let there = hardware(&loaded(""));
        let proportional = "[plant]\nmodel = \"full\"\n[valve]\nkind = \"proportional\"\n";
        let expected = ["valve.kind = \"proportional\", \"switching\" there"];
        assert_eq!(differences(&loaded(proportional), &there), expected);
    }

    #[test]
    fn another_muscle_is_named_by_its_keys() {
        let there = hardware(&loaded(""));
        for (text, expected) in [
            ("", &[][..]),
            // Identified again, with other believed values that are no dimensions, or driven differently.
            (
                "[muscle]\ndiameter_m = 0.0205\n[friction]\nforce_n = 3\n[valve]\nconductance_m3_s_pa = 2e-9\n",
                &[],
            ),
            (
                "[muscle]\npreset = \"dmsp-10\"\n",
                &[
                    "muscle.braid_angle_deg = 28.06, 23.0 there",
                    "muscle.diameter_m = 0.01387, 0.02 there",
                    "muscle.rest_length_m = 0.25, 0.3 there",
                ],
            ),
            ("[load]\nforce_n = 300\n", &["load.force_n = 300.0, 100.0 there"]),
            (
                "[plant]\nkind = \"cylinder\"\n[load]\nforce_n = -100\n",
                &[
                    "load.force_n = -100.0, 100.0 there",
                    "plant.kind = \"cylinder\", \"muscle\" there",
                ],
            ),
            (
                "[believed.sensor.pressure]\nrange_pa = 1e6\n",
                &["sensor.pressure.range_pa = 1000000.0, 700000.0 there"],
            ),
        ] {
            assert_eq!(differences(&loaded(text), &there), expected, "{text}");
        }
        assert_eq!(differences(&loaded("[load]\nforce_n = 300\n"), ""), [""; 0], "a joint there");
    }
}
