//! The gas temperature: short cases of the full measurements of `thermyo evaluate estimator`, and
//! the effect of a broken channel on it. Bounds are on both sides: a figure far better than
//! possible means a broken measurement.

use model_core::Faults;
use system_tests::{Finished, assert_within, run_text};

/// The nominal cycle, which follows from the scenario's defaults, in the plant of this name.
fn cycle(model: &str, more: &str) -> Finished {
    let text =
        format!("[run]\nduration_s = 40.0\nlog_every = 5\n[plant]\nmodel = \"{model}\"\n{more}");
    run_text(&text, &[])
}

/// The nominal cycle with a channel that is broken from 15 s to 25 s.
fn broken(line: &str, fault: &str) -> Finished {
    cycle("lumped", &format!("[faults]\n{line} = \"{fault}\"\nfrom_s = 15.0\nuntil_s = 25.0\n"))
}

/// Quality of the estimate from one time to another.
struct Worth {
    error_k: f64,
    /// Fraction of the time within two stated deviations.
    within: f64,
    /// Fraction of the time in which the estimate was marked as valid.
    valid: f64,
    faults: u32,
}

fn worth(run: &Finished, from_s: f64, until_s: f64) -> Worth {
    let [time, truth, estimate, deviation, valid, faults] =
        ["time_s", "gas_temperature_k", "estimate_k", "estimate_sd_k", "estimate_valid", "faults"]
            .map(|name| run.column(name));
    let rows: Vec<usize> =
        (0..time.len()).filter(|&i| (from_s..until_s).contains(&time[i])).collect();
    let mean = |value: &dyn Fn(usize) -> f64| {
        rows.iter().map(|&i| value(i)).sum::<f64>() / rows.len() as f64
    };
    let error = |i: usize| estimate[i] - truth[i];
    Worth {
        error_k: mean(&|i| error(i).powi(2)).sqrt(),
        within: mean(&|i| f64::from(u8::from(error(i).abs() <= 2.0 * deviation[i]))),
        valid: mean(&|i| valid[i]),
        faults: rows.iter().fold(0, |all, &i| all | faults[i] as u32),
    }
}

#[test]
fn configured_right_configured_wrong_and_started_wrong() {
    let cold = "[believed.heat]\nscale = 0.7\n";
    let quick = "[believed.sensor.gas]\ntime_constant_s = 2.4\n";
    let warm = "initial_temperature_k = 308.0\n";
    for (what, lumped, full) in [
        ("", (0.04, 0.16), (0.2, 0.45)),
        (cold, (0.05, 0.2), (0.2, 0.6)),
        (quick, (0.05, 0.2), (0.2, 0.5)),
        (warm, (0.04, 0.17), (0.2, 0.45)),
    ] {
        for (model, bounds_k) in [("lumped", lumped), ("full", full)] {
            let worth = worth(&cycle(model, what), 15.0, 40.0);
            assert_within(&format!("{model} {what}"), worth.error_k, bounds_k);
            assert!(worth.within > 0.95, "{model} {what}: {} within two deviations", worth.within);
            assert!(worth.valid > 0.85, "{model} {what}: valid {}", worth.valid);
            assert_eq!(worth.faults, 0, "{model} {what}");
        }
    }
}

#[test]
fn a_sensor_off_the_middle_costs_little() {
    for (position, bounds_k) in [(0.0, (0.2, 0.8)), (0.25, (0.2, 0.7)), (0.75, (0.35, 1.0))] {
        let run = cycle("full", &format!("[sensor.gas]\nposition = {position}\n"));
        let worth = worth(&run, 15.0, 40.0);
        assert_within(&format!("at {position}"), worth.error_k, bounds_k);
        assert!(worth.within > 0.95, "at {position}: {} within two deviations", worth.within);
        assert!(worth.valid > 0.5, "at {position}: valid {}", worth.valid);
    }
}

/// Pulses drive gas through the port and back, 0.57 g/s in and 0.22 g/s out behind 0.25 m.
#[test]
fn gas_that_goes_to_and_fro_in_a_hose_costs_little() {
    for (length_m, diameter_m) in [(0.25, 0.004), (1.0, 0.004), (0.86, 0.006)] {
        let hose = format!("[tube]\nlength_m = {length_m:?}\ndiameter_m = {diameter_m:?}\n");
        let worth = worth(&cycle("full", &hose), 15.0, 40.0);
        assert_within(&hose, worth.error_k, (0.1, 0.6));
        assert!(worth.within > 0.95, "{hose}: {} within two deviations", worth.within);
    }
}

/// A tube brings the gas that flows through it near ambient temperature.
#[test]
fn a_cold_or_warm_supply_costs_little() {
    for supply_k in [273.0, 313.0] {
        let supply = format!("[supply]\ntemperature_k = {supply_k:?}\n");
        let worth = worth(&cycle("full", &supply), 15.0, 40.0);
        assert_within(&supply, worth.error_k, (0.1, 0.5));
        assert!(worth.within > 0.95, "{supply}: {} within two deviations", worth.within);
    }
}

#[test]
fn a_constant_coefficient_of_the_heat_transfer_is_one_in_the_core() {
    let run = cycle("lumped", "[heat]\nmodel = \"constant\"\n");
    assert_within("RMS", worth(&run, 15.0, 40.0).error_k, (0.01, 0.05));
}

#[test]
fn a_lost_gas_sensor_costs_little() {
    for (fault, shown, bounds_k) in [
        ("open", Faults::GAS_SENSOR, (0.04, 0.2)),
        ("shorted", Faults::GAS_SENSOR, (0.04, 0.2)),
        ("frozen", Faults::GAS_SENSOR, (0.04, 0.2)),
        ("noisy", Faults::GAS_SENSOR, (0.3, 1.2)),
    ] {
        let run = broken("gas", fault);
        let lost = worth(&run, 15.0, 25.0);
        assert_within(fault, lost.error_k, bounds_k);
        assert_eq!(lost.faults, shown.0, "{fault}");
        assert!(lost.within > 0.85, "{fault}: {}", lost.within);
        let again = worth(&run, 35.0, 40.0);
        assert_within(fault, again.error_k, (0.04, 0.2));
        assert_eq!((again.valid, again.faults), (1.0, 0), "{fault}");
    }
}

#[test]
fn without_pressure_there_is_no_estimate_and_then_there_is_again() {
    for fault in ["open", "shorted", "frozen", "noisy"] {
        let run = broken("pressure", fault);
        let lost = worth(&run, 15.5, 25.0);
        assert_eq!(lost.valid, 0.0, "{fault}");
        assert!(lost.within > 0.99, "{fault}: the stated deviation is as large as can be");
        assert_ne!(lost.faults & Faults::PRESSURE_SENSOR.0, 0, "{fault}");
        // Latched: the muscle stays vented, and the estimate is right again.
        let again = worth(&run, 35.0, 40.0);
        assert_within(fault, again.error_k, (1e-6, 0.3));
        assert_eq!(again.valid, 1.0, "{fault}");
        assert_ne!(again.faults & Faults::PRESSURE_SENSOR.0, 0, "{fault}");
        assert!(run.column("estimate_sd_k").iter().all(|sd| sd.is_finite()), "{fault}");
    }
}

#[test]
fn the_load_tells_the_length_where_its_sensor_is_absent() {
    for fault in ["open", "shorted", "frozen", "noisy"] {
        let run = broken("length", fault);
        let lost = worth(&run, 16.0, 25.0);
        assert_within(fault, lost.error_k, (0.5, 1.6));
        assert!(lost.within > 0.85, "{fault}: {} within two deviations", lost.within);
        assert_ne!(lost.faults & Faults::LENGTH_SENSOR.0, 0, "{fault}");
        assert_within(fault, worth(&run, 35.0, 40.0).error_k, (0.05, 0.5));
    }
    // The fault holds from the start, against a constant load.
    let never = cycle("lumped", "[faults]\nlength = \"open\"\nfrom_s = 0.0\nuntil_s = 40.0\n");
    assert_within("never there", worth(&never, 10.0, 40.0).error_k, (0.5, 1.6));
}
