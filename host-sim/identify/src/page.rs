//! `report.html` of an identification: fit over data, residuals, correlations, open parameters.

use super::Identified;
use super::data::{Observed, Quantity};
use super::findings::Rmse;
use std::collections::BTreeMap;
use thermyo_files::number::{MISSING, fixed, significant};
use thermyo_files::units::Unit;
use thermyo_fit::Fitted;
use thermyo_report::Colour;
use thermyo_report::chart::{Axis, Chart, Panel};
use thermyo_report::page::{Page, Section, Table, Tile};

pub fn page(identified: &Identified, title: &str) -> String {
    let findings = &identified.findings;
    let lead = match findings.failed() {
        Some(what) => format!("Not to be relied on: {what}."),
        None => format!(
            "{} of {} searches from different starts ended at the same values.",
            findings.searches.agreeing, findings.searches.starts
        ),
    };
    let page = Page::new(title, &lead, &thermyo_setup::render(&identified.scenario));
    let tiles = |of: &'static str, rmse: Rmse| {
        let tile =
            move |(name, value, unit, _)| Tile::new(&format!("RMS {name}, {of}"), value, unit);
        rmse.each().map(tile)
    };
    let against = findings.against.into_iter().flat_map(|rmse| tiles("not fitted", rmse));
    tiles("fitted", findings.rmse)
        .chain(against)
        .fold(page, Page::tile)
        .section(values(identified))
        .section(charts(identified))
        .section(correlations(identified))
        .render()
}

fn values(identified: &Identified) -> Section {
    let columns = ["Parameter", "Value", "Standard error", "Relative", "Unit"];
    let rows = identified.findings.parameters.iter().map(|(path, fitted)| {
        let error = fitted.standard_error;
        let or_missing = |text: Option<String>| text.unwrap_or_else(|| MISSING.to_owned());
        vec![
            path.clone(),
            significant(fitted.value, 5),
            or_missing(error.map(|error| significant(error, 2))),
            or_missing(error.map(|error| format!("{:.1} %", 100.0 * error / fitted.value))),
            fitted.unit.to_owned(),
        ]
    });
    let table = Table::new("Identified values, in SI", &columns, rows);
    let section = Section::new("Values").table(table);
    let remarks = &identified.findings.remarks;
    if remarks.is_empty() {
        section.paragraph("The data tell all parameters apart.")
    } else {
        remarks.iter().fold(section, |section, remark| section.paragraph(remark))
    }
}

pub fn values_of(parameters: &BTreeMap<&str, Fitted>) -> Section {
    let rows = parameters.iter().map(|(path, fitted)| {
        let error = significant(fitted.standard_error.unwrap_or(f64::NAN), 2);
        vec![(*path).to_owned(), significant(fitted.value, 5), error, fitted.unit.to_owned()]
    });
    let columns = ["Parameter", "Value", "Standard error", "Unit"];
    Section::new("Values").table(Table::new("Identified values, in SI", &columns, rows))
}

fn label(quantity: Quantity) -> &'static str {
    match quantity {
        Quantity::Pressure => "Pressure",
        Quantity::Length => "Length",
        Quantity::SensorGas => "Sensor in the gas",
        Quantity::SensorWall => "Sensor in the wall",
    }
}

/// Panels of data and fit, one for each quantity, and panels of the residuals.
fn panels(identified: &Identified) -> [Vec<Panel>; 2] {
    let [mut fit, mut rest] = [Vec::new(), Vec::new()];
    for (observed, residuals) in identified.data.observed.iter().zip(&identified.residuals) {
        let Observed { quantity, points, .. } = observed;
        let unit = Unit::of_column(quantity.column());
        let times: Vec<f64> = points.iter().map(|point| point.0).collect();
        let measured: Vec<f64> = points.iter().map(|point| point.1).collect();
        let fitted: Vec<f64> = measured.iter().zip(residuals).map(|(m, r)| m + r).collect();
        fit.push(
            Panel::new(Axis::new(label(*quantity), unit.symbol))
                .dots("measured", Colour::Ink, &times, &unit.convert(&measured))
                .line("fitted", Colour::Vermillion, &times, &unit.convert(&fitted)),
        );
        let axis = Axis::new(&format!("{}, fitted less measured", label(*quantity)), unit.symbol);
        rest.push(
            Panel::new(axis)
                .height(150.0)
                .dots("", Colour::Blue, &times, &unit.convert(residuals))
                .reference(0.0, "0"),
        );
    }
    [fit, rest]
}

fn chart(panels: Vec<Panel>) -> Chart {
    panels.into_iter().fold(Chart::new(Axis::new("Time", "s")), Chart::panel)
}

/// Data, fit and residuals as a separate drawing.
pub fn plot(identified: &Identified, title: &str) -> String {
    chart(panels(identified).into_iter().flatten().collect()).document(title)
}

fn charts(identified: &Identified) -> Section {
    let [fit, rest] = panels(identified).map(chart);
    Section::new("Fit")
        .figure(fit.figure("Fit over data", "The model with the identified values."))
        .figure(rest.figure(
            "Residuals",
            "Scatter is the sensor's; a trend from point to point is the model's.",
        ))
}

fn correlations(identified: &Identified) -> Section {
    let table = &identified.findings.correlations;
    let section = Section::new("Correlations");
    if table.is_empty() {
        return section.paragraph("The data leave the parameters open: there are none to state.");
    }
    let mut columns = vec!["Parameter".to_owned()];
    columns.extend(table.keys().cloned());
    let rows = table.iter().map(|(path, row)| {
        let mut cells = vec![path.clone()];
        cells.extend(row.values().map(|correlation| fixed(*correlation, 3)));
        cells
    });
    section
        .paragraph(
            "How the errors of two parameters go together: at 1 or −1 only their ratio or product is \
             known.",
        )
        .table(Table { caption: String::new(), columns, rows: rows.collect() })
}
