//! Closed forms of thermodynamics, through the command line: the results of a user's scenario.

use system_tests::{Finished, run_text};

const R: f64 = 287.05;
const K: f64 = 1.4;
/// Bound of a closed form, whose error is arithmetic, not modelling: a part in a million.
const BOUND: f64 = 1e-6;

/// Mass flow through a choked nozzle per area and upstream p/sqrt(T).
fn choked(k: f64, r: f64) -> f64 {
    (k / r).sqrt() * (2.0 / (k + 1.0)).powf((k + 1.0) / (2.0 * (k - 1.0)))
}

fn nozzle_area(diameter: f64, coefficient: f64) -> f64 {
    coefficient * std::f64::consts::PI / 4.0 * diameter * diameter
}

fn vessel(heat: &str, drive: &str, more: &str) -> Finished {
    run_text(
        &format!(
            "[run]\nduration_s = 2.0\nlog_every = 50\n\
             [ambient]\npressure_pa = 20000.0\n\
             [plant]\nkind = \"vessel\"\nmodel = \"lumped\"\ninitial_pressure_pa = 600000.0\n\
             initial_temperature_k = 310.0\n\
             [vessel]\nvolume_m3 = 0.002\n\
             [orifice]\ndiameter_m = 0.0012\ndischarge_coefficient = 0.8\n\
             [heat]\nmodel = \"{heat}\"\n\
             [drive]\nkind = \"{drive}\"\n{more}"
        ),
        &[],
    )
}

fn compare(run: &Finished, column: &str, expected: impl Fn(f64) -> f64) {
    let (times, values) = (run.column("time_s"), run.column(column));
    assert!(times.len() > 30, "the run has rows to compare");
    for (time, value) in times.iter().zip(&values) {
        let expected = expected(*time);
        assert!(
            (value / expected - 1.0).abs() < BOUND,
            "{column} at {time} s: {value} for {expected}"
        );
    }
    let (first, last) = (values[0], values[values.len() - 1]);
    assert!(column == "gas_temperature_k" || (last / first - 1.0).abs() > 0.05, "it moves");
}

/// Initial time constant of the discharge, m/(dm/dt).
fn discharge_tau() -> f64 {
    let mass_per_pressure = 0.002 / (R * 310.0);
    mass_per_pressure / (nozzle_area(0.0012, 0.8) * choked(K, R) / 310_f64.sqrt())
}

#[test]
fn adiabatic_discharge() {
    let run = vessel("adiabatic", "discharge", "");
    let x = |t: f64| 1.0 + 0.5 * (K - 1.0) * t / discharge_tau();
    compare(&run, "gas_temperature_k", |t| 310.0 * x(t).powi(-2));
    compare(&run, "pressure_pa", |t| 600_000.0 * x(t).powf(-2.0 * K / (K - 1.0)));
}

#[test]
fn isothermal_discharge() {
    let run = vessel("isothermal", "discharge", "");
    compare(&run, "gas_temperature_k", |_| 310.0);
    compare(&run, "pressure_pa", |t| 600_000.0 * (-t / discharge_tau()).exp());
}

#[test]
fn adiabatic_filling_from_a_reservoir() {
    let run =
        vessel("adiabatic", "fill", "[supply]\npressure_pa = 3000000.0\ntemperature_k = 285.0\n");
    let flow = nozzle_area(0.0012, 0.8) * choked(K, R) * 3.0e6 / 285_f64.sqrt();
    let cv = R / (K - 1.0);
    let mass = |t: f64| 600_000.0 * 0.002 / (R * 310.0) + flow * t;
    // Every kilogram brings cp T_in: an empty vessel would tend to k T_in.
    let energy = |t: f64| 600_000.0 * 0.002 / (K - 1.0) + K * cv * 285.0 * flow * t;
    compare(&run, "pressure_pa", |t| (K - 1.0) * energy(t) / 0.002);
    compare(&run, "gas_temperature_k", |t| energy(t) / (cv * mass(t)));
}

#[test]
fn closed_compression() {
    let folder = tempfile::tempdir().unwrap();
    let csv = folder.path().join("piston.csv");
    std::fs::write(&csv, "time_s,volume_m3\n0,0.002\n0.7,0.0011\n1.3,0.0013\n2,0.0005\n").unwrap();
    let volume = format!("[vessel]\nvolume_csv = \"{}\"\n", csv.display());
    for (heat, exponent) in [("adiabatic", K), ("isothermal", 1.0)] {
        let scenario = format!(
            "[run]\nduration_s = 2.0\nlog_every = 20\n\
             [plant]\nkind = \"vessel\"\nmodel = \"lumped\"\ninitial_pressure_pa = 150000.0\n\
             initial_temperature_k = 300.0\n[heat]\nmodel = \"{heat}\"\n[drive]\nkind = \"closed\"\n{volume}"
        );
        let run = run_text(&scenario, &[]);
        let (pressure, temperature, volume) =
            (run.column("pressure_pa"), run.column("gas_temperature_k"), run.column("volume_m3"));
        assert!((volume[volume.len() - 1] - 0.0005).abs() < 1e-12, "the piston arrives");
        for ((p, t), v) in pressure.iter().zip(&temperature).zip(&volume) {
            let ratio: f64 = 0.002 / v;
            assert!((p / (150_000.0 * ratio.powf(exponent)) - 1.0).abs() < BOUND);
            assert!((t / (300.0 * ratio.powf(exponent - 1.0)) - 1.0).abs() < BOUND);
        }
    }
}
