use super::{Console, Failure, OutputArgs, UnitArgs, read_record, trace_in};
use clap::Args;
use std::path::{Path, PathBuf};
use thermyo_runs::compare;
use thermyo_runs::compare::{Comparison, Recorded, Subject};

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

pub(super) fn run(args: &CompareArgs, to: &mut Console<'_>) -> Result<(), Failure> {
    let to = to.as_asked(args.output.format).in_units(args.units);
    let mut runs = Vec::new();
    let traces: Vec<PathBuf> = args.runs.iter().map(|path| trace_in(path)).collect();
    for (path, trace) in args.runs.iter().zip(&traces) {
        let table = read_record(trace, to)?;
        runs.push(Recorded::of_trace(&name(path), trace, &table)?);
    }
    refuse_unlike(&runs)?;
    let comparison = Comparison::of(runs);
    for warning in comparison.warnings() {
        to.say(format_args!("warning: {warning}"));
    }
    let traces: Vec<&Path> = traces.iter().map(PathBuf::as_path).collect();
    let mut out = args.output.create_beside("compare", &traces)?;
    let json = comparison.summary();
    out.text("summary.json", &json)?;
    out.text("report.html", &comparison.page())?;
    let text = compare::text(&comparison.compared, to.units) + &comparison.tracking(to.units);
    to.results(out, (&json, &text))
}

/// Refuses a mix of joints and muscles, whose columns differ.
fn refuse_unlike(runs: &[Recorded]) -> Result<(), Failure> {
    let of = |subject| runs.iter().map(|recorded| &recorded.run).find(|run| run.subject == subject);
    match (of(Subject::Joint), of(Subject::Muscle)) {
        (Some(joint), Some(muscle)) => Err(Failure::Usage(format!(
            "{} is of a joint and {} of one muscle: compare runs of the same kind",
            joint.name, muscle.name
        ))),
        _ => Ok(()),
    }
}

/// Name of a run: its path without the file name of a trace.
fn name(path: &Path) -> String {
    let folder = path
        .parent()
        .filter(|_| path.ends_with("trace.csv") || path.ends_with(thermyo_joint::trace::FILE));
    let named = folder.filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(path);
    named.display().to_string()
}
