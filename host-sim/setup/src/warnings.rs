//! Warnings about scenarios that are valid and run, but are probably not intended.

use super::loaded::Loaded;
use super::presets::presets_of;
use super::tree::{same, value};
use super::unlikely::unlikely;
use super::unrest::{fills, unrest};
use crate::core_config::pressure_limit_pa;
use std::collections::BTreeMap;
use thermyo_files::input::{InputError, Problem};
use thermyo_plant::chamber;
use thermyo_scenario::document::{Document, Entries, Entry};
use thermyo_scenario::preset::Preset;
use thermyo_scenario::{
    DriveKind, FaultWindow, GasElementKind, HeatModel, LoadKind, NEEDED, PlantKind, PlantModel,
    PressureKind, Scenario, Shape, ValveKind, ZonesSource,
};

/// Tables that neither plant nor core uses, each with the value that causes this.
pub(super) fn unused_tables(loaded: &Loaded) -> Vec<(&'static str, &'static str)> {
    let scenario = &loaded.plant;
    let kind = scenario.plant.kind;
    let vessel = kind == PlantKind::Vessel;
    let own = |owner, table| (table, owner == kind, "plant.kind is another one");
    let moving = |table| (table, !vessel, "plant.kind = \"vessel\"");
    let mut tables: Vec<(&str, &str)> = [
        own(PlantKind::Muscle, "muscle"),
        own(PlantKind::Vessel, "vessel"),
        own(PlantKind::Vessel, "orifice"),
        own(PlantKind::Cylinder, "cylinder"),
        own(PlantKind::Table, "table"),
        moving("friction"),
        moving("load"),
        moving("tube"),
    ]
    .into_iter()
    .filter(|(_, used, _)| !used)
    .map(|(table, _, why)| (table, why))
    .collect();
    // The table's conductance gives the width of the jet.
    let stirs = scenario.heat.model == HeatModel::Correlation;
    if !vessel && scenario.plant.model != PlantModel::Full && !stirs {
        tables.push(("tube", "plant.model is not \"full\""));
    }
    if scenario.plant.model != PlantModel::Paper {
        tables.push(("paper", "plant.model is not \"paper\""));
    }
    let sensors = [&loaded.plant, &loaded.believed].map(|scenario| &scenario.sensor);
    let no_gas = |kind| sensors.iter().all(|sensor| sensor.gas.kind != kind);
    if no_gas(GasElementKind::Ntc) {
        tables.push(("sensor.ntc", "sensor.gas.kind is not \"ntc\""));
    }
    if no_gas(GasElementKind::Max31865) {
        tables.push(("sensor.max31865", "sensor.gas.kind is not \"max31865\""));
    }
    if sensors.iter().all(|sensor| sensor.pressure.kind != PressureKind::Mpr) {
        tables.push(("sensor.mpr", "sensor.pressure.kind is not \"mpr\""));
    }
    let open = [DriveKind::Duty, DriveKind::Closed, DriveKind::Fill, DriveKind::Discharge];
    if open.contains(&scenario.drive.kind) {
        tables.push(("controller", "with this drive.kind nothing is controlled"));
    }
    tables
}

/// Whether `plant.model` has no effect, since a vessel has one zone.
pub(super) fn model_is_unused(scenario: &Scenario) -> bool {
    scenario.plant.kind == PlantKind::Vessel && scenario.plant.model == PlantModel::Full
}

/// Pressure below which a muscle holds nearly a vacuum, or the number was meant in bar \[Pa\].
const NEARLY_VACUUM_PA: f64 = 1000.0;

/// Keys that only a muscle with zones uses.
const IN_FULL: [&str; 15] = [
    "supply.droop_pa_s_kg",
    "muscle.zones",
    "cylinder.zones",
    "table.zones",
    "wall.outer_fraction",
    "wall.conductance_w_k",
    "friction.stribeck_force_n",
    "friction.stribeck_speed_m_s",
    "friction.viscous_n_s_m",
    "friction.presliding_stiffness_n_m",
    "sensor.gas.housing_time_constant_s",
    "sensor.gas.position",
    "sensor.gas.span",
    "sensor.gas.radius",
    "sensor.wall.position",
];

/// Reason why a key of a table in use has no effect.
fn unused_key(scenario: &Scenario, path: &str) -> Option<&'static str> {
    let (drive, load, heat) = (&scenario.drive, &scenario.load, &scenario.heat);
    let of_drive = |kind, why| {
        let why = (drive.kind != kind).then_some(why);
        why.or(drive.profile_csv.is_some().then_some("drive.profile_csv sets it"))
            .or(drive.offset.is_some().then_some("drive.offset sets it"))
    };

    let of_load = |kind, why| (load.kind != kind).then_some(why);
    let none = matches!(heat.model, HeatModel::Adiabatic | HeatModel::Isothermal);
    match path {
        "drive.period_s" if drive.shape != Shape::Constant => None,
        "drive.amplitude" | "drive.offset" => {
            (drive.shape == Shape::Constant).then_some("drive.shape is \"constant\"")
        }
        "drive.period_s" | "drive.flow_kg_s" => {
            of_drive(DriveKind::MassFlow, "drive.kind is not \"mass-flow\"")
        }
        "drive.pressure_pa" => of_drive(DriveKind::Pressure, "drive.kind is not \"pressure\""),
        "drive.contraction" => {
            of_drive(DriveKind::Contraction, "drive.kind is not \"contraction\"")
        }
        "load.force_n" => of_load(LoadKind::Isotonic, "load.kind is not \"isotonic\""),
        "load.length_m" => of_load(LoadKind::Isometric, "load.kind is not \"isometric\""),
        "load.mass_kg" if load.kind == LoadKind::Isometric => Some("load.kind = \"isometric\""),
        "load.mass_kg" if load.kind == LoadKind::Isotonic && !scenario.moves_in_full() => {
            Some("load.kind is not \"mass\", and plant.model is not \"full\"")
        }
        "heat.inner_w_m2_k" | "heat.inner_per_flow" => {
            (heat.model != HeatModel::Constant).then_some("heat.model is not \"constant\"")
        }
        path if path.starts_with("zones.") && path != "zones.source" => {
            let of_plant = scenario.zones.source == ZonesSource::Plant;
            of_plant.then_some("zones.source is not \"keys\"")
        }
        "heat.inlet_diameter_m" | "heat.stirring_decay_s" => {
            (heat.model != HeatModel::Correlation).then_some("heat.model is not \"correlation\"")
        }
        "heat.scale" if none => Some("heat.model sets it"),
        "sensor.gas.radius" if heat.model != HeatModel::Correlation => {
            Some("heat.model is not \"correlation\": the gas has no profile")
        }
        "tube.diameter_m" if scenario.tube.line().is_none() => Some("tube.length_m is 0"),
        "valve.kind" | "valve.dead_band" | "valve.bandwidth_hz" if !scenario.moves_in_full() => {
            Some("plant.model is not \"full\", or it is a vessel: its valves are ideal")
        }
        "valve.dead_band" | "valve.bandwidth_hz" => {
            let switches = scenario.valve.kind == ValveKind::Switching;
            switches.then_some("valve.kind is not \"proportional\"")
        }
        "valve.switch_time_s" => {
            let in_proportion = scenario.valve.kind == ValveKind::Proportional;
            in_proportion.then_some("valve.kind is not \"switching\"")
        }
        path if IN_FULL.contains(&path) && !scenario.moves_in_full() => {
            Some("plant.model is not \"full\", or it is a vessel")
        }
        _ => None,
    }
}

/// Reason why a limit of the gas sensor has no effect.
fn unused_range(scenario: &Scenario, path: &str) -> Option<&'static str> {
    let is_pt1000 = scenario.sensor.gas.kind == GasElementKind::Pt1000;
    let of_range = path.starts_with("sensor.gas.range_");
    (of_range && !is_pt1000).then_some("sensor.gas.kind is not \"pt1000\"")
}

/// Changed values without effect.
fn unused_keys(document: &Document, loaded: &Loaded) -> Vec<InputError> {
    let tables = unused_tables(loaded);
    let defaults = Scenario::default().to_table();
    let changed = |entry: &&Entry| {
        let default = value(&defaults, &entry.table, entry.key.name);
        !same(default, Some(&entry.value)) && tables.iter().all(|(table, _)| *table != entry.table)
    };
    [(&document.plant, &loaded.plant), (&document.believed, &loaded.believed)]
        .into_iter()
        .flat_map(|(entries, scenario)| {
            entries.iter().filter(changed).filter_map(|entry| {
                let path = entry.path();
                let why = unused_key(scenario, &path).or_else(|| unused_range(scenario, &path))?;
                Some(no_sense(document, entries, entry, format!("not used: {why}")))
            })
        })
        .collect()
}

/// Numbers for faults that are not in their windows.
fn unused_fault_numbers(document: &Document) -> Vec<InputError> {
    let entries = &document.plant;
    let one = |entry: &Entry| {
        let [part, fault, _] = NEEDED.iter().find(|[.., number]| *number == entry.key.name)?;
        let part = format!("{}.{part}", entry.table);
        let has = entries.get(&part).is_some_and(|entry| entry.value.as_str() == Some(fault));
        let why = format!("not used: {part} is not {fault:?}");
        (!has).then(|| no_sense(document, entries, entry, why))
    };
    entries.iter().filter_map(one).collect()
}

/// Changed values of `[controller]` that a joint does not use.
pub fn unused_in_joint(document: &Document) -> Vec<InputError> {
    let defaults = Scenario::default().to_table();
    let unused = |entry: &&Entry| {
        let of_loops = entry.table == "controller" && entry.key.name != "minimum_pulse_s";
        of_loops && !same(value(&defaults, &entry.table, entry.key.name), Some(&entry.value))
    };
    let of = |entries: &Entries| {
        let warning = |entry: &Entry| {
            let why = "not used: a joint has [joint.controller]; of [controller] it uses minimum_pulse_s alone";
            no_sense(document, entries, entry, why.to_owned())
        };
        entries.iter().filter(unused).map(warning).collect::<Vec<_>>()
    };
    let mut all = of(&document.plant);
    all.extend(of(&document.believed));
    all
}

/// Presets that keys contradict, each with these keys, which take precedence.
fn contradicted(document: &Document) -> Vec<InputError> {
    let of = |entries: &Entries| {
        let one = |preset: &Preset| {
            let differs = preset.values.iter().filter(|(path, value)| {
                // Muscles of one type come in any length: that key contradicts nothing.
                path != "muscle.rest_length_m"
                    && entries.get(path).is_some_and(|entry| !same(Some(&entry.value), Some(value)))
            });
            let keys: Vec<String> = differs.map(|(path, _)| entries.full_path(path)).collect();
            let key = format!("{}.preset", preset.table);
            let line = entries.get(&key).and_then(|entry| entry.line);
            let problem = Problem::NoSense {
                key: entries.full_path(&key),
                value: format!("{:?}", preset.word),
                why: format!(
                    "{} of the file {} above it",
                    keys.join(", "),
                    if keys.len() == 1 { "stands" } else { "stand" }
                ),
            };
            (!keys.is_empty()).then(|| problem_at(document, line, problem))
        };
        presets_of(entries).filter_map(one).collect::<Vec<_>>()
    };
    let mut all = of(&document.plant);
    all.extend(of(&document.believed));
    all
}

/// All warnings of a valid scenario, by line.
pub fn warnings(document: &Document, loaded: &Loaded) -> Vec<InputError> {
    let scenario = &loaded.plant;
    let mut all: Vec<InputError> = unused_tables(loaded)
        .into_iter()
        .flat_map(|(table, why)| {
            [&document.plant, &document.believed].map(|entries| {
                let entry = entries.iter().find(|entry| entry.table == table)?;
                let problem = Problem::UnusedTable { table: entries.full_path(table), why };
                Some(problem_at(document, entry.line, problem))
            })
        })
        .flatten()
        .collect();
    let model = document.plant.get("plant.model").filter(|_| model_is_unused(scenario));
    all.extend(model.map(|entry| {
        let why = "a vessel has one zone in every model".to_owned();
        no_sense(document, &document.plant, entry, why)
    }));
    all.extend(unused_keys(document, loaded));
    all.extend(unused_fault_numbers(document));
    all.extend(contradicted(document));
    all.extend(unrest(loaded).into_iter().chain(unlikely(loaded)).map(|(key, value, why)| {
        let line = document.plant.get(key).and_then(|entry| entry.line);
        let problem = Problem::NoSense { key: key.to_owned(), value, why };
        problem_at(document, line, problem)
    }));
    let values = [
        ("supply.pressure_pa", scenario.supply.pressure_pa, no_supply(scenario)),
        (
            "ambient.pressure_pa",
            scenario.ambient.pressure_pa,
            vacuum(scenario, |s| s.ambient.pressure_pa),
        ),
        (
            "plant.initial_pressure_pa",
            scenario.plant.initial_pressure_pa,
            vacuum(scenario, |s| s.plant.initial_pressure_pa).or(above_supply(scenario)),
        ),
        (
            "sensor.pressure.range_pa",
            scenario.sensor.pressure.range_pa,
            short_of_pressure(scenario),
        ),
        ("sensor.length.range_m", scenario.sensor.length.range_m, short_of_length(scenario)),
    ]
    .map(|(path, value, why)| (path.to_owned(), value, why));
    let lines: BTreeMap<String, Option<u64>> =
        document.plant.iter().map(|entry| (entry.path(), entry.line)).collect();
    let windows = scenario.faults.windows().filter_map(|(path, window)| {
        let (key, value, why) = never_comes(window, scenario.run.duration_s)?;
        Some((format!("{path}.{key}"), value, Some(why)))
    });
    all.extend(values.into_iter().chain(windows).filter_map(|(key, value, why)| {
        let line = lines.get(&key).copied().flatten();
        let value = format!("{value:?}");
        Some(problem_at(document, line, Problem::NoSense { key, value, why: why? }))
    }));
    all.sort_by_key(|warning| warning.line);
    all
}

/// The key of a window whose faults never occur, and the reason.
fn never_comes(window: &FaultWindow, end_s: f64) -> Option<(&'static str, f64, String)> {
    let FaultWindow { from_s, until_s, .. } = *window;
    window.broken().next()?;
    if from_s >= end_s {
        let why = format!("not before the end of the run, run.duration_s = {end_s:?}");
        return Some(("from_s", from_s, why));
    }
    let why = "not after the start of the window: the fault never comes".to_owned();
    (from_s >= until_s && !window.board_restart).then_some(("until_s", until_s, why))
}

/// Reason why no gas enters at the start although the supply would suffice.
fn above_supply(scenario: &Scenario) -> Option<String> {
    let supply_pa = scenario.supply.pressure_pa;
    let above = scenario.plant.initial_pressure_pa > supply_pa;
    (fills(scenario) && above && no_supply(scenario).is_none()).then(|| {
        format!("above supply.pressure_pa = {supply_pa:?}: nothing flows in until it has fallen")
    })
}

/// Reason why the pressure sensor does not suit.
fn short_of_pressure(scenario: &Scenario) -> Option<String> {
    let limit_pa = pressure_limit_pa(scenario);
    let (key, pressure_pa) = [
        ("plant.initial_pressure_pa", scenario.plant.initial_pressure_pa),
        ("ambient.pressure_pa", scenario.ambient.pressure_pa),
    ]
    .into_iter()
    .find(|(_, pressure_pa)| *pressure_pa > limit_pa)?;
    Some(format!("so that the core vents above {limit_pa:?} Pa, and {key} = {pressure_pa:?}"))
}

/// Reason why the length sensor does not suit.
fn short_of_length(scenario: &Scenario) -> Option<String> {
    let rest_m = chamber::of(scenario)?.rest_length();
    let Scenario { load, drive, .. } = scenario;
    let driven = drive.kind == DriveKind::Contraction && drive.is_constant();
    let (what, length_m) = match load.kind {
        LoadKind::Isometric => ("load.length_m", load.length_m),
        _ if driven && drive.contraction < 0.0 => {
            ("the length of drive.contraction", rest_m * (1.0 - drive.contraction))
        }
        _ => ("the rest length", rest_m),
    };
    (scenario.sensor.length.range_m < length_m).then(|| format!("below {what}, {length_m:?} m"))
}

/// Reason why no gas enters although the drive should let gas in.
fn no_supply(scenario: &Scenario) -> Option<String> {
    let ambient_pa = scenario.ambient.pressure_pa;
    (fills(scenario) && scenario.supply.pressure_pa <= ambient_pa).then(|| {
        format!(
            "not above ambient.pressure_pa = {ambient_pa:?}, so that nothing is filled; pressures are \
             absolute, in Pa"
        )
    })
}

/// Reason why a pressure is probably wrong for a muscle that should move.
fn vacuum(scenario: &Scenario, pressure_pa: impl Fn(&Scenario) -> f64) -> Option<String> {
    let moves = scenario.plant.kind != PlantKind::Vessel;
    (moves && pressure_pa(scenario) < NEARLY_VACUUM_PA)
        .then(|| "nearly a vacuum; pressures are absolute, in Pa".to_owned())
}

/// A value of the file that is not used as intended.
fn no_sense(document: &Document, entries: &Entries, entry: &Entry, why: String) -> InputError {
    let key = entries.full_path(&entry.path());
    problem_at(document, entry.line, Problem::NoSense { key, value: entry.written.clone(), why })
}

fn problem_at(document: &Document, line: Option<u64>, problem: Problem) -> InputError {
    InputError { file: document.origin.clone(), line, problem: Box::new(problem) }
}
