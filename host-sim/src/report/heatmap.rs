//! A quantity over two others, as coloured cells.

use maud::html;

use super::axes::FOOT;
use super::chart::{CHARACTER, FULL_WIDTH};
use super::colour::{fraction, hex, text_on};
use super::number::{MISSING, px, short, significant};
use super::page::{Drawing, Figure};
use super::scale::{Scale, Spacing, data_range};

/// Perceptually uniform and made for colour-blind readers.
const MAP: colorous::Gradient = colorous::CIVIDIS;
const CELL_HEIGHT: f64 = 34.0;
const TOP: f64 = 24.0;
/// Colour bar, its tick labels included \[px\].
const BAR: f64 = 90.0;
/// A cell at least that wide has room for its value \[px\].
const READABLE: f64 = 42.0;

/// A map of cells. Axis texts hold their unit.
#[derive(Debug, Clone)]
pub struct Heatmap {
    /// Text of the x axis.
    pub x_label: String,
    /// Text of the y axis.
    pub y_label: String,
    /// Text of the colour scale.
    pub value_label: String,
    /// Values of x, left to right.
    pub x: Vec<f64>,
    /// Values of y, bottom to top.
    pub y: Vec<f64>,
    /// `cells[row][column]`, rows as in `y`. Missing and non-finite cells stay empty.
    pub cells: Vec<Vec<f64>>,
}

impl Heatmap {
    /// Draws it.
    pub fn figure(&self, title: &str, caption: &str) -> Figure {
        let range = data_range(self.cells.iter().flatten().copied(), Spacing::Linear);
        let y_labels: Vec<String> = self.y.iter().map(|v| short(*v)).collect();
        let longest = y_labels.iter().map(|l| l.chars().count()).max().unwrap_or(0) as f64;
        let left = (longest * CHARACTER + 12.0).max(48.0);
        let right = FULL_WIDTH - BAR;
        let cell_width = (right - left) / self.x.len().max(1) as f64;
        let bottom = TOP + CELL_HEIGHT * self.y.len() as f64;
        let height = bottom.max(TOP + 120.0) + FOOT;
        let cell = |row: usize, column: usize| {
            self.cells.get(row).and_then(|r| r.get(column)).copied().unwrap_or(f64::NAN)
        };
        let label_every = (46.0 / cell_width).ceil().max(1.0) as usize;
        let svg = html! {
            svg.chart xmlns="http://www.w3.org/2000/svg" role="img" aria-label=(title)
                width=(px(FULL_WIDTH)) height=(px(height)) viewBox={ "0 0 " (px(FULL_WIDTH)) " " (px(height)) } {
                text.axis x="0" y="14" { (self.y_label) }
                @for (row, y_label) in y_labels.iter().enumerate() {
                    @let top = bottom - CELL_HEIGHT * (row as f64 + 1.0);
                    text.tick x=(px(left - 7.0)) y=(px(top + CELL_HEIGHT / 2.0 + 4.0)) text-anchor="end" { (y_label) }
                    @for column in 0..self.x.len() {
                        @let value = cell(row, column);
                        @let along = fraction(value, range);
                        @let x = left + cell_width * column as f64;
                        @let (fill, ink) = if value.is_finite() {
                            (hex(MAP, along), text_on(MAP, along))
                        } else {
                            ("none".to_owned(), "currentColor")
                        };
                        rect.cell x=(px(x)) y=(px(top)) width=(px(cell_width)) height=(px(CELL_HEIGHT)) fill=(fill) {}
                        @if cell_width >= READABLE {
                            text.cell-value x=(px(x + cell_width / 2.0)) y=(px(top + CELL_HEIGHT / 2.0 + 4.0))
                                text-anchor="middle" style={ "fill:" (ink) } {
                                @if value.is_finite() { (significant(value, 3)) } @else { (MISSING) }
                            }
                        }
                    }
                }
                @for (column, value) in self.x.iter().enumerate().step_by(label_every) {
                    text.tick x=(px(left + cell_width * (column as f64 + 0.5))) y=(px(bottom + 18.0))
                        text-anchor="middle" { (short(*value)) }
                }
                text.axis x=(px((left + right) / 2.0)) y=(px(bottom + 36.0)) text-anchor="middle" { (self.x_label) }
                (colour_bar(MAP, range, &self.value_label, right + 24.0, (TOP, bottom.max(TOP + 120.0))))
            }
        };
        Figure::new(title, caption, Drawing { legend: html! {}, svg })
    }
}

/// An upright colour bar of 14 px width at `x`, with its label above and its ticks to the right.
pub(super) fn colour_bar(
    map: colorous::Gradient,
    range: (f64, f64),
    label: &str,
    x: f64,
    (top, bottom): (f64, f64),
) -> maud::Markup {
    const STEPS: usize = 48;
    let step = (bottom - top) / STEPS as f64;
    let y = Scale::new(range, (bottom, top), Spacing::Linear);
    html! {
        @for i in 0..STEPS {
            // Each step reaches below the next, so that no seam shows between them.
            rect x=(px(x)) y=(px(top + step * i as f64)) width="14"
                height=(px(bottom - top - step * i as f64))
                fill=(hex(map, 1.0 - (i as f64 + 0.5) / STEPS as f64)) {}
        }
        @for (value, text) in y.ticks((bottom - top) / 32.0) {
            text.tick x=(px(x + 20.0)) y=(px(y.position(value) + 4.0)) { (text) }
        }
        text.axis x=(px(x + 14.0)) y=(px(top - 10.0)) text-anchor="middle" { (label) }
    }
}
