//! Line charts: one or more panels over a shared x axis, and curves in the plane.
//!
//! Written as SVG directly: the `plotters` crate rounds to whole pixels, sets its colours where a
//! style sheet cannot reach them (dark mode, print), and lays its legend over the data.
//!
//! The y label stands level above its panel, the legend above the chart, the labels of reference
//! lines to the right and those of markers on top: nothing covers the data.

use maud::{Markup, html};

use super::Colour;
use super::decimate::{self, Keep};
use super::number::px;
use super::page::{Drawing, Figure};
use super::path::Path;
use super::scale::{Scale, Spacing, data_range, to_round_ends, with_room};

/// Width of a chart across the page \[px\].
pub const FULL_WIDTH: f64 = 860.0;
/// Width of a chart beside another one \[px\].
pub const HALF_WIDTH: f64 = 420.0;

/// Width of a character of a label, on average, rather more than less \[px\].
pub(super) const CHARACTER: f64 = 6.7;
const LINE_HEIGHT: f64 = 15.0;
/// Height of a panel's head, which holds the y label \[px\].
const HEAD: f64 = 28.0;
/// Height of tick labels and x label below the last panel \[px\].
const FOOT: f64 = 42.0;
/// How far a line's own width may reach out of its panel \[px\].
const OVERHANG: f64 = 3.0;

/// An axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    label: String,
    unit: String,
    range: Option<(f64, f64)>,
    spacing: Spacing,
}

impl Axis {
    /// An axis that fits the data; `unit` may be empty.
    pub fn new(label: &str, unit: &str) -> Self {
        Self {
            label: label.to_owned(),
            unit: unit.to_owned(),
            range: None,
            spacing: Spacing::Linear,
        }
    }

    /// Shows from `low` to `high` (`low < high`) instead, whatever the data.
    pub fn range(mut self, low: f64, high: f64) -> Self {
        self.range = Some((low, high));
        self
    }

    /// Logarithmic; values that are not positive are not drawn.
    pub fn log(mut self) -> Self {
        self.spacing = Spacing::Log;
        self
    }

    fn title(&self) -> String {
        if self.unit.is_empty() {
            self.label.clone()
        } else {
            format!("{} [{}]", self.label, self.unit)
        }
    }
}

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mark {
    Line,
    Wide,
    Dashed,
    Dots,
    Band,
}

/// One layer of a panel: stretches of points, thinned already.
#[derive(Debug, Clone)]
struct Layer {
    name: String,
    colour: Colour,
    mark: Mark,
    /// Of a band, its outlines.
    runs: Vec<Vec<(f64, f64)>>,
}

/// One coordinate system, with its own y axis.
#[derive(Debug, Clone)]
pub struct Panel {
    y: Axis,
    height: f64,
    layers: Vec<Layer>,
    references: Vec<(f64, String)>,
}

impl Panel {
    /// An empty panel.
    pub fn new(y: Axis) -> Self {
        Self {
            y,
            height: 210.0,
            layers: Vec::new(),
            references: Vec::new(),
        }
    }

    /// Height of the plotting area \[px\].
    pub fn height(mut self, height: f64) -> Self {
        self.height = height;
        self
    }

    /// A solid line over rising `x`. Values that are not finite are gaps; an empty name stays out
    /// of the legend.
    pub fn line(self, name: &str, colour: Colour, x: &[f64], y: &[f64]) -> Self {
        let runs = decimate::curve(x, y, Keep::Y, decimate::POINTS);
        self.layer(name, colour, Mark::Line, runs)
    }

    /// A wide pale line over rising `x`, below the others: what they are compared with.
    pub fn wide(self, name: &str, colour: Colour, x: &[f64], y: &[f64]) -> Self {
        let runs = decimate::curve(x, y, Keep::Y, decimate::POINTS);
        self.layer(name, colour, Mark::Wide, runs)
    }

    /// A dashed line over rising `x`.
    pub fn dashed(self, name: &str, colour: Colour, x: &[f64], y: &[f64]) -> Self {
        let runs = decimate::curve(x, y, Keep::Y, decimate::POINTS);
        self.layer(name, colour, Mark::Dashed, runs)
    }

    /// A curve in the plane, such as a loop, through the points in their order.
    pub fn plane(self, name: &str, colour: Colour, x: &[f64], y: &[f64]) -> Self {
        let runs = decimate::curve(x, y, Keep::Both, decimate::POINTS);
        self.layer(name, colour, Mark::Line, runs)
    }

    /// Single points, such as measured ones.
    pub fn dots(self, name: &str, colour: Colour, x: &[f64], y: &[f64]) -> Self {
        let there: Vec<(f64, f64)> = x
            .iter()
            .copied()
            .zip(y.iter().copied())
            .filter(|p| p.0.is_finite() && p.1.is_finite())
            .collect();
        let runs = vec![decimate::thin(&there, Keep::Y, decimate::POINTS / 3)];
        self.layer(name, colour, Mark::Dots, runs)
    }

    /// A shaded band between `low` and `high` over rising `x`.
    pub fn band(self, name: &str, colour: Colour, x: &[f64], low: &[f64], high: &[f64]) -> Self {
        // A gap in either edge is a gap in both, so that the edges' stretches belong together.
        let len = x.len().min(low.len()).min(high.len());
        let present = |i: usize| low[i].is_finite() && high[i].is_finite();
        let edge = |values: &[f64]| {
            let values: Vec<f64> = (0..len)
                .map(|i| if present(i) { values[i] } else { f64::NAN })
                .collect();
            decimate::curve(&x[..len], &values, Keep::Y, decimate::POINTS / 2)
        };
        let outlines = edge(low)
            .into_iter()
            .zip(edge(high))
            .map(|(low, high)| low.into_iter().chain(high.into_iter().rev()).collect());
        let runs = outlines.collect();
        self.layer(name, colour, Mark::Band, runs)
    }

    /// A horizontal line, labelled beside the panel.
    pub fn reference(mut self, value: f64, label: &str) -> Self {
        self.references.push((value, label.to_owned()));
        self
    }

    fn layer(mut self, name: &str, colour: Colour, mark: Mark, runs: Vec<Vec<(f64, f64)>>) -> Self {
        self.layers.push(Layer {
            name: name.to_owned(),
            colour,
            mark,
            runs,
        });
        self
    }

    fn points(&self) -> impl Iterator<Item = (f64, f64)> {
        self.layers
            .iter()
            .flat_map(|layer| layer.runs.iter().flatten().copied())
    }

    fn y_range(&self) -> (f64, f64) {
        self.y.range.unwrap_or_else(|| {
            let references = self.references.iter().map(|(value, _)| *value);
            let values = self.points().map(|p| p.1).chain(references);
            with_room(data_range(values, self.y.spacing), self.y.spacing)
        })
    }
}

/// A chart.
#[derive(Debug, Clone)]
pub struct Chart {
    x: Axis,
    width: f64,
    panels: Vec<Panel>,
    markers: Vec<(f64, String)>,
}

impl Chart {
    /// A chart without panels yet, across the page.
    pub fn new(x: Axis) -> Self {
        Self {
            x,
            width: FULL_WIDTH,
            panels: Vec::new(),
            markers: Vec::new(),
        }
    }

    /// Half as wide, to stand beside another one.
    pub fn half(mut self) -> Self {
        self.width = HALF_WIDTH;
        self
    }

    /// Adds a panel below the others.
    pub fn panel(mut self, panel: Panel) -> Self {
        self.panels.push(panel);
        self
    }

    /// A vertical line through all panels, labelled on top.
    pub fn marker(mut self, x: f64, label: &str) -> Self {
        self.markers.push((x, label.to_owned()));
        self
    }

    /// Draws it.
    pub fn figure(&self, title: &str, caption: &str) -> Figure {
        let drawing = Drawing {
            legend: self.legend(),
            svg: self.svg(title),
        };
        Figure::new(title, caption, drawing)
    }

    fn legend(&self) -> Markup {
        let mut shown: Vec<&Layer> = Vec::new();
        for layer in self
            .panels
            .iter()
            .flat_map(|panel| &panel.layers)
            .filter(|l| !l.name.is_empty())
        {
            let same =
                |l: &&Layer| (&l.name, l.colour, l.mark) == (&layer.name, layer.colour, layer.mark);
            if !shown.iter().any(same) {
                shown.push(layer);
            }
        }
        html! {
            @if !shown.is_empty() {
                ul.legend {
                    @for layer in shown {
                        li {
                            svg class=(layer.colour.class()) width="26" height="10" aria-hidden="true" {
                                @match layer.mark {
                                    Mark::Line => path.line d="M1 5h24" {},
                                    Mark::Wide => path.line.wide d="M2 5h22" {},
                                    Mark::Dashed => path.line.dashed d="M1 5h24" {},
                                    Mark::Dots => path.dots d="M4 5h0M13 5h0M22 5h0" {},
                                    Mark::Band => rect.band x="1" width="24" height="10" {},
                                }
                            }
                            (layer.name)
                        }
                    }
                }
            }
        }
    }

    fn svg(&self, title: &str) -> Markup {
        let x_range = self.x.range.unwrap_or_else(|| {
            let values = self.panels.iter().flat_map(Panel::points).map(|p| p.0);
            let range = data_range(values, self.x.spacing);
            if self.x.spacing == Spacing::Linear {
                to_round_ends(range)
            } else {
                range
            }
        });
        let y_ticks: Vec<_> = self.panels.iter().map(y_ticks).collect();
        let longest_tick = longest(y_ticks.iter().flatten().map(|(_, label)| label.as_str()));
        let longest_reference = longest(
            self.panels
                .iter()
                .flat_map(|p| &p.references)
                .map(|(_, label)| label.as_str()),
        );
        let left = (longest_tick * CHARACTER + 12.0).max(48.0);
        let right = self.width - (longest_reference * CHARACTER + 10.0).max(18.0);
        let x = Scale::new(x_range, (left, right), self.x.spacing);
        let x_ticks: Vec<(f64, String)> = x
            .ticks((right - left) / 90.0)
            .into_iter()
            .map(|(v, label)| (x.position(v), label))
            .collect();

        let (marker_labels, marker_rows) = self.marker_labels(&x, x_range);
        let first_top = HEAD + marker_rows as f64 * LINE_HEIGHT;
        let tops: Vec<f64> = self
            .panels
            .iter()
            .scan(first_top, |top, panel| {
                let own = *top;
                *top += panel.height + HEAD + 8.0;
                Some(own)
            })
            .collect();
        let bottom = tops
            .last()
            .zip(self.panels.last())
            .map_or(first_top, |(top, panel)| top + panel.height);
        let height = bottom + FOOT;

        html! {
            svg.chart xmlns="http://www.w3.org/2000/svg" role="img" aria-label=(title)
                width=(px(self.width)) height=(px(height)) viewBox={ "0 0 " (px(self.width)) " " (px(height)) } {
                @for ((panel, top), ticks) in self.panels.iter().zip(&tops).zip(&y_ticks) {
                    (Frame { panel, x: &x, left, right, top: *top, x_ticks: &x_ticks }.draw(ticks))
                }
                @for (position, row, label) in &marker_labels {
                    path.marker d={ "M" (px(*position)) " " (px(first_top)) "V" (px(bottom)) } {}
                    text.small x=(px(*position)) y=(px(first_top - 5.0 - *row as f64 * LINE_HEIGHT))
                        text-anchor="middle" { (label) }
                }
                @for (position, label) in &x_ticks {
                    text.tick x=(px(*position)) y=(px(bottom + 18.0)) text-anchor="middle" { (label) }
                }
                text.axis x=(px((left + right) / 2.0)) y=(px(bottom + 36.0)) text-anchor="middle" {
                    (self.x.title())
                }
            }
        }
    }

    /// Position, row (0 is the lowest) and text of the markers in sight, and the number of rows.
    fn marker_labels(&self, x: &Scale, range: (f64, f64)) -> (Vec<(f64, usize, &str)>, usize) {
        let mut markers: Vec<&(f64, String)> = self
            .markers
            .iter()
            .filter(|(v, _)| (range.0..=range.1).contains(v))
            .collect();
        markers.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut ends: Vec<f64> = Vec::new();
        let mut placed = Vec::new();
        for (value, label) in markers {
            let position = x.position(*value);
            let half = (label.chars().count() as f64 * CHARACTER + 8.0) / 2.0;
            let row = ends
                .iter()
                .position(|end| *end <= position - half)
                .unwrap_or(ends.len());
            ends.resize(ends.len().max(row + 1), 0.0);
            ends[row] = position + half;
            placed.push((position, row, label.as_str()));
        }
        (placed, ends.len())
    }
}

/// Characters of the longest text.
fn longest<'a>(texts: impl Iterator<Item = &'a str>) -> f64 {
    texts.map(|text| text.chars().count()).max().unwrap_or(0) as f64
}

fn y_ticks(panel: &Panel) -> Vec<(f64, String)> {
    Scale::new(panel.y_range(), (panel.height, 0.0), panel.y.spacing).ticks(panel.height / 45.0)
}

/// A panel at its place.
struct Frame<'a> {
    panel: &'a Panel,
    x: &'a Scale,
    left: f64,
    right: f64,
    top: f64,
    /// Positions and labels.
    x_ticks: &'a [(f64, String)],
}

impl Frame<'_> {
    fn draw(&self, y_ticks: &[(f64, String)]) -> Markup {
        let Self {
            panel,
            left,
            right,
            top,
            ..
        } = *self;
        let bottom = top + panel.height;
        let range = panel.y_range();
        let y = Scale::new(range, (bottom, top), panel.y.spacing);
        let (clip_left, clip_top) = (left - OVERHANG, top - OVERHANG);
        let (clip_width, clip_height) =
            (right - left + 2.0 * OVERHANG, panel.height + 2.0 * OVERHANG);
        let mut grid = Path::default();
        for (position, _) in self.x_ticks {
            grid.polyline([(*position, top), (*position, bottom)]);
        }
        for (value, _) in y_ticks {
            grid.polyline([(left, y.position(*value)), (right, y.position(*value))]);
        }
        html! {
            text.axis x="0" y=(px(top - 12.0)) { (panel.y.title()) }
            path.grid d=(grid.data()) {}
            @for (value, label) in y_ticks {
                text.tick x=(px(left - 7.0)) y=(px(y.position(*value) + 4.0)) text-anchor="end" { (label) }
            }
            path.frame d=(Path::through([(left, bottom), (right, bottom)]).data()) {}
            // A nested svg clips without the document-wide id that a clip path would need.
            svg x=(px(clip_left)) y=(px(clip_top)) width=(px(clip_width)) height=(px(clip_height))
                viewBox={ (px(clip_left)) " " (px(clip_top)) " " (px(clip_width)) " " (px(clip_height)) } {
                // What others are compared with lies below, then bands, then dots: a line through dense dots stays visible.
                @for mark in [Mark::Wide, Mark::Band, Mark::Dots, Mark::Dashed, Mark::Line] {
                    @for layer in panel.layers.iter().filter(|layer| layer.mark == mark) {
                        (self.layer(layer, &y))
                    }
                }
                @for (value, _) in &panel.references {
                    path.reference
                        d=(Path::through([(left, y.position(*value)), (right, y.position(*value))]).data()) {}
                }
            }
            @for (position, label) in spread(&panel.references, &y, range) {
                text.small x=(px(right + 6.0)) y=(px(position + 4.0)) { (label) }
            }
        }
    }

    fn layer(&self, layer: &Layer, y: &Scale) -> Markup {
        let drawable = |p: &&(f64, f64)| self.x.shows(p.0) && y.shows(p.1);
        let at = |p: &(f64, f64)| (self.x.position(p.0), y.position(p.1));
        let mut path = Path::default();
        for run in &layer.runs {
            let shown = run.iter().filter(drawable).map(at);
            match layer.mark {
                Mark::Dots => path.dots(shown),
                Mark::Line | Mark::Wide | Mark::Dashed => path.polyline(shown),
                Mark::Band => {
                    path.polyline(shown);
                    path.close();
                }
            }
        }
        let mark = match layer.mark {
            Mark::Line => "line",
            Mark::Wide => "line wide",
            Mark::Dashed => "line dashed",
            Mark::Dots => "dots",
            Mark::Band => "band",
        };
        html! { path class={ (layer.colour.class()) " " (mark) } d=(path.data()) {} }
    }
}

/// Where the labels of the reference lines in sight go: beside their line, but clear of each other.
fn spread<'a>(
    references: &'a [(f64, String)],
    y: &Scale,
    range: (f64, f64),
) -> Vec<(f64, &'a str)> {
    let mut labels: Vec<(f64, &str)> = references
        .iter()
        .filter(|(value, _)| (range.0..=range.1).contains(value))
        .map(|(value, label)| (y.position(*value), label.as_str()))
        .collect();
    labels.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut lowest_free = f64::NEG_INFINITY;
    for (position, _) in &mut labels {
        *position = position.max(lowest_free);
        lowest_free = *position + LINE_HEIGHT;
    }
    labels
}
