//! Rules that tie several keys together.

use crate::core_config::pressure_limit_pa;
use thermyo_files::input::nearest;
use thermyo_plant::chamber;
use thermyo_scenario::fault_rules;
use thermyo_scenario::schema::{Limits, fittable, fittable_paths, limits};
use thermyo_scenario::violation::{Violation, within};
use thermyo_scenario::{
    DriveKind, HeatModel, LoadKind, Muscle, PlantKind, PlantModel, Scenario, Shape, Tube, ValveKind,
};
use thermyo_scenario::{number, short};

/// Largest number of steps in a run: more would take days.
const MOST_STEPS: f64 = 1.0e9;
/// Largest number of core steps per PWM period, from the range of its counter.
const MOST_PWM_STEPS: f64 = 1000.0;

/// Checks the rules for the plant, whose geometry is resolved.
pub fn check_plant(scenario: &Scenario) -> Result<(), Violation> {
    let run = &scenario.run;
    let longest = limits("run.duration_s").max.min(MOST_STEPS * run.step_s);
    let why = "one step to 1e9 steps of run.step_s";
    within("run.duration_s", run.duration_s, (run.step_s, longest), why)?;
    check_drive(scenario)?;
    check_identify(scenario)?;
    fault_rules::check(scenario)?;
    if scenario.plant.model == PlantModel::Paper {
        let ratio = scenario.gas.heat_capacity_ratio;
        let paper = &scenario.paper;
        for (path, alpha) in [
            ("paper.alpha_in", paper.alpha_in),
            ("paper.alpha_out", paper.alpha_out),
            ("paper.alpha", paper.alpha),
        ] {
            within(path, alpha, (1.0, ratio), "at most gas.heat_capacity_ratio")?;
        }
    }
    check_believed(scenario)?;
    check_start(scenario)
}

/// A chamber given by a table has no stops at the ends of its rows.
fn check_start(scenario: &Scenario) -> Result<(), Violation> {
    if scenario.plant.kind != PlantKind::Table || scenario.load.kind == LoadKind::Isometric {
        return Ok(());
    }
    let (Some(chamber), Some(start_m)) = (chamber::of(scenario), thermyo_plant::start_m(scenario))
    else {
        return Ok(());
    };
    let [shortest, longest] = chamber.range();
    if (shortest..=longest).contains(&start_m) {
        return Ok(());
    }
    let place = if start_m.is_nan() { "no length".to_owned() } else { format!("{start_m:.4} m") };
    let allowed = format!(
        "a pressure that holds the load, above ambient.pressure_pa, at a length in table.csv, {shortest} to \
         {longest} m, and this one holds it at {place}"
    );
    let pressure = format!("{:?}", scenario.plant.initial_pressure_pa);
    Err(Violation::value("plant.initial_pressure_pa", &pressure, allowed))
}

/// Pulses and the valves' stroke have to fit into a PWM period.
fn check_pulses(scenario: &Scenario) -> Result<(), Violation> {
    let period_s = scenario.pwm_period_s();
    if scenario.moves_in_full() && scenario.valve.kind == ValveKind::Switching {
        // All other plants have ideal valves.
        let slowest = limits("valve.switch_time_s").max.min(period_s);
        let why = "at most a period of valve.pwm_hz, or both valves would be open together";
        within("valve.switch_time_s", scenario.valve.switch_time_s, (0.0, slowest), why)?;
    }
    let longest = limits("controller.minimum_pulse_s").max.min(period_s);
    let why = "at most a period of valve.pwm_hz, or no pulse would be given";
    let shortest_s = short(scenario.controller.minimum_pulse_s);
    within("controller.minimum_pulse_s", shortest_s, (0.0, longest), why)
}

/// Rules for the core's configuration, which hold for the plant too.
pub fn check_believed(scenario: &Scenario) -> Result<(), Violation> {
    let slowest = 1.0 / (MOST_PWM_STEPS * scenario.run.step_s);
    let fastest = limits("valve.pwm_hz").max;
    // With a small margin: 1/(1000 step) is rounded.
    let why = "a period of at most 1000 times run.step_s";
    within("valve.pwm_hz", scenario.valve.pwm_hz, (slowest * (1.0 - 1e-12), fastest), why)?;
    check_pulses(scenario)?;
    check_line(&scenario.tube)?;
    let heat = &scenario.heat;
    let largest = limits("heat.scale")
        .max
        .min(limits("heat.inner_w_m2_k").max / heat.inner_w_m2_k)
        .min(limits("heat.inner_per_flow").max / heat.inner_per_flow);
    let why = "with which heat.inner_w_m2_k and heat.inner_per_flow stay within their limits";
    within("heat.scale", heat.scale, (limits("heat.scale").min, largest), why)?;
    let sensor = &scenario.sensor.gas;
    let highest = limits("sensor.gas.range_max_k").max;
    let why = "at least 1 K above sensor.gas.range_min_k";
    within("sensor.gas.range_max_k", sensor.range_max_k, (sensor.range_min_k + 1.0, highest), why)?;
    let chip = &scenario.sensor.max31865;
    let (lowest, highest) = (short(chip.lowest_k), short(chip.highest_k));
    let allowed = (lowest + 1.0, limits("sensor.max31865.highest_k").max);
    within(
        "sensor.max31865.highest_k",
        highest,
        allowed,
        "at least 1 K above sensor.max31865.lowest_k",
    )?;
    if scenario.plant.kind == PlantKind::Muscle {
        let Muscle { thread_length_m, rest_length_m, slack_m, .. } = scenario.muscle;
        // From braids at 2.7 deg to the steepest that still pull; the core allows slightly more.
        let ends = [0.9989, 0.579].map(|share| rest_length_m - share * thread_length_m);
        let allowed = limits("muscle.slack_m");
        let range = (ends[0].max(allowed.min), ends[1].min(allowed.max));
        let why = "by its rest length, so that a braid that pulls is left";
        within("muscle.slack_m", slack_m, range, why)?;
    }
    let Some(chamber) = chamber::of(scenario) else { return Ok(()) };
    match scenario.load.kind {
        LoadKind::Isometric => {
            let [shortest, longest] = chamber.lengths();
            let why = "between its shortest and its longest length";
            within("load.length_m", scenario.load.length_m, (shortest, longest), why)
        }
        LoadKind::Isotonic => {
            let [least, most] = chamber.loads();
            let why = "against what pressure does: positive where it pulls the ends apart";
            within("load.force_n", scenario.load.force_n, (least, most), why)
        }
        LoadKind::Mass => Ok(()),
    }
}

fn check_line(tube: &Tube) -> Result<(), Violation> {
    let [length, bore] = ["tube.length_m", "tube.diameter_m"];
    match (tube.length_m, tube.diameter_m) {
        (None, Some(_)) => Err(Violation::missing(length, bore, "tube.diameter_m needs it")),
        (Some(length_m), None) if length_m > 0.0 => {
            Err(Violation::missing(bore, length, "tube.length_m needs it"))
        }
        _ => Ok(()),
    }
}

/// Measured columns with which the plant can be compared.
pub const OBSERVABLE: [&str; 4] = ["pressure_pa", "length_m", "sensor_gas_k", "sensor_wall_k"];

fn check_identify(scenario: &Scenario) -> Result<(), Violation> {
    let identify = &scenario.identify;
    let wrong = |path, list: &[String], why| Violation::value(path, &format!("{list:?}"), why);
    let all = &identify.parameters;
    for (i, path) in all.iter().enumerate() {
        let rule = "keys of this scenario's physical numbers";
        let why = if fittable(path).is_none() {
            let paths: Vec<String> = fittable_paths().collect();
            let near = nearest(path, paths.iter().map(String::as_str));
            let hint = near.map_or_else(String::new, |near| format!("; did you mean {near}?"));
            format!("{rule}, and {path:?} is none{hint}")
        } else if let Some(why) = without_effect(scenario, path) {
            format!("{rule} that matter; {path} does not: {why}")
        } else if all[..i].contains(path) {
            format!("{rule}, each once; {path} appears twice")
        } else if number(scenario, path).is_none() {
            format!("{rule}, with values above 0 to start from; {path} has none")
        } else if number(scenario, path).is_some_and(|value| value <= 0.0) {
            format!("{rule}, with values above 0 to start from; {path} is not above 0")
        } else {
            continue;
        };
        return Err(wrong("identify.parameters", all, why));
    }
    let columns = &identify.columns;
    for (i, name) in columns.iter().enumerate() {
        let why = if !OBSERVABLE.contains(&name.as_str()) {
            format!("some of {}; {name:?} is none of them", OBSERVABLE.join(", "))
        } else if columns[..i].contains(name) {
            format!("some of {}, each once; {name} appears twice", OBSERVABLE.join(", "))
        } else {
            continue;
        };
        return Err(wrong("identify.columns", columns, why));
    }
    Ok(())
}

/// Reason why the heat transfer does not depend on a key.
fn without_effect(scenario: &Scenario, path: &str) -> Option<&'static str> {
    let constant = scenario.heat.model == HeatModel::Constant;
    match path {
        "heat.inner_w_m2_k" | "heat.inner_per_flow" if !constant => {
            Some("heat.model is not \"constant\"; \"correlation\", the default, has heat.scale")
        }
        _ => None,
    }
}

fn check_drive(scenario: &Scenario) -> Result<(), Violation> {
    let drive = &scenario.drive;
    let contraction = drive.kind == DriveKind::Contraction;
    if contraction && scenario.plant.kind == PlantKind::Vessel {
        let allowed = "another kind: a vessel does not contract".to_owned();
        return Err(Violation::value("drive.kind", "\"contraction\"", allowed));
    }
    if contraction && scenario.load.kind == LoadKind::Isometric {
        let allowed = "another kind: with load.kind = \"isometric\" nothing moves".to_owned();
        return Err(Violation::value("drive.kind", "\"contraction\"", allowed));
    }
    check_shape(scenario)?;
    match (&drive.profile_csv, drive.kind) {
        (Some(path), DriveKind::Discharge | DriveKind::Fill | DriveKind::Closed) => {
            let path_text = format!("{:?}", path.display().to_string());
            let allowed = "left out: this drive.kind has no set point".to_owned();
            Err(Violation::value("drive.profile_csv", &path_text, allowed))
        }
        (None, DriveKind::Duty) => {
            let why = "drive.kind = \"duty\" needs it";
            Err(Violation::missing("drive.profile_csv", "drive.kind", why))
        }
        (None, DriveKind::MassFlow) => {
            let longest = limits("drive.period_s").max;
            let shortest = 4.0 / scenario.valve.pwm_hz;
            let why = "at least four periods of valve.pwm_hz, two a stroke";
            within("drive.period_s", drive.period_s, (shortest, longest), why)
        }
        (None, DriveKind::Pressure | DriveKind::Contraction) if drive.shape != Shape::Constant => {
            let (allowed, why) = set_points(scenario);
            let outside = drive.extremes().into_iter().find(|value| !allowed.contains(*value));
            outside.map_or(Ok(()), |value| {
                let why = format!("{allowed} at every time, and it reaches {value}: {why}");
                Err(Violation::value("drive.amplitude", &format!("{:?}", drive.amplitude), why))
            })
        }
        (None, DriveKind::Pressure | DriveKind::Contraction) => {
            let (path, value) = if contraction {
                ("drive.contraction", drive.contraction)
            } else {
                ("drive.pressure_pa", drive.pressure_pa)
            };
            let (allowed, why) = set_points(scenario);
            within(path, value, (allowed.min, allowed.max), why)
        }
        _ => Ok(()),
    }
}

fn check_shape(scenario: &Scenario) -> Result<(), Violation> {
    let drive = &scenario.drive;
    if drive.shape == Shape::Constant {
        return Ok(());
    }
    let shape = format!("{:?}", drive.shape.word());
    if !matches!(drive.kind, DriveKind::Pressure | DriveKind::Contraction) {
        let allowed =
            "left out: only drive.kind = \"pressure\" and \"contraction\" have a shape".to_owned();
        return Err(Violation::value("drive.shape", &shape, allowed));
    }
    if drive.profile_csv.is_some() {
        let allowed = "left out: drive.profile_csv is the set point over time".to_owned();
        return Err(Violation::value("drive.shape", &shape, allowed));
    }
    if drive.amplitude == 0.0 {
        let why = "a shape needs its amplitude, in the set point's unit";
        return Err(Violation::missing("drive.amplitude", "drive.shape", why));
    }
    let (steps, why) = drive.shape.least_steps();
    let allowed = (steps * scenario.run.step_s, limits("drive.period_s").max);
    within("drive.period_s", drive.period_s, allowed, why)
}

/// Allowed set points of the drive, and the reason.
pub fn set_points(scenario: &Scenario) -> (Limits, &'static str) {
    match scenario.drive.kind {
        DriveKind::Pressure => (
            limits("drive.pressure_pa").between(scenario.ambient.pressure_pa, highest_pa(scenario)),
            "ambient.pressure_pa to supply.pressure_pa, and within sensor.pressure.range_pa",
        ),
        DriveKind::Contraction => {
            let allowed = limits("drive.contraction");
            let Some(chamber) = chamber::of(scenario) else { return (allowed, "") };
            let [shortest, longest] = chamber.lengths();
            let rest = chamber.rest_length();
            let least = allowed.min.max(1.0 - longest / rest);
            let most = allowed.max.min(1.0 - shortest / rest);
            (allowed.between(least, most), "from its longest to its shortest length")
        }
        DriveKind::MassFlow => {
            let largest = limits("drive.flow_kg_s").max;
            (limits("drive.flow_kg_s").between(-largest, largest), "negative: out")
        }
        DriveKind::Duty | DriveKind::Discharge | DriveKind::Fill | DriveKind::Closed => {
            (Limits { min: -1.0, max: 1.0, unit: "" }, "negative: outlet")
        }
    }
}

/// Highest pressure \[Pa\] that the supply gives and for which the board does not vent.
pub fn highest_pa(scenario: &Scenario) -> f64 {
    scenario.supply.pressure_pa.min(pressure_limit_pa(scenario))
}
