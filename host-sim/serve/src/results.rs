//! What has been recorded or tuned, and may be opened from the page.

use std::path::{Path, PathBuf};

/// Files of a result that a page may ask for, and what they are.
const FILES: [(&str, &str); 5] = [
    ("report.html", "text/html; charset=utf-8"),
    ("trace.csv", "text/csv; charset=utf-8"),
    ("summary.json", "application/json"),
    ("scenario.toml", "text/plain; charset=utf-8"),
    ("tuned.toml", "text/plain; charset=utf-8"),
];

/// One of them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Outcome {
    /// Name of its folder.
    pub name: String,
    /// Where that is.
    pub folder: PathBuf,
    /// What it is.
    pub text: String,
}

impl Outcome {
    /// A file of it and its type, if a page may have that.
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
