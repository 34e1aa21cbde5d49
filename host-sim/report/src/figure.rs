//! A drawing, and its title and caption on a page.

use super::chart::Chart;
use maud::{Markup, html};

#[derive(Debug, Clone)]
pub struct Drawing {
    /// Legend above the drawing; may be empty.
    pub legend: Markup,
    pub svg: Markup,
    /// Data for the interactive chart that replaces the drawing, if any.
    pub chart: Option<Chart>,
}

impl Drawing {
    /// A drawing without an interactive chart.
    pub fn still(legend: Markup, svg: Markup) -> Self {
        Self { legend, svg, chart: None }
    }
}

/// A drawing with its title and caption. The page numbers it.
#[derive(Debug, Clone)]
pub struct Figure {
    title: String,
    caption: String,
    pub(super) drawing: Drawing,
}

impl Figure {
    /// Creates a figure; `caption` may be empty.
    pub fn new(title: &str, caption: &str, drawing: Drawing) -> Self {
        Self { title: title.to_owned(), caption: caption.to_owned(), drawing }
    }

    pub fn svg(&self) -> &str {
        &self.drawing.svg.0
    }

    pub(super) fn render(&self, number: usize) -> Markup {
        html! {
            figure id=(figure_id(number)) {
                div.figure-title { (self.title) }
                (self.drawing.legend)
                div.plot tabindex="0" { (self.drawing.svg) }
                figcaption { b { "Figure " (number) "." } " " (self.caption) }
            }
        }
    }
}

impl Chart {
    pub fn figure(&self, title: &str, caption: &str) -> Figure {
        let chart = Some(self.clone());
        let drawing = Drawing { legend: self.legend(), svg: self.svg(title).0, chart };
        Figure::new(title, caption, drawing)
    }
}

pub(super) fn figure_id(number: usize) -> String {
    format!("fig-{number}")
}
