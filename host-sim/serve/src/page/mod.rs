//! Files that the pages of `thermyo serve` and `thermyo playground` share.

use thermyo_report::muscle::palette;
use thermyo_report::style::{CHART_SCRIPT, CHART_STYLE, DRAWING_STYLE};

/// Names and texts, apart from [`colours`].
pub const FILES: [(&str, &str); 6] = [
    ("drawing.css", DRAWING_STYLE),
    ("chart.css", CHART_STYLE),
    ("page.css", include_str!("page.css")),
    ("chart.js", CHART_SCRIPT),
    ("live.js", include_str!("live.js")),
    ("muscle.js", include_str!("muscle.js")),
];

/// `palette.js`: colours of the muscle, cold to hot.
pub fn colours() -> String {
    let colours: Vec<String> = palette(64).iter().map(|colour| format!("\"{colour}\"")).collect();
    format!("export default [{}];\n", colours.join(","))
}
