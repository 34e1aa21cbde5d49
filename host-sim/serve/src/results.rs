//! Results of recordings, tunings and studies, which the page can open.

use std::path::{Path, PathBuf};

const SVG: &str = "image/svg+xml";
/// Files of a result that a page may request, with their types.
const FILES: [(&str, &str); 12] = [
    ("report.html", "text/html; charset=utf-8"),
    ("trace.csv", "text/csv; charset=utf-8"),
    ("joint_trace.csv", "text/csv; charset=utf-8"),
    ("summary.json", "application/json"),
    ("scenario.toml", "text/plain; charset=utf-8"),
    ("tuned.toml", "text/plain; charset=utf-8"),
    ("identified.toml", "text/plain; charset=utf-8"),
    ("fit.svg", SVG),
    ("map.svg", SVG),
    ("stops.svg", SVG),
    ("motion.svg", SVG),
    ("runs.svg", SVG),
];

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Outcome {
    pub name: String,
    pub folder: PathBuf,
    /// Description on the page.
    pub text: String,
    /// Whether it has a muscle's record, `trace.csv`.
    pub trace: bool,
}

impl Outcome {
    /// Path and type of a file, if a page may request it.
    pub fn file(&self, name: &str) -> Option<(PathBuf, &'static str)> {
        let (known, kind) = FILES.iter().find(|(known, _)| *known == name)?;
        Some((self.folder.join(known), kind))
    }
}

/// The first folder `PREFIX-1`, `PREFIX-2` ... in `out` that does not exist, and its name.
pub fn next_folder(out: &Path, prefix: &str) -> (PathBuf, String) {
    let names = (1_u32..).map(|number| format!("{prefix}-{number}"));
    let mut free = names.map(|name| (out.join(&name), name)).filter(|(folder, _)| !folder.exists());
    free.next().unwrap_or_default()
}
