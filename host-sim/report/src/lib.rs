//! `report.html`: one self-contained page per run, and the drawings on it.
//!
//! Bottom up: [`scale`] turns values into text and positions, [`decimate`] keeps the drawings
//! small, [`chart`], [`bars`], [`muscle`] and [`heatmap`] draw a [`figure::Figure`] each, [`page`]
//! puts text and figures on a page. [`series`] records the data to draw, in bounded memory, during
//! a run.
//!
//! A drawing names its colours by class and leaves their values to the page's style sheet, so one
//! drawing serves light mode, dark mode and print. `plot` packs the points of the charts for
//! `report.js`, which draws them again by `chart.js`, the charts of all pages; without script and
//! in print the page shows the static drawings.

mod axes;
pub mod bars;
pub mod chart;
mod colour;
pub mod decimate;
pub mod figure;
pub mod heatmap;
mod layer;
pub mod muscle;
pub mod page;
mod path;
mod plot;
pub mod scale;
pub mod series;
pub mod style;

pub use colour::Colour;

pub use series::Recorder;
