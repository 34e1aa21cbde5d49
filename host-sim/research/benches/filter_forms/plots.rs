//! The plots of `docs/background/estimator-trials.md`.

use crate::record::Recording;
use std::{fs, io};
use thermyo_evaluate::smoother;
use thermyo_report::Colour;
use thermyo_report::chart::{Axis, Chart, Panel};
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs");
/// Distance of the points in steps.
const EVERY: usize = 20;

pub fn write(full: &Loaded, nominal: &Recording, low: &[Vec<f64>; 2]) -> io::Result<()> {
    let save = |file: &str, document: String| fs::write(format!("{FOLDER}/{file}"), document);
    let title = "Nominal cycle on the plant full";
    save("estimator_error.svg", error(full, nominal).document(title))?;
    let title = "Heat transfer believed 30 % low, plant lumped: error of the estimate";
    save("estimator_gains.svg", gains(low).document(title))
}

fn thinned(values: impl Iterator<Item = f64>) -> Vec<f64> {
    values.step_by(EVERY).collect()
}

/// Times of a run with so many points \[s\].
fn seconds(count: usize) -> Vec<f64> {
    (0..count).map(|i| (i * EVERY) as f64 * 1e-3).collect()
}

/// The last cycles of the nominal run on `full`: temperatures and errors.
fn error(full: &Loaded, nominal: &Recording) -> Chart {
    let Recording { telemetry, truth_k, .. } = nominal;
    let smoothed = smoother::smooth(&core_config(&full.believed), telemetry).smoothed_k;
    let truth = || truth_k.iter().copied();
    let estimate = || telemetry.iter().map(|t| f64::from(t.estimate.gas_k));
    let double = |sign: f64| {
        thinned(telemetry.iter().map(move |t| sign * 2.0 * f64::from(t.estimate.gas_sd_k)))
    };
    let minus = |values: Vec<f64>| thinned(values.iter().zip(truth_k).map(|(a, b)| a - b));
    let sensing = core_config(&full.believed).sensing();
    let bare = telemetry.iter().map(|t| f64::from(sensing.gas_k(t.sample.gas)));
    let (errors, smoother_errors) = (minus(estimate().collect()), minus(smoothed));
    let time = seconds(errors.len());
    let temperatures = Panel::new(Axis::new("Gas temperature", "K"))
        .wide("truth", Colour::Truth, &time, &thinned(truth()))
        .line("estimate", Colour::Estimate, &time, &thinned(estimate()))
        .line("bare sensor", Colour::Sensor, &time, &thinned(bare));
    let errors = Panel::new(Axis::new("Error", "K"))
        .band("two stated deviations", Colour::Estimate, &time, &double(-1.0), &double(1.0))
        .line("estimate", Colour::Estimate, &time, &errors)
        .line("smoother", Colour::Green, &time, &smoother_errors);
    Chart::new(Axis::new("Time", "s").range(85.0, 100.0)).panel(temperatures).panel(errors)
}

/// Errors with the covariance's gains and with steady ones.
fn gains(errors: &[Vec<f64>; 2]) -> Chart {
    let [shipped, steady] = errors.each_ref().map(|errors| thinned(errors.iter().copied()));
    let time = seconds(shipped.len());
    let panel = Panel::new(Axis::new("Error", "K"))
        .line("steady gains", Colour::Orange, &time, &steady)
        .line("gains of the covariance (shipped)", Colour::Blue, &time, &shipped);
    Chart::new(Axis::new("Time", "s")).panel(panel)
}
