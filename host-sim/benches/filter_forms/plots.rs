//! The plots of `docs/estimator.md`.

use crate::record::Recording;
use host_sim::core_config::core_config;
use host_sim::report::Colour;
use host_sim::report::chart::{Axis, Chart, Panel};
use host_sim::scenario::Loaded;
use host_sim::smoother;
use std::{fs, io};

const STYLE: &str = include_str!("../../src/report/style.css");
const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs");
/// Steps from point to point.
const EVERY: usize = 20;

/// Writes both plots.
pub fn write(full: &Loaded, nominal: &Recording, low: &[Vec<f64>; 2]) -> io::Result<()> {
    save("estimator_error.svg", &error(full, nominal))?;
    save("estimator_gains.svg", &gains(low))
}

/// A drawing that stands alone: with the page's style and paper.
fn save(name: &str, chart: &Chart) -> io::Result<()> {
    let figure = chart.figure(name, "");
    let (head, body) = figure.svg().split_once('>').expect("an svg element");
    let paper = "<rect width=\"100%\" height=\"100%\" style=\"fill:var(--paper)\"/>";
    fs::write(format!("{FOLDER}/{name}"), format!("{head}><style>{STYLE}</style>{paper}{body}\n"))
}

fn thinned(values: impl Iterator<Item = f64>) -> Vec<f64> {
    values.step_by(EVERY).collect()
}

/// Seconds of a run with so many points.
fn seconds(count: usize) -> Vec<f64> {
    (0..count).map(|i| (i * EVERY) as f64 * 1e-3).collect()
}

/// The last cycles of the nominal run on `full`: temperatures and errors.
fn error(full: &Loaded, nominal: &Recording) -> Chart {
    let Recording { telemetry, truth_k, .. } = nominal;
    let smoothed = smoother::smooth(&core_config(&full.believed), telemetry);
    let truth = || truth_k.iter().copied();
    let estimate = || telemetry.iter().map(|t| f64::from(t.estimate.gas_k));
    let double = |sign: f64| {
        thinned(telemetry.iter().map(move |t| sign * 2.0 * f64::from(t.estimate.gas_sd_k)))
    };
    let minus = |values: Vec<f64>| thinned(values.iter().zip(truth_k).map(|(a, b)| a - b));
    let converter = model_core::front_end::Converter::new(&core_config(&full.believed).front_end);
    let bare = telemetry.iter().map(|t| f64::from(converter.gas_k(t.sample.gas)));
    let (errors, smoother_errors) = (minus(estimate().collect()), minus(smoothed));
    let time = seconds(errors.len());
    let temperatures =
        Panel::new(Axis::new("Gas: truth grey, estimate blue; bare sensor orange", "K"))
            .wide("", Colour::Grey, &time, &thinned(truth()))
            .line("", Colour::Blue, &time, &thinned(estimate()))
            .line("", Colour::Orange, &time, &thinned(bare));
    let errors = Panel::new(Axis::new(
        "Error: estimate blue, band two stated deviations; smoother green",
        "K",
    ))
    .band("", Colour::Blue, &time, &double(-1.0), &double(1.0))
    .line("", Colour::Blue, &time, &errors)
    .line("", Colour::Green, &time, &smoother_errors);
    Chart::new(Axis::new("Time", "s").range(85.0, 100.0)).panel(temperatures).panel(errors)
}

/// Errors with the covariance's gains and with steady ones.
fn gains(errors: &[Vec<f64>; 2]) -> Chart {
    let [shipped, steady] = errors.each_ref().map(|errors| thinned(errors.iter().copied()));
    let time = seconds(shipped.len());
    let panel = Panel::new(Axis::new("Error: steady gains orange, shipped blue", "K"))
        .line("", Colour::Orange, &time, &steady)
        .line("", Colour::Blue, &time, &shipped);
    Chart::new(Axis::new("Time", "s")).panel(panel)
}
