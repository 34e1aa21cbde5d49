//! A thermistor in place of the Pt1000: the estimate is as good if it is configured right.

use thermyo_record::summary::Summary;

use model_core::Faults;
use thermyo_simulation::run;

fn run_with(sensor: &str) -> (Summary, Faults) {
    // The plant's air follows the core's own law: the remaining error is the sensor's.
    let text = format!(
        "[run]\nduration_s = 60\n[plant]\nmodel = \"lumped\"\n[heat]\nmodel = \"constant\"\n{sensor}"
    );
    let loaded = thermyo_setup::parse(&text, "thermistor.toml".as_ref()).unwrap();
    let mut faults = Faults::NONE;
    let summary = run::on_core(&loaded, |row| faults = faults.with(row.telemetry.faults)).unwrap();
    (summary, faults)
}

#[test]
fn the_estimate_is_as_good_from_a_thermistor() {
    let (platinum, _) = run_with("");
    let ntc = "[sensor.gas]\nkind = \"ntc\"\n[sensor.ntc]\nbeta_k = 3435.0\nseries_ohm = 6800.0\n";
    let (thermistor, faults) = run_with(ntc);
    assert_eq!(faults, Faults::NONE);
    let (known, found) = (platinum.rmse_k.estimate, thermistor.rmse_k.estimate);
    // The errors are 0.072 and 0.024 K.
    assert!((1.0..5.0).contains(&(found / known)), "{found} K, {known} K from a Pt1000");
    // A core configured with another Beta reads wrong temperatures.
    let (wrong, _) = run_with(&format!("{ntc}[believed.sensor.ntc]\nbeta_k = 3700.0\n"));
    assert!(wrong.rmse_k.estimate > 1.5 * found, "{} K", wrong.rmse_k.estimate);
}

#[test]
fn what_is_no_thermistor_is_named() {
    let text = "[sensor.gas]\nkind = \"ntc\"\n[sensor.ntc]\nbeta_k = 3.9\n";
    let error = thermyo_setup::parse(text, "given.toml".as_ref()).unwrap_err().to_string();
    assert!(
        error.starts_with("given.toml:4: sensor.ntc.beta_k = 3.9: must be a number"),
        "{error}"
    );
}
