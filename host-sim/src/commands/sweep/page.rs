//! `report.html` of a sweep: a line over one key, a map over two, a pair of maps for each value of a
//! third.

use super::outcome::{BARE, ESTIMATE, WAYS, ends};
use super::reach::with_unit;
use super::{Outcome, Sweep};
use crate::report::Colour;
use crate::report::chart::{Axis, Chart, Panel};
use crate::report::heatmap::{Heatmap, Style};
use crate::report::number::{fixed, short};
use crate::report::page::{Figure, Page, Section, Table, Tile};
use crate::report::scale::{Spacing, data_range};
use crate::scenario;

/// Colours of the ways, as in the report of a run.
const COLOURS: [Colour; 4] = [Colour::Vermillion, Colour::Orange, Colour::Green, Colour::Blue];
/// From this ratio on, the errors' scale is logarithmic.
const WIDE: f64 = 5.0;

/// The page.
pub fn page(outcome: &Outcome, title: &str, within_k: f64) -> String {
    let sweep = outcome.sweep;
    let conclusion = outcome.conclusion(within_k);
    let page = Page::new(title, &conclusion, &scenario::render(&sweep.base));
    tiles(outcome, within_k)
        .into_iter()
        .fold(page, Page::tile)
        .section(maps(outcome, within_k))
        .section(limits(outcome, within_k))
        .section(how(outcome))
        .render()
}

fn tiles(outcome: &Outcome, within_k: f64) -> Vec<Tile> {
    let summary = outcome.summary(within_k);
    let share = |way: usize| {
        let within = summary.errors.get(WAYS[way].1).map_or(0, |extent| extent.within);
        format!("Within {within_k} K: {within} of {} points", summary.run)
    };
    let least = |way: usize| summary.errors.get(WAYS[way].1).and_then(|extent| extent.min_k);
    let tile = |way: usize, who: &str| {
        let label = format!("{who}, smallest RMS error. {}", share(way));
        Tile::new(&label, least(way).unwrap_or(f64::NAN), "K")
    };
    vec![tile(BARE, "Bare sensor in the gas"), tile(ESTIMATE, "Estimate")]
}

/// The axis text of a key.
fn axis(sweep: &Sweep, key: usize) -> String {
    let (name, unit) = (&sweep.ranges[key].key, sweep.unit(key));
    if unit.is_empty() { name.clone() } else { format!("{name} [{unit}]") }
}

fn maps(outcome: &Outcome, within_k: f64) -> Section {
    let sweep = outcome.sweep;
    let section = Section::new("Which sensor is fast enough");
    let several: Vec<usize> =
        (0..sweep.ranges.len()).filter(|key| sweep.ranges[*key].values.len() > 1).collect();
    match several[..] {
        [x, y] => section.figures(pair(outcome, (x, y), &[], within_k)),
        [x, y, z] => {
            let values = sweep.ranges[z].values.iter().enumerate();
            values.fold(section, |section, (place, _)| {
                section.figures(pair(outcome, (x, y), &[(z, place)], within_k))
            })
        }
        _ => section.figure(lines(outcome, within_k)),
    }
}

/// Errors of all ways over one key.
fn lines(outcome: &Outcome, within_k: f64) -> Figure {
    let sweep = outcome.sweep;
    let key = outcome.main_key();
    let range = &sweep.ranges[key];
    let mut panel =
        Panel::new(Axis::new("RMS error against the plant's gas temperature", "K").log());
    panel = panel.height(300.0);
    for (way, (name, ..)) in WAYS.iter().enumerate() {
        let errors = outcome.errors_k(way);
        panel = panel.line(name, COLOURS[way], &range.values, &errors).dots(
            "",
            COLOURS[way],
            &range.values,
            &errors,
        );
    }
    let x = Axis::new(&range.key, sweep.unit(key));
    let x = if range.logarithmic { x.log() } else { x };
    let panel = panel.reference(within_k, &format!("{within_k} K"));
    Chart::new(x).panel(panel).figure(
        "Errors of each way to know the gas temperature",
        "Every point is a run of its own.",
    )
}

/// Maps of bare sensor and estimate on one colour scale, other keys held in their places.
fn pair(
    outcome: &Outcome,
    (x, y): (usize, usize),
    held: &[(usize, usize)],
    within_k: f64,
) -> Vec<Figure> {
    let sweep = outcome.sweep;
    let of_both = || [BARE, ESTIMATE].into_iter().flat_map(|way| outcome.errors_k(way));
    let (low, high) = data_range(of_both(), Spacing::Linear);
    let spacing = if low > 0.0 && high > WIDE * low { Spacing::Log } else { Spacing::Linear };
    let held_text: String = held
        .iter()
        .map(|(key, place)| {
            let range = &sweep.ranges[*key];
            format!(", {} = {}", range.key, with_unit(range.values[*place], sweep.unit(*key)))
        })
        .collect();
    let map = |way: usize, who: &str, caption: &str| {
        let errors = outcome.errors_k(way);
        let mut cells =
            vec![vec![f64::NAN; sweep.ranges[x].values.len()]; sweep.ranges[y].values.len()];
        for (point, error) in errors.into_iter().enumerate() {
            let places = sweep.places(point);
            if held.iter().all(|(key, place)| places[*key] == *place) {
                cells[places[y]][places[x]] = error;
            }
        }
        Heatmap {
            x_label: axis(sweep, x),
            y_label: axis(sweep, y),
            value_label: "K".to_owned(),
            x: sweep.ranges[x].values.clone(),
            y: sweep.ranges[y].values.clone(),
            cells,
            style: Style {
                range: Some((low, high)),
                spacing,
                limit: Some((within_k, format!("within {within_k} K"))),
                half: true,
            },
        }
        .figure(&format!("{who}{held_text}"), caption)
    };
    vec![
        map(BARE, "Bare sensor", "RMS error of the sensor's reading."),
        map(ESTIMATE, "Estimate", "RMS error of the core's estimate, on the same scale."),
    ]
}

/// A line of a table per line of the grid along the main key: where each way is good enough.
fn limits(outcome: &Outcome, within_k: f64) -> Section {
    let sweep = outcome.sweep;
    let main = outcome.main_key();
    let others: Vec<usize> = (0..sweep.ranges.len()).filter(|key| *key != main).collect();
    let mut columns: Vec<String> = others.iter().map(|key| axis(sweep, *key)).collect();
    columns.extend(WAYS.iter().map(|(name, ..)| (*name).to_owned()));
    let reaches: Vec<_> = (0..WAYS.len()).map(|way| outcome.reaches(way, within_k)).collect();
    let row = |(i, line): (usize, Vec<usize>)| {
        let values = sweep.values(line[0]);
        let mut cells: Vec<String> = others.iter().map(|key| short(values[*key])).collect();
        cells.extend(reaches.iter().map(|lines| lines[i].text(sweep.unit(main))));
        cells
    };
    let rows = outcome.lines(main).into_iter().enumerate().map(row).collect();
    let caption = format!("{}: where the RMS error is within {within_k} K", sweep.ranges[main].key);
    let section = Section::new("Limits").table(Table { caption, columns, rows });
    section.paragraph("Limits are interpolated between the points of the grid.")
}

fn how(outcome: &Outcome) -> Section {
    let sweep = outcome.sweep;
    let rows = sweep.ranges.iter().enumerate().map(|(i, range)| {
        let (first, last) = (range.values[0], range.values[range.values.len() - 1]);
        let spaced = if range.logarithmic { "ratio" } else { "difference" };
        vec![
            axis(sweep, i),
            range.values.len().to_string(),
            short(first),
            short(last),
            spaced.to_owned(),
        ]
    });
    let columns = ["Key", "Values", "From", "To", "The same from value to value"];
    let mut section = Section::new("What was run").table(Table {
        caption: String::new(),
        columns: columns.map(str::to_owned).to_vec(),
        rows: rows.collect(),
    });
    let mut text = format!(
        "Shard {}: {} of {} points, each a run of its own; errors count from 10 s on, or over the second \
         half of a run shorter than 20 s.",
        sweep.shard,
        outcome.rows.len(),
        sweep.grid()
    );
    let shares = ends(outcome.figures().map(|figures| figures.within_2sd));
    if let [Some(low), Some(high)] = shares {
        text += &format!(
            " The truth lay within two stated standard deviations of the estimate in {} to {} % of the time.",
            fixed(100.0 * low, 0),
            fixed(100.0 * high, 0)
        );
    }
    section = section.paragraph(&text);
    for key in outcome.without_effect() {
        section = section.paragraph(&format!("{key} changes nothing in this scenario."));
    }
    match outcome.failed() {
        Some(failed) => section.paragraph(&format!("{failed}. Their cells are empty.")),
        None => section,
    }
}
