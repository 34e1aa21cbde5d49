//! A quantity as a function of two others, as coloured cells.

use maud::{Markup, html};

use super::Colour;
use super::axes::FOOT;
use super::chart::{CHARACTER, FULL_WIDTH, HALF_WIDTH, text_width};
use super::colour::{hex, text_on};
use super::figure::{Drawing, Figure};
use super::path::Path;
use super::scale::{Scale, Spacing, data_range};
use thermyo_files::number::{MISSING, px, significant};

/// A perceptually uniform map, suitable for colour-blind readers.
const MAP: colorous::Gradient = colorous::CIVIDIS;
/// A map that is white in the middle, suitable for colour-blind readers.
const SIGNED_MAP: colorous::Gradient = colorous::PURPLE_ORANGE;
/// Colour of the outline, which is far from all colours of the map.
const LIMIT: Colour = Colour::Vermillion;
const CELL_HEIGHT: f64 = 34.0;
const TOP: f64 = 24.0;
/// Width of the colour bar with its tick labels and the gap before it, and width of that gap
/// \[px\].
const BAR: (f64, f64) = (90.0, 24.0);
/// As [`BAR`], for a map of half width.
const HALF_BAR: (f64, f64) = (66.0, 12.0);
/// Preferred and least number of significant digits in a cell.
const DIGITS: [usize; 2] = [3, 2];
/// Least distance of the values of two cells \[px\].
const BETWEEN: f64 = 3.0;

/// A map of cells. Axis labels contain their unit.
#[derive(Debug, Clone)]
pub struct Heatmap {
    pub x_label: String,
    pub y_label: String,
    pub value_label: String,
    /// Labels of the columns, left to right.
    pub x: Vec<String>,
    /// Labels of the rows, bottom to top.
    pub y: Vec<String>,
    /// `cells[row][column]`, rows as in `y`. Missing and non-finite cells stay empty.
    pub cells: Vec<Vec<f64>>,
    pub style: Style,
}

/// Colouring and width of a map.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Style {
    /// Ends of the colour scale, by which maps can share it; `None` fits the cells.
    pub range: Option<(f64, f64)>,
    /// Linear or logarithmic colour scale.
    pub spacing: Spacing,
    /// Cells up to this value are outlined; the text is the label.
    pub limit: Option<(f64, String)>,
    /// Whether the map is half as wide, to be placed beside another one.
    pub half: bool,
    /// Whether zero is neutral, and the scale equally long on both sides of it.
    pub signed: bool,
}

impl Heatmap {
    pub fn figure(&self, title: &str, caption: &str) -> Figure {
        let spacing = self.style.spacing;
        let map = if self.style.signed { SIGNED_MAP } else { MAP };
        let range = self.range();
        let along_scale = Scale::new(range, (0.0, 1.0), spacing);
        let (width, (bar, gap), least) =
            if self.style.half { (HALF_WIDTH, HALF_BAR, 0.0) } else { (FULL_WIDTH, BAR, 48.0) };
        let left = (longest(&self.y) * CHARACTER + 12.0).max(least);
        let right = width - bar;
        let cell_width = (right - left) / self.x.len().max(1) as f64;
        let bottom = TOP + CELL_HEIGHT * self.y.len() as f64;
        let height = bottom.max(TOP + 120.0) + FOOT;
        let digits = DIGITS.into_iter().find(|digits| {
            let texts = self.cells.iter().flatten().map(|value| significant(*value, *digits));
            longest(&texts.collect::<Vec<_>>()) * CHARACTER + BETWEEN <= cell_width
        });
        let corner = |row: usize, column: usize| {
            (left + cell_width * column as f64, bottom - CELL_HEIGHT * row as f64)
        };
        let label_every =
            ((longest(&self.x) * CHARACTER + 4.0) / cell_width).ceil().max(1.0) as usize;
        let svg = html! {
            svg.chart xmlns="http://www.w3.org/2000/svg" role="img" aria-label=(title)
                width=(px(width)) height=(px(height)) viewBox={ "0 0 " (px(width)) " " (px(height)) } {
                text.axis x="0" y="14" { (self.y_label) }
                @for (row, y_label) in self.y.iter().enumerate() {
                    @let top = bottom - CELL_HEIGHT * (row as f64 + 1.0);
                    text.tick x=(px(left - 7.0)) y=(px(top + CELL_HEIGHT / 2.0 + 4.0)) text-anchor="end" { (y_label) }
                    @for column in 0..self.x.len() {
                        (drawn(self.cell(row, column), (map, &along_scale), digits, (corner(row, column).0, top), cell_width))
                    }
                }
                @for (column, label) in self.x.iter().enumerate().step_by(label_every) {
                    text.tick x=(px(left + cell_width * (column as f64 + 0.5))) y=(px(bottom + 18.0))
                        text-anchor="middle" { (label) }
                }
                text.axis x=(px((left + right) / 2.0)) y=(px(bottom + 36.0)) text-anchor="middle" { (self.x_label) }
                @if let Some((limit, _)) = &self.style.limit {
                    @let outline = self.outline(*limit, corner);
                    path.outline-ground d=(outline) {}
                    path class={ (LIMIT.class()) " outline" } d=(outline) {}
                }
                (colour_bar(map, range, spacing, &self.value_label, (right + gap, width), (TOP, bottom.max(TOP + 120.0))))
            }
        };
        Figure::new(title, caption, Drawing::still(self.legend(), svg))
    }

    fn legend(&self) -> Markup {
        html! {
            @if let Some((_, label)) = &self.style.limit {
                ul.legend { li {
                    svg class=(LIMIT.class()) width="16" height="14" aria-hidden="true" {
                        path.outline d="M2 2H14V12H2Z" {}
                    }
                    (label)
                } }
            }
        }
    }

    /// Ends of the colour scale.
    fn range(&self) -> (f64, f64) {
        let cells = || self.cells.iter().flatten().copied();
        if self.style.signed {
            let size = data_range(cells().map(f64::abs).chain([0.0]), Spacing::Linear).1;
            return (-size, size);
        }
        self.style.range.unwrap_or_else(|| data_range(cells(), self.style.spacing))
    }

    fn cell(&self, row: usize, column: usize) -> f64 {
        self.cells.get(row).and_then(|cells| cells.get(column)).copied().unwrap_or(f64::NAN)
    }

    /// The edges around the cells up to `limit`; `corner` is the lower left corner of a cell
    /// \[px\].
    fn outline(&self, limit: f64, corner: impl Fn(usize, usize) -> (f64, f64)) -> String {
        let inside = |row: usize, column: usize| self.cell(row, column) <= limit;
        let (rows, columns) = (self.y.len(), self.x.len());
        let mut path = Path::default();
        for row in 0..rows {
            for column in (0..columns).filter(|column| inside(row, *column)) {
                let sides = [
                    (row > 0 && inside(row - 1, column), [(0, 0), (0, 1)]),
                    (row + 1 < rows && inside(row + 1, column), [(1, 0), (1, 1)]),
                    (column > 0 && inside(row, column - 1), [(0, 0), (1, 0)]),
                    (column + 1 < columns && inside(row, column + 1), [(0, 1), (1, 1)]),
                ];
                for (_, ends) in sides.iter().filter(|(goes_on, _)| !goes_on) {
                    path.polyline(ends.map(|(up, along)| corner(row + up, column + along)));
                }
            }
        }
        path.data().to_owned()
    }
}

/// A cell whose upper left corner is given.
fn drawn(
    value: f64,
    (map, scale): (colorous::Gradient, &Scale),
    digits: Option<usize>,
    (x, top): (f64, f64),
    width: f64,
) -> Markup {
    let along = if scale.shows(value) { scale.position(value).clamp(0.0, 1.0) } else { 0.0 };
    let (fill, ink) = if value.is_finite() {
        (hex(map, along), text_on(map, along))
    } else {
        ("none".to_owned(), "currentColor")
    };
    html! {
        rect.cell x=(px(x)) y=(px(top)) width=(px(width)) height=(px(CELL_HEIGHT)) fill=(fill) {
            // A cell without room for a number shows it as a tooltip.
            @if digits.is_none() { title { (significant(value, DIGITS[0])) } }
        }
        @if let Some(digits) = digits {
            text.cell-value x=(px(x + width / 2.0)) y=(px(top + CELL_HEIGHT / 2.0 + 4.0))
                text-anchor="middle" style={ "fill:" (ink) } {
                @if value.is_finite() { (significant(value, digits)) } @else { (MISSING) }
            }
        }
    }
}

fn longest(texts: &[String]) -> f64 {
    texts.iter().map(|text| text.chars().count()).max().unwrap_or(0) as f64
}

/// An upright colour bar of 14 px width at `x` in a drawing that ends at `end`, with its label above
/// and its ticks to the right.
pub(super) fn colour_bar(
    map: colorous::Gradient,
    range: (f64, f64),
    spacing: Spacing,
    label: &str,
    (x, end): (f64, f64),
    (top, bottom): (f64, f64),
) -> maud::Markup {
    const STEPS: usize = 48;
    let step = (bottom - top) / STEPS as f64;
    let y = Scale::new(range, (bottom, top), spacing);
    let middle = (x + 14.0).min(end - text_width(label) / 2.0);
    html! {
        @for i in 0..STEPS {
            // Each step extends below the next, so that no seam is visible between them.
            rect x=(px(x)) y=(px(top + step * i as f64)) width="14"
                height=(px(bottom - top - step * i as f64))
                fill=(hex(map, 1.0 - (i as f64 + 0.5) / STEPS as f64)) {}
        }
        @for (value, text) in y.ticks((bottom - top) / 32.0) {
            text.tick x=(px(x + 20.0)) y=(px(y.position(value) + 4.0)) { (text) }
        }
        text.axis x=(px(middle)) y=(px(top - 10.0)) text-anchor="middle" { (label) }
    }
}
