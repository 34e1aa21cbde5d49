use super::{Failure, OutputArgs, UnitArgs, print, publish, read_record, trace_in};
use clap::Args;
use std::io::Write;
use std::path::{Path, PathBuf};
use thermyo_files::output::OutputDir;
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

pub(super) fn run(
    args: &CompareArgs,
    stdout: &mut dyn Write,
    stderr: &mut dyn Write,
) -> Result<(), Failure> {
    let mut runs = Vec::new();
    for path in &args.runs {
        let trace = trace_in(path);
        let table = read_record(&trace, stderr)?;
        runs.push(Recorded::of_trace(&name(path), &trace, &table)?);
    }
    refuse_unlike(&runs)?;
    let comparison = Comparison::of(runs);
    for warning in comparison.warnings() {
        let _ = writeln!(stderr, "thermyo: warning: {warning}");
    }
    let units = args.units.system();
    let folder = args.output.out.clone().unwrap_or_else(|| PathBuf::from("out/compare"));
    let mut out = OutputDir::create(&folder)?;
    let json = comparison.summary();
    out.text("summary.json", &json)?;
    out.text("report.html", &comparison.page())?;
    publish(out, args.output.format, stderr)?;
    if args.output.format.json {
        return print(stdout, &json);
    }
    print(stdout, &compare::text(&comparison.compared, units))?;
    print(stdout, &comparison.tracking(units))?;
    print(stdout, &format!("report: {}\n", folder.join("report.html").display()))
}

/// A joint has other columns than a muscle.
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

/// Name of a run: its path without the file name that a trace has.
fn name(path: &Path) -> String {
    let folder = path
        .parent()
        .filter(|_| path.ends_with("trace.csv") || path.ends_with(thermyo_joint::trace::FILE));
    let named = folder.filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(path);
    named.display().to_string()
}
