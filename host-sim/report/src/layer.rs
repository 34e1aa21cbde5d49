//! One series of a chart: thinning, drawing and legend entry.

use std::ops::Range;

use maud::{Markup, html};

use super::Colour;
use super::decimate::{self, Keep};
use super::path::Path;
use super::plot::{Bits, Store};
use super::scale::Scale;
use super::series::{CAPACITY, Recorder};
use serde_json::{Value, json};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mark {
    /// A thin line over rising x.
    Line,
    /// A thin line through points in any order.
    Plane,
    /// A wide pale line over rising x.
    Wide,
    /// A dashed line over rising x.
    Dashed,
    Dots,
    /// The area between two edges over rising x.
    Band,
}

impl Mark {
    /// Drawing order, lowest first: a line through dense dots stays visible.
    pub(super) const STACK: [Self; 6] =
        [Self::Wide, Self::Band, Self::Dots, Self::Dashed, Self::Plane, Self::Line];

    fn class(self) -> &'static str {
        match self {
            Self::Line | Self::Plane => "line",
            Self::Wide => "line wide",
            Self::Dashed => "line dashed",
            Self::Dots => "dots",
            Self::Band => "band",
        }
    }
}

#[derive(Debug, Clone)]
pub(super) struct Layer {
    pub(super) name: String,
    pub(super) colour: Colour,
    pub(super) mark: Mark,
    x: Vec<f64>,
    /// One edge, or the two of a band. NaN if any of them is not finite.
    edges: Vec<Vec<f64>>,
}

impl Layer {
    pub(super) fn new(name: &str, colour: Colour, mark: Mark, x: &[f64], edges: &[&[f64]]) -> Self {
        let len = edges.iter().map(|edge| edge.len()).fold(x.len(), usize::min);
        let present =
            |i: &usize| x[*i].is_finite() && edges.iter().all(|edge| edge[*i].is_finite());
        let masked = |edge: &&[f64]| {
            (0..len).map(|i| if present(&i) { edge[i] } else { f64::NAN }).collect()
        };
        let edges = edges.iter().map(masked).collect();
        Self { name: name.to_owned(), colour, mark, x: x[..len].to_vec(), edges }
    }

    /// x of the points without gaps.
    pub(super) fn x(&self) -> impl Iterator<Item = f64> {
        let there = |i: &usize| self.edges.iter().all(|edge| edge[*i].is_finite());
        (0..self.x.len()).filter(there).map(|i| self.x[i])
    }

    /// y of the points whose x is within `window`.
    pub(super) fn y(&self, window: (f64, f64)) -> impl Iterator<Item = f64> {
        let within = move |i: &usize| (window.0..=window.1).contains(&self.x[*i]);
        (0..self.x.len()).filter(within).flat_map(|i| self.edges.iter().map(move |edge| edge[i]))
    }

    /// The points in `window` and the next on either side, so that lines continue to its border.
    fn rows(&self, window: (f64, f64)) -> Range<usize> {
        if self.mark == Mark::Plane {
            return 0..self.x.len();
        }
        let first = self.x.iter().position(|x| *x >= window.0).unwrap_or(self.x.len());
        let last = self.x.iter().rposition(|x| *x <= window.1).unwrap_or(0);
        first.saturating_sub(1)..(last + 2).min(self.x.len())
    }

    /// Unbroken stretches; for a band, their outlines.
    fn runs(&self, window: (f64, f64), points: usize) -> Vec<Vec<(f64, f64)>> {
        let rows = self.rows(window);
        if rows.is_empty() {
            return Vec::new();
        }
        let thinned = |edge: &[f64], keep, budget| {
            decimate::curve(&self.x[rows.clone()], &edge[rows.clone()], keep, budget)
        };
        match (self.mark, &self.edges[..]) {
            (Mark::Plane, [y]) => thinned(y, Keep::Both, points),
            (Mark::Dots, [y]) => thinned(y, Keep::Y, points / 3),
            (Mark::Band, [low, high]) => {
                let [low, high] = [low, high].map(|edge| thinned(edge, Keep::Y, points / 2));
                low.into_iter()
                    .zip(high)
                    .map(|(low, high)| low.into_iter().chain(high.into_iter().rev()).collect())
                    .collect()
            }
            (_, edges) => edges.iter().flat_map(|y| thinned(y, Keep::Y, points)).collect(),
        }
    }

    pub(super) fn draw(&self, window: (f64, f64), points: usize, x: &Scale, y: &Scale) -> Markup {
        let drawable = |p: &&(f64, f64)| x.shows(p.0) && y.shows(p.1);
        let at = |p: &(f64, f64)| (x.position(p.0), y.position(p.1));
        let mut path = Path::default();
        for run in self.runs(window, points) {
            let shown = run.iter().filter(drawable).map(at);
            match self.mark {
                Mark::Dots => path.dots(shown),
                Mark::Band => path.area(shown),
                _ => path.polyline(shown),
            }
        }
        html! { path class={ (self.colour.class()) " " (self.mark.class()) } d=(path.data()) {} }
    }

    /// The data from which the page's script draws the layer.
    pub(super) fn plot(&self, store: &mut Store, log: bool) -> Value {
        let fine = if log { Bits::ThirtyTwo } else { Bits::Sixteen };
        let (x, edges) = self.kept();
        let edges: Vec<usize> = edges.iter().map(|edge| store.add(edge, fine)).collect();
        json!({
            "name": self.name,
            "colour": self.colour.class(),
            "mark": self.mark.class(),
            "rising": self.mark != Mark::Plane,
            "x": store.add(&x, Bits::ThirtyTwo),
            "y": edges,
        })
    }

    /// The points, thinned for a page.
    fn kept(&self) -> (Vec<f64>, Vec<Vec<f64>>) {
        if self.x.len() <= CAPACITY {
            return (self.x.clone(), self.edges.clone());
        }
        if let (Mark::Plane, [y]) = (self.mark, &self.edges[..]) {
            let gap = [(f64::NAN, f64::NAN)];
            let runs = decimate::curve(&self.x, y, Keep::Both, CAPACITY);
            let (x, y) = runs.iter().flat_map(|run| run.iter().chain(&gap).copied()).unzip();
            return (x, vec![y]);
        }
        let names = ["x", "low", "high"];
        let mut recorder = Recorder::new(&names[..=self.edges.len()]);
        for (i, x) in self.x.iter().enumerate() {
            let row: Vec<f64> = [*x].into_iter().chain(self.edges.iter().map(|e| e[i])).collect();
            recorder.push(&row);
        }
        let column = |name: &str| recorder.column(name).unwrap_or_default().to_vec();
        (column("x"), names[1..=self.edges.len()].iter().map(|name| column(name)).collect())
    }

    /// Whether both layers look the same in the legend.
    pub(super) fn looks_like(&self, other: &Self) -> bool {
        (&self.name, self.colour, self.mark) == (&other.name, other.colour, other.mark)
    }

    /// Sample for a legend: 26 by 10 px.
    pub(super) fn sample(&self) -> Markup {
        let class = self.mark.class();
        html! {
            svg class=(self.colour.class()) width="26" height="10" aria-hidden="true" {
                @match self.mark {
                    Mark::Band => rect class=(class) x="1" width="24" height="10" {},
                    Mark::Dots => path class=(class) d="M4 5h0M13 5h0M22 5h0" {},
                    _ => path class=(class) d="M1 5h24" {},
                }
            }
        }
    }

    pub(super) fn legend(&self) -> Markup {
        html! { li { (self.sample()) (self.name) } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_is_thinned_for_itself() {
        let x: Vec<f64> = (0..100_000).map(f64::from).collect();
        let layer = Layer::new("", Colour::Blue, Mark::Line, &x, &[&x]);
        let runs = layer.runs((500.0, 600.0), decimate::POINTS);
        assert_eq!(runs.len(), 1);
        assert_eq!((runs[0][0].0, runs[0].len()), (499.0, 103));
        assert!(layer.runs((200_000.0, 300_000.0), decimate::POINTS).iter().flatten().count() <= 1);
    }
}
