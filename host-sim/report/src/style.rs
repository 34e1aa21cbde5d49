//! Style sheets and the script of charts, shared by reports, the live page and the playground.

pub const DRAWING_STYLE: &str = include_str!("drawing.css");
/// Legend, cursor and buttons of the charts.
pub const CHART_STYLE: &str = include_str!("chart.css");
/// The interactive charts, a module.
pub const CHART_SCRIPT: &str = include_str!("chart.js");
