//! Sensor chips in place of the converter: the estimate is as good, at their own rate, and a lost
//! chip vents.

use thermyo_record::summary::Summary;

use model_core::{Command, Faults};
use thermyo_simulation::run;

const MAX31865: &str = "[sensor.gas]\nkind = \"max31865\"\n";
const MPR: &str = "[sensor.pressure]\nkind = \"mpr\"\nrange_pa = 250e3\n";

struct Ran {
    summary: Summary,
    faults: Faults,
    /// First step with a fault, and whether the last one vents.
    found_s: Option<f64>,
    vents: bool,
}

fn run_with(sensor: &str) -> Ran {
    // The plant's air follows the core's own law: the remaining error is the sensor's.
    let text = format!(
        "[run]\nduration_s = 60\nlog_every = 1\n[plant]\nmodel = \"lumped\"\n[heat]\nmodel = \"constant\"\n{sensor}"
    );
    let loaded = thermyo_setup::parse(&text, "digital.toml".as_ref()).unwrap();
    let (mut faults, mut found_s, mut vents) = (Faults::NONE, None, false);
    let summary = run::on_core(&loaded, |row| {
        faults = faults.with(row.telemetry.faults);
        if row.telemetry.faults != Faults::NONE {
            found_s.get_or_insert(row.truth.time_s);
        }
        vents = row.telemetry.command == Command::VENT;
    })
    .unwrap();
    Ran { summary, faults, found_s, vents }
}

/// One reading every 20 ms, as old as its conversion is long; the core allows for that age.
#[test]
fn the_estimate_is_as_good_from_a_max31865() {
    // The error is 0.024 K, so hundredths of a kelvin are several times as much: 0.036 to 0.092 K
    // here.
    let analog = run_with("").summary.rmse_k.estimate;
    let pt1000 = "[sensor.max31865]\nzero_ohm = 1000.0\nreference_ohm = 4300.0\n";
    // The chip's mean over 20 ms has 0.004 K of noise where a conversion has 0.05 K.
    for (noise_k, chip, allowed) in [
        (0.004, "", 0.8..2.0),
        (0.004, pt1000, 0.8..2.0),
        (0.02, "", 0.8..2.0),
        (0.05, "", 1.0..6.0),
    ] {
        let digital = run_with(&format!("{MAX31865}noise_k = {noise_k}\n{chip}"));
        assert_eq!(digital.faults, Faults::NONE);
        let found = digital.summary.rmse_k.estimate;
        println!("{found} K with {noise_k} K of noise, {analog} K from the converter");
        assert!(allowed.contains(&(found / analog)), "{found} K, {analog} K from the converter");
    }
    // A core configured with another resistor reads wrong temperatures.
    let believed = "[believed.sensor.max31865]\nreference_ohm = 425.0\n";
    let wrong = run_with(&format!("{MAX31865}noise_k = 0.004\n{believed}"));
    assert!(wrong.summary.rmse_k.estimate > 10.0 * analog);
}

#[test]
fn a_max31865_that_is_lost_vents() {
    // Readings come at 10.00, 10.02, ... s; the last one before is that at 9.98 s.
    for (fault, after_s) in [("open", 0.02), ("shorted", 0.02), ("frozen", 0.1 - 0.02)] {
        assert_vents(
            &format!("{MAX31865}[faults]\ngas = \"{fault}\"\n"),
            Faults::GAS_LOST,
            after_s,
        );
    }
}

/// A fault from 10 s on: the first bad reading is shown, and the second one vents.
fn assert_vents(fault: &str, shown: Faults, after_s: f64) {
    let ran = run_with(&format!("{fault}from_s = 10\n"));
    assert!(ran.faults.intersects(shown), "{fault}: {}", ran.faults);
    let found_s = ran.found_s.unwrap() - 10.0;
    assert!((-0.001..after_s + 0.002).contains(&found_s), "{fault}: {found_s} s");
    assert!(ran.vents, "{fault}");
}

/// Below 2.5 bar, the range of the chip.
const LOW: &str = "[supply]\npressure_pa = 240e3\n[load]\nforce_n = 20.0\n[drive]\nkind = \"pressure\"\n\
                   pressure_pa = 180e3\n";

#[test]
fn a_pressure_comes_from_an_mpr() {
    let analog = run_with(&format!("{LOW}[sensor.pressure]\nrange_pa = 250e3\n"));
    let digital = run_with(&format!("{LOW}{MPR}"));
    assert_eq!((analog.faults, digital.faults), (Faults::NONE, Faults::NONE));
    let (known, found) = (analog.summary.rmse_k.estimate, digital.summary.rmse_k.estimate);
    println!("{found} K, {known} K from the converter");
    // The stroke goes on during the conversion, which costs more than the noise.
    assert!((4.0..10.0).contains(&(found / known)), "{found} K, {known} K from the converter");
    for (fault, after_s) in [("open", 0.012), ("shorted", 0.012), ("frozen", 0.05)] {
        let text = format!("{LOW}{MPR}[faults]\npressure = \"{fault}\"\n");
        assert_vents(&text, Faults::PRESSURE_SENSOR, after_s);
    }
}

#[test]
fn what_is_no_such_part_is_named() {
    for (text, message) in [
        (
            "[sensor.max31865]\nlowest_k = 300\nhighest_k = 200\n",
            "sensor.max31865.highest_k = 200: must be",
        ),
        ("[sensor.gas]\nkind = \"max6675\"\n", "sensor.gas.kind = \"max6675\": must be one of"),
        ("[sensor.mpr]\ntimeout_s = 0.0\n", "sensor.mpr.timeout_s = 0.0: must be a number"),
    ] {
        let parsed = thermyo_setup::parse(text, "given.toml".as_ref());
        let error = parsed.map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    }
}
