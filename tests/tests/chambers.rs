//! Every chamber: closed forms, the estimate, pressure and position held. Bounds are on both sides: a figure far better
//! than possible means a broken measurement.

use system_tests::{Finished, assert_within, run_text, thermyo};

/// Valves for 0.1 l: the shortest pulse is 0.5 % of the pressure.
const SMALL_VALVES: &str = "[valve]\nconductance_m3_s_pa = 1.0e-9\n";
const PUSHES: &str = "[plant]\nkind = \"cylinder\"\nmodel = \"MODEL\"\n[load]\nforce_n = -150.0\n";
const PULLS: &str = "[plant]\nkind = \"cylinder\"\nmodel = \"MODEL\"\n\
                     [cylinder]\nacts = \"pull\"\nrest_length_m = 0.35\n[load]\nforce_n = 150.0\n";

const BELLOWS: &str = concat!(
    "[plant]\nkind = \"table\"\nmodel = \"MODEL\"\n[table]\ncsv = \"",
    env!("CARGO_MANIFEST_DIR"),
    "/../scenarios/bellows.csv\"\n[load]\nforce_n = -40.0\n"
);

/// Name and scenario of a chamber, its rest length and its stroke \[m\], and the contraction at half of the stroke.
const MOVING: [(&str, &str, f64, f64); 3] = [
    ("pushes", PUSHES, 0.25, -0.1),
    ("pulls", PULLS, 0.35, 0.1),
    ("bellows", BELLOWS, 0.09, -0.035),
];

fn run(chamber: &str, model: &str, drive: &str) -> Finished {
    let chamber = chamber.replace("MODEL", model);
    run_text(&format!("[run]\nduration_s = 20.0\n{chamber}{SMALL_VALVES}[drive]\n{drive}"), &[])
}

/// Root mean square of the difference of two columns over the second half \[their unit\].
fn rms(run: &Finished, column: &str, of: impl Fn(usize) -> f64) -> f64 {
    let values = run.column(column);
    let rows = values.len() / 2..values.len();
    let count = rows.len() as f64;
    (rows.map(|i| (values[i] - of(i)).powi(2)).sum::<f64>() / count).sqrt()
}

/// At a constant load the pressure is constant, and an inflow adds R T_in/P to the volume, with or without heat: cp dm
/// T_in = P dV cp/R.
#[test]
fn a_cylinder_under_a_constant_load_is_filled_at_constant_pressure() {
    for (name, chamber, rest_m, stroke_m) in MOVING.into_iter().take(2) {
        let sign = f64::signum(stroke_m);
        let text = chamber.replace("MODEL", "lumped")
            + "[heat]\nmodel = \"adiabatic\"\n[friction]\nforce_n = 0.0\n";
        let text = if text.contains("[cylinder]") { text } else { text + "[cylinder]\n" };
        let text = text
            .replace("[cylinder]\n", "[cylinder]\nspring_n = 0.0\nspring_stiffness_n_m = 0.0\n");
        // 150 N on 12.5 cm2: 1.2 bar above ambient.
        let start = "[plant]\ninitial_pressure_pa = 221324.0\n";
        let run = run_text(
            &format!(
                "[run]\nduration_s = 2.0\n{}{SMALL_VALVES}[drive]\nkind = \"mass-flow\"\n\
                 period_s = 100.0\nflow_kg_s = 5.0e-5\n",
                text.replace("[plant]\n", start)
            ),
            &[],
        );
        let (mass_kg, length_m) = (run.column("mass_kg"), run.column("length_m"));
        let (first, last) = (0, mass_kg.len() - 1);
        let added_m3 = 287.05 * 298.0 * (mass_kg[last] - mass_kg[first]) / 221_325.0;
        let expected_m = rest_m - sign * added_m3 / 1.25e-3;
        // The first pascal moves it to its load.
        assert!(
            (length_m[last] - expected_m).abs() < 1e-6,
            "{name}: {} {expected_m}",
            length_m[last]
        );
        assert!((length_m[last] - rest_m).abs() > 0.02, "{name}: it moves");
    }
}

#[test]
fn the_estimate_of_the_gas() {
    let cycle = "kind = \"mass-flow\"\nperiod_s = 3.0\nflow_kg_s = 1.5e-4\n";
    for (name, chamber, ..) in MOVING {
        let run = run(chamber, "lumped", cycle);
        let truth = run.column("gas_temperature_k");
        assert_within(name, rms(&run, "estimate_k", |i| truth[i]), (0.01, 0.5));
        let bare_k = rms(&run, "sensor_gas_k", |i| truth[i]);
        assert!(bare_k > 3.0, "{name}: there is something to estimate, {bare_k} K");
        assert!(run.column("faults").iter().all(|faults| *faults == 0.0), "{name}");
    }
}

#[test]
fn the_pressure_is_held() {
    let vessel = "[plant]\nkind = \"vessel\"\nmodel = \"MODEL\"\n[sensor.length]\nrange_m = 0.4\n";
    let kinds = MOVING.map(|(name, chamber, ..)| (name, chamber));
    for (name, chamber) in kinds.into_iter().chain([("vessel", vessel)]) {
        for model in ["lumped", "full"] {
            let run = run(chamber, model, "kind = \"pressure\"\npressure_pa = 350000.0\n");
            let error = rms(&run, "pressure_pa", |_| 350_000.0) / 350_000.0;
            assert_within(&format!("{name} {model}"), error, (1e-6, 0.01));
        }
    }
}

#[test]
fn the_position_is_held() {
    for (name, chamber, rest_m, stroke_m) in MOVING {
        for model in ["lumped", "full"] {
            for share in [0.3, 0.8] {
                let contraction = share * stroke_m / rest_m;
                let drive = format!("kind = \"contraction\"\ncontraction = {contraction}\n");
                let run = run(chamber, model, &drive);
                let wanted_m = rest_m * (1.0 - contraction);
                let error = rms(&run, "length_m", |_| wanted_m) / f64::abs(stroke_m);
                assert_within(&format!("{name} {model} {share}"), error, (1e-6, 0.01));
                assert!(run.column("faults").iter().all(|faults| *faults == 0.0), "{name}");
            }
        }
    }
}

#[test]
fn a_load_that_pressure_does_not_move_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scenario.toml");
    for (load, message) in [
        ("[load]\nforce_n = 10.0\n", "load.force_n = 10.0: must be a number from -1e6 to 0 N"),
        ("", "load.force_n = 100.0 (not given): must be a number from -1e6 to 0 N"),
    ] {
        std::fs::write(&file, format!("[plant]\nkind = \"cylinder\"\n{load}")).unwrap();
        let outcome = thermyo(&["check", &file.display().to_string()]);
        assert_eq!(outcome.code, 2);
        assert!(outcome.err.contains(message), "{}", outcome.err);
    }
}

/// A run that leaves the range of the table ends with an error.
#[test]
fn a_table_is_not_extrapolated() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scenario.toml");
    let out = folder.path().join("out").display().to_string();
    let bellows = BELLOWS.replace("MODEL", "lumped");
    let inflow = "[drive]\nkind = \"mass-flow\"\nflow_kg_s = 1.0e-3\nperiod_s = 10.0\n";
    std::fs::write(&file, format!("[run]\nduration_s = 5.0\n{bellows}{inflow}")).unwrap();
    let outcome = thermyo(&["run", &file.display().to_string(), "--out", &out, "--quiet"]);
    assert_ne!(outcome.code, 0);
    let message = "and what is known of it reaches from 0.08 to 0.13 m";
    assert!(outcome.err.contains(message), "{}", outcome.err);
}

#[test]
fn a_table_that_is_none_is_refused_by_cell() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scenario.toml");
    let check = |csv: &str, scenario: &str| {
        std::fs::write(folder.path().join("b.csv"), csv).unwrap();
        std::fs::write(&file, scenario).unwrap();
        let outcome = thermyo(&["check", &file.display().to_string()]);
        assert_eq!(outcome.code, 2, "{csv}");
        outcome.err
    };
    let scenario = "[plant]\nkind = \"table\"\n[table]\ncsv = \"b.csv\"\n";
    let head = "length_m,volume_m3,force_n\n0.08,1e-4,-80\n";
    let rows = [
        ("0.1,1.4e-4,80\n0.1,1.6e-4,90\n", "b.csv:4:", "above that of the row before by 0.1 mm"),
        ("0.1,1.4e-4,80\n0.11,1.3e-4,90\n", "b.csv:4:", "as in the first two rows"),
        ("0.1,1.4e-4,80\n0.11,1.6e-4,70\n", "b.csv:4:", "no less than that of the row before"),
        ("0.1,1.4e-4,80\n", "b.csv:3:", "the last one of 3 to 12 rows"),
    ];
    for (rows, place, message) in rows {
        let err = check(&format!("{head}{rows}"), scenario);
        assert!(err.contains(place) && err.contains(message), "{err}");
    }
    let err = check(head, "[plant]\nkind = \"table\"\n");
    assert!(err.contains("table.csv") && err.contains("needs it"), "{err}");
}

/// A trace of its own, with wrong friction and heat transfer in the configuration, gives both back.
#[test]
fn identify_finds_what_was_configured_wrong() {
    let cycle = "kind = \"mass-flow\"\nperiod_s = 3.0\nflow_kg_s = 1.5e-4\n";
    for (name, chamber, ..) in MOVING {
        let recorded = run(chamber, "lumped", cycle);
        let file = recorded.path("configured_wrong.toml");
        let text = format!(
            "[run]\nduration_s = 20.0\n{}{SMALL_VALVES}[drive]\n{cycle}[friction]\nforce_n = 12.0\n\
             [heat]\nscale = 0.7\n[identify]\nparameters = [\"friction.force_n\", \"heat.scale\"]\n\
             starts = 2\n",
            chamber.replace("MODEL", "lumped")
        );
        std::fs::write(&file, text).unwrap();
        let out = recorded.path("identified");
        let [trace, file, out] =
            [recorded.path("trace.csv"), file, out].map(|path| path.display().to_string());
        let outcome = thermyo(&["identify", &trace, "--config", &file, "--out", &out, "--quiet"]);
        assert_eq!(outcome.code, 0, "{name}: {}", outcome.err);
        let found = std::fs::read_to_string(format!("{out}/summary.json")).unwrap();
        let found: serde_json::Value = serde_json::from_str(&found).unwrap();
        for (path, truth) in [("friction.force_n", 15.0), ("heat.scale", 1.0)] {
            let value = found["parameters"][path]["value"].as_f64();
            let value = value.unwrap_or_else(|| panic!("{found}"));
            assert_within(&format!("{name} {path}"), value / truth, (0.97, 1.03));
            assert!(value != truth, "fitted, not configured");
        }
    }
}
