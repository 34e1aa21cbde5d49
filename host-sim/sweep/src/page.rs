//! `report.html` of a sweep: a line over one key, a map over two, a pair of maps for each value of a
//! third.

use super::outcome::ends;
use super::reach::with_unit;
use super::ways::{BARE, ESTIMATE, WAYS};
use super::{Outcome, Shard, Study};
use thermyo_files::number::fixed;
use thermyo_report::Colour;
use thermyo_report::chart::{Axis, Chart, Panel};
use thermyo_report::figure::Figure;
use thermyo_report::heatmap::{Heatmap, Style};
use thermyo_report::page::{Page, Section, Table, Tile};
use thermyo_report::scale::{Spacing, data_range};

/// Colours of the methods, as in the report of a run.
const COLOURS: [Colour; 4] = [Colour::Vermillion, Colour::Orange, Colour::Green, Colour::Blue];
/// Largest number of points of a scatter chart, evenly chosen.
const MOST_DOTS: usize = 2000;
/// Ratio above which the errors' scale is logarithmic.
const WIDE: f64 = 5.0;

pub fn page(outcome: &Outcome, within_k: f64) -> String {
    let study = outcome.study;
    let conclusion = outcome.conclusion(within_k);
    let page = Page::new(&format!("Sweep of {}", study.name), &conclusion, &study.scenario);
    let page = tiles(outcome, within_k).into_iter().fold(page, Page::tile);
    let page = if study.plan.is_map() {
        let page = page.section(maps(outcome, within_k)).section(limits(outcome, within_k));
        outcome
            .tracking_errors()
            .map(|errors| set_point(outcome, errors))
            .into_iter()
            .fold(page, Page::section)
    } else {
        page.section(clouds(outcome, within_k))
    };
    page.section(how(outcome)).render()
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

fn axis(study: &Study, key: usize) -> String {
    let (name, unit) = (&study.plan.ranges[key].key, study.unit(key));
    if unit.is_empty() { name.clone() } else { format!("{name} [{unit}]") }
}

fn along(study: &Study, key: usize) -> Axis {
    let range = &study.plan.ranges[key];
    let axis = Axis::new(&range.key, study.unit(key)).words(&range.words);
    if range.logarithmic { axis.log() } else { axis }
}

fn maps(outcome: &Outcome, within_k: f64) -> Section {
    let study = outcome.study;
    let section = Section::new("Which sensor is fast enough");
    match several(study)[..] {
        [x, y] => section.figures(pair(outcome, (x, y), &[], within_k)),
        [x, y, z] => {
            let values = study.plan.ranges[z].values.iter().enumerate();
            values.fold(section, |section, (place, _)| {
                section.figures(pair(outcome, (x, y), &[(z, place)], within_k))
            })
        }
        _ => section.figure(lines(outcome, within_k)),
    }
}

/// Keys that have several values.
fn several(study: &Study) -> Vec<usize> {
    let ranges = &study.plan.ranges;
    (0..ranges.len()).filter(|key| ranges[*key].values.len() > 1).collect()
}

/// Errors of the set point, which have this unit, over the keys.
fn set_point(outcome: &Outcome, (errors, unit): (Vec<f64>, &str)) -> Section {
    let study = outcome.study;
    let section = Section::new("Set point");
    let caption = "RMS error of the set point.";
    let map = |keys, held: &[(usize, usize)]| {
        let style = Style { half: true, ..Style::default() };
        let map =
            Heatmap { value_label: unit.to_owned(), style, ..grid(outcome, keys, held, &errors) };
        map.figure(&format!("Tracking{}", held_text(study, held)), caption)
    };
    match several(study)[..] {
        [x, y] => section.figure(map((x, y), &[])),
        [x, y, z] => {
            let places = 0..study.plan.ranges[z].values.len();
            section.figures(places.map(|place| map((x, y), &[(z, place)])).collect())
        }
        _ => {
            let key = outcome.main_key();
            let values = &study.plan.ranges[key].values;
            let panel = Panel::new(Axis::new("RMS error of the set point", unit))
                .line("", Colour::Blue, values, &errors)
                .dots("", Colour::Blue, values, &errors);
            section.figure(Chart::new(along(study, key)).panel(panel).figure("Tracking", caption))
        }
    }
}

/// Errors of bare sensor and estimate over each key, a dot per point.
fn clouds(outcome: &Outcome, within_k: f64) -> Section {
    let study = outcome.study;
    let every = outcome.rows.len().div_ceil(MOST_DOTS).max(1);
    let shown: Vec<_> = outcome
        .rows
        .iter()
        .step_by(every)
        .filter_map(|row| Some((study.plan.values(row.point), row.figures.as_ref().ok()?)))
        .collect();
    let section = Section::new("Errors over each key");
    study.plan.ranges.iter().enumerate().fold(section, |section, (key, range)| {
        let values: Vec<f64> = shown.iter().map(|(values, _)| values[key]).collect();
        let panel =
            Panel::new(Axis::new("RMS error against the plant's gas temperature", "K").log());
        let panel = [BARE, ESTIMATE].into_iter().fold(panel.height(220.0), |panel, way| {
            let errors: Vec<f64> = shown.iter().map(|(_, f)| WAYS[way].2(&f.rmse_k)).collect();
            panel.dots(WAYS[way].0, COLOURS[way], &values, &errors)
        });
        let panel = panel.reference(within_k, &format!("{within_k} K"));
        let chart = Chart::new(along(study, key)).panel(panel);
        section.figure(chart.figure(&range.key, "Every dot is a run of its own."))
    })
}

/// Errors of all methods over one key.
fn lines(outcome: &Outcome, within_k: f64) -> Figure {
    let study = outcome.study;
    let key = outcome.main_key();
    let range = &study.plan.ranges[key];
    let mut panel =
        Panel::new(Axis::new("RMS error against the plant's gas temperature", "K").log());
    panel = panel.height(300.0);
    for (way, (name, ..)) in outcome.ways() {
        let errors = outcome.errors_k(way);
        panel = panel.line(name, COLOURS[way], &range.values, &errors).dots(
            "",
            COLOURS[way],
            &range.values,
            &errors,
        );
    }
    let panel = panel.reference(within_k, &format!("{within_k} K"));
    Chart::new(along(study, key)).panel(panel).figure(
        "Errors of each way to know the gas temperature",
        "Every point is a run of its own.",
    )
}

/// Maps of bare sensor and estimate on one colour scale, with the other keys fixed.
fn pair(
    outcome: &Outcome,
    keys: (usize, usize),
    held: &[(usize, usize)],
    within_k: f64,
) -> Vec<Figure> {
    let of_both = || [BARE, ESTIMATE].into_iter().flat_map(|way| outcome.errors_k(way));
    let (low, high) = data_range(of_both(), Spacing::Linear);
    let spacing = if low > 0.0 && high > WIDE * low { Spacing::Log } else { Spacing::Linear };
    let map = |way: usize, who: &str, caption: &str| {
        let style = Style {
            range: Some((low, high)),
            spacing,
            limit: Some((within_k, format!("within {within_k} K"))),
            half: true,
            signed: false,
        };
        let grid = grid(outcome, keys, held, &outcome.errors_k(way));
        let map = Heatmap { value_label: "K".to_owned(), style, ..grid };
        map.figure(&format!("{who}{}", held_text(outcome.study, held)), caption)
    };
    vec![
        map(BARE, "Bare sensor", "RMS error of the sensor's reading."),
        map(ESTIMATE, "Estimate", "RMS error of the core's estimate, on the same scale."),
    ]
}

/// The values of the other keys, as the end of a title.
fn held_text(study: &Study, held: &[(usize, usize)]) -> String {
    let text = |(key, place): &(usize, usize)| {
        let range = &study.plan.ranges[*key];
        let value = match range.words.get(*place) {
            Some(word) => word.clone(),
            None => with_unit(range.values[*place], study.unit(*key)),
        };
        format!(", {} = {value}", range.key)
    };
    held.iter().map(text).collect()
}

/// Map of a figure of each point over two keys, with the other keys fixed.
fn grid(
    outcome: &Outcome,
    (x, y): (usize, usize),
    held: &[(usize, usize)],
    figures: &[f64],
) -> Heatmap {
    let study = outcome.study;
    let places = |key: usize| {
        let range = &study.plan.ranges[key];
        range.values.iter().map(|value| range.shown(*value)).collect()
    };
    let [columns, rows] = [x, y].map(|key| study.plan.ranges[key].values.len());
    let mut cells = vec![vec![f64::NAN; columns]; rows];
    for (point, figure) in figures.iter().enumerate() {
        let places = study.plan.places(point);
        if held.iter().all(|(key, place)| places[*key] == *place) {
            cells[places[y]][places[x]] = *figure;
        }
    }
    Heatmap {
        x_label: axis(study, x),
        y_label: axis(study, y),
        value_label: String::new(),
        x: places(x),
        y: places(y),
        cells,
        style: Style::default(),
    }
}

/// Table with a row per line of the grid along the main key, and the range in which each method is within the limit.
fn limits(outcome: &Outcome, within_k: f64) -> Section {
    let study = outcome.study;
    let main = outcome.main_key();
    let others: Vec<usize> = (0..study.plan.ranges.len()).filter(|key| *key != main).collect();
    let mut columns: Vec<String> = others.iter().map(|key| axis(study, *key)).collect();
    let ways = outcome.ways();
    columns.extend(ways.iter().map(|(_, (name, ..))| (*name).to_owned()));
    let reaches: Vec<_> = ways.iter().map(|(way, _)| outcome.reaches(*way, within_k)).collect();
    let caption =
        format!("{}: where the RMS error is within {within_k} K", study.plan.ranges[main].key);
    let section = Section::new("Limits");
    let interpolated = "Limits are interpolated between the points of the grid.";
    if others.is_empty() {
        // With a single line, the rows are the methods.
        let rows = ways.iter().zip(&reaches).map(|((_, (name, ..)), lines)| {
            vec![(*name).to_owned(), lines[0].text(study.unit(main))]
        });
        let table = Table::new(&caption, &["Gas temperature from", "Within the limit"], rows);
        return section.table(table).paragraph(interpolated);
    }
    let row = |(i, line): (usize, Vec<usize>)| {
        let values = study.plan.values(line[0]);
        let mut cells: Vec<String> =
            others.iter().map(|key| study.plan.ranges[*key].shown(values[*key])).collect();
        cells.extend(reaches.iter().map(|lines| lines[i].text(study.unit(main))));
        cells
    };
    let rows = outcome.lines(main).into_iter().enumerate().map(row).collect();
    section.table(Table { caption, columns, rows }).paragraph(interpolated)
}

fn how(outcome: &Outcome) -> Section {
    let study = outcome.study;
    let rows = study.plan.ranges.iter().enumerate().map(|(i, range)| {
        let (first, last) = (range.values[0], range.values[range.values.len() - 1]);
        let count = match range.interval {
            true => "any between".to_owned(),
            false => range.values.len().to_string(),
        };
        let listed = range.written().contains(',');
        let scale = match (&range.words[..], range.logarithmic) {
            ([], true) => "logarithmic",
            ([], false) if listed => "list",
            ([], false) => "linear",
            _ => "words",
        };
        vec![axis(study, i), count, range.shown(first), range.shown(last), scale.to_owned()]
    });
    let columns = ["Key", "Values", "From", "To", "Scale"];
    let mut section = Section::new("Runs").table(Table::new("", &columns, rows));
    let shard = match study.shard {
        Shard::WHOLE => String::new(),
        shard => format!("Shard {shard}: "),
    };
    let mut text = format!(
        "{shard}{} of {} points, each a run of its own; errors count from 10 s on, or over the second \
         half of a run shorter than 20 s.",
        outcome.rows.len(),
        study.plan.points()
    );
    let shares = ends(outcome.figures().map(|figures| figures.within_2sd));
    if let [Some(low), Some(high)] = shares {
        let [low, high] = [low, high].map(|share| fixed(100.0 * share, 0));
        let shares = if low == high { low } else { format!("{low} to {high}") };
        text += &format!(
            " The truth lay within two stated standard deviations of the estimate in {shares} % of the time."
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
