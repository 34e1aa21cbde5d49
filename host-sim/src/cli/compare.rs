use super::{Failure, OutputArgs, UnitArgs, print, publish, read_record, trace_in};
use clap::Args;
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};
use thermyo_files::output::OutputDir;
use thermyo_files::units::UnitSystem;
use thermyo_record::tracking::Control;
use thermyo_runs::compare;
use thermyo_runs::compare::{Compared, Run};

#[derive(Debug, Args)]
pub(super) struct CompareArgs {
    /// Recorded runs: folders of results, or traces; the others are compared with the first
    #[arg(required = true, num_args = 2..)]
    runs: Vec<PathBuf>,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    units: UnitArgs,
}

pub(super) fn run(
    args: &CompareArgs,
    stdout: &mut dyn Write,
    stderr: &mut dyn Write,
) -> Result<(), Failure> {
    let mut runs = Vec::new();
    for path in &args.runs {
        let trace = trace_in(path);
        runs.push(Run::new(&name(path), kind_of(&trace), &read_record(&trace, stderr)?)?);
    }
    let Some((first, others)) = runs.split_first() else { return Ok(()) };
    let compared: Vec<Compared> = others.iter().map(|run| run.compared(first)).collect();
    for note in others.iter().filter_map(|run| run.unlike(first)) {
        let _ = writeln!(stderr, "thermyo: warning: {note}");
    }
    for compared in compared.iter().filter(|compared| compared.differences.is_empty()) {
        let Compared { run, with, .. } = compared;
        let _ = writeln!(
            stderr,
            "thermyo: warning: {run} and {with} have no column at the same time in common"
        );
    }
    let units = args.units.system();
    let folder = args.output.out.clone().unwrap_or_else(|| PathBuf::from("out/compare"));
    let mut out = OutputDir::create(&folder)?;
    let control: Vec<Value> = args.runs.iter().map(|path| control_of(path)).collect();
    let mut json = serde_json::to_value(&compared).expect("figures are plain data");
    for (entry, control_of_run) in json.as_array_mut().into_iter().flatten().zip(&control[1..]) {
        entry["control"] = json!({ "run": control_of_run, "with": control[0] });
    }
    let json = format!("{json:#}\n");
    out.text("summary.json", &json)?;
    out.text("report.html", &compare::page(&runs, &compared))?;
    publish(out, args.output.format, stderr)?;
    if args.output.format.json {
        return print(stdout, &json);
    }
    print(stdout, &compare::text(&compared, units))?;
    for (run, control) in runs.iter().zip(&control) {
        print(stdout, &tracking(&run.name, control, units))?;
    }
    print(stdout, &format!("report: {}\n", folder.join("report.html").display()))
}

/// `plant.kind` of the scenario beside a trace; none without one.
fn kind_of(trace: &Path) -> Option<&'static str> {
    let loaded = thermyo_setup::load(&trace.with_file_name("scenario.toml")).ok()?;
    Some(loaded.plant.plant.kind.word())
}

/// `control` of the summary beside a trace; null without one.
fn control_of(run: &Path) -> Value {
    let summary = std::fs::read(trace_in(run).with_file_name("summary.json")).unwrap_or_default();
    let summary: Value = serde_json::from_slice(&summary).unwrap_or_default();
    summary["control"].clone()
}

/// How a run followed its set point, below its name; empty without a set point.
fn tracking(name: &str, control: &Value, units: UnitSystem) -> String {
    let control = serde_json::from_value::<Control>(control.clone());
    control.map(|control| format!("{name}\n{}", control.text(units))).unwrap_or_default()
}

/// Name of a run: its path without the file name that every trace has.
fn name(path: &Path) -> String {
    let folder = path.parent().filter(|_| path.ends_with("trace.csv"));
    let named = folder.filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(path);
    named.display().to_string()
}
