//! Style sheets and the script of charts, which reports, the live page and the playground share.

pub const DRAWING_STYLE: &str = include_str!("drawing.css");
/// Legend, cursor and buttons of the charts.
pub const CHART_STYLE: &str = include_str!("chart.css");
/// The interactive charts, a module.
pub const CHART_SCRIPT: &str = include_str!("chart.js");
