//! The `thermyo` binary, tried wrong on purpose: one clear line, the right exit code, nothing left.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn thermyo(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_thermyo")).args(arguments).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

fn scenario(folder: &Path, text: &str) -> String {
    let path = folder.join("scenario.toml");
    fs::write(&path, text).unwrap();
    path.display().to_string()
}

#[test]
fn bad_input_is_one_line_and_exit_code_2() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let missing = folder.path().join("missing.toml").display().to_string();
    let unknown = scenario(folder.path(), "[heat]\niner_w_m2_k = 3.0\n");
    for (arguments, expected) in [
        (vec!["run", &missing], "missing.toml: no such file"),
        (vec!["run", &unknown], "scenario.toml:2: unknown key heat.iner_w_m2_k"),
        (vec!["check", &unknown], "did you mean heat.inner_w_m2_k"),
        (
            vec!["run", &unknown, "--board", "toaster"],
            "must be core, emulated, serial:PORT or a PORT",
        ),
        (vec!["replay", &missing], "missing.toml: no such file"),
        (vec!["replay", env!("CARGO_MANIFEST_DIR")], "is a folder; a file is needed"),
        (vec!["tune", &missing], "missing.toml: no such file"),
        (vec!["tune", &unknown, "--max-pressure", "nan"], "must be an absolute pressure"),
        (vec!["evaluate", "tune"], "--out goes with `evaluate control` and `evaluate faults` only"),
    ] {
        let mut all = arguments.clone();
        let place = out.display().to_string();
        if ["run", "tune", "evaluate"].contains(&arguments[0]) {
            all.extend(["--out", &place]);
        }
        let output = thermyo(&all);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", said(&output));
        assert!(said(&output).contains(expected), "{arguments:?}: {}", said(&output));
        assert!(output.stdout.is_empty());
        assert!(!out.exists(), "{arguments:?} left something");
    }
}

#[test]
fn a_port_that_is_not_there_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let file = scenario(folder.path(), "");
    let output = thermyo(&["run", &file, "--board", "serial:/dev/no-such-port"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(said(&output).contains("/dev/no-such-port"), "{}", said(&output));
}

#[test]
fn an_output_folder_that_cannot_be_written_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let file = scenario(folder.path(), "[run]\nduration_s = 0.1\n");
    let taken = folder.path().join("taken");
    fs::write(&taken, "a file").unwrap();
    let output = thermyo(&["run", &file, "--out", &taken.display().to_string()]);
    assert_eq!(output.status.code(), Some(2));
    assert!(said(&output).contains("taken") && said(&output).lines().count() == 1);
    assert_eq!(fs::read_to_string(&taken).unwrap(), "a file");
}

/// A limit on the size of files stands for a disk that is full.
#[cfg(unix)]
#[test]
fn a_full_disk_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let file = scenario(folder.path(), "[run]\nduration_s = 20.0\n[plant]\nmodel = \"lumped\"\n");
    let out = folder.path().join("out");
    let output = Command::new("bash")
        .arg("-c")
        .arg("trap '' XFSZ; ulimit -f 100; exec \"$0\" run \"$1\" --out \"$2\"")
        .arg(env!("CARGO_BIN_EXE_thermyo"))
        .args([&file, &out.display().to_string()])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains("trace.csv: cannot be written"), "{}", said(&output));
    assert!(!out.exists(), "half a result is left");
}

#[test]
fn a_run_that_would_not_end_does_not_begin() {
    let folder = tempfile::tempdir().unwrap();
    for (text, message) in [
        (
            "[plant]\nmodel = \"full\"\n[tube]\nvolume_m3 = 1e-9\n[valve]\nconductance_m3_s_pa = 1e-6\n",
            "tube.volume_m3 is too small for the conductances of valve and tube: it asks for integration steps of ",
        ),
        (
            "[plant]\nmodel = \"full\"\n[friction]\nviscous_n_s_m = 1e6\npresliding_stiffness_n_m = 1e9\n[load]\nmass_kg = 0.01\n",
            "load.mass_kg is too small for the stiffness and viscosity of friction: it asks",
        ),
        (
            "[plant]\nmodel = \"lumped\"\n[valve]\nconductance_m3_s_pa = 1e-3\n",
            "valve.conductance_m3_s_pa is too large for the gas's volume: it asks",
        ),
    ] {
        let file = scenario(folder.path(), text);
        let out = folder.path().join("out");
        let output = thermyo(&["run", &file, "--out", &out.display().to_string()]);
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
        assert!(said(&output).contains(message), "{}", said(&output));
        assert!(said(&output).contains(" s, at least 1e-7 s are taken"), "{}", said(&output));
        assert!(!out.exists(), "half a result is left");
    }
}

#[test]
fn a_diverging_plant_stops_with_time_and_state() {
    let folder = tempfile::tempdir().unwrap();
    // A vessel whose piston squeezes the gas to a thousandth: the temperature leaves every range.
    fs::write(folder.path().join("piston.csv"), "time_s,volume_m3\n0,0.001\n1,0.000001\n").unwrap();
    let file = scenario(
        folder.path(),
        "[run]\nduration_s = 1.0\n[plant]\nkind = \"vessel\"\n[vessel]\nvolume_csv = \"piston.csv\"\n\
         [heat]\nmodel = \"adiabatic\"\n[drive]\nkind = \"closed\"\n",
    );
    let out = folder.path().join("out");
    let output = thermyo(&["run", &file, "--out", &out.display().to_string()]);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(said(&output).contains("the plant diverged at 0.9"), "{}", said(&output));
    assert!(said(&output).contains("temperature ="), "{}", said(&output));
    assert!(said(&output).contains("a step before"), "{}", said(&output));
    assert!(!out.exists(), "half a result is left");
}
