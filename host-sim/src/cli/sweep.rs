//! `thermyo sweep`: its arguments, and what it prints and writes.

use super::{Failure, OutputArgs, interrupt, load, print, progress_bar, publish, stopped};
use crate::commands::sweep::page::page;
use crate::commands::sweep::{Range, Shard, Sweep};
use crate::files::output::OutputDir;
use crate::files::rows::Rows;
use crate::scenario;
use crate::simulation::run::RunError;
use clap::Args;
use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// Arguments of `thermyo sweep`.
#[derive(Debug, Args)]
pub(super) struct SweepArgs {
    /// Scenario file (TOML)
    scenario: PathBuf,
    /// A key of the scenario, and its values: COUNT of them from FROM to TO, a fixed difference
    /// apart; with ":log" behind, a fixed ratio. One to three times; their product is run
    #[arg(long, value_name = "KEY=FROM:TO:COUNT[:log]", required = true)]
    vary: Vec<Range>,
    /// Run only each N-th point, beginning with the I-th, 1 to N
    #[arg(long, value_name = "I/N", default_value_t = Shard::WHOLE)]
    shard: Shard,
    /// The root-mean-square error that is good enough, in kelvin
    #[arg(long, value_name = "K", default_value_t = 1.0, value_parser = tolerance)]
    within: f64,
    #[command(flatten)]
    output: OutputArgs,
}

fn tolerance(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number > 0.0 && number.is_finite() => Ok(number),
        _ => Err("must be a number above 0".to_owned()),
    }
}

pub(super) fn run(
    args: SweepArgs,
    stdout: &mut dyn Write,
    stderr: &mut dyn Write,
) -> Result<(), Failure> {
    load(&args.scenario, stderr)?;
    let sweep = Sweep::new(&args.scenario, args.vary, args.shard).map_err(Failure::Sweep)?;
    let folder = args.output.out.unwrap_or_else(|| PathBuf::from("out/sweep"));
    let mut out = OutputDir::create(&folder)?;
    let bar = progress_bar(sweep.count() as u64, args.output.quiet);
    // In the order in which they are done, until all are there: a point may take minutes.
    let file = out.file("sweep.csv")?;
    let rows = Rows::new(file, &sweep.csv_header())
        .map_err(|error| out.unwritable("sweep.csv", &error))?;
    let rows = Mutex::new(rows);
    interrupt::watch();
    let outcome = sweep.run(interrupt::check, |point| {
        bar.inc(1);
        let mut rows = rows.lock().unwrap_or_else(PoisonError::into_inner);
        rows.push(&point.csv())?;
        rows.hand_over()
    });
    bar.finish_and_clear();
    drop(rows);
    let outcome = match outcome {
        Ok(outcome) => outcome,
        Err(RunError::Output(error)) if error.kind() == io::ErrorKind::Interrupted => {
            return Err(stopped(out, stderr));
        }
        Err(RunError::Output(error)) => {
            return Err(out.unwritable("sweep.csv", &error).into());
        }
        Err(other) => return Err(Failure::Run(other)),
    };
    let summary = outcome.summary(args.within);
    let json = serde_json::to_string_pretty(&summary).expect("a summary is plain data") + "\n";
    let stem = args.scenario.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into());
    out.text("sweep.csv", &outcome.csv())?;
    out.text("summary.json", &json)?;
    out.text("scenario.toml", &scenario::render(&sweep.base))?;
    out.text("report.html", &page(&outcome, &format!("Sweep of {stem}"), args.within))?;
    publish(out, stderr)?;
    if args.output.json {
        print(stdout, &json)?;
    } else {
        let mut text = format!("{} of {} points run\n", summary.run, summary.points);
        text += &format!("{}\n", summary.conclusion);
        for key in &summary.without_effect {
            text += &format!("{key} changes nothing in this scenario\n");
        }
        text += &format!("report: {}\n", folder.join("report.html").display());
        print(stdout, &text)?;
    }
    outcome.failed().map_or(Ok(()), |what| Err(Failure::Check(what)))
}
