//! Pages with stops: estimate against measurement, and how the gas relaxes.

use super::{Analysis, Rows, Stop};
use thermyo_files::number::{MISSING, fixed, significant};
use thermyo_report::Colour;
use thermyo_report::chart::{Axis, Chart, Panel};
use thermyo_report::page::{Page, Section, Table, Tile};
use thermyo_setup::Loaded;

/// A page with tiles of the figures.
pub fn begun(title: &str, lead: &str, loaded: &Loaded, analysis: &Analysis) -> Page {
    let page = Page::new(title, lead, &thermyo_setup::render(loaded));
    let mut tiles = Vec::new();
    let rms = |of: fn(&Stop) -> Option<f64>| analysis.rms_k(of);
    if let Some(error_k) = rms(Stop::estimate_error_k) {
        tiles.push(Tile::new("Estimate less measured, RMS", error_k, "K"));
    }
    if let Some(bare_k) = rms(|stop| Some(stop.sensor_k - stop.gas_k)) {
        tiles.push(Tile::new("Bare sensor less measured, RMS", bare_k, "K"));
    }
    if let Some(sd_k) = rms(|stop| Some(stop.gas_sd_k)) {
        tiles.push(Tile::new("Uncertainty of a measurement", sd_k, "K"));
    }
    if let Some(heat) = analysis.heat.as_ref().filter(|heat| heat.parted) {
        tiles.push(Tile::new("Heat transfer, still gas", heat.still_w_m2_k.value, "W/(m2 K)"));
    }
    tiles.into_iter().fold(page, Page::tile)
}

/// Adds the stops, the relaxation and the values.
pub fn with_stops(page: Page, analysis: &Analysis, rows: &Rows, remarks: &[String]) -> Page {
    page.section(at_stops(analysis, remarks)).section(
        Section::new("After each stop").figure(relaxations(analysis, rows).figure(
            "The gas relaxes to its wall",
            "Above: the measured temperature of the gas, T = T_end (P V)/(P V)_end, less that at the end. Below: \
             what the sensor reads of it, and the estimate less the measurement.",
        )),
    ).section(values(analysis))
}

fn at_stops(analysis: &Analysis, remarks: &[String]) -> Section {
    let usable: Vec<&Stop> = analysis.usable().collect();
    let times: Vec<f64> = usable.iter().map(|stop| stop.time_s).collect();
    let column = |of: &dyn Fn(&Stop) -> f64| -> Vec<f64> {
        usable.iter().map(|stop| of(stop) - stop.gas_k).collect()
    };
    let low = column(&|stop| stop.gas_k - 2.0 * stop.gas_sd_k);
    let high = column(&|stop| stop.gas_k + 2.0 * stop.gas_sd_k);
    let mut panel = Panel::new(Axis::new("Less the measured gas temperature", "K"))
        .height(240.0)
        .band("± 2 standard deviations of the measurement", Colour::Grey, &times, &low, &high)
        .reference(0.0, "measured");
    if usable.iter().all(|stop| stop.estimate_k.is_some()) {
        panel = panel.dots(
            "estimate",
            Colour::Estimate,
            &times,
            &column(&|stop| stop.estimate_k.unwrap_or(f64::NAN)),
        );
    }
    if usable.iter().all(|stop| stop.truth_k.is_some()) {
        panel = panel.dots(
            "plant",
            Colour::Truth,
            &times,
            &column(&|stop| stop.truth_k.unwrap_or(f64::NAN)),
        );
    }
    let chart = Chart::new(Axis::new("Time", "s")).panel(panel);
    let section =
        Section::new("At the stops").figure(chart.figure(
            "Estimate and measurement at each stop",
            "Both valves were shut at these times.",
        ));
    let section = section.table(table(analysis));
    remarks.iter().fold(section, |section, remark| section.paragraph(remark))
}

fn table(analysis: &Analysis) -> Table {
    let or_missing = |value: Option<f64>| value.map_or_else(|| MISSING.to_owned(), |k| fixed(k, 2));
    let rows = analysis.stops.iter().map(|stop| {
        vec![
            fixed(stop.time_s, 2),
            fixed(stop.pressure_pa / 1e3, 1),
            fixed(stop.gas_k, 2),
            fixed(stop.gas_sd_k, 2),
            or_missing(stop.estimate_k),
            or_missing(stop.estimate_sd_k),
            or_missing(stop.truth_k),
            fixed(stop.sensor_k, 2),
            fixed(stop.end_k, 2),
            if stop.usable() { "✓" } else { "✗" }.to_owned(),
        ]
    });
    let columns = [
        "Time, s",
        "Pressure, kPa",
        "Measured, K",
        "±, K",
        "Estimate, K",
        "±, K",
        "Plant, K",
        "Sensor, K",
        "At the end, K",
        "Counts",
    ];
    Table {
        caption: "One standard deviation each".to_owned(),
        columns: columns.map(str::to_owned).to_vec(),
        rows: rows.collect(),
    }
}

/// Gas, sensor and error of the estimate over the time since each stop.
pub fn relaxations(analysis: &Analysis, rows: &Rows) -> Chart {
    let kelvin = |label: &str| Axis::new(label, "K");
    let mut gas = Panel::new(kelvin("Gas less its end")).height(240.0);
    let mut sensor = Panel::new(kelvin("Sensor less that end")).height(180.0);
    let mut error = Panel::new(kelvin("Estimate less measured")).height(180.0);
    for (i, stop) in analysis.stops.iter().enumerate().filter(|(_, stop)| stop.usable()) {
        let of = &rows.rows[stop.rows.clone()];
        let times: Vec<f64> = of.iter().map(|row| row.time_s - stop.time_s).collect();
        let gas_k: Vec<f64> = stop.curve_k.iter().map(|k| k - stop.end_k).collect();
        let sensor_k: Vec<f64> = of.iter().map(|row| row.sensor_k - stop.end_k).collect();
        gas = gas.nth_line(i, &format!("stop {}", i + 1), &times, &gas_k);
        sensor = sensor.nth_line(i, "", &times, &sensor_k);
        let errors: Vec<f64> = of
            .iter()
            .zip(&stop.curve_k)
            .map(|(row, k)| row.estimate_k.unwrap_or(f64::NAN) - k)
            .collect();
        error = error.nth_line(i, "", &times, &errors);
    }
    Chart::new(Axis::new("Time since the stop", "s"))
        .panel(gas)
        .panel(sensor)
        .panel(error.reference(0.0, "0"))
}

fn values(analysis: &Analysis) -> Section {
    let row = |name: &str, value: f64, error: f64, unit: &str| {
        vec![name.to_owned(), significant(value, 4), significant(error, 2), unit.to_owned()]
    };
    let mut rows = Vec::new();
    if let Some(heat) = &analysis.heat {
        let with = |name: &str, found: &super::relaxation::With, unit: &str| {
            row(name, found.value, found.standard_error, unit)
        };
        rows.push(with("Heat transfer, still gas", &heat.still_w_m2_k, "W/(m2 K)"));
        rows.push(with("The same over the configured law", &heat.scale, ""));
        if let Some(stirred) = &heat.stirred_w_m2_k {
            rows.push(with("Added by the jet, when it ends", stirred, "W/(m2 K)"));
        }
        if let Some(per_flow) = &heat.stirred_per_flow {
            rows.push(with("The same per inflow", per_flow, "W/(m2 K) per kg/s"));
        }
        if let Some(decay_s) = &heat.decay_s {
            rows.push(with("Time constant with which that decays", decay_s, "s"));
        }
    }
    if let Some(sensor) = &analysis.sensor {
        let with = |name: &str, value: f64, sd: f64, unit: &str| row(name, value, value * sd, unit);
        rows.push(with("Lag of the element", sensor.lag_s, sensor.lag_sd, "s"));
        rows.push(with(
            "Lag of housing and still gas around it",
            sensor.housing_s,
            sensor.housing_sd,
            "s",
        ));
        rows.push(with(
            "Gas at the sensor over the mean",
            sensor.location_factor,
            sensor.location_sd,
            "",
        ));
    }
    let table = Table {
        caption: "With standard errors, by leaving out one stop at a time".to_owned(),
        columns: ["Quantity", "Value", "±", "Unit"].map(str::to_owned).to_vec(),
        rows,
    };
    Section::new("Heat transfer and sensor").table(table)
}
