//! `thermyo measure stop`, simulated: the true temperature is in its record.

use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn thermyo(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_thermyo")).args(arguments).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn summary(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", said(output)))
}

/// Measures on a scenario, and returns its summary.
fn measured(folder: &Path, scenario: &str, more: &[&str]) -> (Output, Value) {
    let file = folder.join("given.toml").display().to_string();
    fs::write(&file, scenario).unwrap();
    let out = folder.join("out").display().to_string();
    let arguments =
        [&["measure", "stop", &file, "--out", &out, "--json", "--quiet"], more].concat();
    let output = thermyo(&arguments);
    let summary = summary(&output);
    (output, summary)
}

const FULL: &str = "[plant]\nmodel = \"full\"\n[heat]\nmodel = \"constant\"\ninner_w_m2_k = 11.0\n\
    [identify]\nparameters = [\"heat.inner_w_m2_k\", \"sensor.gas.time_constant_s\"]\n";

#[test]
fn a_muscle_shows_its_gas_temperature_and_its_heat_transfer() {
    let folder = tempfile::tempdir().unwrap();
    let (output, summary) = measured(folder.path(), FULL, &["--stops", "5"]);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    assert_eq!(summary["usable"], 5);
    let plant_k = summary["rms_k"]["plant"].as_f64().unwrap();
    let bare_k = summary["rms_k"]["sensor_gas"].as_f64().unwrap();
    assert!(plant_k < 0.4 && bare_k > 10.0, "{plant_k} K, bare {bare_k} K");
    for stop in summary["stops"].as_array().unwrap() {
        let of = |name: &str| stop[name].as_f64().unwrap();
        let error_k = of("gas_k") - of("truth_k");
        assert!(error_k.abs() < 3.0 * of("gas_sd_k"), "{stop}");
        assert!((0.1..1.0).contains(&of("gas_sd_k")), "{stop}");
    }
    let still = summary["heat"]["still_w_m2_k"]["value"].as_f64().unwrap();
    assert!((9.9..12.1).contains(&still), "{still} W/(m2 K)");
    identified_and_judged(folder.path());
}

/// The record of a measurement is one for `identify` and `evaluate` too.
fn identified_and_judged(folder: &Path) {
    let [file, trace, out] =
        ["given.toml", "out/trace.csv", "fit"].map(|name| folder.join(name).display().to_string());
    let output =
        thermyo(&["identify", &trace, "--config", &file, "--out", &out, "--json", "--quiet"]);
    let found = summary(&output);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let value = |name: &str| found["parameters"][name]["value"].as_f64().unwrap();
    assert!((9.9..12.1).contains(&value("heat.inner_w_m2_k")), "{found}");
    assert!((2.7..3.3).contains(&value("sensor.gas.time_constant_s")), "{found}");
    let identified = fs::read_to_string(folder.join("fit/identified.toml")).unwrap();
    assert!(identified.contains("[believed"), "the core's values differ");
    let recording = folder.join("out").display().to_string();
    let output =
        thermyo(&["evaluate", "estimator", "--recording", &recording, "--json", "--quiet"]);
    assert!(String::from_utf8_lossy(&output.stdout).contains("bare_k"), "{}", said(&output));
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
}

#[test]
fn stops_that_cannot_be_used_are_named_and_end_with_exit_code_1() {
    let folder = tempfile::tempdir().unwrap();
    let leaky = format!("{FULL}[leak]\nconductance_m3_s_pa = 5e-11\n");
    let (output, summary) = measured(folder.path(), &leaky, &["--stops", "3"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("a leak: the muscle lost"), "{}", said(&output));
    assert_eq!(summary["usable"], 0);
    let (output, _) = measured(folder.path(), FULL, &["--stops", "3", "--wait", "6"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("the wait of 6 s was too short"), "{}", said(&output));
}

#[test]
fn what_cannot_be_measured_is_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let vessel = folder.path().join("vessel.toml").display().to_string();
    fs::write(&vessel, "[plant]\nkind = \"vessel\"\n[drive]\nkind = \"closed\"\n").unwrap();
    let out = folder.path().join("out");
    for (arguments, expected) in [
        (vec![vessel.as_str()], "a stop is measured on a chamber with a length sensor"),
        (vec!["nothing.toml"], "nothing.toml: no such file"),
        (vec![&vessel, "--stops", "2"], "must be a whole number from 3 to 100"),
        (vec![&vessel, "--wait", "1"], "must be a time from 6 to 3600 s"),
        (vec![&vessel, "--period", "0"], "must be a time from 0.5 to 120 s"),
        (vec!["scenarios/nominal.toml", "--max-pressure", "3"], "use 3bar"),
        (
            vec!["scenarios/nominal.toml", "--max-pressure", "1e9"],
            "--max-pressure: a highest pressure",
        ),
        (vec!["scenarios/nominal.toml", "--max-pressure", "120000"], "warms the gas too little"),
    ] {
        let place = out.display().to_string();
        let arguments = [&["measure", "stop"], &arguments[..], &["--out", &place]].concat();
        let output = thermyo(&arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", said(&output));
        assert!(said(&output).contains(expected), "{arguments:?}: {}", said(&output));
        assert!(!out.exists(), "{arguments:?} left something");
    }
}
