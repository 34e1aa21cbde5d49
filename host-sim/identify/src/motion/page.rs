//! `report.html` of a record of motion: the record, the law, and its residuals.

use super::Identified;
use crate::page::values_of;
use thermyo_report::Colour;
use thermyo_report::chart::{Axis, Chart, Panel};
use thermyo_report::page::{Page, Section, Tile};

pub fn page(identified: &Identified, title: &str) -> String {
    let findings = &identified.findings;
    let lead = findings.failed().map_or_else(
        || "One slip and two creeping arms beside the static law, fitted to a motion.".to_owned(),
        |why| format!("Not to be relied on: {why}."),
    );
    let page = Page::new(title, &lead, &thermyo_setup::render(&identified.scenario));
    let of = |page: Page, name: &str, left: &super::Left| {
        let page = match left.length_m {
            Some(length_m) => page.tile(Tile::new(&format!("RMS length, {name}"), length_m, "m")),
            None => page,
        };
        page.tile(Tile::new(&format!("RMS force, {name}"), left.force_n, "N"))
    };
    let page = of(page, "fitted", &findings.rmse);
    let page = findings.against.iter().fold(page, |page, left| of(page, "not fitted", left));
    let chart = chart(identified).figure(
        "Record and law",
        "Lengths are those at which the law holds the load at the measured pressure; forces those of the \
         measured length and pressure.",
    );
    page.section(values_of(&findings.parameters))
        .section(Section::new("Fit").figure(chart))
        .render()
}

fn chart(identified: &Identified) -> Chart {
    let rows = &identified.record.rows;
    let times: Vec<f64> = rows.iter().map(|row| row.time_s).collect();
    let (name, unit, scale) =
        if identified.record.has_force { ("Force", "N", 1.0) } else { ("Length", "mm", 1000.0) };
    let measured = rows
        .iter()
        .map(|row| scale * if identified.record.has_force { row.force_n } else { row.length_m });
    let measured: Vec<f64> = measured.collect();
    let left: Vec<f64> = identified.residuals.iter().map(|left| scale * left).collect();
    let law: Vec<f64> = measured.iter().zip(&left).map(|(is, left)| is + left).collect();
    let pressures: Vec<f64> = rows.iter().map(|row| row.pressure_pa / 1000.0).collect();
    let values = Panel::new(Axis::new(name, unit))
        .line("measured", Colour::Ink, &times, &measured)
        .line("law", Colour::Vermillion, &times, &law);
    let rest = Panel::new(Axis::new(&format!("{name}, law less measured"), unit))
        .height(150.0)
        .line("", Colour::Blue, &times, &left)
        .reference(0.0, "0");
    let pressure = Panel::new(Axis::new("Pressure", "kPa")).height(120.0).line(
        "",
        Colour::Green,
        &times,
        &pressures,
    );
    Chart::new(Axis::new("Time", "s")).panel(values).panel(rest).panel(pressure)
}

/// Record and law as a separate drawing.
pub fn plot(identified: &Identified, title: &str) -> String {
    chart(identified).document(title)
}
