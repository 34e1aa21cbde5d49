//! A kind of scenario that the page runs.

use serde_json::Value;

/// File name in messages about a text that the page wrote.
pub const WRITTEN: &str = "scenario.toml";
/// Duration longer than any use of the page \[s\].
pub const ENDLESS_S: f64 = 1.0e9;

/// A kind of scenario: one muscle, or a joint.
pub trait Kind: Sized {
    const COLUMNS: &'static [&'static str];
    type Run;

    /// Reads a text, named `origin` in messages; returns it with the warnings of `thermyo run`, one per line.
    fn parse(text: &str, origin: &str) -> Result<(Self, String), String>;
    /// The text for `thermyo run`.
    fn render(&self) -> String;
    /// Parameters of the plant by table and key.
    fn settings(&self) -> Value;
    /// The same scenario with other numbers, in the plant; if `configured`, in the core too.
    fn turned(&self, values: &[(String, f64)], configured: bool) -> Result<Self, String>;
    /// The same scenario without an end, with every step logged.
    fn endless(&self) -> Self;

    /// A run at time zero.
    fn start(&self) -> Result<Self::Run, String>;
    /// Takes over the numbers of the plant in a run.
    fn retune(&self, run: &mut Self::Run) -> Result<(), String>;
    /// Runs one step. If it is logged and `rows` is given, adds the cells of its row to `rows`. Returns whether there
    /// is another step.
    fn step(run: &mut Self::Run, rows: Option<&mut Vec<f64>>) -> Result<bool, String>;
    /// A line with the core's mode, a line with its faults; none before the first step.
    fn state(run: &Self::Run) -> String;
}

/// The refusal of a key with a file's name.
pub fn no_file(origin: &str, key: &str, line: Option<u64>) -> String {
    let line = line.map_or(String::new(), |line| format!(":{line}"));
    format!(
        "{origin}{line}: {key}: this page takes no CSV file: leave the key out, or run the scenario with \
         `thermyo run`"
    )
}
