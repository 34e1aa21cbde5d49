//! Several recorded runs, with the scenario and the summary beside their traces.

use super::{Compared, Run, page};
use serde_json::{Value, json};
use std::path::Path;
use thermyo_files::input::InputError;
use thermyo_files::table::Table;
use thermyo_files::units::UnitSystem;
use thermyo_record::tracking::Control;

/// A run, and how it followed its set point: `control` of its summary, or null.
#[derive(Debug, Clone)]
pub struct Recorded {
    pub run: Run,
    control: Value,
}

impl Recorded {
    /// The record in `table`, read from the file `trace`.
    ///
    /// # Errors
    /// As [`Run::new`].
    pub fn of_trace(name: &str, trace: &Path, table: &Table) -> Result<Self, InputError> {
        Ok(Self { run: Run::new(name, kind_of(trace), table)?, control: control_of(trace) })
    }

    /// A record of which nothing else is known.
    ///
    /// # Errors
    /// As [`Run::new`].
    pub fn alone(name: &str, table: &Table) -> Result<Self, InputError> {
        Ok(Self { run: Run::new(name, None, table)?, control: Value::Null })
    }
}

/// `plant.kind` of the scenario beside a trace; none without one.
fn kind_of(trace: &Path) -> Option<&'static str> {
    let loaded = thermyo_setup::load(&trace.with_file_name("scenario.toml")).ok()?;
    Some(loaded.plant.plant.kind.word())
}

/// `control` of the summary beside a trace; null without one.
fn control_of(trace: &Path) -> Value {
    let summary = std::fs::read(trace.with_file_name("summary.json")).unwrap_or_default();
    let summary: Value = serde_json::from_slice(&summary).unwrap_or_default();
    summary["control"].clone()
}

/// The first run, and the differences of the others from it.
#[derive(Debug)]
pub struct Comparison {
    runs: Vec<Run>,
    controls: Vec<Value>,
    /// An entry for each run but the first.
    pub compared: Vec<Compared>,
}

impl Comparison {
    /// Compares the others with the first one.
    pub fn of(recorded: Vec<Recorded>) -> Self {
        let (runs, controls): (Vec<Run>, Vec<Value>) =
            recorded.into_iter().map(|recorded| (recorded.run, recorded.control)).unzip();
        let others = runs.iter().skip(1);
        let compared = runs
            .first()
            .into_iter()
            .flat_map(|first| others.clone().map(move |run| run.compared(first)));
        let compared = compared.collect();
        Self { runs, controls, compared }
    }

    /// Reasons why the comparison may mean little.
    pub fn warnings(&self) -> Vec<String> {
        let Some((first, others)) = self.runs.split_first() else { return Vec::new() };
        let unlike = others.iter().filter_map(|run| run.unlike(first));
        let apart = self.compared.iter().filter(|compared| compared.differences.is_empty());
        let apart = apart.map(|Compared { run, with, .. }| {
            format!("{run} and {with} have no column at the same time in common")
        });
        unlike.chain(apart).collect()
    }

    /// Content of `summary.json`.
    pub fn summary(&self) -> String {
        let mut json = serde_json::to_value(&self.compared).expect("figures are plain data");
        let entries = json.as_array_mut().into_iter().flatten();
        for (entry, control) in entries.zip(self.controls.iter().skip(1)) {
            entry["control"] = json!({ "run": control, "with": self.controls[0] });
        }
        format!("{json:#}\n")
    }

    /// Content of `report.html`.
    pub fn page(&self) -> String {
        page::page(&self.runs, &self.compared)
    }

    /// How each run followed its set point, below its name; empty without a set point.
    pub fn tracking(&self, units: UnitSystem) -> String {
        let all = self.runs.iter().zip(&self.controls).filter_map(|(run, control)| {
            let control = serde_json::from_value::<Control>(control.clone()).ok()?;
            Some(format!("{}\n{}", run.name, control.text(units)))
        });
        all.collect()
    }

    /// Pressure, temperatures and length of all runs as a separate drawing.
    pub fn plot(&self) -> String {
        page::plot(&self.runs)
    }

    /// Rows of quantity, RMS, mean and largest difference, of each run but the first.
    pub fn rows(&self) -> impl Iterator<Item = Vec<[String; 4]>> {
        self.compared.iter().map(page::rows)
    }
}
