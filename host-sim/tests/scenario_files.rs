//! Scenario files as users write them: accepted values, and messages for all others.

use crate::command_support::{Folder, thermyo};
use model_core::Command;
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use std::fs;
use std::path::Path;
use thermyo_plant::BuildError;
use thermyo_record::trace::{COLUMNS, Row};
use thermyo_scenario::schema::{Allowed, TABLES};
use thermyo_scenario::{LoadKind, Run, Scenario};
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;
use thermyo_simulation::board::{BoardError, CoreBoard};
use thermyo_simulation::run;
use thermyo_simulation::run::RunError;

const NAME: &str = "scenario.toml";

fn parse(text: &str) -> Result<Loaded, String> {
    thermyo_setup::parse(text, Path::new(NAME)).map_err(|error| error.to_string())
}

fn valid(text: &str) -> Loaded {
    parse(text).unwrap_or_else(|message| panic!("{message}\n{text}"))
}

/// Each text is refused with its message, which begins with the line.
#[track_caller]
fn assert_messages(cases: &[(&str, &str)]) {
    for (text, message) in cases {
        let message = format!("scenario.toml:{message}");
        assert_eq!(parse(text).err(), Some(message), "{text}");
    }
}

#[test]
fn an_empty_scenario_has_the_defaults() {
    for text in ["", "\n\n# nothing\n", "\u{feff}", "[believed]\n[sensor]\n[believed.sensor.gas]"] {
        let loaded = valid(text);
        assert_eq!(loaded.plant, Scenario::default());
        assert_eq!(loaded.believed, loaded.plant);
        assert_eq!(loaded.plant.muscle.rest_length_m, 0.3);
        assert_eq!(loaded.plant.muscle.diameter_m, 0.02);
        assert_eq!(loaded.plant.muscle.braid_angle_deg, 23.0);
    }
}

#[test]
fn values_are_written_in_the_units_of_their_quantity() {
    let loaded = valid(
        "[supply]\npressure_pa = \"7 bar\"\ntemperature_k = \"25 degC\"\n[drive]\ncontraction = \"5%\"\n\
         [muscle]\nrest_length_m = \"250 mm\"\n[sensor.gas]\ntime_constant_s = \"200 ms\"\n\
         [valve]\nconductance_m3_s_pa = \"1.5 l/(s bar)\"\npwm_hz = \"0.2 kHz\"\n\
         [believed.supply]\npressure_pa = \"101.5 psi\"",
    );
    let plant = &loaded.plant;
    assert_eq!((plant.supply.pressure_pa, plant.supply.temperature_k), (7e5, 298.15));
    assert_eq!((plant.drive.contraction, plant.muscle.rest_length_m), (0.05, 0.25));
    assert_eq!((plant.sensor.gas.time_constant_s, plant.valve.pwm_hz), (0.2, 200.0));
    assert_eq!(plant.valve.conductance_m3_s_pa, 1.5e-8);
    assert_eq!(loaded.believed.supply.pressure_pa.round(), 699_818.0);
    let printed = thermyo_setup::render(&loaded);
    assert!(printed.contains("pressure_pa = 700000.0  # Pa, "), "it prints SI");
    assert_messages(&[
        (
            "[supply]\npressure_pa = \"5 kg\"",
            "2: supply.pressure_pa = \"5 kg\": must be a number from 1 to 3e6 Pa, or a text \
             with its unit: Pa, kPa, MPa, bar, mbar, psi",
        ),
        (
            "[supply]\npressure_pa = \"500000\"",
            "2: supply.pressure_pa = \"500000\": must be a number from 1 to 3e6 Pa, or a text \
             with its unit: Pa, kPa, MPa, bar, mbar, psi",
        ),
        (
            "[supply]\npressure_pa = \"50 bar\"",
            "2: supply.pressure_pa = \"50 bar\": must be a number from 1 to 3e6 Pa",
        ),
        (
            "[believed.sensor.gas]\nnoise_k = \"1 degC\"",
            "2: believed.sensor.gas.noise_k = \"1 degC\": must be a number from 0 to 100 K, \
             or a text with its unit: K",
        ),
        (
            "[muscle]\nzones = \"5 mm\"",
            "2: muscle.zones = \"5 mm\": must be a whole number from 1 to 64",
        ),
    ]);
}

#[test]
fn unknown_names_get_a_suggestion() {
    assert_messages(&[
        (
            "# c\n\n[heat]\n\n\n\niner_w_m2_k = 3",
            "7: unknown key heat.iner_w_m2_k; did you mean heat.inner_w_m2_k?",
        ),
        ("run.duration = 5", "1: unknown key run.duration; did you mean run.duration_s?"),
        ("duration_s = 5", "1: unknown key duration_s; did you mean run.duration_s?"),
        (
            "[muscle]\nforce_n = 5",
            "2: unknown key muscle.force_n; did you mean friction.force_n or load.force_n?",
        ),
        (
            "[believed.heat]\ninner = 5",
            "2: unknown key believed.heat.inner; \
             did you mean believed.heat.inner_w_m2_k?",
        ),
        ("[muscel]\nzones = 2", "1: unknown table [muscel]; did you mean [muscle]?"),
        ("[sensor.gass]\n", "1: unknown table [sensor.gass]; did you mean [sensor.gas]?"),
        (
            "[sensors.gas]\n",
            "1: unknown table [sensors]; did you mean [sensor.gas] or [sensor.wall] or \
             [sensor.pressure] or [sensor.length] or [sensor.ntc] or [sensor.max31865] or [sensor.mpr]?",
        ),
        ("[plant.supply]\n", "1: unknown table [plant.supply]; did you mean [supply]?"),
        ("[beleived.heat]\n", "1: unknown table [beleived]; did you mean [believed]?"),
        (
            "[tube]\ncolour = 1",
            "2: unknown key tube.colour; known here: volume_m3, conductance_m3_s_pa, length_m, \
             diameter_m",
        ),
        ("[estimator]\nturns = 3", "2: unknown key estimator.turns; did you mean muscle.turns?"),
        ("\"run.seed\" = 3", "1: unknown key \"run.seed\"; did you mean run.seed?"),
        (
            "[run]\nseed = 1\n[believed.muscle]\n\"a\\nb\" = 3",
            "4: unknown key believed.muscle.a\\nb; known here: preset, thread_length_m, \
             turns, rest_length_m, diameter_m, braid_angle_deg, zones, bladder_stiffness_n_m, \
             bladder_saturation_n, bladder_strain, slack_m, slip_force_n, slip_stiffness_n_m, \
             slip_pressure_factor, creep_fast_n_m, creep_fast_s, creep_slow_n_m, creep_slow_s, \
             dead_volume_m3",
        ),
    ]);
    let message = parse("[qqqq]").unwrap_err();
    assert!(
        message.starts_with("scenario.toml:1: unknown table [qqqq]; known here: [run], [gas], ")
    );
    assert!(message.ends_with(", [identify]"), "{message}");
}

#[test]
fn messages_on_wrong_values_state_the_allowed_ones() {
    assert_messages(&[
        ("[muscle]\nzones = -3", "2: muscle.zones = -3: must be a whole number from 1 to 64"),
        ("muscle = { zones = 8.0 }", "1: muscle.zones = 8.0: must be a whole number from 1 to 64"),
        (
            "[muscle]\nzones = \"eight\"",
            "2: muscle.zones = \"eight\": must be a whole number from 1 to 64",
        ),
        (
            "[run]\nduration_s = nan",
            "2: run.duration_s = nan: must be a number from 0.001 to 1e6 s",
        ),
        (
            "[run]\nduration_s = -inf",
            "2: run.duration_s = -inf: must be a number from 0.001 to 1e6 s",
        ),
        (
            "[run]\nduration_s = 1e999",
            "2: run.duration_s = 1e999: must be a number from 0.001 to 1e6 s",
        ),
        (
            "[run]\nduration_s = true",
            "2: run.duration_s = true: must be a number from 0.001 to 1e6 s",
        ),
        (
            "[run]\nseed = 99999999999999999999",
            "2: run.seed = 99999999999999999999: \
             must be a whole number from 0 to 9223372036854775807",
        ),
        (
            "[muscle]\nrest_length_m = -0.3",
            "2: muscle.rest_length_m = -0.3: must be a number from 0.005 to 10 m",
        ),
        (
            "[plant]\nmodel = \"balloon\"",
            "2: plant.model = \"balloon\": must be one of \"full\", \"lumped\", \"paper\"",
        ),
        (
            "[plant]\nmodel = \"Full\"",
            "2: plant.model = \"Full\": must be one of \"full\", \"lumped\", \"paper\"",
        ),
        (
            "[valve]\ncritical_ratio = 1.0",
            "2: valve.critical_ratio = 1.0: must be a number from 0.01 to 0.99",
        ),
        (
            "[valve]\nkind = \"servo\"",
            "2: valve.kind = \"servo\": must be one of \"switching\", \"proportional\"",
        ),
        (
            "[valve]\nkind = \"proportional\"\ndead_band = 1",
            "3: valve.dead_band = 1: must be a number from 0 to 0.9",
        ),
        (
            "[valve]\nkind = \"proportional\"\nbandwidth_hz = -50.0",
            "3: valve.bandwidth_hz = -50.0: must be a number from 1 to 10000 Hz",
        ),
        (
            "[believed.gas]\ngas_constant_j_kg_k = [1,\n2]",
            "2: believed.gas.gas_constant_j_kg_k = [1,\\n2]: \
             must be a number from 50 to 5000 J/(kg K)",
        ),
        ("gas = 3", "1: gas = 3: must be a table, [gas]"),
        ("sensor = \"x\"", "1: sensor = \"x\": must be a table, [sensor]"),
        ("believed = 1", "1: believed = 1: must be a table, [believed]"),
        ("[[gas]]\n", "1: gas = [[gas]]: must be a table, [gas]"),
        (
            "[vessel]\nvolume_csv = 3",
            "2: vessel.volume_csv = 3: \
             must be the path of a CSV file with the columns time_s,volume_m3",
        ),
    ]);
}

#[test]
fn the_first_mistake_of_the_file_is_named() {
    assert_messages(&[(
        "[wall]\nheat_capacity_j_k = 0\n[ambient]\npressure_pa = 0\n[sensor.gas]\nx = 1",
        "2: wall.heat_capacity_j_k = 0: must be a number from 0.01 to 1e9 J/K",
    )]);
}

#[test]
fn only_keys_of_the_core_can_be_believed() {
    let reason = "the core does not know of it, so that it cannot believe otherwise";
    for table in ["run", "plant", "drive", "faults", "paper"] {
        let message = format!("scenario.toml:2: believed.{table}: {reason}");
        assert_eq!(parse(&format!("\n[believed.{table}]\n")), Err(message));
    }
    let message = format!("scenario.toml:1: believed.vessel.volume_csv: {reason}");
    assert_eq!(parse("believed.vessel.volume_csv = 'a.csv'"), Err(message));
}

#[test]
fn broken_toml_gives_one_line() {
    for (text, line) in [
        ("[run", 1),
        ("\n\nduration_s == 3", 3),
        ("[run]\nseed = 1\nseed = 2", 3),
        ("[run]\n[gas]\n[run]", 3),
        ("a = \"\n", 1),
        ("[run]\nduration_s =", 2),
        ("[run]\nduration_s = 1,5", 2),
        ("\u{0}", 1),
    ] {
        let message = parse(text).unwrap_err();
        let start = format!("scenario.toml:{line}: not valid TOML: ");
        assert!(message.starts_with(&start), "{message}");
        assert_eq!(message.lines().count(), 1, "{message}");
    }
    let comma = parse("[muscle]\nrest_length_m = 0,3  # metres").unwrap_err();
    let expected = "scenario.toml:2: not valid TOML: 0,3: numbers need a decimal point";
    assert_eq!(comma, expected);
    for (text, bare) in [
        ("[plant]\nmodel = full", "full"),
        ("[load]\nkind = isotonic  # a weight", "isotonic"),
        ("[drive]\npressure_pa = 250 kPa", "250 kPa"),
    ] {
        let expected =
            format!("scenario.toml:2: not valid TOML: {bare}: a text needs quotes: \"{bare}\"");
        assert_eq!(parse(text), Err(expected));
    }
    let twice = parse("[valve]\npwm_hz = 1e2\npwm_hz = 1e2").unwrap_err();
    assert_eq!(twice, "scenario.toml:3: not valid TOML: duplicate key");
    let columns = parse("time_s,pressure_pa\n0,1e5\n").unwrap_err();
    let expected = "scenario.toml:1: not valid TOML: it begins as a CSV file does; a scenario has tables such as \
                    [run], and keys with values";
    assert_eq!(columns, expected);
    let joint = parse("joint = 3\n").unwrap_err();
    assert_eq!(joint, "scenario.toml:1: joint = 3: must be a table, [joint]");
}

#[test]
fn files_that_cannot_be_read_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let load = |path: &Path| thermyo_setup::load(path).unwrap_err().to_string();
    let absent = folder.path().join("absent.toml");
    assert_eq!(load(&absent), format!("{}: no such file", absent.display()));
    assert_eq!(
        load(folder.path()),
        format!("{}: is a folder; a file is needed", folder.path().display())
    );
    let latin = folder.path().join("latin1.toml");
    fs::write(&latin, b"[run]\n# \xe9t\xe9\n").unwrap();
    assert_eq!(load(&latin), format!("{}:2: is not UTF-8 text", latin.display()));
    let empty = folder.path().join("empty.toml");
    fs::write(&empty, "").unwrap();
    assert_eq!(thermyo_setup::load(&empty).unwrap(), valid(""));
}

#[test]
fn keys_have_to_fit_each_other() {
    assert_messages(&[
        (
            "[run]\nduration_s = 0.01\nstep_s = 0.02",
            "2: run.duration_s = 0.01: must be a number from 0.02 to 1e6 s, \
             one step to 1e9 steps of run.step_s",
        ),
        (
            "run.duration_s = 1e6\nrun.step_s = 1e-4",
            "1: run.duration_s = 1e6: must be a number from 1e-4 to 1e5 s, \
             one step to 1e9 steps of run.step_s",
        ),
        (
            "supply.pressure_pa = 3.1e6",
            "1: supply.pressure_pa = 3.1e6: must be a number from 1 to 3e6 Pa",
        ),
        (
            "[plant]\ninitial_pressure_pa = 1e7",
            "2: plant.initial_pressure_pa = 1e7: must be a number from 1 to 3e6 Pa",
        ),
        (
            "[faults]\nsupply_pressure_pa = 2e7",
            "2: faults.supply_pressure_pa = 2e7: must be a number from 1 to 3e6 Pa",
        ),
        (
            "[drive]\nkind = \"pressure\"\npressure_pa = 800_000",
            "3: drive.pressure_pa = 800_000: must be a number from 101325 to \
             689500 Pa, ambient.pressure_pa to supply.pressure_pa, and within sensor.pressure.range_pa",
        ),
        (
            "drive.kind = \"pressure\"\nsupply.pressure_pa = 2e5",
            "2: drive.pressure_pa = 300000.0 (not given): must be a number from \
             101325 to 2e5 Pa, ambient.pressure_pa to supply.pressure_pa, and within \
             sensor.pressure.range_pa",
        ),
        (
            "[drive]\nkind = \"contraction\"\ncontraction = 0.4",
            "3: drive.contraction = 0.4: must be a number from 0 to 0.372789, \
             from its longest to its shortest length",
        ),
        (
            "plant.kind = \"vessel\"\ndrive.kind = \"contraction\"",
            "2: drive.kind = \"contraction\": \
             must be another kind: a vessel does not contract",
        ),
        (
            "load.kind = \"isometric\"\ndrive.kind = \"contraction\"",
            "2: drive.kind = \"contraction\": \
             must be another kind: with load.kind = \"isometric\" nothing moves",
        ),
        (
            "drive.kind = \"duty\"",
            "1: drive.profile_csv is missing: drive.kind = \"duty\" needs it",
        ),
        ("tube.length_m = 4.0", "1: tube.diameter_m is missing: tube.length_m needs it"),
        // Written when "constant" was the default.
        (
            "[heat]\ninner_w_m2_k = 50",
            "2: heat.model is missing: \"constant\" goes with heat.inner_w_m2_k; \
             \"correlation\", the default, with heat.scale",
        ),
        (
            "[believed.heat]\ninner_per_flow = 7e4",
            "2: believed.heat.model is missing: \"constant\" goes with heat.inner_per_flow; \
             \"correlation\", the default, with heat.scale",
        ),
        (
            "[identify]\nparameters = [\"heat.inner_w_m2_k\"]",
            "2: identify.parameters = [\"heat.inner_w_m2_k\"]: must be keys of this \
             scenario's physical numbers that matter; heat.inner_w_m2_k does not: heat.model is not \
             \"constant\"; \"correlation\", the default, has heat.scale",
        ),
        (
            "believed.tube.diameter_m = 0.004",
            "1: believed.tube.length_m is missing: tube.diameter_m needs it",
        ),
        (
            "drive.period_s = 0.001",
            "1: drive.period_s = 0.001: must be a number from 0.04 to 86400 s, \
             at least four periods of valve.pwm_hz, two a stroke",
        ),
        (
            "drive.kind = \"pressure\"\ndrive.shape = \"sine\"\ndrive.amplitude = 1e4\ndrive.period_s = 0.001",
            "4: drive.period_s = 0.001: must be a number from 0.004 to 86400 s, at least four times run.step_s",
        ),
        (
            "drive.kind = \"pressure\"\ndrive.shape = \"chirp\"\ndrive.amplitude = 1e4\ndrive.period_s = 0.05",
            "4: drive.period_s = 0.05: must be a number from 0.064 to 86400 s, \
             at least 64 times run.step_s, of which the end takes four",
        ),
        (
            "[load]\nkind = \"isometric\"\nlength_m = 0.31",
            "3: load.length_m = 0.31: must be a number from 0.188164 to 0.3 m, \
             between its shortest and its longest length",
        ),
        (
            "[load]\nkind = \"isometric\"\n[muscle]\nrest_length_m = 0.6",
            " load.length_m = 0.26 (not given): must be a number from 0.376327 to 0.6 \
             m, between its shortest and its longest length",
        ),
        (
            "[sensor.gas]\nrange_max_k = 270",
            "2: sensor.gas.range_max_k = 270: must be a number from 271 to 1100 K, \
             at least 1 K above sensor.gas.range_min_k",
        ),
        (
            "\n[believed.sensor.gas]\nrange_max_k = 270",
            "3: believed.sensor.gas.range_max_k = 270: must be a number from 271 to \
             1100 K, at least 1 K above sensor.gas.range_min_k",
        ),
        (
            "valve.pwm_hz = 0.5\ndrive.period_s = 9.0",
            "1: valve.pwm_hz = 0.5: must be a number from 1 to 1e5 Hz, \
             a period of at most 1000 times run.step_s",
        ),
        (
            "[valve]\npwm_hz = 250\nswitch_time_s = 0.005",
            "3: valve.switch_time_s = 0.005: must be a number from 0 to 0.004 s, \
             at most a period of valve.pwm_hz, or both valves would be open together",
        ),
        (
            "plant.model = \"paper\"\npaper.alpha_in = 1.5",
            "2: paper.alpha_in = 1.5: must be a number from 1 to 1.4, \
             at most gas.heat_capacity_ratio",
        ),
    ]);
    for kind in ["discharge", "fill", "closed"] {
        for plant in ["vessel", "muscle"] {
            valid(&format!("plant.kind = \"{plant}\"\ndrive.kind = \"{kind}\""));
        }
    }
    valid("paper.alpha_in = 1.5"); // has no effect in another model
    valid("plant.model = \"lumped\"\nvalve.pwm_hz = 1000"); // the valves of this model are ideal
}

#[test]
fn geometry_comes_from_either_pair() {
    let rest =
        valid("[muscle]\nrest_length_m = 0.25\ndiameter_m = 0.03\nbraid_angle_deg = 25").plant;
    let angle = 25.0_f64.to_radians();
    let b = 0.25 / angle.cos();
    let n = b * angle.sin() / (std::f64::consts::PI * 0.03);
    assert!((rest.muscle.thread_length_m / b - 1.0).abs() < 1e-14);
    assert!((rest.muscle.turns / n - 1.0).abs() < 1e-14);

    let thread = valid(&format!("[muscle]\nthread_length_m = {b:?}\nturns = {n:?}")).plant.muscle;
    let length = b * 23.0_f64.to_radians().cos();
    assert!((thread.rest_length_m / length - 1.0).abs() < 1e-15);
    assert!((thread.braid_angle_deg - 23.0).abs() < 1e-10);

    let text = format!("[muscle]\nthread_length_m = {b:?}\nturns = {n:?}\nrest_length_m = 0.25");
    let thread = valid(&text).plant.muscle;
    assert!((thread.diameter_m - 0.03).abs() < 1e-14);
    assert!((thread.braid_angle_deg - 25.0).abs() < 1e-10);

    // Both, rounded by hand, are consistent.
    let both = "[muscle]\nthread_length_m = 0.3259\nturns = 2.027\nrest_length_m = 0.3\n\
                diameter_m = 0.02\nbraid_angle_deg = 23";
    assert_eq!(valid(both).plant.muscle.turns, 2.027);
}

#[test]
fn geometry_that_is_none_is_refused() {
    assert_messages(&[
        (
            "muscle.turns = 2",
            "1: muscle.thread_length_m is missing: muscle.turns needs it; \
             or give rest_length_m, diameter_m and braid_angle_deg instead",
        ),
        (
            "muscle.thread_length_m = 0.3",
            "1: muscle.turns is missing: muscle.thread_length_m needs it; \
             or give rest_length_m, diameter_m and braid_angle_deg instead",
        ),
        (
            "[muscle]\nthread_length_m = 0.3\nturns = 2\nrest_length_m = 0.35",
            "4: muscle.rest_length_m = 0.35: must be a number from 0.176336 to 0.299588 \
             m, thread_length_m times the cosine of a braid angle from 54 to 3 deg",
        ),
        (
            "[muscle]\nthread_length_m = 0.3259\nturns = 2.027\nrest_length_m = 0.3\ndiameter_m = 0.03",
            "5: muscle.diameter_m = 0.03: must be a number from 0.019974 to 0.0200139 \
             m, by thread_length_m, turns and rest_length_m",
        ),
        (
            "[muscle]\nrest_length_m = 0.3\ndiameter_m = 5",
            "3: muscle.diameter_m = 5: must be a number from 4.05344e-5 to 0.405343 m, \
             by its rest length and braid angle",
        ),
        (
            "[muscle]\nrest_length_m = 9.9",
            "2: muscle.rest_length_m = 9.9: must be a number from 0.00920505 to \
             9.20504 m, by its braid angle",
        ),
    ]);
}

#[test]
fn the_core_can_be_configured_with_another_geometry() {
    let believing = |believed: &str| {
        let loaded = valid(&format!("[believed.muscle]\n{believed}"));
        assert_eq!(loaded.plant, valid("").plant);
        loaded.believed.muscle
    };
    let plant = valid("").plant.muscle;
    let thicker = believing("diameter_m = 0.025");
    assert_eq!(thicker.thread_length_m, plant.thread_length_m);
    assert!((thicker.turns / plant.turns - 0.8).abs() < 1e-12);
    let more_turns = believing("turns = 2.5");
    assert_eq!(more_turns.rest_length_m, plant.rest_length_m);
    assert!((more_turns.diameter_m - 0.02 * plant.turns / 2.5).abs() < 1e-12);
    // The plant's file has diameter and angle, so these stay.
    let longer = believing("rest_length_m = 0.33");
    assert_eq!(longer.braid_angle_deg, plant.braid_angle_deg);
    assert!((longer.thread_length_m / plant.thread_length_m - 1.1).abs() < 1e-12);
    assert_eq!(believing("zones = 3").turns, plant.turns);
}

#[test]
fn believed_keys_override_the_plant() {
    let loaded = valid(
        "[heat]\nmodel = \"constant\"\ninner_w_m2_k = 50\n[supply]\ntemperature_k = 310\n\
         [believed.heat]\ninner_w_m2_k = 20\n[believed.sensor.gas]\ntime_constant_s = 2",
    );
    assert_eq!(loaded.plant.heat.inner_w_m2_k, 50.0);
    assert_eq!(loaded.plant.sensor.gas.time_constant_s, 3.0);
    let mut expected = loaded.plant.clone();
    expected.heat.inner_w_m2_k = 20.0;
    expected.sensor.gas.time_constant_s = 2.0;
    assert_eq!(loaded.believed, expected);
}

#[test]
fn sizes_that_are_not_given_fit_the_others() {
    let vessel = valid("plant.kind = \"vessel\"\nvessel.volume_m3 = 8.0").plant;
    assert!((vessel.vessel.characteristic_length_m - 2.0).abs() < 1e-15);
    let length = 8.0 / vessel.vessel.section_m2();
    assert!((vessel.sensor.length.range_m * 0.8 / length - 1.0).abs() < 1e-12);
    let muscle = valid("muscle.rest_length_m = 0.6").plant;
    assert_eq!(muscle.sensor.length.range_m, 0.6 / 0.8);
    let given = valid("[muscle]\nrest_length_m = 0.6\n[sensor.length]\nrange_m = 0.3").plant;
    assert_eq!(given.sensor.length.range_m, 0.3);
    let wide = "[muscle]\nrest_length_m = 0.7\ndiameter_m = 0.04\nbraid_angle_deg = 23\n";
    let fitted = valid(wide);
    assert!((1000.0..1300.0).contains(&fitted.plant.controller.load_limit_n), "0.15 of 7.6 kN");
    assert_eq!(fitted.believed.controller, fitted.plant.controller);
    assert_eq!(parse(&thermyo_setup::render(&fitted)), Ok(fitted));
    let given = valid(&format!("{wide}[controller]\nload_limit_n = 500\n")).plant;
    assert_eq!([given, valid("").plant].map(|s| s.controller.load_limit_n), [500.0, 300.0]);
}

/// A folder with a scenario and the CSV files beside it.
fn folder(scenario: &str, files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join(NAME), scenario).unwrap();
    for (name, text) in files {
        fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

const PISTON: &str = "[plant]\nkind = \"vessel\"\n[vessel]\nvolume_csv = \"piston.csv\"\n";
const STEPS: &str = "[drive]\nkind = \"contraction\"\nprofile_csv = \"steps.csv\"\n";

#[test]
fn profiles_lie_beside_the_scenario() {
    // Other columns are allowed, so that a measured file can be used unchanged.
    let csv = "time_s,pressure_pa,volume_m3\n0,1e5,0.02\n0.5,,0.01\n";
    let folder = folder(PISTON, &[("piston.csv", csv)]);
    let loaded = thermyo_setup::load(&folder.path().join(NAME)).unwrap();
    let profile = loaded.volume_profile.as_ref().unwrap();
    assert_eq!(profile.points(), [(0.0, 0.02), (0.5, 0.01)]);
    assert_eq!(loaded.plant.vessel.volume_csv, Some(folder.path().join("piston.csv")));
    assert_eq!(loaded.plant.vessel.characteristic_length_m, 0.02_f64.cbrt());
    // The scenario printed by `check` works from another folder.
    assert_eq!(parse(&thermyo_setup::render(&loaded)), Ok(loaded));
}

#[test]
fn a_print_names_the_model_of_an_unused_coefficient() {
    let loaded = valid("[believed.heat]\nmodel = \"correlation\"\ninner_per_flow = 0.0");
    assert_eq!(parse(&thermyo_setup::render(&loaded)), Ok(loaded));
}

#[test]
fn broken_profiles_are_named_by_file_line_and_column() {
    for (scenario, file, csv, message) in [
        (
            PISTON,
            "piston.csv",
            "time_s,volume_m3\n0,0.02\n0,0.01\n",
            "piston.csv:3: column time_s = 0.0: must be above 0.0, the time of the row before",
        ),
        (
            PISTON,
            "piston.csv",
            "time_s,volume_m3\n0,0.02\n\n1,-0.01\n",
            "piston.csv:4: column volume_m3 = -0.01: must be a number from 1e-9 to 1e6 m3",
        ),
        (
            PISTON,
            "piston.csv",
            "time_s,volume_m3\n0,\n",
            "piston.csv:2: column volume_m3 = (empty): must be a number",
        ),
        (
            STEPS,
            "steps.csv",
            "time_s,value\n0,0.1\n1,0.5\n",
            "steps.csv:3: column value = 0.5: must be a number from 0 to 0.372789, \
             from its longest to its shortest length",
        ),
        (
            STEPS,
            "steps.csv",
            "time_s,contraction\n0,0.1\n1,0.5\n",
            "steps.csv:3: column contraction = 0.5: must be a number from 0 to 0.372789, \
             from its longest to its shortest length",
        ),
        (
            STEPS,
            "steps.csv",
            "time_s,value\n0,inf\n",
            "steps.csv:2: column value = inf: must be a finite number",
        ),
    ] {
        let folder = folder(scenario, &[(file, csv)]);
        let found = thermyo_setup::load(&folder.path().join(NAME)).unwrap_err().to_string();
        assert_eq!(found, folder.path().join(message).display().to_string(), "{csv}");
    }
    for (csv, message) in [
        (None, "no such file"),
        (Some("time_s,volume\n0,1\n"), "column volume_m3 is missing; the file has time_s, volume"),
        (Some(""), "is empty; the first line must name the columns"),
        (Some("time_s,volume_m3\n"), "has no row below the names of the columns"),
    ] {
        let files: Vec<_> = csv.iter().map(|csv| ("piston.csv", *csv)).collect();
        let folder = folder(PISTON, &files);
        let (scenario, file) = (folder.path().join(NAME), folder.path().join("piston.csv"));
        let found = thermyo_setup::load(&scenario).unwrap_err().to_string();
        let (scenario, file) = (scenario.display(), file.display());
        assert_eq!(found, format!("{scenario}:4: vessel.volume_csv: {file}: {message}"));
    }
    let closed = "drive.kind = \"closed\"\ndrive.profile_csv = \"steps.csv\"";
    assert_messages(&[(
        closed,
        "2: drive.profile_csv = \"steps.csv\": \
         must be left out: this drive.kind has no set point",
    )]);
}

fn warned(text: &str) -> Vec<String> {
    let document = thermyo_scenario::Document::parse(text, "scenario.toml".as_ref()).unwrap();
    let loaded = thermyo_setup::assemble(&document).unwrap();
    thermyo_setup::warnings(&document, &loaded).iter().map(ToString::to_string).collect()
}

#[test]
fn implausible_values_are_reported() {
    for (text, warning) in [
        (
            "[supply]\npressure_pa = 2000",
            "2: supply.pressure_pa = 2000.0: not above ambient.pressure_pa = 101325.0, so \
             that nothing is filled; pressures are absolute, in Pa",
        ),
        (
            "[drive]\nkind = \"fill\"",
            "2: drive.kind = \"fill\": the inlet stays open: the gas goes on to supply.pressure_pa = 700000.0, and \
             above 689500 Pa, by sensor.pressure.range_pa, the core vents with the fault \"overpressure\", unless the \
             run ends before",
        ),
        (
            "[muscle]\nzones = 3\n[plant]\nkind = \"vessel\"",
            "2: [muscle] is not used: plant.kind is another one",
        ),
        (
            "[plant]\nkind = \"vessel\"\n[believed.load]\nforce_n = 3",
            "4: [believed.load] is not used: plant.kind = \"vessel\"",
        ),
        (
            "[plant]\nkind = \"vessel\"\nmodel = \"full\"",
            "3: plant.model = \"full\": a vessel has one zone in every model",
        ),
        (
            "[valve]\npwm_hz = 5\n[drive]\nkind = \"pressure\"",
            "2: valve.pwm_hz = 5.0: the loops act once in 200 ms: steps overshoot by a tenth and more, \
             and settle late; from 30 Hz on by less",
        ),
        (
            "[leak]\nconductance_m3_s_pa = 3e-9\n[drive]\nkind = \"pressure\"\npressure_pa = 2.5e5",
            "2: leak.conductance_m3_s_pa = 3e-9: in a period of valve.pwm_hz it moves the pressure by \
             9944 Pa, and the loop rests within 3000 Pa, controller.pressure_dead_zone_pa to either side: the loop \
             may never come to rest",
        ),
        (
            "[load]\nmass_kg = 50.3\n[drive]\nkind = \"contraction\"\ncontraction = 0.1",
            "2: load.mass_kg = 50.3: it flies 11 mm past a goal that it comes to at \
             controller.contraction_rate_per_s, since only load.force_n brakes it, and may swing on; a lower rate \
             lets it stop",
        ),
        (
            "[tube]\nlength_m = 3\ndiameter_m = 0.006\n[drive]\nkind = \"pressure\"",
            "2: tube.length_m = 3.0: with valve.dead_time_s its flow comes 9.7 ms late, and the loops \
             compensate 8.0 ms, a period of valve.pwm_hz less the valve's stroke: steps overshoot, and a pressure may \
             swing on",
        ),
        (
            "[tube]\nlength_m = 2\ndiameter_m = 0.006\n[drive]\nkind = \"pressure\"",
            "2: tube.length_m = 2.0: the line's gas swings at 47 Hz, near a half of valve.pwm_hz = 100.0, and \
             a bore of 6.0 mm damps it little: a held pressure may swing on at 50 Hz; a bore of 3 mm, or another length, \
             lets it rest",
        ),
        (
            "[tube]\nlength_m = 10\ndiameter_m = 0.002",
            "3: tube.diameter_m = 0.002: 10 m of it pass 0.65 g/s by friction, below a quarter of the 3.30 \
             g/s that the core expects of valve.conductance_m3_s_pa, so that it takes the inlet for shut and vents with \
             the fault \"no inflow\"",
        ),
        (
            "[tube]\nlength_m = 10\ndiameter_m = 0.02",
            "3: tube.diameter_m = 0.02: 10 m of it have 3142 cm3 beside the 99 cm3 of the chamber, and keep \
             more than nine tenths of what flows in, so that it takes the inlet for shut and vents with the fault \
             \"no inflow\"",
        ),
        ("[vessel]\nvolume_m3 = 0.1", "2: [vessel] is not used: plant.kind is another one"),
        (
            "[plant]\nmodel = \"lumped\"\n[heat]\nmodel = \"constant\"\n[tube]\nvolume_m3 = 1e-5\n",
            "6: [tube] is not used: plant.model is not \"full\"",
        ),
        (
            "[tube]\nlength_m = 0\ndiameter_m = 0.004",
            "3: tube.diameter_m = 0.004: not used: tube.length_m is 0",
        ),
        (
            "[drive]\npressure_pa = 4e5",
            "2: drive.pressure_pa = 4e5: not used: drive.kind is not \"pressure\"",
        ),
        (
            "[drive]\nkind = \"contraction\"\nperiod_s = 2",
            "3: drive.period_s = 2: not used: drive.kind is not \"mass-flow\"",
        ),
        (
            "[load]\nkind = \"mass\"\nforce_n = 30",
            "3: load.force_n = 30: not used: load.kind is not \"isotonic\"",
        ),
        (
            "[plant]\nmodel = \"lumped\"\n[load]\nmass_kg = 3",
            "4: load.mass_kg = 3: not used: load.kind is not \"mass\", and plant.model is not \
             \"full\"",
        ),
        (
            "[believed.heat]\nmodel = \"adiabatic\"\ninner_w_m2_k = 30",
            "3: believed.heat.inner_w_m2_k = 30: not used: heat.model is not \"constant\"",
        ),
        (
            "[plant]\nmodel = \"lumped\"\n[muscle]\nzones = 3",
            "4: muscle.zones = 3: not used: plant.model is not \"full\", or it is a vessel",
        ),
        (
            "[valve]\ndead_band = 0.1",
            "2: valve.dead_band = 0.1: not used: valve.kind is not \"proportional\"",
        ),
        (
            "[believed.valve]\nbandwidth_hz = 20",
            "2: believed.valve.bandwidth_hz = 20: not used: valve.kind is not \"proportional\"",
        ),
        (
            "[valve]\nkind = \"proportional\"\nswitch_time_s = 0.001",
            "3: valve.switch_time_s = 0.001: not used: valve.kind is not \"switching\"",
        ),
        (
            "[plant]\nmodel = \"lumped\"\n[valve]\nkind = \"proportional\"",
            "4: valve.kind = \"proportional\": not used: plant.model is not \"full\", or it is a \
             vessel: its valves are ideal",
        ),
        (
            "[ambient]\npressure_pa = 1.013",
            "2: ambient.pressure_pa = 1.013: nearly a vacuum; pressures are absolute, in Pa",
        ),
        (
            "[plant]\ninitial_pressure_pa = 1.2",
            "2: plant.initial_pressure_pa = 1.2: nearly a vacuum; pressures are absolute, in Pa",
        ),
        (
            "[plant]\ninitial_pressure_pa = 4e5\n[supply]\npressure_pa = 3e5",
            "2: plant.initial_pressure_pa = 400000.0: above supply.pressure_pa = 300000.0: nothing \
             flows in until it has fallen",
        ),
        (
            "[sensor.pressure]\nrange_pa = 1e5",
            "2: sensor.pressure.range_pa = 100000.0: so that the core vents above 98500.0 Pa, \
             and plant.initial_pressure_pa = 120000.0",
        ),
        (
            "[plant]\nkind = \"vessel\"\ninitial_pressure_pa = 8e5\n[drive]\nkind = \"discharge\"",
            " sensor.pressure.range_pa = 700000.0: so that the core vents above 689500.0 Pa, and \
             plant.initial_pressure_pa = 800000.0",
        ),
        (
            "[sensor.length]\nrange_m = 0.1",
            "2: sensor.length.range_m = 0.1: below the rest length, 0.3 m",
        ),
        (
            "[run]\nduration_s = 6\n[faults]\npressure = \"open\"\nfrom_s = 9\nuntil_s = 10",
            "5: faults.from_s = 9.0: not before the end of the run, run.duration_s = 6.0",
        ),
        (
            "[run]\nduration_s = 6\n[faults.late]\nemergency_stop = true\nfrom_s = 6\nuntil_s = 10",
            "5: faults.late.from_s = 6.0: not before the end of the run, run.duration_s = 6.0",
        ),
        (
            "[faults]\npressure = \"open\"\nfrom_s = 2\nuntil_s = 2",
            "4: faults.until_s = 2.0: not after the start of the window: the fault never comes",
        ),
        (
            "[faults]\noutlet_leak = 0.1",
            "2: faults.outlet_leak = 0.1: not used: faults.outlet is not \"leaking\"",
        ),
        (
            "[faults.hot]\ngas = \"noisy\"\ngas_drift_k_s = 0.1",
            "3: faults.hot.gas_drift_k_s = 0.1: not used: faults.hot.gas is not \"drifting\"",
        ),
        (
            "[sensor.gas]\nkind = \"ntc\"\nrange_max_k = 350",
            "3: sensor.gas.range_max_k = 350: not used: sensor.gas.kind is not \"pt1000\"",
        ),
        (
            "[sensor.ntc]\nresistance_ohm = 5000",
            "2: [sensor.ntc] is not used: sensor.gas.kind is not \"ntc\"",
        ),
        (
            "[sensor.max31865]\nreference_ohm = 4000",
            "2: [sensor.max31865] is not used: sensor.gas.kind is not \"max31865\"",
        ),
        (
            "[believed.sensor.mpr]\ntimeout_s = 0.1",
            "2: [believed.sensor.mpr] is not used: sensor.pressure.kind is not \"mpr\"",
        ),
        (
            "[drive]\nkind = \"closed\"\n[controller]\nlength_gain = 0.5",
            "4: [controller] is not used: with this drive.kind nothing is controlled",
        ),
    ] {
        assert_eq!(warned(text), [format!("scenario.toml:{warning}")], "{text}");
        // The printed scenario has the same warnings, and no others.
        let printed = warned(&thermyo_setup::render(&valid(text)));
        assert!(printed.len() <= 1, "{text}: {printed:?}");
    }
}

#[test]
fn no_warning_without_reason() {
    for text in [
        "",
        "[plant]\nkind = \"vessel\"",
        "[drive]\nkind = \"discharge\"\n[supply]\npressure_pa = 1e5",
        "[plant]\nmodel = \"lumped\"\n[muscle]\nzones = 8",
        "[plant]\nkind = \"vessel\"\ninitial_pressure_pa = 10",
        "[supply]\npressure_pa = 3e5\n[plant]\ninitial_pressure_pa = 3e5",
        "[sensor.length]\nrange_m = 0.3",
        "[run]\nduration_s = 6\n[faults]\nfrom_s = 9\nuntil_s = 10",
        "[run]\nduration_s = 6\n[faults]\npressure = \"open\"\nfrom_s = 5.9\nuntil_s = 10",
        "[believed.sensor.gas]\nkind = \"ntc\"\n[sensor.ntc]\nbeta_k = 3900",
        "[drive]\nkind = \"pressure\"\n[controller]\nlength_gain = 0.5",
    ] {
        assert_eq!(warned(text), [""; 0]);
        assert_eq!(warned(&thermyo_setup::render(&valid(text))), [""; 0]);
    }
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios");
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let is_joint = thermyo_joint::load(&path).unwrap().is_some();
        if !is_joint && path.extension().is_some_and(|extension| extension == "toml") {
            let (_, warnings) = thermyo_setup::load_with_warnings(&path).unwrap();
            assert!(warnings.is_empty(), "{warnings:?}");
        }
    }
}

#[test]
fn the_print_explains_every_key() {
    let text = thermyo_setup::render(&valid("[believed.heat]\nouter_w_m2_k = 5"));
    for line in [
        "duration_s = 100.0  # s, 0.001 to 1e6: simulated time",
        "zones = 8  # 1 to 64: axial zones of gas and wall (full)",
        "model = \"full\"  # \"full\" | \"lumped\" | \"paper\": zones, wall layers and real valves; one zone; the paper's eq. (12)",
        "conductance_m3_s_pa = 4e-9  # m3/(s Pa), 1e-13 to 0.001: sonic conductance C at ANR (ISO 6358)",
        "critical_ratio = 0.3  # 0.01 to 0.99: critical pressure ratio b",
        "# volume_csv = \"FILE.csv\"  # CSV file, time_s,volume_m3: volume over time, of a moving piston",
    ] {
        assert!(text.lines().any(|found| found == line), "{line} is not in\n{text}");
    }
    let believed = text.split_once("\n[believed.").unwrap().1;
    assert_eq!(
        believed,
        "heat]  # what the core is configured with instead\n\
         outer_w_m2_k = 5.0  # W/(m2 K), 0 to 1e5: wall to ambient, at rest\n"
    );
}

/// Text of a key's value, anywhere in its range.
fn any_value(allowed: Allowed) -> BoxedStrategy<Option<String>> {
    match allowed {
        Allowed::Real(limits) if limits.min > 0.0 && limits.max / limits.min > 100.0 => {
            (limits.min.ln()..limits.max.ln())
                .prop_map(move |x| Some(format!("{:?}", x.exp().clamp(limits.min, limits.max))))
                .boxed()
        }
        Allowed::Real(limits) => {
            (limits.min..=limits.max).prop_map(|x| Some(format!("{x:?}"))).boxed()
        }
        Allowed::Whole { min, max } => (min..=max).prop_map(|x| Some(x.to_string())).boxed(),
        Allowed::Choice(words) => {
            proptest::sample::select(words).prop_map(|word| Some(format!("{word:?}"))).boxed()
        }
        Allowed::Switch => proptest::bool::ANY.prop_map(|on| Some(on.to_string())).boxed(),
        Allowed::List => {
            let lists = vec!["[]", "[\"heat.scale\"]", "[\"pressure_pa\"]", "[\"a\\nb\"]"];
            proptest::sample::select(lists).prop_map(|list| Some(list.to_owned())).boxed()
        }
        Allowed::Csv { .. } => Just(None).boxed(),
    }
}

/// A scenario with some keys anywhere in their ranges; others keep their defaults.
fn any_scenario(share: f64) -> impl Strategy<Value = String> {
    let keys: Vec<_> = ["", "believed."]
        .into_iter()
        .flat_map(|prefix| {
            TABLES.iter().filter(move |table| prefix.is_empty() || table.believed).flat_map(
                move |table| {
                    table.keys.iter().map(move |key| {
                        let path = format!("{prefix}{}.{}", table.name, key.name);
                        proptest::option::weighted(share, any_value(key.allowed)).prop_map(
                            move |value| match value.flatten() {
                                Some(value) => format!("{path} = {value}\n"),
                                None => String::new(),
                            },
                        )
                    })
                },
            )
        })
        .collect();
    keys.prop_map(|lines| lines.concat())
}

fn one_line(message: &str) -> bool {
    message.starts_with("scenario.toml:") && !message.contains(char::is_control)
}

/// Multiple of the usual number of cases.
fn cases(times: f64) -> ProptestConfig {
    let usual = ProptestConfig::default();
    ProptestConfig { cases: (times * f64::from(usual.cases)) as u32, ..usual }
}

proptest! {
    #![proptest_config(cases(2.0))]

    #[test]
    fn the_print_reads_back_to_the_bit(text in any_scenario(0.03)) {
        match parse(&text) {
            Ok(loaded) => {
                let printed = thermyo_setup::render(&loaded);
                let again = parse(&printed);
                prop_assert_eq!(again.as_ref(), Ok(&loaded), "{}", printed);
                // Equal numbers may differ in the sign of zero; equal texts may not.
                prop_assert_eq!(thermyo_setup::render(&again.unwrap()), printed);
                // The core accepts every scenario that passes here.
                prop_assert_eq!(core_config(&loaded.believed).check(), Ok(()));
                let working = loaded.plant.load.kind != LoadKind::Isometric
                    || loaded.plant.load.length_m <= loaded.plant.muscle.rest_length_m;
                prop_assert!(working);
            }
            Err(message) => prop_assert!(one_line(&message), "{}", message),
        }
    }

    #[test]
    fn a_damaged_scenario_never_panics(
        at in 0.0..1.0_f64,
        length in 0_usize..6,
        inserted in "[\\[\\]=.\"'{}#\n a-z0-9-]{0,5}|\\PC{0,3}",
    ) {
        let mut text = thermyo_setup::render(&valid("[believed.heat]\nscale = 0.7"));
        let boundary = |text: &str, mut at: usize| {
            while !text.is_char_boundary(at) {
                at += 1;
            }
            at
        };
        let start = boundary(&text, (at * text.len() as f64) as usize);
        let end = boundary(&text, (start + length).min(text.len()));
        text.replace_range(start..end, &inserted);
        if let Err(message) = parse(&text) {
            prop_assert!(one_line(&message), "{}", message);
        }
    }

    #[test]
    fn no_bytes_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        let text = String::from_utf8_lossy(&bytes);
        if let Err(message) = parse(&text) {
            prop_assert!(one_line(&message), "{:?}", message);
        }
    }
}

proptest! {
    #![proptest_config(cases(0.25))]

    /// Core and plant: finite figures, or an error.
    #[test]
    fn an_odd_scenario_runs_or_gives_a_reason(text in any_scenario(0.03)) {
        let Ok(mut loaded) = parse(&text) else { return Ok(()) };
        for scenario in [&mut loaded.plant, &mut loaded.believed] {
            scenario.run = Run { duration_s: 0.2, log_every: 1, ..Run::default() };
        }
        let mut odd = Vec::new();
        let ended = run::run(&loaded, &mut CoreBoard::default(), None, &mut |row: &Row| {
            let cells = COLUMNS.iter().zip(row.cells());
            odd.extend(cells.filter(|(_, cell)| !cell.is_finite()).map(|(name, _)| *name));
            let Command { inlet, outlet } = row.telemetry.command;
            odd.extend((inlet.share() > 0.0 && outlet.share() > 0.0).then_some("both valves open"));
            Ok(())
        });
        prop_assert!(odd.is_empty(), "{:?}", odd);
        match ended {
            Ok(_)
            | Err(
                RunError::Diverged(_)
                | RunError::Build(BuildError::TooFast { .. })
                // The believed parameters may allow less than the plant's.
                | RunError::Board(BoardError::SetPoint(_)),
            ) => {}
            Err(error) => prop_assert!(false, "{}", error),
        }
    }
}

#[test]
fn the_core_takes_every_key_at_its_limits() {
    let (mut taken, mut tried) = (0, 0);
    for table in TABLES {
        for key in table.keys {
            let limits = match key.allowed {
                Allowed::Real(limits) => [format!("{:?}", limits.min), format!("{:?}", limits.max)],
                Allowed::Whole { min, max } => [min.to_string(), max.to_string()],
                Allowed::Choice(_) | Allowed::Switch | Allowed::List | Allowed::Csv { .. } => {
                    continue;
                }
            };
            for (limit, kind) in
                limits.iter().flat_map(|limit| ["muscle", "vessel"].map(|kind| (limit, kind)))
            {
                let text =
                    format!("{}.{} = {limit}\nplant.kind = \"{kind}\"\n", table.name, key.name);
                tried += 1;
                match parse(&text) {
                    Ok(loaded) => {
                        assert_eq!(core_config(&loaded.believed).check(), Ok(()), "{text}");
                        taken += 1;
                    }
                    Err(message) => {
                        // Only a rule with another key may forbid the value, not the key's own
                        // range.
                        assert!(message.contains(", ") || message.contains("missing"), "{message}");
                    }
                }
            }
        }
    }
    // Ends of duration, diameter, thread length and the like contradict the other defaults.
    assert!(taken * 10 > tried * 8 && taken < tried, "{taken} of {tried}");
}

/// An experiment has its own duration.
#[test]
fn a_late_fault_is_no_warning_of_an_experiment() {
    let folder = Folder::new();
    let text =
        "[run]\nduration_s = 6\n[faults.late]\nemergency_stop = true\nfrom_s = 9\nuntil_s = 10\n";
    let file = folder.file("late.toml", text);
    for experiment in ["tune", "measure stop"] {
        let words = experiment.split(' ').chain([file.as_str(), "--max-pressure", "9e6"]);
        thermyo(&words.collect::<Vec<_>>()).refused("--max-pressure: ").in_one_line();
    }
}

#[test]
fn most_random_scenarios_are_valid() {
    // The round trip above would prove nothing if hardly any scenario passed.
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let valid = (0..200)
        .filter(|_| {
            let text = any_scenario(0.03).new_tree(&mut runner).unwrap().current();
            parse(&text).is_ok()
        })
        .count();
    assert!((60..200).contains(&valid), "{valid} of 200");
}
