//! Files that the pages of `thermyo serve` and `thermyo playground` share.

use thermyo_report::muscle::palette;
use thermyo_report::style::{CHART_SCRIPT, CHART_STYLE, DRAWING_STYLE};

/// Kind of a board, with a page of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Muscle,
    Joint,
}

impl Kind {
    /// The page, with the parts for this kind of board.
    pub fn page(self) -> String {
        let page = include_str!("page.html");
        match self {
            Self::Muscle => page.to_owned(),
            Self::Joint => page.replacen("data-kind=\"muscle\"", "data-kind=\"joint\"", 1),
        }
    }
}

/// Names and texts, apart from [`colours`].
pub const FILES: [(&str, &str); 6] = [
    ("drawing.css", DRAWING_STYLE),
    ("chart.css", CHART_STYLE),
    ("page.css", include_str!("page.css")),
    ("chart.js", CHART_SCRIPT),
    ("live.js", include_str!("live.js")),
    ("muscle.js", include_str!("muscle.js")),
];

/// Files of the page of `thermyo serve` alone, apart from `units.js`.
pub const OWN_FILES: [(&str, &str); 5] = [
    ("page.js", include_str!("page.js")),
    ("quantities.js", include_str!("quantities.js")),
    ("of_muscle.js", include_str!("of_muscle.js")),
    ("of_joint.js", include_str!("of_joint.js")),
    ("arm.js", include_str!("arm.js")),
];

/// `palette.js`: colours of the muscle, cold to hot.
pub fn colours() -> String {
    let colours: Vec<String> = palette(64).iter().map(|colour| format!("\"{colour}\"")).collect();
    format!("export default [{}];\n", colours.join(","))
}
