//! Several recorded runs, with the scenarios and summaries beside their traces.

use super::{Compared, Run, Subject, page};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::path::Path;
use thermyo_files::input::InputError;
use thermyo_files::table::Table;
use thermyo_files::units::UnitSystem;
use thermyo_record::following::Followed;
use thermyo_record::tracking::Control;

/// Tracking of a joint's set point, from its summary.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct JointControl {
    rms_error_rad: f64,
    end_error_rad: f64,
    rms_stiffness_error: f64,
    pulses_per_s: f64,
    limited: f64,
    /// The figures of a shape.
    control: Option<Followed>,
}

impl JointControl {
    /// Two lines of text.
    fn text(&self, units: UnitSystem) -> String {
        let angle = |value_rad| thermyo_joint::angle_text(value_rad, units);
        let limited = match self.limited {
            limited if limited > 0.0 => {
                format!("; limited for {} of the time", UnitSystem::Practical.text(limited, "", 1))
            }
            _ => String::new(),
        };
        format!(
            "set point: RMS error {}, at the end {}{}; stiffness, RMS error {}\n\
             valves: {:.1} pulses/s{limited}\n",
            angle(self.rms_error_rad),
            angle(self.end_error_rad),
            self.control.as_ref().map_or_else(String::new, Followed::shape_text),
            units.text(self.rms_stiffness_error, "", 2),
            self.pulses_per_s,
        )
    }
}

/// A run, and its tracking of the set point: that part of its summary, or null.
#[derive(Debug, Clone)]
pub struct Recorded {
    pub run: Run,
    control: Value,
}

impl Recorded {
    /// The record in `table`, read from the file `trace`.
    pub fn of_trace(name: &str, trace: &Path, table: &Table) -> Result<Self, InputError> {
        let run = Run::new(name, kind_of(trace), table)?;
        let control = control_of(trace, run.subject);
        Ok(Self { run, control })
    }

    /// A record without scenario and summary.
    pub fn alone(name: &str, table: &Table) -> Result<Self, InputError> {
        Ok(Self { run: Run::new(name, None, table)?, control: Value::Null })
    }
}

/// `plant.kind` of the scenario beside a trace; none if there is no scenario.
fn kind_of(trace: &Path) -> Option<&'static str> {
    let loaded = thermyo_setup::load(&trace.with_file_name("scenario.toml")).ok()?;
    Some(loaded.plant.plant.kind.word())
}

/// Tracking of the set point, from the summary beside a trace; null if there is no summary.
fn control_of(trace: &Path, subject: Subject) -> Value {
    let summary = std::fs::read(trace.with_file_name("summary.json")).unwrap_or_default();
    let summary: Value = serde_json::from_slice(&summary).unwrap_or_default();
    match subject {
        Subject::Muscle => summary["control"].clone(),
        Subject::Joint => json!(JointControl::deserialize(summary).ok()),
    }
}

/// The first run, and the differences of the others from it.
#[derive(Debug)]
pub struct Comparison {
    runs: Vec<Run>,
    controls: Vec<Value>,
    /// An entry for each run except the first.
    pub compared: Vec<Compared>,
}

impl Comparison {
    /// Compares the other runs with the first; all have the same [`Subject`].
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
        let gaps = self.runs.iter().filter_map(Run::gap);
        let unlike = others.iter().filter_map(|run| run.unlike(first));
        let apart = self.compared.iter().filter(|compared| compared.differences.is_empty());
        let apart = apart.map(|Compared { run, with, .. }| {
            format!("{run} and {with} have no column at the same time in common")
        });
        unlike.chain(gaps).chain(apart).collect()
    }

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
        page::page(&self.runs, &self.compared, &self.warnings())
    }

    /// Tracking of each run, below its name; empty without a set point.
    pub fn tracking(&self, units: UnitSystem) -> String {
        let all = self.runs.iter().zip(&self.controls).filter_map(|(run, control)| {
            let text = match run.subject {
                Subject::Muscle => Control::deserialize(control).ok()?.text(units),
                Subject::Joint => JointControl::deserialize(control).ok()?.text(units),
            };
            Some(format!("{}\n{text}", run.name))
        });
        all.collect()
    }

    /// Pressure, temperatures and length of all runs as a separate drawing.
    pub fn plot(&self) -> String {
        page::plot(&self.runs)
    }

    /// Rows of quantity, RMS, mean and largest difference, of each run except the first.
    pub fn rows(&self) -> impl Iterator<Item = Vec<[String; 4]>> {
        self.compared.iter().map(page::rows)
    }
}
