//! `thermyo tune`: its findings for a muscle with a wrong configuration of the core, their benefit, and its refusals.
//! Bounds are on both sides: a figure far better than possible means a broken measurement.

use thermyo_evaluate::control::sine;
use thermyo_evaluate::tune::{ALL_WRONG, configured, off, tuned};
use thermyo_simulation::board::CoreBoard;

use std::fs;
use system_tests::{Outcome, assert_within, thermyo};
use tempfile::TempDir;

#[test]
fn a_muscle_configured_wrong_is_found() {
    let loaded = configured(&thermyo_evaluate::nominal().unwrap(), ALL_WRONG.1);
    let tuned = tuned(&loaded).unwrap();
    let (plant, findings) = (&loaded.plant, &tuned.findings);
    let turns = plant.muscle.turns;
    for (path, truth, bounds) in [
        ("friction.force_n", plant.friction.force_n, (-2.0, 2.0)),
        // Twice the error as without slip and creep, like the two above and below.
        ("muscle.turns", turns, (-0.5, 0.5)),
        ("muscle.bladder_stiffness_n_m", plant.muscle.bladder_stiffness_n_m, (-3.0, 1.5)),
        // Tube and drooping regulator take 5 % of the conductance.
        ("valve.conductance_m3_s_pa", plant.valve.conductance_m3_s_pa, (-9.0, -4.0)),
        // The conductance takes 5 %, and creep between short pulses as much again.
        ("valve.switch_time_s", plant.valve.switch_time_s, (-15.0, -5.0)),
        // 1 ms, and the pressure sensor's lag of 0.5 ms.
        ("valve.dead_time_s", plant.valve.dead_time_s + 0.0005, (-5.0, 20.0)),
    ] {
        println!("{path}: {:.2} %", off(&tuned, truth, path).percent);
        assert_within(&format!("{path}, error %"), off(&tuned, truth, path).percent, bounds);
        let error = findings.value(path).unwrap().standard_error.unwrap();
        assert_within(&format!("{path}, standard error"), error / truth, (0.01, 0.4));
    }
    // The rule reproduces the gains that were found by hand.
    for (path, bounds) in [
        ("controller.pressure_loop_s", (0.0145, 0.0160)),
        ("controller.pressure_reset_s", (0.27, 0.32)),
        ("controller.load_gain_n_m_s", (3.5e4, 5.5e4)),
    ] {
        assert_within(path, findings.value(path).unwrap().after, bounds);
    }
    assert!(findings.value("friction.softening_per_k").unwrap().remark.starts_with("kept"));
    // Ramps show it barely: it is kept, or found with its error.
    let viscous = findings.value("friction.viscous_n_s_m").unwrap();
    println!("{viscous:?}, {}", plant.friction.viscous_n_s_m);
    match viscous.standard_error {
        Some(error) => {
            let off = (viscous.after - plant.friction.viscous_n_s_m).abs();
            assert!(off < 2.0 * error, "{viscous:?}");
        }
        None => assert!(viscous.remark.starts_with("kept"), "{viscous:?}"),
    }
    let rms = |loaded| sine(loaded, 0.5, 0.15, &mut CoreBoard::default()).unwrap().rms_percent;
    assert_within("error before, %", rms(&loaded), (0.25, 0.45));
    assert_within("error after, %", rms(&tuned.scenario), (0.05, 0.15));
    assert!(findings.improved);
}

/// Tunes a scenario given as text, into a folder that does not exist yet.
fn tune(text: &str, more: &[&str]) -> (Outcome, TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scenario.toml");
    fs::write(&file, text).unwrap();
    let (file, out) = (file.display().to_string(), folder.path().join("out").display().to_string());
    let mut arguments = vec!["tune", &file, "--out", &out, "--quiet"];
    arguments.extend(more);
    (thermyo(&arguments), folder)
}

#[test]
fn the_written_scenario_can_be_used() {
    let (outcome, folder) = tune("[believed.friction]\nforce_n = 10.0\n", &["--json"]);
    assert_eq!(outcome.code, 0, "{}", outcome.err);
    let summary: serde_json::Value = serde_json::from_str(&outcome.out).unwrap();
    let first = &summary["parameters"][0];
    assert_eq!((&first["path"], &first["before"]), (&"friction.force_n".into(), &10.0.into()));
    let tuned = thermyo_setup::load(&folder.path().join("out/tuned.toml")).unwrap();
    assert_eq!(Some(tuned.believed.friction.force_n), first["after"].as_f64());
    // The plant's keys are unchanged; the controller's have no true value.
    assert_eq!(tuned.plant.friction.force_n, 15.0);
    assert_eq!(tuned.plant.controller, tuned.believed.controller);
    assert!(
        fs::read_to_string(folder.path().join("out/report.html")).unwrap().contains("Hysteresis")
    );
}

#[test]
fn the_pressure_stays_below_its_limit() {
    let (outcome, _folder) = tune("", &["--json", "--max-pressure", "250000"]);
    assert_eq!(outcome.code, 0, "{}", outcome.err);
    let summary: serde_json::Value = serde_json::from_str(&outcome.out).unwrap();
    // The loop's overshoot is below 2 % of a step.
    assert_within("highest", summary["highest_pa"].as_f64().unwrap(), (2.3e5, 2.53e5));
    assert_within("duration", summary["duration_s"].as_f64().unwrap(), (20.0, 60.0));
}

#[test]
fn poor_data_is_refused_and_nothing_written() {
    let fault = |what: &str| format!("[faults]\n{what}\nfrom_s = 3.0\nuntil_s = 30.0\n");
    let weak = "[supply]\npressure_pa = 250_000.0\n[drive]\npressure_pa = 200_000.0\n";
    for (text, expected) in [
        ("[load]\nkind = \"isometric\"\n".to_owned(), "nothing moves"),
        ("[supply]\npressure_pa = 160_000.0\n".to_owned(), "and at most 136 kPa are allowed"),
        (
            format!("{weak}[believed.supply]\npressure_pa = 700_000.0\n"),
            "faults during the experiment: ",
        ),
        ("[valve]\nconductance_m3_s_pa = 4e-11\n".to_owned(), "or the valve too small"),
        (
            // A valve too large for the muscle, behind a tube that does not limit it.
            "[valve]\nconductance_m3_s_pa = 4e-8\n[tube]\nconductance_m3_s_pa = 1e-6\n".to_owned(),
            "kept the inlet open for 30 ms",
        ),
        ("[load]\nforce_n = 900.0\n[believed.load]\nforce_n = 100.0\n".to_owned(), "moved by 0."),
        (fault("length = \"frozen\""), "faults during the experiment: length sensor"),
        (fault("length = \"open\""), "faults during the experiment: length sensor"),
        (fault("gas = \"shorted\""), "faults during the experiment: gas sensor"),
        (fault("pressure = \"open\""), "pressure sensor, overpressure"),
        (fault("pressure = \"frozen\""), "faults during the experiment: pressure sensor"),
        ("[sensor.pressure]\nnoise_pa = 60_000.0\n".to_owned(), "experiment: pressure sensor"),
        (
            "[valve]\npwm_hz = 10.0\n".to_owned(),
            "at most 9.7 kPa are allowed: is the valve configured wrong",
        ),
        ("[sensor.length]\nnoise_m = 0.015\n".to_owned(), "experiment: length sensor"),
        ("[believed.valve]\nconductance_m3_s_pa = 4e-10\n".to_owned(), "friction stands out of"),
        // Slip and creep hold the muscle against a load too light to lengthen it.
        ("[load]\nforce_n = 0.0\n".to_owned(), "too light to lengthen the muscle again"),
    ] {
        let (outcome, folder) = tune(&text, &[]);
        assert_eq!(outcome.code, 1, "{text}: {}{}", outcome.out, outcome.err);
        let why = outcome.err.lines().last().unwrap();
        assert!(why.starts_with("thermyo: nothing was tuned: "), "{text}: {}", outcome.err);
        assert!(outcome.err.contains(expected), "{text}: {}", outcome.err);
        assert!(outcome.out.is_empty() && !folder.path().join("out").exists(), "{text}");
    }
}

#[test]
fn an_untunable_chamber_is_bad_input() {
    let vessel = "[plant]\nkind = \"vessel\"\n[drive]\nkind = \"discharge\"\n";
    let bellows = format!(
        "[plant]\nkind = \"table\"\n[table]\ncsv = \"{}/../scenarios/bellows.csv\"\n",
        env!("CARGO_MANIFEST_DIR")
    );
    for (text, message) in [
        (vessel, "plant.kind = \"vessel\": must be another one: a vessel has neither friction nor"),
        (&bellows, "plant.kind = \"table\": must be another one: area and stiffness of this one"),
    ] {
        let (outcome, folder) = tune(text, &[]);
        assert_eq!(outcome.code, 2, "{}", outcome.err);
        assert!(outcome.err.contains(message), "{}", outcome.err);
        assert!(!folder.path().join("out").exists());
    }
}

/// A cylinder with a stiff spring, whose configured friction and area are 10 % too small.
#[test]
fn a_cylinder_configured_wrong_is_found() {
    for (acts, rest_m, load_n) in [("push", 0.25, -150.0), ("pull", 0.35, 150.0)] {
        let text = format!(
            "[plant]\nkind = \"cylinder\"\n[load]\nforce_n = {load_n}\n\
             [cylinder]\nacts = \"{acts}\"\nrest_length_m = {rest_m}\nspring_stiffness_n_m = 4000.0\n\
             [valve]\nconductance_m3_s_pa = 1.5e-9\n\
             [believed.friction]\nforce_n = 13.5\n[believed.cylinder]\narea_m2 = 1.125e-3\n"
        );
        let (outcome, folder) = tune(&text, &[]);
        assert_eq!(outcome.code, 0, "{acts}: {}", outcome.err);
        let found = fs::read_to_string(folder.path().join("out").join("summary.json")).unwrap();
        let found: serde_json::Value = serde_json::from_str(&found).unwrap();
        for (path, truth, bounds) in [
            ("friction.force_n", 15.0, (-6.0, 6.0)),
            ("cylinder.area_m2", 1.25e-3, (-2.0, 2.0)),
            ("cylinder.spring_stiffness_n_m", 4000.0, (-3.0, 3.0)),
        ] {
            let parameters = found["parameters"].as_array().unwrap();
            let one = parameters.iter().find(|parameter| parameter["path"] == path).unwrap();
            let error = (one["after"].as_f64().unwrap() / truth - 1.0) * 100.0;
            assert_within(&format!("{acts} {path}, error %"), error, bounds);
            assert!(error != 0.0, "measured");
        }
    }
}
