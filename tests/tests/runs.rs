//! Properties of every run: mass and energy balance, the same seed gives the same bytes, and printed
//! figures equal the written ones.

use system_tests::{repository, run_file, run_text, thermyo};

#[test]
fn mass_and_energy_balance_over_100_s() {
    for model in ["full", "lumped"] {
        let run = run_text(&format!("[plant]\nmodel = \"{model}\"\n"), &[]);
        assert_eq!(run.figure("strokes"), 20.0);
        assert_eq!(run.figure("core.steps"), 100_001.0);
        let (mass, energy) = (run.figure("mass_balance_error"), run.figure("energy_balance_error"));
        assert!(mass < 1e-9, "{model}: mass {mass}");
        // Integrator and balance have the same order but are separate: an error of zero would mean that the balance
        // closes by construction.
        assert!(energy < 1e-6 && energy > 1e-16, "{model}: energy {energy}");
    }
}

#[test]
fn same_seed_same_bytes() {
    let scenario = |seed: u64| format!("[run]\nduration_s = 3.0\nseed = {seed}\n");
    let [first, again, other] =
        [7, 7, 8].map(|seed| run_text(&scenario(seed), &[]).text("trace.csv"));
    assert_eq!(first, again);
    assert_ne!(first, other);
}

#[test]
fn every_number_of_the_trace_reads_back() {
    let run = run_text("[run]\nduration_s = 0.5\n[plant]\nmodel = \"lumped\"\n", &[]);
    let header = run.text("trace.csv").lines().next().unwrap().to_owned();
    assert!(header.starts_with(
        "time_s,pressure_pa,volume_m3,length_m,mass_kg,flow_in_kg_s,flow_out_kg_s,\
         gas_temperature_k,wall_temperature_k,sensor_gas_k,sensor_wall_k,estimate_k,\
         estimate_sd_k,duty_in,duty_out"
    ));
    for name in header.split(',') {
        assert_eq!(run.column(name).len(), 51, "{name}");
    }
    // Mass equals the inflow, row by row: the flows are means since the row before.
    let (mass, inflow) = (run.column("mass_kg"), run.column("flow_in_kg_s"));
    let moved: f64 = inflow.iter().map(|flow| flow * 0.01).sum();
    assert!((moved / (mass[50] - mass[0]) - 1.0).abs() < 1e-9);
}

#[test]
fn a_run_of_many_rows_writes_a_small_page() {
    let run =
        run_text("[run]\nduration_s = 30.0\nlog_every = 1\n[plant]\nmodel = \"lumped\"\n", &[]);
    let page = run.text("report.html");
    assert!((50_000..1_000_000).contains(&page.len()), "{} bytes", page.len());
    assert!(!page.contains("src=\"http") && !page.contains("href=\"http"), "opens offline");
}

#[test]
fn the_resolved_scenario_runs_to_the_same_trace() {
    let first = run_text("[run]\nduration_s = 1.0\n[believed.heat]\nscale = 0.7\n", &[]);
    let again = run_file(&first.path("scenario.toml"), &[]);
    assert_eq!(first.text("trace.csv"), again.text("trace.csv"));
}

#[test]
fn shipped_scenarios_are_valid() {
    let mut count = 0;
    for entry in std::fs::read_dir(repository("scenarios")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|ending| ending == "toml") {
            let outcome = thermyo(&["check", &path.display().to_string()]);
            assert_eq!(outcome.code, 0, "{}", outcome.err);
            count += 1;
        }
    }
    assert!(count >= 3, "{count} scenarios");
}

#[test]
fn the_nominal_cycle_closes_and_the_estimate_beats_the_bare_sensor() {
    let run = run_file(&repository("scenarios/nominal.toml"), &[]);
    let (low, high) = (run.figure("pressure_pa.min"), run.figure("pressure_pa.max"));
    // The crept bladder holds the muscle short: to lengthen it, the pressure falls almost to ambient.
    assert!(
        (1.02e5..1.05e5).contains(&low) && (3.5e5..4.1e5).contains(&high),
        "{low} to {high} Pa"
    );
    assert_eq!(run.figure("core.faults"), 0.0);
    let (bare, estimate) = (run.figure("rmse_k.sensor_gas"), run.figure("rmse_k.estimate"));
    assert!((10.0..13.0).contains(&bare), "bare {bare} K");
    assert!((0.02..0.15).contains(&estimate), "estimate {estimate} K");
}
