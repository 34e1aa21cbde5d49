//! Line charts: one or more panels over a shared x axis, and curves in the plane.
//!
//! Written as SVG directly: the `plotters` crate rounds to whole pixels, sets its colours where a
//! style sheet cannot reach them (dark mode, print), and draws its legend over the data.
//!
//! The y label is placed level above its panel, the legend above the chart, the labels of reference
//! lines to the right and those of markers on top, so that nothing covers the data.

use maud::{Markup, PreEscaped, html};

use super::Colour;
use super::axes::{Area, FOOT, Tick, axis_title, ticks};
use super::decimate;
use super::layer::{Layer, Mark};
use super::path::Path;
use super::plot::Store;
use super::scale::{Scale, Spacing, data_range, to_round_ends, with_room};
use super::style::DRAWING_STYLE;
use serde_json::{Value, json};
use thermyo_files::number::px;

/// Width of a chart across the page \[px\].
pub const FULL_WIDTH: f64 = 860.0;
/// Width of a drawing for a phone, beside the one across the page \[px\].
pub(super) const NARROW_WIDTH: f64 = 358.0;
/// Width of a chart beside another one \[px\].
pub const HALF_WIDTH: f64 = 420.0;

/// Mean width of a character of a label, rounded up \[px\].
pub(super) const CHARACTER: f64 = 6.7;
const LINE_HEIGHT: f64 = 15.0;
/// Margin around a stand-alone chart, and space between the entries of its legend \[px\].
const BORDER: f64 = 16.0;
/// Width of a sample line in that legend \[px\].
const SAMPLE: f64 = 32.0;
/// Height of a panel's head, which holds the y label \[px\].
const HEAD: f64 = 28.0;
/// Preferred distances of ticks \[px\].
const X_TICK_DISTANCE: f64 = 90.0;
const Y_TICK_DISTANCE: f64 = 45.0;
/// Width by which a line may extend beyond its panel \[px\].
const CLIP_MARGIN: f64 = 3.0;

#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    label: String,
    unit: String,
    range: Option<(f64, f64)>,
    spacing: Spacing,
    words: Vec<String>,
}

impl Axis {
    /// An axis that fits the data; `unit` may be empty.
    pub fn new(label: &str, unit: &str) -> Self {
        Self {
            label: label.to_owned(),
            unit: unit.to_owned(),
            range: None,
            spacing: Spacing::Linear,
            words: Vec::new(),
        }
    }

    /// Sets the range to `low..high` (`low < high`), independent of the data.
    pub fn range(mut self, low: f64, high: f64) -> Self {
        self.range = Some((low, high));
        self
    }

    /// Makes the axis logarithmic; values that are not positive are not drawn.
    pub fn log(mut self) -> Self {
        self.spacing = Spacing::Log;
        self
    }

    /// Labels 0, 1, 2 and so on of an x axis by these words; an empty list keeps the numbers.
    pub fn words(mut self, words: &[String]) -> Self {
        self.words = words.to_vec();
        self
    }

    fn title(&self) -> String {
        axis_title(&self.label, &self.unit)
    }

    fn plot(&self) -> Value {
        let log = self.spacing == Spacing::Log;
        json!({
            "label": self.label, "unit": self.unit, "log": log, "range": self.range, "words": self.words,
        })
    }
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
    pub fn new(y: Axis) -> Self {
        Self { y, height: 210.0, layers: Vec::new(), references: Vec::new() }
    }

    /// Height of the plotting area \[px\].
    pub fn height(mut self, height: f64) -> Self {
        self.height = height;
        self
    }

    /// A solid line over rising `x`. Values that are not finite are gaps; a series with an empty
    /// name is not in the legend.
    pub fn line(self, name: &str, colour: Colour, x: &[f64], y: &[f64]) -> Self {
        self.layer(Layer::new(name, colour, Mark::Line, x, &[y]))
    }

    /// A wide pale line over rising `x`, below the others: the reference of a comparison.
    pub fn wide(self, name: &str, colour: Colour, x: &[f64], y: &[f64]) -> Self {
        self.layer(Layer::new(name, colour, Mark::Wide, x, &[y]))
    }

    /// A dashed line over rising `x`.
    pub fn dashed(self, name: &str, colour: Colour, x: &[f64], y: &[f64]) -> Self {
        self.layer(Layer::new(name, colour, Mark::Dashed, x, &[y]))
    }

    /// A line, number `n` from 0 among several of one kind: in the colours of curves, dashed in every second round.
    pub fn nth_line(self, n: usize, name: &str, x: &[f64], y: &[f64]) -> Self {
        let colours = Colour::CURVES.len();
        let line = if (n / colours).is_multiple_of(2) { Self::line } else { Self::dashed };
        line(self, name, Colour::CURVES[n % colours], x, y)
    }

    /// A curve in the plane, such as a loop, through the points in their order.
    pub fn plane(self, name: &str, colour: Colour, x: &[f64], y: &[f64]) -> Self {
        self.layer(Layer::new(name, colour, Mark::Plane, x, &[y]))
    }

    /// Single points over rising `x`, such as measurements.
    pub fn dots(self, name: &str, colour: Colour, x: &[f64], y: &[f64]) -> Self {
        self.layer(Layer::new(name, colour, Mark::Dots, x, &[y]))
    }

    /// A shaded band between `low` and `high` over rising `x`.
    pub fn band(self, name: &str, colour: Colour, x: &[f64], low: &[f64], high: &[f64]) -> Self {
        self.layer(Layer::new(name, colour, Mark::Band, x, &[low, high]))
    }

    /// A horizontal line, labelled beside the panel.
    pub fn reference(mut self, value: f64, label: &str) -> Self {
        self.references.push((value, label.to_owned()));
        self
    }

    /// Adds a layer; a series without a point is left out, also from the legend.
    fn layer(mut self, layer: Layer) -> Self {
        if layer.x().next().is_some() {
            self.layers.push(layer);
        }
        self
    }

    /// The range of y of all points whose x is within `window`.
    fn y_range(&self, window: (f64, f64)) -> (f64, f64) {
        self.y.range.unwrap_or_else(|| {
            let references = self.references.iter().map(|(value, _)| *value);
            let values = self.layers.iter().flat_map(|layer| layer.y(window)).chain(references);
            with_room(data_range(values, self.y.spacing), self.y.spacing)
        })
    }

    fn scale(&self, window: (f64, f64), area: Area) -> Scale {
        Scale::new(self.y_range(window), (area.bottom, area.top), self.y.spacing)
    }
}

#[derive(Debug, Clone)]
pub struct Chart {
    x: Axis,
    width: f64,
    panels: Vec<Panel>,
    markers: Vec<(f64, String)>,
}

impl Chart {
    /// A chart across the page, still without panels.
    pub fn new(x: Axis) -> Self {
        Self { x, width: FULL_WIDTH, panels: Vec::new(), markers: Vec::new() }
    }

    /// Makes the chart half as wide, to be placed beside another one.
    pub fn half(mut self) -> Self {
        self.width = HALF_WIDTH;
        self
    }

    /// Adds a panel below the others. Only the first one may lack a series with a point: a chart
    /// without data has its frame.
    pub fn panel(mut self, panel: Panel) -> Self {
        if self.panels.is_empty() || !panel.layers.is_empty() {
            self.panels.push(panel);
        }
        self
    }

    /// A vertical line through all panels, labelled on top.
    pub fn marker(mut self, x: f64, label: &str) -> Self {
        self.markers.push((x, label.to_owned()));
        self
    }

    /// One layer for each entry of the legend.
    fn named(&self) -> Vec<&Layer> {
        let named =
            self.panels.iter().flat_map(|panel| &panel.layers).filter(|l| !l.name.is_empty());
        let mut shown: Vec<&Layer> = Vec::new();
        for layer in named {
            if !shown.iter().any(|other| other.looks_like(layer)) {
                shown.push(layer);
            }
        }
        shown
    }

    /// The drawing with title and legend as a stand-alone SVG file, for documents that are not
    /// pages of this crate.
    pub fn document(&self, title: &str) -> String {
        let (chart, height) = self.svg(title);
        let width = self.width + 2.0 * BORDER;
        let (mut left, mut top) = (BORDER, 40.0);
        let mut entries: Vec<([f64; 2], &Layer)> = Vec::new();
        for layer in self.named() {
            let entry = SAMPLE + text_width(&layer.name);
            if left > BORDER && left + entry > width {
                (left, top) = (BORDER, top + LINE_HEIGHT);
            }
            entries.push(([left, top], layer));
            left += entry + BORDER;
        }
        let chart_top = top + 22.0;
        let height = height + chart_top + BORDER;
        let document = html! {
            svg.chart xmlns="http://www.w3.org/2000/svg" width=(px(width)) height=(px(height))
                viewBox={ "0 0 " (px(width)) " " (px(height)) } {
                style { (PreEscaped(DRAWING_STYLE)) }
                rect width="100%" height="100%" fill="var(--paper)" {}
                text.label.value x=(px(BORDER)) y="26" { (title) }
                @for ([left, top], layer) in &entries {
                    g transform={ "translate(" (px(*left)) " " (px(*top)) ")" } { (layer.sample()) }
                    text x=(px(left + SAMPLE)) y=(px(top + 9.0)) { (layer.name) }
                }
                g transform={ "translate(" (px(BORDER)) " " (px(chart_top)) ")" } { (chart) }
            }
        };
        document.into_string()
    }

    pub(super) fn legend(&self) -> Markup {
        let shown = self.named();
        html! {
            @if !shown.is_empty() {
                ul.legend { @for layer in shown { (layer.legend()) } }
            }
        }
    }

    /// The data from which the page's script draws the chart.
    pub(super) fn plot(&self, store: &mut Store) -> Value {
        let (from, to) = self.window();
        let panels: Vec<Value> = self.panels.iter().map(|panel| panel.plot(store)).collect();
        json!({
            "x": self.x.plot(),
            "window": [from, to],
            "panels": panels,
            "markers": self.markers,
        })
    }

    /// The visible range of x.
    fn window(&self) -> (f64, f64) {
        self.x.range.unwrap_or_else(|| {
            if !self.x.words.is_empty() {
                return (-0.5, self.x.words.len() as f64 - 0.5);
            }
            let values = self.panels.iter().flat_map(|panel| &panel.layers).flat_map(Layer::x);
            let range = data_range(values, self.x.spacing);
            if self.x.spacing == Spacing::Linear { to_round_ends(range) } else { range }
        })
    }

    /// The drawing and its height \[px\].
    pub(super) fn svg(&self, title: &str) -> (Markup, f64) {
        let window = self.window();
        let (left, right) = self.sides(window);
        let x = Scale::new(window, (left, right), self.x.spacing);
        let x_ticks = match &self.x.words[..] {
            [] => ticks(&x, (right - left) / X_TICK_DISTANCE),
            words => {
                let places = words.iter().enumerate();
                places.map(|(i, word)| (x.position(i as f64), word.clone())).collect()
            }
        };
        let layers: usize = self.panels.iter().map(|panel| panel.layers.len()).sum();
        let points = (decimate::DRAWING / layers.max(1)).min(decimate::POINTS);
        let (marker_labels, marker_rows) = self.marker_labels(&x, window);
        let first_top = HEAD + marker_rows as f64 * LINE_HEIGHT;
        let mut next_top = first_top;
        let areas: Vec<Area> = self
            .panels
            .iter()
            .map(|panel| {
                let top = next_top;
                next_top += panel.height + HEAD + 8.0;
                Area { left, right, top, bottom: top + panel.height }
            })
            .collect();
        let last = areas.last().copied().unwrap_or(Area {
            left,
            right,
            top: first_top,
            bottom: first_top,
        });
        let height = last.bottom + FOOT;
        let drawing = html! {
            svg.chart xmlns="http://www.w3.org/2000/svg" role="img" aria-label=(title)
                width=(px(self.width)) height=(px(height)) viewBox={ "0 0 " (px(self.width)) " " (px(height)) } {
                @for (panel, area) in self.panels.iter().zip(&areas) {
                    (panel.draw(*area, window, points, &x, &x_ticks))
                }
                @for (line, middle, row, label) in &marker_labels {
                    path.marker d={ "M" (px(*line)) " " (px(first_top)) "V" (px(last.bottom)) } {}
                    text.small x=(px(*middle)) y=(px(first_top - 5.0 - *row as f64 * LINE_HEIGHT))
                        text-anchor="middle" { (label) }
                }
                (last.x_axis(&x_ticks, &self.x.title()))
            }
        };
        (drawing, height)
    }

    /// Left and right end of the panels, which leaves room for y ticks and labels of reference
    /// lines.
    fn sides(&self, window: (f64, f64)) -> (f64, f64) {
        let longest_tick = self
            .panels
            .iter()
            .flat_map(|p| {
                let area = Area { left: 0.0, right: 0.0, top: 0.0, bottom: p.height };
                ticks(&p.scale(window, area), p.height / Y_TICK_DISTANCE)
            })
            .map(|(_, label)| text_width(&label))
            .fold(0.0, f64::max);
        let references = self.panels.iter().flat_map(|p| &p.references);
        let longest_reference = references.map(|(_, label)| text_width(label)).fold(0.0, f64::max);
        ((longest_tick + 12.0).max(48.0), self.width - (longest_reference + 10.0).max(18.0))
    }

    /// Position of line and label, row (0 is the lowest) and text of the visible markers, and the
    /// number of rows.
    fn marker_labels(
        &self,
        x: &Scale,
        window: (f64, f64),
    ) -> (Vec<(f64, f64, usize, &str)>, usize) {
        let mut markers: Vec<&(f64, String)> =
            self.markers.iter().filter(|(v, _)| (window.0..=window.1).contains(v)).collect();
        markers.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut ends: Vec<f64> = Vec::new();
        let mut placed = Vec::new();
        for (value, label) in markers {
            let line = x.position(*value);
            let half = text_width(label) / 2.0 + 4.0;
            let middle = line.min(self.width - half).max(half);
            let row = ends.iter().position(|end| *end <= middle - half).unwrap_or(ends.len());
            ends.resize(ends.len().max(row + 1), 0.0);
            ends[row] = middle + half;
            placed.push((line, middle, row, label.as_str()));
        }
        (placed, ends.len())
    }
}

impl Panel {
    fn plot(&self, store: &mut Store) -> Value {
        let log = self.y.spacing == Spacing::Log;
        let layers: Vec<Value> = self.layers.iter().map(|layer| layer.plot(store, log)).collect();
        json!({
            "y": self.y.plot(),
            "height": self.height,
            "layers": layers,
            "references": self.references,
        })
    }

    fn draw(
        &self,
        area: Area,
        window: (f64, f64),
        points: usize,
        x: &Scale,
        x_ticks: &[Tick],
    ) -> Markup {
        let y = self.scale(window, area);
        let y_ticks = ticks(&y, self.height / Y_TICK_DISTANCE);
        let (clip_left, clip_top) = (px(area.left - CLIP_MARGIN), px(area.top - CLIP_MARGIN));
        let clip_width = px(area.right - area.left + 2.0 * CLIP_MARGIN);
        let clip_height = px(self.height + 2.0 * CLIP_MARGIN);
        html! {
            text.axis x="0" y=(px(area.top - 12.0)) { (self.y.title()) }
            (area.draw(x_ticks, &y_ticks))
            // A nested svg clips without the document-wide id that a clip path would need.
            svg x=(clip_left) y=(clip_top) width=(clip_width) height=(clip_height)
                viewBox={ (clip_left) " " (clip_top) " " (clip_width) " " (clip_height) } {
                @for mark in Mark::STACK {
                    @for layer in self.layers.iter().filter(|layer| layer.mark == mark) {
                        (layer.draw(window, points, x, &y))
                    }
                }
                @for (value, _) in &self.references {
                    @let at = y.position(*value);
                    path.reference d=(Path::through([(area.left, at), (area.right, at)]).data()) {}
                }
            }
            @for (position, label) in self.reference_labels(&y, window) {
                text.small x=(px(area.right + 6.0)) y=(px(position + 4.0)) { (label) }
            }
        }
    }

    /// Positions of the labels of the visible reference lines: beside their line, without overlap.
    fn reference_labels(&self, y: &Scale, window: (f64, f64)) -> Vec<(f64, &str)> {
        let range = self.y_range(window);
        let in_sight =
            self.references.iter().filter(|(value, _)| (range.0..=range.1).contains(value));
        let mut labels: Vec<(f64, &str)> =
            in_sight.map(|(value, label)| (y.position(*value), label.as_str())).collect();
        labels.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut lowest_free = f64::NEG_INFINITY;
        for (position, _) in &mut labels {
            *position = position.max(lowest_free);
            lowest_free = *position + LINE_HEIGHT;
        }
        labels
    }
}

/// Approximate width of a label, rounded up \[px\].
pub(super) fn text_width(text: &str) -> f64 {
    text.chars().count() as f64 * CHARACTER
}
