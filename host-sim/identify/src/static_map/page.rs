//! `report.html` of a static map: force over pressure, and the residuals of the law.

use super::{Findings, Identified, Readings};
use crate::page::values_of;
use thermyo_files::number::{short, significant};
use thermyo_report::Colour;
use thermyo_report::chart::{Axis, Chart, Panel};
use thermyo_report::heatmap::{Heatmap, Style};
use thermyo_report::page::{Page, Section, Tile};

/// Number of bins along a map's axis; readings in one bin share a cell.
const PARTS: f64 = 30.0;
/// Number of lengths above which neighbouring ones share a curve, such as the measured lengths of a loop.
const MOST_LENGTHS: usize = 40;

pub fn page(identified: &Identified, title: &str) -> String {
    let findings = &identified.findings;
    let lead = findings.failed().unwrap_or_else(|| {
        "Braid, a bladder that fills, and a slack of the length, fitted to static readings."
            .to_owned()
    });
    let page = Page::new(title, &lead, &thermyo_setup::render(&identified.scenario))
        .tile(Tile::new("RMS residual", findings.rmse.force_n, "N"));
    let page = match &findings.against {
        Some(against) => page.tile(Tile::new("RMS against other readings", against.force_n, "N")),
        None => page,
    };
    page.section(values(identified)).section(fit(identified)).render()
}

fn values(identified: &Identified) -> Section {
    let Findings { parameters, remarks, .. } = &identified.findings;
    remarks.iter().fold(values_of(parameters), |section, remark| section.paragraph(remark))
}

fn distinct(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    values
}

fn lengths_m(readings: &Readings) -> Vec<f64> {
    distinct(readings.loaded.iter().map(|reading| reading.length_m))
}

fn chart(identified: &Identified) -> Chart {
    let readings = &identified.readings;
    let mut lengths_m = curves(&lengths_m(readings));
    lengths_m.reverse();
    let mut panel = Panel::new(Axis::new("Force", "N"));
    let mut rest = Panel::new(Axis::new("Law less reading", "N")).height(170.0);
    let mut coloured: Vec<_> = lengths_m.iter().zip(colours(lengths_m.len())).collect();
    // Grey lies below the colours.
    coloured.sort_by_key(|(_, colour)| *colour != Colour::Grey);
    for ([low_m, high_m], colour) in coloured {
        let all = readings.loaded.iter().zip(&identified.residuals_n);
        let mut rows: Vec<_> = all.filter(|(r, _)| within([*low_m, *high_m], r.length_m)).collect();
        rows.sort_by(|(a, _), (b, _)| a.gauge_pressure_pa.total_cmp(&b.gauge_pressure_pa));
        let rows = || rows.iter();
        let kilopascals: Vec<f64> = rows().map(|(r, _)| r.gauge_pressure_pa / 1000.0).collect();
        let measured: Vec<f64> = rows().map(|(reading, _)| reading.force_n).collect();
        let left: Vec<f64> = rows().map(|(_, left_n)| **left_n).collect();
        let name = match colour {
            Colour::Grey => "lengths between".to_owned(),
            _ => format!("{} mm", significant(500.0 * (low_m + high_m), 4)),
        };
        panel = panel.dots(&name, colour, &kilopascals, &measured);
        // Friction has a law for each direction.
        for direction in [-1.0, 0.0, 1.0] {
            let one_way = rows().filter(|(reading, _)| reading.direction == direction);
            let (kilopascals, law): (Vec<f64>, Vec<f64>) = one_way
                .map(|(r, left_n)| (r.gauge_pressure_pa / 1000.0, r.force_n + **left_n))
                .unzip();
            panel = panel.line("", colour, &kilopascals, &law);
        }
        rest = rest.dots("", colour, &kilopascals, &left);
    }
    Chart::new(Axis::new("Gauge pressure", "kPa")).panel(panel).panel(rest.reference(0.0, "0"))
}

/// Colours of this many curves in the order of their lengths: a colour each, or, where there are
/// more of them, evenly spaced ones and grey between.
fn colours(number: usize) -> Vec<Colour> {
    let named = Colour::CURVES;
    let mut colours = vec![Colour::Grey; number];
    for (n, colour) in named.iter().enumerate().take(number) {
        let last = named.len() - 1;
        let place = if number > named.len() { (n * (number - 1) + last / 2) / last } else { n };
        colours[place] = *colour;
    }
    colours
}

/// Readings and law as a separate drawing.
pub fn plot(identified: &Identified, title: &str) -> String {
    chart(identified).document(title)
}

fn fit(identified: &Identified) -> Section {
    let readings = &identified.readings;
    let section = Section::new("Fit").figure(chart(identified).figure(
        "Readings and law",
        "Dots: readings at each length; lines: the law. Below: what it leaves. Of more than seven \
         lengths, seven have a colour.",
    ));
    let lengths_m = groups(&lengths_m(readings));
    let pressures_pa =
        groups(&distinct(readings.loaded.iter().map(|reading| reading.gauge_pressure_pa)));
    let cell = |length_m: &[f64; 2], gauge_pa: &[f64; 2]| {
        let all = readings.loaded.iter().zip(&identified.residuals_n);
        all.filter(|(r, _)| within(*length_m, r.length_m) && within(*gauge_pa, r.gauge_pressure_pa))
            .map(|(_, left_n)| *left_n)
            .max_by(|a, b| a.abs().total_cmp(&b.abs()))
            .unwrap_or(f64::NAN)
    };
    // Middle of a group, to a tenth of the shown unit.
    let named = |groups: &[[f64; 2]], per_si: f64| -> Vec<String> {
        let middles = groups.iter().map(|[low, high]| 0.5 * per_si * (low + high));
        middles.map(|middle| short((10.0 * middle).round() / 10.0)).collect()
    };
    let map = Heatmap {
        x_label: "Gauge pressure, kPa".to_owned(),
        y_label: "Length, mm".to_owned(),
        value_label: "Law less reading, N".to_owned(),
        x: named(&pressures_pa, 1.0e-3),
        y: named(&lengths_m, 1.0e3),
        cells: lengths_m
            .iter()
            .map(|length_m| pressures_pa.iter().map(|gauge_pa| cell(length_m, gauge_pa)).collect())
            .collect(),
        style: Style { signed: true, ..Style::default() },
    };
    section.figure(map.figure(
        "Residual map",
        "Empty where the muscle was slack, or not measured. Of several readings in a cell the worst is shown.",
    ))
}

/// Ends of the lengths of each curve.
fn curves(lengths_m: &[f64]) -> Vec<[f64; 2]> {
    if lengths_m.len() > MOST_LENGTHS {
        return groups(lengths_m);
    }
    lengths_m.iter().map(|length_m| [*length_m; 2]).collect()
}

fn within([low, high]: [f64; 2], value: f64) -> bool {
    (low..=high).contains(&value)
}

/// Groups rising values that lie close together; returns the ends of each group.
fn groups(values: &[f64]) -> Vec<[f64; 2]> {
    let span = values.last().zip(values.first()).map_or(0.0, |(last, first)| last - first);
    let mut groups: Vec<[f64; 2]> = Vec::new();
    for value in values {
        match groups.last_mut() {
            Some([first, last]) if value - *first < span / PARTS => *last = *value,
            _ => groups.push([*value; 2]),
        }
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Thirty lengths used to repeat seven colours, so that four or five of them looked the same.
    #[test]
    fn no_two_lengths_share_a_colour() {
        for number in 0..=MOST_LENGTHS {
            let mut named = colours(number);
            assert_eq!(named.len(), number);
            let ends = [named.first(), named.last()];
            assert!(!ends.contains(&Some(&Colour::Grey)), "{number}: {named:?}");
            named.retain(|colour| *colour != Colour::Grey);
            assert_eq!(named, Colour::CURVES[..number.min(7)]);
        }
    }

    /// A loop has a length of its own in each row, and its page used to have as many curves.
    #[test]
    fn many_lengths_share_curves() {
        let lengths_m = |number: u32| -> Vec<f64> {
            (0..number).map(|i| 0.2 + 0.05 * f64::from(i) / f64::from(number)).collect()
        };
        assert_eq!(curves(&lengths_m(40)).len(), 40);
        let shared = curves(&lengths_m(100_000));
        assert!((25..=31).contains(&shared.len()), "{shared:?}");
        assert!(shared.iter().all(|[low, high]| low < high), "{shared:?}");
    }
}
