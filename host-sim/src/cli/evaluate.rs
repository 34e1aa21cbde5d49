//! `thermyo evaluate`: its arguments, and what it prints and writes.

use super::{Failure, print, publish};
use crate::evaluate::{self, control_page};
use crate::output::OutputDir;
use crate::scenario;
use clap::{Args, ValueEnum};
use std::io::Write;
use std::path::PathBuf;

/// Arguments of `thermyo evaluate`.
#[derive(Debug, Args)]
pub(super) struct EvaluateArgs {
    /// What to evaluate
    #[arg(value_enum)]
    what: Subject,
    /// Nominal scenario [default: scenarios/nominal.toml as built in]
    #[arg(long, value_name = "FILE.toml")]
    scenario: Option<PathBuf>,
    /// Folder for report.html and the plots of docs/control.md; of `control`
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Subject {
    /// The estimate of the gas temperature
    Estimator,
    /// The muscle at rest, in motion, and against the usual practice
    Control,
    /// What `thermyo tune` finds of a muscle told wrong, and what that is worth
    Tune,
    /// What breaks, whether it is found in time, and what follows; and that nothing else is
    Faults,
}

pub(super) fn run(
    args: &EvaluateArgs,
    out: &mut dyn Write,
    err: &mut dyn Write,
) -> Result<(), Failure> {
    let EvaluateArgs { what, scenario: path, out: folder } = args;
    if folder.is_some() && !matches!(what, Subject::Control) {
        return Err(Failure::Usage("--out goes with `evaluate control` only".to_owned()));
    }
    let drawn = folder.as_deref().map(OutputDir::create).transpose()?;
    let nominal = match path {
        Some(path) => scenario::load(path)?,
        None => evaluate::nominal()?,
    };
    let lines = match what {
        Subject::Estimator => evaluate::estimator::evaluate(&nominal).map_err(Failure::Run)?,
        Subject::Control => evaluate::control::evaluate(&nominal).map_err(Failure::Run)?,
        Subject::Tune => evaluate::tune::evaluate(&nominal)?,
        Subject::Faults => evaluate::faults::evaluate().map_err(Failure::Run)?,
    };
    print(out, &evaluate::table(&lines))?;
    if let Some(mut files) = drawn {
        let plots = control_page::plots(&nominal)?;
        for plot in &plots {
            files.text(plot.file, &plot.svg())?;
        }
        files.text("report.html", &control_page::page(&nominal, &lines, &plots))?;
        publish(files, err)?;
    }
    match evaluate::missed(&lines) {
        (0, _) => Ok(()),
        (missed, all) => Err(Failure::Check(format!("{missed} of {all} targets are missed"))),
    }
}
