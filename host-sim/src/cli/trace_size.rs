//! The warning about a trace that fills a disk.

use super::Console;
use super::unbuilt::located;
use std::path::Path;
use thermyo_files::input::read_text;
use thermyo_scenario::Run;
use thermyo_scenario::document::{Document, Entry};
use thermyo_scenario::joint::{JointDocument, is_joint};

const KEY: &str = "run.log_every";
/// Mean length of a cell and its comma, on the traces of the shipped scenarios \[byte\].
const CELL_BYTES: f64 = 12.0;
/// Size of a trace above which a warning is printed \[byte\].
const LARGE_BYTES: f64 = 1.0e9;

/// Warns before a run that writes a large trace with this many columns.
pub(super) fn warn(run: &Run, columns: usize, path: &Path, to: &mut Console<'_>) {
    let rows = run.steps() / run.log_every + 1;
    let bytes = rows as f64 * columns as f64 * CELL_BYTES;
    if bytes <= LARGE_BYTES {
        return;
    }
    let text = read_text(path).unwrap_or_default();
    let given = if is_joint(&text) {
        JointDocument::parse(&text, path).ok().and_then(|document| document.given(KEY))
    } else {
        let document = Document::parse(&text, path).ok();
        document.and_then(|document| document.plant.get(KEY).map(Entry::given))
    };
    let given = given.unwrap_or_else(|| (None, KEY.to_owned(), run.log_every.to_string()));
    let why = format!(
        "the trace will have {rows} rows, about {:.0} GB; with a larger {KEY} it has fewer",
        bytes / 1e9
    );
    to.warn(&[located(path, Some(given), why)]);
}
