use super::progress::Bar;
use super::{Failure, interrupt, load, print, publish, read_record, whole};
use clap::{Args, ValueEnum};
use std::io::Write;
use std::path::PathBuf;
use thermyo_evaluate::{CaseFigures, control_page, faults, recording};
use thermyo_files::output::OutputDir;
use thermyo_setup::Loaded;

#[derive(Debug, Args)]
pub(super) struct EvaluateArgs {
    /// Subject of the evaluation
    #[arg(value_enum)]
    subject: Subject,
    /// Folder of measured data; for `truth`
    data: Option<PathBuf>,
    /// Nominal scenario [default: scenarios/nominal.toml as built in]
    #[arg(long, value_name = "FILE.toml")]
    scenario: Option<PathBuf>,
    /// Folder for report.html, and the plots of docs/background/control-trials.md; for `control`
    /// and `faults`
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the table as JSON on standard output
    #[arg(long)]
    json: bool,
    /// No progress bar
    #[arg(long)]
    quiet: bool,
    /// Simulated hours of healthy muscles; for `faults` [default: 1]
    #[arg(long, value_name = "HOURS", value_parser = hours)]
    hours: Option<f64>,
    /// `estimator`: evaluate N random muscles (full model) instead of the table; `plants`: number
    /// of random plants [default: 200]
    #[arg(long, value_name = "N", value_parser = |text: &str| whole(text, 1..=10_000_u64))]
    random: Option<u64>,
    /// Seed of the random muscles or plants; with --random [default: 1]
    #[arg(long, value_name = "S", requires = "random", value_parser = |text: &str| whole(text, 0..=u64::MAX))]
    seed: Option<u64>,
    /// Evaluate a board's recording in this folder, with a reference sensor's column; for
    /// `estimator`
    #[arg(long, value_name = "DIR", conflicts_with_all = ["random", "scenario"])]
    recording: Option<PathBuf>,
    /// Lag of that reference sensor in seconds [default: 0]
    #[arg(long, value_name = "SECONDS", requires = "recording", conflicts_with_all = ["random", "scenario"], value_parser = lag_s)]
    reference_lag: Option<f64>,
}

fn lag_s(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value: &f64| (0.0..=10.0).contains(value));
    value.ok_or_else(|| "must be seconds from 0 to 10".to_owned())
}

fn hours(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value: &f64| (0.0..=10_000.0).contains(value));
    value.ok_or_else(|| "must be hours from 0 to 10000".to_owned())
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Subject {
    /// Accuracy of the estimated gas temperature
    Estimator,
    /// Control at rest, in motion, and against a PID baseline
    Control,
    /// Results of `thermyo tune` on a wrongly configured muscle, and the control that follows
    Tune,
    /// Fault injection: detection time, reaction, false alarms
    Faults,
    /// Random plants of every size: none diverges, and none oscillates without a warning
    Plants,
    /// Published measurements, from the data in a folder
    Truth,
}

/// Checks which arguments go together.
fn check(args: &EvaluateArgs) -> Result<(), Failure> {
    let EvaluateArgs { subject, data, scenario, out, hours, random, recording, .. } = args;
    let wrong = [
        (
            recording.is_some() && !matches!(subject, Subject::Estimator),
            "--recording goes with `evaluate estimator` only",
        ),
        (
            random.is_some() && !matches!(subject, Subject::Estimator | Subject::Plants),
            "--random goes with `evaluate estimator` and `evaluate plants` only",
        ),
        (
            random.is_some() && scenario.is_some(),
            "--random draws its own scenarios: leave out --scenario",
        ),
        (
            out.is_some() && !matches!(subject, Subject::Control | Subject::Faults),
            "--out goes with `evaluate control` and `evaluate faults` only",
        ),
        (
            hours.is_some() && !matches!(subject, Subject::Faults),
            "--hours goes with `evaluate faults` only",
        ),
        (
            data.is_some() && !matches!(subject, Subject::Truth),
            "a folder of data goes with `evaluate truth` only",
        ),
    ];
    match wrong.iter().find(|(found, _)| *found) {
        None => Ok(()),
        Some((_, why)) => Err(Failure::Usage((*why).to_owned())),
    }
}

pub(super) fn run(
    args: &EvaluateArgs,
    out: &mut dyn Write,
    err: &mut dyn Write,
) -> Result<(), Failure> {
    check(args)?;
    interrupt::watch();
    let drawn = args.out.as_deref().map(OutputDir::create).transpose()?;
    let nominal = match &args.scenario {
        Some(path) => load(path, err)?,
        None => thermyo_evaluate::nominal()?,
    };
    let lines = evaluated(args, &nominal, err)?;
    let stopped = interrupt::is_requested();
    if args.json {
        let json = serde_json::to_string_pretty(&lines).expect("a table is plain data") + "\n";
        print(out, &json)?;
    } else {
        print(out, &thermyo_evaluate::table(&lines))?;
    }
    if stopped {
        let _ = writeln!(err, "thermyo: {}", finished(lines.len()));
        return Err(Failure::Interrupted);
    }
    if let Some(files) = drawn {
        report(args.subject, &nominal, &lines, files, err)?;
    }
    match thermyo_evaluate::missed(&lines) {
        (0, _) => Ok(()),
        (missed, all) => Err(Failure::Check(format!("{missed} of {all} targets are missed"))),
    }
}

fn evaluated(
    args: &EvaluateArgs,
    nominal: &Loaded,
    err: &mut dyn Write,
) -> Result<Vec<CaseFigures>, Failure> {
    let bar = Bar::new(0, args.quiet);
    Ok(match args.subject {
        Subject::Estimator => match (&args.recording, args.random) {
            (Some(folder), _) => {
                let recorded = read_record(&folder.join(recording::FILE), err)?;
                vec![recording::evaluate(&recorded, args.reference_lag.unwrap_or(0.0))?]
            }
            (None, Some(count)) => {
                let seed = args.seed.unwrap_or(1);
                thermyo_evaluate::estimator::random(seed, count, &bar).map_err(Failure::Run)?
            }
            (None, None) => {
                thermyo_evaluate::estimator::evaluate(nominal, &bar).map_err(Failure::Run)?
            }
        },
        Subject::Control => {
            thermyo_evaluate::control::evaluate(nominal, &bar).map_err(Failure::Run)?
        }
        Subject::Truth => {
            let missing = || Failure::Usage("`evaluate truth` needs a folder of data".to_owned());
            thermyo_evaluate::truth::evaluate(args.data.as_deref().ok_or_else(missing)?, &bar)?
        }
        Subject::Plants => {
            let count = args.random.unwrap_or(thermyo_evaluate::plants::COUNT);
            thermyo_evaluate::plants::evaluate(args.seed.unwrap_or(1), count, &bar)
                .map_err(Failure::Run)?
        }
        Subject::Tune => thermyo_evaluate::tune::evaluate(nominal, &bar)?,
        Subject::Faults => {
            let evaluation = faults::Evaluation::new(nominal, args.hours.unwrap_or(faults::HOURS));
            evaluation.evaluate(&bar).map_err(Failure::Run)?
        }
    })
}

/// Writes the page, and for `control` its plots.
fn report(
    subject: Subject,
    nominal: &Loaded,
    lines: &[CaseFigures],
    mut files: OutputDir,
    err: &mut dyn Write,
) -> Result<(), Failure> {
    let page = if let Subject::Faults = subject {
        faults::page::page(nominal, lines)
    } else {
        let plots = control_page::plots(nominal)?;
        for plot in &plots {
            files.text(plot.file, &plot.svg())?;
        }
        control_page::page(nominal, lines, &plots)
    };
    files.text("report.html", &page)?;
    publish(files, err)
}

/// Message about the finished cases of a stopped table.
fn finished(count: usize) -> String {
    let finished = match count {
        0 => return "no case was finished, nothing is kept".to_owned(),
        1 => "line above is of the case that was".to_owned(),
        count => format!("{count} lines above are of the cases that were"),
    };
    format!("the {finished} finished; no report is written")
}

#[cfg(test)]
mod tests {
    use super::finished;

    #[test]
    fn one_line_is_one() {
        assert!(finished(0).starts_with("no case"));
        assert!(finished(1).starts_with("the line above is of the case that was finished;"));
        assert!(finished(2).starts_with("the 2 lines above are of the cases that were finished;"));
    }
}
