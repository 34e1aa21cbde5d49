//! `thermyo identify`: finds the parameters behind a trace, states their errors, and refuses unusable input.
//!
//! More seeds: `THERMYO_IDENTIFY_SEEDS=20 cargo test -p system-tests identify`. The measured cases
//! need `THERMYO_DATA`, the folder with `gas_spring` and `hyddown`; without it they are skipped.

use thermyo_record::board_trace::Recorder;
use thermyo_record::trace::Row;
use thermyo_simulation::board::CoreBoard;

use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
use serde_json::Value;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::{env, fs};
use system_tests::{Outcome, repository, run_text, thermyo};
use tempfile::TempDir;
use thermyo_setup::core_config::core_config;
use thermyo_simulation::run;

/// A short cycle of the lumped muscle; the default values are the true ones.
const CYCLE: &str = "[run]\nduration_s = 15.0\nseed = 1\n[plant]\nmodel = \"lumped\"\n\
    [heat]\nmodel = \"constant\"\n";
/// Initial beliefs, wrong by up to 50 %.
const WRONG: &str = "[plant]\nmodel = \"lumped\"\n\
    [heat]\nmodel = \"constant\"\ninner_w_m2_k = 120.0\n\
    [wall]\nheat_capacity_j_k = 45.0\n\
    [muscle]\ndead_volume_m3 = 8.0e-6\n\
    [friction]\nforce_n = 20.0\n\
    [sensor.gas]\ntime_constant_s = 2.2\n";
/// Keys and their true values.
const TRUTH: [(&str, f64); 5] = [
    ("heat.inner_w_m2_k", 90.0),
    ("wall.heat_capacity_j_k", 65.0),
    ("muscle.dead_volume_m3", 5.0e-6),
    ("friction.force_n", 15.0),
    ("sensor.gas.time_constant_s", 3.0),
];

/// One identification: its outcome, its folder, and `summary.json` if it was written.
struct Identified {
    outcome: Outcome,
    folder: TempDir,
    summary: Value,
}

fn identify(data: &Path, config: &Path) -> Identified {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let [data, config, out] = [data, config, folder.path()].map(|path| path.display().to_string());
    let outcome = thermyo(&["identify", &data, "--config", &config, "--out", &out, "--quiet"]);
    let summary = fs::read_to_string(folder.path().join("summary.json"));
    let summary = summary.map_or(Value::Null, |text| serde_json::from_str(&text).expect("JSON"));
    Identified { outcome, folder, summary }
}

fn identify_texts(data: &str, config: &str) -> Identified {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let [data_file, config_file] = ["data.csv", "config.toml"].map(|name| folder.path().join(name));
    fs::write(&data_file, data).expect("written");
    fs::write(&config_file, config).expect("written");
    identify(&data_file, &config_file)
}

fn asking_for(config: &str, parameters: &[&str]) -> String {
    format!("{config}[identify]\nstarts = 3\nparameters = {parameters:?}\n")
}

impl Identified {
    fn figure(&self, path: &[&str]) -> f64 {
        let value = path.iter().fold(&self.summary, |value, key| &value[*key]);
        value.as_f64().unwrap_or_else(|| panic!("{path:?} is no number in {}", self.summary))
    }

    fn parameter(&self, path: &str) -> (f64, f64) {
        let of = |key: &str| self.figure(&["parameters", path, key]);
        (of("value"), of("standard_error"))
    }
}

/// A trace as a board would record it: the sensors' noise on every reading.
fn recorded(trace: &str, seed: u64) -> String {
    // As in the scenario's defaults, averaged over the eight conversions of a code.
    let noises = [("pressure_pa", 150.0), ("length_m", 2.0e-5), ("sensor_gas_k", 0.05)];
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut lines = trace.lines();
    let names: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let at = |name: &str| names.iter().position(|known| *known == name).expect("the column");
    let inputs = ["time_s", "flow_in_kg_s", "flow_out_kg_s"].map(at);
    let outputs = noises.map(|(name, noise)| (at(name), noise / 8.0_f64.sqrt()));
    // The true values are read, so that the noise of the run's own seed does not repeat in every trace.
    let truth = at("sensor_gas_k");
    let mut text =
        "time_s,flow_in_kg_s,flow_out_kg_s,pressure_pa,length_m,sensor_gas_k\n".to_owned();
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        text += &inputs.map(|i| cells[i]).join(",");
        for (i, deviation) in outputs {
            let value: f64 = cells[i].parse().expect("a number");
            let normal: f64 = StandardNormal.sample(&mut random);
            let noise = if i == truth { 0.0 } else { deviation * normal };
            write!(text, ",{:?}", value + noise).expect("a string takes it");
        }
        text.push('\n');
    }
    text
}

#[test]
fn true_values_lie_within_three_standard_errors() {
    let seeds: u64 = env::var("THERMYO_IDENTIFY_SEEDS").map_or(3, |n| n.parse().expect("a number"));
    let config = asking_for(WRONG, &TRUTH.map(|(path, _)| path));
    let mut squares = Vec::new();
    let mut missed = 0;
    for seed in 1..=seeds {
        let trace = run_text(&CYCLE.replace("seed = 1", &format!("seed = {seed}")), &[]);
        let found = identify_texts(&recorded(&trace.text("trace.csv"), seed), &config);
        assert_eq!(found.outcome.code, 0, "{}{}", found.outcome.out, found.outcome.err);
        let deviations = TRUTH.map(|(path, truth)| {
            let (value, error) = found.parameter(path);
            // Certain enough to be of use.
            assert!(error < 0.1 * value, "{path}: {value} ± {error}");
            (value - truth) / error
        });
        println!("seed {seed}: in standard errors {deviations:.2?}");
        missed += u64::from(deviations.iter().any(|z| z.abs() > 3.0));
        squares.extend(deviations.map(|z| z * z));
    }
    assert!(missed * 20 <= seeds, "{missed} of {seeds} seeds missed");
    // Standard errors that are far too wide would pass the above.
    let mean_square = squares.iter().sum::<f64>() / squares.len() as f64;
    assert!((0.2..2.5).contains(&mean_square), "mean square deviation {mean_square}");
}

#[test]
fn the_result_runs_and_the_report_shows_it() {
    let trace = run_text(CYCLE, &[]);
    let config = asking_for(WRONG, &TRUTH.map(|(path, _)| path));
    let found = identify_texts(&trace.text("trace.csv"), &config);
    assert_eq!(found.outcome.code, 0, "{}", found.outcome.err);
    assert_eq!(found.summary["converged"], Value::Bool(true));
    assert_eq!(found.summary["parameters"]["wall.heat_capacity_j_k"]["unit"], "J/K");
    // 0.05 K over the root of eight conversions.
    let rmse = found.figure(&["rmse", "temperature_k"]);
    assert!((0.015..0.020).contains(&rmse), "{rmse}");
    let own = found.figure(&["correlations", "friction.force_n", "friction.force_n"]);
    assert!((own - 1.0).abs() < 1e-12);

    let file = found.folder.path().join("identified.toml").display().to_string();
    let checked = thermyo(&["check", &file]);
    assert_eq!(checked.code, 0, "{}", checked.err);
    let (value, _) = found.parameter("heat.inner_w_m2_k");
    assert!(checked.out.contains(&format!("inner_w_m2_k = {value:?} ")));
    let page = fs::read_to_string(found.folder.path().join("report.html")).expect("a page");
    for part in ["Residuals", "Correlations", "wall.heat_capacity_j_k", "Fit over data"] {
        assert!(page.contains(part), "{part}");
    }
    let plot = fs::read_to_string(found.folder.path().join("fit.svg")).expect("a drawing");
    for part in ["<svg", "Pressure [kPa]", "Sensor in the gas, fitted less measured [K]"] {
        assert!(plot.contains(part), "{part}");
    }
}

/// A table of columns, the first of which is the time, starting at a given time.
fn csv<const N: usize>(header: &str, columns: [Vec<f64>; N], from_s: f64) -> String {
    let rows = (0..columns[0].len()).filter(|i| columns[0][*i] >= from_s);
    let row = |i: usize| columns.each_ref().map(|column| column[i].to_string()).join(",") + "\n";
    header.to_owned() + &rows.map(row).collect::<String>()
}

/// A shut muscle that leaks, as recorded by a monitor; and the scenario that requests the leak, configured five times
/// too large.
fn held(seconds: f64, leak_m3_s_pa: f64) -> Identified {
    let hold = format!(
        "[run]\nduration_s = {seconds:?}\nlog_every = 100\n\
         [plant]\nmodel = \"lumped\"\ninitial_pressure_pa = 400e3\n\
         [load]\nkind = \"isometric\"\nlength_m = 0.27\n[drive]\nkind = \"closed\"\n[leak]\n"
    );
    let run = run_text(&format!("{hold}conductance_m3_s_pa = {leak_m3_s_pa:?}\n"), &[]);
    let columns = ["time_s", "measured_pressure_pa", "sensor_gas_k"];
    let text = csv("time_s,pressure_pa,sensor_gas_k\n", columns.map(|name| run.column(name)), 0.0);
    let configured = format!("{hold}conductance_m3_s_pa = 1e-11\n");
    identify_texts(&text, &asking_for(&configured, &["leak.conductance_m3_s_pa"]))
}

/// Searches end with residuals of the size of their tolerance, while the start itself has none.
#[test]
fn searches_of_a_record_without_noise_agree() {
    let text = "run = { duration_s = 20 }\nplant.initial_pressure_pa = 4e5\nplant.model = \"lumped\"\n\
         drive.kind = \"closed\"\nleak.conductance_m3_s_pa = 2e-12\n[identify]\nstarts = 3\n\
         columns = [\"pressure_pa\"]\nparameters = [\"leak.conductance_m3_s_pa\"]\n";
    let run = run_text(text, &[]);
    let columns = ["time_s", "pressure_pa"].map(|name| run.column(name));
    let found = identify_texts(&csv("time_s,pressure_pa\n", columns, 0.0), text);
    assert_eq!(found.outcome.code, 0, "{}{}", found.outcome.out, found.outcome.err);
}

#[test]
fn a_hold_identifies_the_leak_or_reports_that_it_cannot() {
    let found = held(20.0, 2.0e-12);
    assert_eq!(found.outcome.code, 0, "{}{}", found.outcome.out, found.outcome.err);
    let (value, error) = found.parameter("leak.conductance_m3_s_pa");
    println!("leak {value:.4e} ± {error:.1e} m3/(s Pa)");
    assert!(error > 0.0 && error < 0.01 * value, "{value} ± {error}");
    assert!((value - 2.0e-12).abs() < 4.0 * error, "{value} ± {error}");
    assert!(!found.outcome.out.contains("not determined"), "{}", found.outcome.out);
    // Two seconds lose 9 Pa, in readings with a noise of 53 Pa.
    let found = held(2.0, 2.0e-14);
    assert_eq!(found.outcome.code, 1, "{}", found.outcome.out);
    assert_eq!(found.summary["converged"], Value::Bool(false));
    let expected = "the data leave leak.conductance_m3_s_pa open";
    assert!(found.outcome.err.contains(expected), "{}", found.outcome.err);
    let (out, value) =
        (&found.outcome.out, &found.summary["parameters"]["leak.conductance_m3_s_pa"]);
    let open = value["standard_error"].is_null() && out.contains("do not determine it");
    assert!(open || out.contains("is not determined"), "{out}");
}

/// A muscle's record as a board's monitor writes it, starting at a given time: 100 rows per second, its sensors' own
/// noise and codes, no flow.
fn monitored(model: &str, from_s: f64) -> String {
    let cycle = "[run]\nduration_s = 60.0\nlog_every = 10\n[plant]\nmodel = ";
    let run = run_text(&format!("{cycle}{model:?}\n[heat]\nmodel = \"constant\"\n"), &[]);
    let columns = [
        "time_s",
        "measured_pressure_pa",
        "measured_length_m",
        "sensor_gas_k",
        "duty_in",
        "duty_out",
    ];
    let header = "time_s,pressure_pa,length_m,sensor_gas_k,duty_in,duty_out\n";
    csv(header, columns.map(|name| run.column(name)), from_s)
}

/// The core's believed values of a muscle, wrong by up to 50 %.
fn configured(model: &str) -> String {
    format!(
        "[plant]\nmodel = {model:?}\n\
         [heat]\nmodel = \"constant\"\ninner_w_m2_k = 120.0\ninner_per_flow = 7e4\n\
         [wall]\nheat_capacity_j_k = 45.0\n\
         [sensor.gas]\ntime_constant_s = 2.2\n\
         [identify]\nstarts = 3\ncolumns = [\"sensor_gas_k\"]\nparameters = [\"heat.inner_w_m2_k\", \
         \"heat.inner_per_flow\", \"wall.heat_capacity_j_k\", \"sensor.gas.time_constant_s\"]\n"
    )
}

#[test]
fn pressure_and_length_drive_where_only_the_sensor_is_compared() {
    // From rest, and from the middle of a stroke.
    for from_s in [0.0, 21.7] {
        let found = identify_texts(&monitored("lumped", from_s), &configured("lumped"));
        assert_eq!(found.outcome.code, 0, "{}{}", found.outcome.out, found.outcome.err);
        for (path, truth, certain) in [
            ("heat.inner_w_m2_k", 90.0, 0.01),
            // Six times as uncertain as for a muscle without slip and creep.
            ("heat.inner_per_flow", 1e5, 0.05),
            ("wall.heat_capacity_j_k", 65.0, 0.03),
            ("sensor.gas.time_constant_s", 3.0, 0.002),
        ] {
            let (value, error) = found.parameter(path);
            println!("record from {from_s} s: {path} {value} ± {error}, true {truth}");
            assert!(error < certain * value, "{path}: {value} ± {error}");
            // For a muscle that creeps and never rests on its stop, the record leaves a combination of three parameters
            // open, along which small errors of the model act.
            assert!((value - truth).abs() < 6.0 * error, "{path}: {value} ± {error}");
        }
        let rmse = found.figure(&["rmse", "temperature_k"]);
        assert!((0.016..0.020).contains(&rmse), "{rmse}");
    }
}

/// Housing and location of the sensor appear as heat transfer and lag.
#[test]
fn motion_alone_leaves_the_heat_transfer_of_a_muscle_in_zones_open() {
    let found = identify_texts(&monitored("full", 0.0), &configured("full"));
    assert_eq!(found.outcome.code, 1, "{}{}", found.outcome.out, found.outcome.err);
    assert_eq!(found.summary["converged"], Value::Bool(false));
}

/// Pulses in every third period, and one row in five periods: most pulses are between the rows, and 26 W/(m2 K) were
/// found where 15 are true, with an error of 2.
#[test]
fn a_record_that_misses_pulses_is_refused() {
    let columns = ["time_s", "pressure_pa", "length_m", "sensor_gas_k", "duty_in", "duty_out"];
    let recorded = |log_every: u32| {
        let slow = format!(
            "[run]\nduration_s = 60.0\nlog_every = {log_every}\n[plant]\nmodel = \"lumped\"\n\
             [load]\nkind = \"isometric\"\n[drive]\nperiod_s = 7.0\nflow_kg_s = 1.2e-4\n\
             [heat]\nmodel = \"constant\"\n"
        );
        let run = run_text(&slow, &[]);
        csv(&(columns.join(",") + "\n"), columns.map(|name| run.column(name)), 0.0)
    };
    let config =
        configured("lumped").replace("[identify]", "[load]\nkind = \"isometric\"\n[identify]");
    let found = identify_texts(&recorded(50), &config);
    let Outcome { code, err, .. } = &found.outcome;
    assert_eq!(*code, 2, "{err}");
    let expected = "column time_s: rows are 0.0500 s apart, and pulses between them are missing: \
                    must be at most 0.0100 s";
    assert!(err.contains(expected), "{err}");
    assert_eq!(identify_texts(&recorded(10), &config).outcome.code, 0);
}

#[test]
fn a_record_with_holes_or_of_something_else_is_remarked() {
    let record = monitored("lumped", 0.0);
    let whole = identify_texts(&record, &configured("lumped"));
    assert!(!whole.outcome.out.contains("holes"), "{}", whole.outcome.out);
    assert!(!whole.outcome.out.contains("is missed by"), "{}", whole.outcome.out);

    let time_s = |line: &str| line.split(',').next().and_then(|cell| cell.parse::<f64>().ok());
    let kept = |line: &&str| time_s(line).is_none_or(|time_s| !(20.005..35.0).contains(&time_s));
    let holed: String = record.lines().filter(kept).map(|line| line.to_owned() + "\n").collect();
    let found = identify_texts(&holed, &configured("lumped"));
    let out = &found.outcome.out;
    assert!(out.contains("The record has holes, from 20.00 to 35.00 s: "), "{out}");
    assert!(out.contains("sensor_gas_k is missed by "), "{out}");
}

/// The board restarted in the middle, and had run for two minutes before the monitor started.
#[test]
fn a_monitors_record_of_a_board_that_restarted_is_taken() {
    let cycle = "[run]\nduration_s = 60.0\nlog_every = 10\n[plant]\nmodel = \"lumped\"\n\
                 [heat]\nmodel = \"constant\"\n";
    let loaded = thermyo_setup::parse(cycle, "cycle.toml".as_ref()).expect("a scenario");
    let config = core_config(&loaded.believed);
    let mut recorder = Recorder::new(Vec::new()).expect("memory takes it");
    let mut observer = |row: &Row| {
        let mut telemetry = row.telemetry;
        telemetry.step = telemetry.step.checked_sub(30_000).unwrap_or(telemetry.step + 120_000);
        recorder.write(&config, None, &telemetry).map(drop)
    };
    run::run(&loaded, &mut CoreBoard::default(), None, &mut observer).expect("it runs");
    let record = String::from_utf8(recorder.finish().expect("memory takes it")).expect("text");
    let found = identify_texts(&record, &configured("lumped"));
    assert_eq!(found.outcome.code, 0, "{}{}", found.outcome.out, found.outcome.err);
    for (path, truth, certain) in
        [("heat.inner_w_m2_k", 90.0, 0.01), ("sensor.gas.time_constant_s", 3.0, 0.002)]
    {
        let (value, error) = found.parameter(path);
        println!("{path} {value} ± {error}, true {truth}");
        assert!(error < certain * value, "{path}: {value} ± {error}");
        assert!((value - truth).abs() < 6.0 * error, "{path}: {value} ± {error}");
    }
}

/// A cooling vessel: pressure only, no valve.
const COOLING: &str = "[plant]\nkind = \"vessel\"\ninitial_temperature_k = 350.0\n\
    initial_pressure_pa = 500000.0\n[sensor.gas]\nrange_max_k = 360.0\n[drive]\nkind = \"closed\"\n\
    [heat]\nmodel = \"constant\"\ninner_per_flow = 0.0\n";

fn cooling_trace() -> String {
    let trace = run_text(&format!("{COOLING}[run]\nduration_s = 60.0\nlog_every = 100\n"), &[]);
    let columns = ["time_s", "pressure_pa", "sensor_gas_k"];
    csv("time_s,pressure_pa,sensor_gas_k\n", columns.map(|name| trace.column(name)), 0.0)
}

#[test]
fn indistinguishable_parameters_are_reported() {
    // Heat flow is coefficient times surface: pressure shows only the product.
    let config = asking_for(COOLING, &["heat.inner_w_m2_k", "heat.scale"]);
    let found = identify_texts(&cooling_trace(), &config);
    assert_eq!(found.outcome.code, 1, "{}{}", found.outcome.out, found.outcome.err);
    assert!(found.outcome.err.contains("leave the parameters open"), "{}", found.outcome.err);
    assert_eq!(found.summary["converged"], Value::Bool(false));
    assert!(found.summary["parameters"]["heat.scale"]["standard_error"].is_null());

    // A parameter that no measurement depends on.
    let config = asking_for(COOLING, &["heat.inner_w_m2_k", "valve.conductance_m3_s_pa"]);
    let found = identify_texts(&cooling_trace(), &config);
    assert_eq!(found.outcome.code, 1, "{}", found.outcome.out);

    // Alone, the coefficient is found.
    let started = COOLING.replace("inner_per_flow", "inner_w_m2_k = 40.0\ninner_per_flow");
    let found = identify_texts(&cooling_trace(), &asking_for(&started, &["heat.inner_w_m2_k"]));
    assert_eq!(found.outcome.code, 0, "{}", found.outcome.err);
    let (value, error) = found.parameter("heat.inner_w_m2_k");
    assert!((value - 90.0).abs() < 3.0 * error && error < 3.0, "{value} ± {error}");
}

#[test]
fn a_fit_stays_where_a_scenario_may_be() {
    // Gas is taken as ideal up to 3 MPa.
    let rows: String = (0..50).map(|i| format!("{i},3.1e6\n")).collect();
    let config =
        "[plant]\nkind = \"vessel\"\ninitial_pressure_pa = 2.8e6\n[drive]\nkind = \"closed\"\n";
    let config = asking_for(config, &["plant.initial_pressure_pa"]);
    let found = identify_texts(&format!("time_s,pressure_pa\n{rows}"), &config);
    let Outcome { code, out, err } = &found.outcome;
    assert!(out.contains("plant.initial_pressure_pa went to a limit"), "{code}: {out}{err}");
    let checked =
        thermyo(&["check", &found.folder.path().join("identified.toml").display().to_string()]);
    assert_eq!(checked.code, 0, "{}", checked.err);
    assert!(
        checked.out.contains("# Pa, 1 to 3e6: absolute pressure at the start"),
        "{}",
        checked.out
    );
}

#[test]
fn bad_input_is_one_clear_message() {
    let data = "time_s,pressure_pa\n0,5e5\n1,4.9e5\n2,4.8e5\n";
    let fit = |parameters: &[&str]| asking_for(COOLING, parameters);
    let only = |column: &str| {
        fit(&["heat.inner_w_m2_k"]).replace("starts", &format!("columns = [{column:?}]\nstarts"))
    };
    let two = fit(&["heat.inner_w_m2_k", "heat.scale"]);
    let one = fit(&["heat.inner_w_m2_k"]);
    for (data, config, message) in [
        (data, COOLING.to_owned(), "config.toml: identify.parameters is missing"),
        (data, fit(&["heat.inner_w_m2"]), "did you mean heat.inner_w_m2_k?"),
        (data, fit(&["muscle.turns"]), "\"muscle.turns\" is none"),
        (data, fit(&["heat.scale", "heat.scale"]), "heat.scale appears twice"),
        (data, fit(&["heat.inner_per_flow"]), "heat.inner_per_flow is not above 0"),
        (
            data,
            fit(&["heat.inner_w_m2_k"])
                .replace("starts", "columns = [\"pressure_pa\", \"pressure_pa\"]\nstarts"),
            "pressure_pa appears twice",
        ),
        (data, only("pressure"), "\"pressure\" is none of them"),
        (data, only("sensor_gas_k"), "data.csv: column sensor_gas_k is missing, or empty"),
        (
            "time_s,pressure_pa\n0,\n1,\n",
            one.clone(),
            "column pressure_pa or length_m or sensor_gas_k",
        ),
        ("time_s,colour\n0,1\n1,2\n", one, "data.csv: unknown column colour"),
        ("time_s,pressure_pa\n0,5e5\n1,4e5\n", two, "2 measured values: must be more than the 2"),
        (data, asking_for(WRONG, &["heat.scale"]), "column duty_in is missing"),
        (
            "time_s,pressure_pa,duty_in,duty_out\n0,2e5,0,0\n1,2e5,,1\n2,2e5,0,0\n",
            asking_for(WRONG, &["heat.scale"]),
            "data.csv: column duty_out: must be filled where duty_in is",
        ),
        (
            "time_s,pressure_pa,length_m,sensor_gas_k\n0,2e5,0.29,298\n1,1e5,0.28,299\n",
            configured("full"),
            "2 measured values: must be more than the 4",
        ),
        (
            "time_s,pressure_pa,length_m,sensor_gas_k\n0,2e5,0.3,298\n1,0,0.3,299\n2,2e5,0.3,298\n",
            configured("full").replace("\"heat.inner_per_flow\", \"wall.heat_capacity_j_k\", ", ""),
            "data.csv:3: column pressure_pa = 0.0: must be absolute, and no less than 81060 Pa",
        ),
        (
            "time_s,pressure_pa,length_m,sensor_gas_k,duty_in,duty_out\n0,2e5,0.3,298,0,0\n0.1,2e5,0.3,298,0,0\n\n\
             0.1,2e5,0.3,298,0,0\n0.2,2e5,0.3,298,0,0\n0.3,2e5,0.3,298,0,0\n",
            configured("full"),
            "data.csv:5: column time_s = 0.1: must be later than the row before it, at 0.1 s",
        ),
        (
            "time_s,pressure_pa,length_m,sensor_gas_k,duty_in,duty_out\n0,2e5,0.3,298,0,0\n10,2e5,0.3,298,0,0\n\
             20,2e5,0.3,298,0,0\n30,2e5,0.3,298,0,0\n40,2e5,0.3,298,0,0\n",
            configured("full"),
            "data.csv: column time_s: rows are 10.0 s apart: must be at most 1 s where pressure and length drive a \
             muscle. Is it in seconds?",
        ),
    ] {
        let found = identify_texts(data, &config);
        let Outcome { code, err, .. } = &found.outcome;
        assert_eq!(*code, 2, "{message}: {err}");
        assert!(err.contains(message) && err.lines().count() == 1, "{message}: {err}");
        let left = fs::read_dir(found.folder.path()).expect("the folder").count();
        assert_eq!(left, 0, "{message}: something was written");
    }
}

/// A measured case, if it is available.
fn measurement(name: &str) -> Option<PathBuf> {
    let path = env::var_os("THERMYO_DATA").map(|folder| Path::new(&folder).join(name));
    let found = path.filter(|path| path.exists());
    if found.is_none() {
        println!("skipped: set THERMYO_DATA to the folder that has {name}");
    }
    found
}

#[test]
fn measured_gas_spring() {
    let Some(data) = measurement("gas_spring/upper_2022-01-28.csv") else { return };
    let found = identify(&data, &repository("scenarios/gas_spring.toml"));
    assert_eq!(found.outcome.code, 0, "{}", found.outcome.err);
    // Newton's cooling with a wall that stays cold: 3.5 kPa.
    let rmse = found.figure(&["rmse", "pressure_pa"]);
    assert!((2_600.0..2_800.0).contains(&rmse), "{rmse}");
    // 23 501 rows, few of which are independent: the model's error persists.
    let rows = found.figure(&["effective_rows", "pressure_pa"]);
    assert!((20.0..200.0).contains(&rows), "{rows}");
    let (mass, error) = found.parameter("gas_mass_kg");
    assert!((0.21..0.23).contains(&mass) && error < 0.01, "{mass} ± {error}");
}

#[test]
fn measured_air_discharge() {
    let Some(data) = measurement("hyddown/air_discharge.csv") else { return };
    let found = identify(&data, &repository("scenarios/air_discharge.toml"));
    assert_eq!(found.outcome.code, 0, "{}", found.outcome.err);
    let of = |key| found.figure(&["rmse", key]);
    let (pressure, temperature) = (of("pressure_pa"), of("temperature_k"));
    assert!((1.2..2.0).contains(&temperature), "{temperature} K");
    // The readings themselves scatter by 1.4 kPa about a smooth curve; see
    // docs/background/identification.md.
    assert!((2_000.0..3_700.0).contains(&pressure), "{pressure} Pa");
    let (coefficient, error) = found.parameter("orifice.discharge_coefficient");
    assert!((0.82..0.92).contains(&coefficient) && error < 0.02, "{coefficient} ± {error}");
}
