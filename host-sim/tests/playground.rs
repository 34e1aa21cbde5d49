//! `thermyo playground`: its module under Node, compared bit by bit; its page in headless Chromium.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use crate::browser_support::Chromium;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn thermyo() -> Command {
    Command::new(env!("CARGO_BIN_EXE_thermyo"))
}

/// The page, written once.
fn playground() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("playground");
        let _ = fs::remove_dir_all(&folder);
        let output =
            thermyo().args(["playground", "--json", "--out"]).arg(&folder).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let said: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let sizes = fs::read_dir(&folder).unwrap().map(|file| file.unwrap().metadata().unwrap());
        let bytes: u64 = sizes.map(|file| file.len()).sum();
        assert_eq!(said["bytes"], bytes);
        assert!((100_000..2_100_000).contains(&bytes), "{bytes} bytes");
        folder
    })
}

/// The trace of `thermyo run`, of one muscle or of a joint.
fn command(scenario: &Path) -> Vec<u8> {
    let out = tempfile::tempdir().unwrap();
    let output =
        thermyo().args(["run", "--quiet"]).arg(scenario).arg("--out").arg(out.path()).output();
    let output = output.unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let trace = out.path().join("trace.csv");
    fs::read(&trace)
        .unwrap_or_else(|_| fs::read(trace.with_file_name(thermyo_joint::trace::FILE)).unwrap())
}

/// Trace and messages of the module.
fn module(scenario: &Path) -> Result<Vec<u8>, String> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/browser/playground_trace.mjs");
    let output = Command::new("node").arg(script).arg(playground()).arg(scenario).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    if output.status.success() { Ok(output.stdout) } else { Err(said) }
}

fn assert_same(what: &str, a: &[u8], b: &[u8]) {
    let lines = |bytes: &[u8]| String::from_utf8_lossy(bytes).lines().count();
    assert!(lines(a) > 100, "{what}: {} rows", lines(a));
    let differs = a.split(|byte| *byte == b'\n').zip(b.split(|byte| *byte == b'\n'));
    let first = differs.enumerate().find(|(_, (a, b))| a != b).map(|(i, _)| i + 1);
    assert!(a == b, "{what}: line {first:?} of {} and {}", lines(a), lines(b));
}

#[test]
fn its_trace_is_that_of_the_command_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let mut cases: Vec<PathBuf> = ["nominal", "contraction", "reproduce", "joint", "joint_board"]
        .map(|name| repository().join("scenarios").join(name).with_extension("toml"))
        .into();
    // All functions of f64 whose rounding depends on the platform.
    for (name, text) in [
        (
            "correlation",
            "[run]\nduration_s = 20\n[heat]\nmodel = \"correlation\"\n[sensor.gas]\ndensity_exponent = 0.5\n",
        ),
        ("paper", "[run]\nduration_s = 20\n[plant]\nmodel = \"paper\"\n"),
        (
            "vessel",
            "[run]\nduration_s = 20\n[plant]\nkind = \"vessel\"\ninitial_pressure_pa = 600000\n[drive]\nkind = \"discharge\"\n",
        ),
        (
            "faults",
            "[run]\nduration_s = 10\nlog_every = 1\n[drive]\nkind = \"pressure\"\npressure_pa = 250000\n[muscle]\nbladder_saturation_n = 20\nbladder_strain = 0.05\n[faults]\nfrom_s = 5\nleak_conductance_m3_s_pa = 1e-11\n",
        ),
        (
            "joint_faults",
            "[run]\nduration_s = 4\nlog_every = 1\n[plant]\nmodel = \"lumped\"\n[heat]\nmodel = \"correlation\"\n[joint]\ngravity_n_m = 2\n[joint.b.muscle]\nbladder_stiffness_n_m = 700\n[joint.a.faults]\nfrom_s = 3\nlength = \"open\"\n[drive]\nshape = \"step\"\namplitude_rad = \"20 deg\"\nload_n_m = 0.5\n",
        ),
    ] {
        let file = folder.path().join(name).with_extension("toml");
        fs::write(&file, text).unwrap();
        cases.push(file);
    }
    for scenario in cases {
        let name = scenario.display().to_string();
        assert_same(&name, &module(&scenario).unwrap(), &command(&scenario));
    }
}

#[test]
fn an_invalid_scenario_gives_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("wrong.toml");
    for (text, expected) in [
        (
            "[supply]\npressure_pa = 7\npressure = 7e5\n",
            "Error: scenario.toml:3: unknown key supply.pressure; did you mean supply.pressure_pa?\n",
        ),
        (
            "[joint]\nradius = 0.02\n",
            "Error: scenario.toml:2: unknown key joint.radius; did you mean joint.radius_m?\n",
        ),
        (
            "[joint]\nradius_csv = \"radius.csv\"\n",
            "Error: scenario.toml:2: joint.radius_csv: this page takes no CSV file: leave the key out",
        ),
        (
            "[joint]\n[drive]\nload_csv = \"load.csv\"\n",
            "Error: scenario.toml:3: drive.load_csv: this page takes no CSV file: leave the key out",
        ),
    ] {
        fs::write(&file, text).unwrap();
        let said = module(&file).unwrap_err();
        assert!(said.contains(expected), "{said}");
    }
}

#[test]
fn its_own_page_is_replaced_and_no_other() {
    let out = tempfile::tempdir().unwrap();
    let page = out.path().join("index.html");
    let write =
        || thermyo().args(["playground", "--quiet", "--out"]).arg(out.path()).output().unwrap();
    let names = || fs::read_dir(out.path()).unwrap().count();
    fs::write(&page, "mine").unwrap();
    // The refusal comes before the module is built, which takes minutes in a checkout: here it could not be built.
    let refused = thermyo()
        .args(["playground", "--quiet", "--out"])
        .arg(out.path())
        .env("PATH", "")
        .env("CARGO", "/nowhere/cargo")
        .output()
        .unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("index.html: not of a playground"));
    assert_eq!((names(), fs::read(&page).unwrap()), (1, b"mine".to_vec()));

    fs::remove_file(&page).unwrap();
    assert!(write().status.success());
    let files = names();
    fs::write(&page, "an older one").unwrap();
    // The served folder contains no other files.
    assert!(write().status.success());
    assert_eq!(names(), files);
    assert_ne!(fs::read(&page).unwrap(), b"an older one");
}

#[test]
fn it_warns_of_implausible_values_and_refuses_files() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("arm.toml");
    let script =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/browser/playground_warnings.mjs");
    let said = |text: &str| {
        fs::write(&file, text).unwrap();
        let output =
            Command::new("node").arg(&script).arg(playground()).arg(&file).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    assert_eq!(said("[run]\nduration_s = 5\n"), "");
    let supply = said("[supply]\npressure_pa = 7\n");
    assert!(supply.starts_with("arm.toml:2: supply.pressure_pa = 7"), "{supply}");
    let vessel =
        said("[plant]\nkind = \"vessel\"\n[muscle]\nzones = 4\n[drive]\nkind = \"closed\"\n");
    assert!(vessel.starts_with("arm.toml:4: [muscle] is not used"), "{vessel}");
    fs::write(&file, "[drive]\nprofile_csv = \"p.csv\"\n").unwrap();
    let refused = module(&file).unwrap_err();
    assert!(
        refused.contains("scenario.toml:2: drive.profile_csv: this page takes no CSV file"),
        "{refused}"
    );
}

/// The arm follows, even with gravity that is not in the core's configuration; saved files are those of `thermyo run`.
fn assert_the_joint_moves(seen: &serde_json::Value) {
    let joint = &seen["joint"];
    let number = |name: &str| joint[name].as_f64().unwrap_or_else(|| panic!("{name}: {seen:#}"));
    assert!((0.05..0.8).contains(&number("error_deg")), "{seen:#}");
    // While it is held, the plant's stiffness is 0.2 to 0.4 N m/rad below the set point.
    assert!((number("stiffness") - 20.0).abs() < 1.0, "{seen:#}");
    assert!((number("held_deg") - 10.0).abs() < 1.0, "{seen:#}");
    let refused = joint["refused"][0].as_str().unwrap();
    assert!(refused.contains("stays between the stops"), "{seen:#}");
    assert_eq!(joint["refused"][1], 0, "{seen:#}");
    assert_eq!(joint["again"][0], "", "{seen:#}");
    assert!(
        joint["again"][1].as_str().unwrap().starts_with("The scenario of this page"),
        "{seen:#}"
    );
    let stopped = serde_json::json!(["the plant diverged at 3 s. Start again.", ""]);
    assert_eq!(joint["stopped"], stopped, "{seen:#}");
    assert_eq!(joint["narrow_px"], 390, "{seen:#}");
    assert_eq!(joint["nameless"], 0, "{seen:#}");
    assert_eq!(joint["views"], serde_json::json!(["joint"]), "{seen:#}");
    let saved = |name: &str| PathBuf::from(joint[name].as_str().unwrap());
    let expected = command(&repository().join("scenarios/joint.toml"));
    assert_same("the saved scenario", &command(&saved("scenario")), &expected);
    assert_same("the saved trace", &fs::read(saved("trace")).unwrap(), &expected);
    let turned = fs::read_to_string(saved("turned")).unwrap();
    let believed = turned.split("[believed.joint]").nth(1).expect("it has its own gravity");
    assert!(believed.contains("\ngravity_n_m = 4.9"), "{turned}");
    assert!(turned.contains("\ngravity_n_m = 3.0"), "{turned}");
    command(&saved("turned"));
    fs::remove_dir_all(saved("trace").parent().unwrap()).unwrap();
}

fn assert_the_tour_shows_what_it_says(seen: &serde_json::Value) {
    let error_k = |step: usize| seen["tour"][step]["error_k"].as_f64().unwrap();
    assert!(error_k(1) > 2.0 * error_k(0) && error_k(1) > 2.0 * error_k(2), "{seen:#}");
    assert!((0.01..1.0).contains(&error_k(3)), "{seen:#}");
    let address = seen["tour"][1]["address"].as_str().unwrap();
    assert_eq!(address, "#run=a+working+cycle&heat.scale=3&core=before");
    let elsewhere = &seen["elsewhere"];
    assert_eq!(elsewhere["address"], seen["tour"][4]["address"], "{seen:#}");
    assert_eq!(elsewhere["knobs"], elsewhere["here"], "{seen:#}");
    assert!(elsewhere["knobs"].as_str().unwrap().contains("400 kPa"), "{seen:#}");
    let plot = serde_json::json!([
        "pressure-absolute.csv",
        "data:text/csv;charset=utf-8,\"Time [s]\",\"Pressure, absolute, simulated [kPa]\",\"Pressure, absolute, set point [kPa]\""
    ]);
    assert_eq!(seen["saved_plot"], plot, "{seen:#}");
}

#[test]
fn the_page_runs_and_is_turned() {
    let Some(chromium) = Chromium::find() else { return };
    let seen = chromium.look("playground.mjs", playground().as_os_str(), "playground", &[]);
    println!("{seen:#}");
    assert_eq!(seen["problems"], serde_json::json!([]), "{seen:#}");
    let number = |name: &str| seen[name].as_f64().unwrap_or_else(|| panic!("{name}: {seen:#}"));
    assert!((number("held_kpa") - 250.0).abs() < 5.0, "{seen:#}");
    assert!((number("followed_kpa") - 400.0).abs() < 5.0, "{seen:#}");
    assert_eq!(seen["changed"], true);
    assert_eq!(seen["unconfigured"], true);
    assert_eq!(seen["mode"].as_str(), Some("mass flow"));
    assert_ne!(seen["hovered"], seen["not_hovered"]);
    assert_eq!(seen["narrow_px"], 390, "{seen:#}");
    assert_eq!(seen["nameless"], 0, "{seen:#}");
    assert_eq!(seen["serious"], serde_json::json!([]), "{seen:#}");
    assert_the_tour_shows_what_it_says(&seen);
    assert_the_joint_moves(&seen);
    let refused = seen["refused"].as_str().unwrap();
    assert!(refused.starts_with("wrong.toml:2: supply.pressure_pa = -1"), "{refused}");
    let refused = &seen["elsewhere"]["refused"];
    assert!(refused[0].as_str().unwrap().contains("supply.pressure_pa = -1"), "{seen:#}");
    assert_eq!(refused[1], 0, "{seen:#}");
    // `thermyo run` accepts a saved scenario and gives the same trace.
    let saved = |name: &str| PathBuf::from(seen["shipped"][name].as_str().unwrap());
    let expected = command(&repository().join("scenarios/nominal.toml"));
    assert_same("the saved scenario", &command(&saved("scenario")), &expected);
    assert_same("the saved trace", &fs::read(saved("trace")).unwrap(), &expected);
    fs::remove_dir_all(saved("trace").parent().unwrap()).unwrap();
}
