//! A permanent leak of a chamber: in the plant against the closed form, and in estimate, pressure
//! loop and supervisor, with and without its configuration.

use crate::run_support::rows;
use model_core::Faults;
use thermyo_plant::{Actuation, BuildError, Truth};
use thermyo_record::trace::Row;
use thermyo_runs::signals::rms_difference;
use thermyo_scenario::{HeatModel, LoadKind, PlantKind, PlantModel, Scenario};

const CRITICAL_RATIO: f64 = 0.3;

/// A shut chamber of one size that leaks.
fn leaking(kind: PlantKind, model: PlantModel, pressure_pa: f64) -> Scenario {
    let mut scenario = Scenario::default();
    scenario.plant.kind = kind;
    scenario.plant.model = model;
    scenario.plant.initial_pressure_pa = pressure_pa;
    scenario.load.kind = LoadKind::Isometric;
    scenario.heat.model = HeatModel::Isothermal;
    scenario.leak.conductance_m3_s_pa = 2.0e-10;
    scenario.leak.critical_ratio = CRITICAL_RATIO;
    scenario
}

/// Time in which gas that keeps its temperature falls from one pressure to another \[s\]: with
/// tau = V/(C rho0 R sqrt(T0 T)) and x = ambient over pressure, x' = x phi(x)/tau. Choked, that is a
/// logarithm; below, with x = b + (1 - b) sin a, the integral of (1 - b) da/(b + (1 - b) sin a).
fn seconds(scenario: &Scenario, volume_m3: f64, from_pa: f64, to_pa: f64) -> f64 {
    let b = CRITICAL_RATIO;
    let tau_s = volume_m3
        / (scenario.leak.conductance_m3_s_pa
            * 1.0e5
            * (scenario.plant.initial_temperature_k / 293.15).sqrt());
    let root = (1.0 - 2.0 * b).sqrt();
    let primitive = |x: f64| {
        let half = (0.5 * ((x - b) / (1.0 - b)).asin()).tan();
        ((b * half + 1.0 - b - root) / (b * half + 1.0 - b + root)).ln() * (1.0 - b) / root
    };
    let [from, to] = [from_pa, to_pa].map(|pressure_pa| scenario.ambient.pressure_pa / pressure_pa);
    tau_s * ((to.min(b) / from.min(b)).ln() + primitive(to.max(b)) - primitive(from.max(b)))
}

#[test]
fn a_leak_down_at_constant_temperature_is_the_closed_form() {
    for (kind, model, tolerance) in [
        (PlantKind::Vessel, PlantModel::Lumped, 1e-7),
        (PlantKind::Muscle, PlantModel::Lumped, 1e-6),
        // The tube empties through the same leak, depending on its wall between P V^k and P V.
        (PlantKind::Muscle, PlantModel::Full, 2e-3),
    ] {
        // Choked to the end, through the critical ratio, and subsonic from the start.
        for (from_pa, fallen) in [(7.0e5, 0.2), (4.0e5, 0.4), (1.8e5, 0.6)] {
            let mut scenario = leaking(kind, model, from_pa);
            scenario.vessel.volume_m3 = 1.0e-4;
            let mut plant = thermyo_plant::build(&scenario, None).unwrap();
            let Truth { volume_m3, .. } = plant.truth();
            let full = model == PlantModel::Full;
            let tube_m3 = if full { scenario.tube.volume_m3 } else { 0.0 };
            let [adiabatic_m3, gas_m3] =
                [scenario.gas.heat_capacity_ratio, 1.0].map(|k| volume_m3 + tube_m3 / k);
            let to_pa = from_pa - fallen * (from_pa - scenario.ambient.pressure_pa);
            let [adiabatic_s, expected_s] =
                [adiabatic_m3, gas_m3].map(|gas_m3| seconds(&scenario, gas_m3, from_pa, to_pa));
            let mut before = plant.truth();
            while plant.truth().pressure_pa > to_pa {
                before = plant.truth();
                plant.advance(Actuation::default()).unwrap();
            }
            let now = plant.truth();
            // The pressure is exponential within a step.
            let ln = |pressure_pa: f64| (before.pressure_pa / pressure_pa).ln();
            let over = ln(to_pa) / ln(now.pressure_pa);
            let found_s = before.time_s + over * (now.time_s - before.time_s);
            let off = found_s / expected_s - 1.0;
            println!("{kind:?} {model:?}, {from_pa} Pa: {found_s:.5} s, off by {off:.1e}");
            assert!(off < tolerance, "{found_s} s, not {expected_s} s");
            let least = found_s / adiabatic_s - 1.0;
            assert!(least > -tolerance, "{found_s} s, at least {adiabatic_s} s");
            let ledger = plant.ledger();
            assert!(ledger.mass_balance_error() < 1e-12 && ledger.energy_balance_error() < 1e-9);
        }
    }
}

#[test]
fn a_leak_that_is_too_large_to_integrate_is_named() {
    for model in [PlantModel::Lumped, PlantModel::Full] {
        let mut scenario = leaking(PlantKind::Muscle, model, 3.0e5);
        scenario.leak.conductance_m3_s_pa = 1.0e-3;
        let error = thermyo_plant::build(&scenario, None).err().unwrap();
        assert!(matches!(error, BuildError::TooFast { .. }));
        assert!(error.to_string().starts_with("leak.conductance_m3_s_pa is too large"), "{error}");
    }
}

/// 1e-11 m3/(s Pa) loses 0.5 % of the gas per second.
const LEAKS: &str = "[leak]\nconductance_m3_s_pa = 1e-11\n";
const UNCONFIGURED: &str =
    "[leak]\nconductance_m3_s_pa = 1e-11\n[believed.leak]\nconductance_m3_s_pa = 0.0\n";

/// Error of the estimate in a shut, leaking muscle: a leak is no change of temperature, even if it is not configured.
fn held_error_k(model: &str, leak: &str) -> f64 {
    let text = format!(
        "run = {{ duration_s = 60, log_every = 10 }}\n\
         plant = {{ model = \"{model}\", initial_pressure_pa = 4e5 }}\n\
         load = {{ kind = \"isometric\", length_m = 0.27 }}\ndrive.kind = \"closed\"\n{leak}"
    );
    late_error_k(&text)
}

/// Error of the estimate from 10 s on, RMS \[K\].
pub fn late_error_k(text: &str) -> f64 {
    let rows = rows(text);
    let late = rows.iter().filter(|row| row.truth.time_s > 10.0);
    let (estimate, truth): (Vec<f64>, Vec<f64>) = late
        .map(|row| (f64::from(row.telemetry.estimate.gas_k), row.truth.gas_temperature_k))
        .unzip();
    rms_difference(&estimate, &truth)
}

#[test]
fn the_estimate_of_a_hold_takes_the_leak_along() {
    for model in ["lumped", "full"] {
        let [configured_k, unconfigured_k] =
            [LEAKS, UNCONFIGURED].map(|leak| held_error_k(model, leak));
        println!("{model}: {configured_k:.3} K configured, {unconfigured_k:.3} K not");
        assert!(configured_k < 0.3, "{model}: {configured_k} K");
        assert!(unconfigured_k < 0.3, "{model}: {unconfigured_k} K");
    }
}

/// Mean error below the set point without the loop's integral, over two seconds of a leak of 5 % per second \[Pa\].
#[test]
fn the_pressure_loop_feeds_a_configured_leak() {
    let low_pa = |leak: &str| {
        let text = format!(
            "run = {{ duration_s = 3, log_every = 1 }}\n\
             plant = {{ model = \"lumped\", initial_pressure_pa = 3e5 }}\nheat.model = \"isothermal\"\n\
             load = {{ kind = \"isometric\", length_m = 0.27 }}\n\
             drive = {{ kind = \"pressure\", pressure_pa = 3e5 }}\n\
             controller.pressure_dead_zone_pa = 0.0\ncontroller.minimum_pulse_s = 0.0\n\
             controller.pressure_reset_s = 1000.0\n{leak}"
        );
        let rows = rows(&text);
        let late = rows.iter().filter(|row| row.truth.time_s > 1.0);
        late.clone().map(|row| 3.0e5 - row.truth.pressure_pa).sum::<f64>() / late.count() as f64
    };
    let leak = LEAKS.replace("1e-11", "1e-10");
    let unconfigured = UNCONFIGURED.replace("1e-11", "1e-10");
    let [tight_pa, configured_pa, unconfigured_pa] = ["", &leak, &unconfigured].map(low_pa);
    println!(
        "low by {tight_pa:.0} Pa tight, {configured_pa:.0} Pa configured, {unconfigured_pa:.0} Pa not"
    );
    assert!((configured_pa - tight_pa).abs() < 60.0, "{configured_pa} Pa, tight {tight_pa} Pa");
    assert!((unconfigured_pa - tight_pa) > 120.0, "{unconfigured_pa} Pa, tight {tight_pa} Pa");
}

/// Time at which a leak is first found in a shut muscle \[s\]; from 3 s on there is an additional hole.
fn found_s(leak: &str, hole_m3_s_pa: f64) -> Option<f64> {
    let text = format!(
        "run = {{ duration_s = 60, log_every = 10 }}\nplant.model = \"lumped\"\n\
         load = {{ kind = \"isometric\", length_m = 0.27 }}\n\
         plant.initial_pressure_pa = 5e5\ndrive.kind = \"closed\"\n\
         faults = {{ from_s = 3, leak_conductance_m3_s_pa = {hole_m3_s_pa} }}\n{leak}"
    );
    let rows = rows(&text);
    let leaks = |row: &&Row| row.telemetry.faults.intersects(Faults::LEAK);
    let first = rows.iter().find(leaks)?;
    let others = rows.iter().fold(Faults::NONE, |all, row| all.with(row.telemetry.faults));
    assert!(!others.intersects(Faults::GAS_GAINED), "{others:?}");
    Some(first.truth.time_s)
}

#[test]
fn only_leakage_beyond_the_configured_leak_counts() {
    // 8 % of the gas per second.
    let leak = |configured: &str| {
        format!(
            "[leak]\nconductance_m3_s_pa = 1.4e-10\n[believed.leak]\nconductance_m3_s_pa = {configured}\n"
        )
    };
    let unconfigured_s = found_s(&leak("0.0"), 0.0).unwrap();
    assert!((3.0..9.0).contains(&unconfigured_s), "{unconfigured_s} s");
    assert_eq!(found_s(&leak("1.4e-10"), 0.0), None);
    // A configured leak that was repaired is no gain of gas.
    let mended = "[believed.leak]\nconductance_m3_s_pa = 1.4e-10\n";
    assert_eq!(found_s(mended, 0.0), None);
    // The leak grows to three times that.
    let grown_s = found_s(&leak("1.4e-10"), 2.8e-10).unwrap();
    println!(
        "found after {unconfigured_s:.2} s where nothing is configured, {:.2} s after it grew",
        grown_s - 3.0
    );
    assert!((5.0..12.0).contains(&grown_s), "{grown_s} s");
}
