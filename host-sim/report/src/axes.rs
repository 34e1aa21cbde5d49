//! Grid, ticks and axis titles of a plotting area.

use maud::{Markup, html};

use super::path::Path;
use super::scale::Scale;
use thermyo_files::number::px;

/// Height of tick labels and title of an x axis below a plotting area \[px\].
pub(super) const FOOT: f64 = 42.0;

/// A position on an axis \[px\] and its label.
pub(super) type Tick = (f64, String);

/// Ticks of `scale` at their positions, about `count`.
pub(super) fn ticks(scale: &Scale, count: f64) -> Vec<Tick> {
    scale.ticks(count).into_iter().map(|(value, label)| (scale.position(value), label)).collect()
}

/// Title of an axis: the label with its unit, if any.
pub(super) fn axis_title(label: &str, unit: &str) -> String {
    if unit.is_empty() { label.to_owned() } else { format!("{label} [{unit}]") }
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Area {
    pub(super) left: f64,
    pub(super) right: f64,
    pub(super) top: f64,
    pub(super) bottom: f64,
}

impl Area {
    /// Grid, y tick labels and base line.
    pub(super) fn draw(&self, x_ticks: &[Tick], y_ticks: &[Tick]) -> Markup {
        let Self { left, right, top, bottom } = *self;
        let mut grid = Path::default();
        for (x, _) in x_ticks {
            grid.polyline([(*x, top), (*x, bottom)]);
        }
        for (y, _) in y_ticks {
            grid.polyline([(left, *y), (right, *y)]);
        }
        html! {
            path.grid d=(grid.data()) {}
            @for (y, label) in y_ticks {
                text.tick x=(px(left - 7.0)) y=(px(y + 4.0)) text-anchor="end" { (label) }
            }
            path.frame d=(Path::through([(left, bottom), (right, bottom)]).data()) {}
        }
    }

    /// Tick labels and title of the x axis, within [`FOOT`] below.
    pub(super) fn x_axis(&self, ticks: &[Tick], title: &str) -> Markup {
        html! {
            @for (x, label) in ticks {
                text.tick x=(px(*x)) y=(px(self.bottom + 18.0)) text-anchor="middle" { (label) }
            }
            text.axis x=(px(f64::midpoint(self.left, self.right))) y=(px(self.bottom + 36.0))
                text-anchor="middle" { (title) }
        }
    }
}
