//! Horizontal bars: budgets with signs, and comparisons over decades.

use maud::{Markup, html};

use super::Colour;
use super::axes::{Area, FOOT, axis_title, ticks};
use super::chart::{FULL_WIDTH, NARROW_WIDTH};
use super::figure::{Drawing, Figure};
use super::path::Path;
use super::scale::{Scale, Spacing, data_range};
use thermyo_files::number::{px, significant};

/// Mean width of a character of a bar's label, rounded up \[px\].
const CHARACTER: f64 = 7.6;
const ROW: f64 = 30.0;
/// Height of a row if labels stand above their bars \[px\].
const TALL_ROW: f64 = 46.0;
const TOP: f64 = 8.0;
/// Space for a bar's value beside its end \[px\].
const VALUE: f64 = 70.0;

#[derive(Debug, Clone)]
struct Bar {
    label: String,
    value: f64,
    colour: Colour,
}

#[derive(Debug, Clone)]
pub struct Bars {
    label: String,
    unit: String,
    spacing: Spacing,
    bars: Vec<Bar>,
}

impl Bars {
    /// Bars from zero, to the left if negative: a budget. `label` and `unit` belong to the axis.
    pub fn linear(label: &str, unit: &str) -> Self {
        Self {
            label: label.to_owned(),
            unit: unit.to_owned(),
            spacing: Spacing::Linear,
            bars: Vec::new(),
        }
    }

    /// Dots on a logarithmic axis, where a bar's length would mean nothing. Values that are not
    /// positive are listed but not drawn.
    pub fn log(label: &str, unit: &str) -> Self {
        Self { spacing: Spacing::Log, ..Self::linear(label, unit) }
    }

    /// Adds a bar below the others.
    pub fn bar(mut self, label: &str, value: f64, colour: Colour) -> Self {
        self.bars.push(Bar { label: label.to_owned(), value, colour });
        self
    }

    pub fn figure(&self, title: &str, caption: &str) -> Figure {
        let drawings = html! { (self.svg(title, FULL_WIDTH)) (self.svg(title, NARROW_WIDTH)) };
        Figure::new(title, caption, Drawing::still(html! {}, drawings))
    }

    fn range(&self) -> (f64, f64) {
        let values = self.bars.iter().map(|bar| bar.value);
        match self.spacing {
            Spacing::Linear => data_range(values.chain([0.0]), Spacing::Linear),
            Spacing::Log => {
                let (low, high) = data_range(values, Spacing::Log);
                (low / 2.0, high)
            }
        }
    }

    fn svg(&self, name: &str, width: f64) -> Markup {
        let narrow = width < FULL_WIDTH;
        let range = self.range();
        let longest =
            self.bars.iter().map(|bar| bar.label.chars().count()).max().unwrap_or(0) as f64;
        let labels = if narrow { 2.0 } else { (longest * CHARACTER + 14.0).min(width / 2.0) };
        let row = if narrow { TALL_ROW } else { ROW };
        let left = if range.0 < 0.0 { labels + VALUE } else { labels };
        let right = width - VALUE;
        let bottom = TOP + row * self.bars.len() as f64;
        let x = Scale::new(range, (left, right), self.spacing);
        let x_ticks = ticks(&x, (right - left) / if narrow { 60.0 } else { 100.0 });
        let area = Area { left, right, top: TOP, bottom };
        let origin = if self.spacing == Spacing::Linear { x.position(0.0) } else { left };
        let height = bottom + FOOT;
        let title = axis_title(&self.label, &self.unit);
        html! {
            svg.chart.narrow[narrow] xmlns="http://www.w3.org/2000/svg" role="img" aria-label=(name)
                width=(px(width)) height=(px(height)) viewBox={ "0 0 " (px(width)) " " (px(height)) } {
                (area.draw(&x_ticks, &[]))
                @for (i, bar) in self.bars.iter().enumerate() {
                    @let top = TOP + row * i as f64;
                    @let middle = top + row - ROW / 2.0;
                    @if narrow {
                        text.label x="0" y=(px(top + 14.0)) { (bar.label) }
                    } @else {
                        text.label x=(px(labels - 12.0)) y=(px(middle + 4.0)) text-anchor="end" { (bar.label) }
                    }
                    (self.bar_at(bar, &x, middle, origin))
                }
                path.frame d=(Path::through([(origin, TOP), (origin, bottom)]).data()) {}
                (area.x_axis(&x_ticks, &title))
            }
        }
    }

    fn bar_at(&self, bar: &Bar, x: &Scale, middle: f64, origin: f64) -> Markup {
        let drawn = x.shows(bar.value);
        let end = if drawn { x.position(bar.value) } else { origin };
        let (anchor, value_at) =
            if end < origin { ("end", end - 8.0) } else { ("start", end + 10.0) };
        html! {
            g class=(bar.colour.class()) {
                @if drawn && self.spacing == Spacing::Linear {
                    rect.bar x=(px(end.min(origin))) y=(px(middle - 9.0)) width=(px((end - origin).abs()))
                        height="18" rx="2" {}
                } @else if drawn {
                    path.stem d=(Path::through([(origin, middle), (end, middle)]).data()) {}
                    circle.bar cx=(px(end)) cy=(px(middle)) r="6" {}
                }
            }
            text.value x=(px(value_at)) y=(px(middle + 4.0)) text-anchor=(anchor) { (significant(bar.value, 3)) }
        }
    }
}
