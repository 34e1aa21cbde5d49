use super::progress::Bar;
use super::{
    Console, Failure, FormatArgs, interrupt, load, pretty, quantity, read_record, trace_in, whole,
};
use clap::{Args, Subcommand};
use std::path::{Path, PathBuf};
use thermyo_evaluate::{CaseFigures, control_observed, control_page, estimator, faults, joint};
use thermyo_evaluate::{plants, recording, truth, tune};
use thermyo_files::output::OutputDir;
use thermyo_setup::Loaded;

#[derive(Debug, Args)]
pub(super) struct EvaluateArgs {
    #[command(subcommand)]
    subject: Subject,
}

#[derive(Debug, Subcommand)]
enum Subject {
    /// Accuracy of the estimated gas temperature
    Estimator(EstimatorArgs),
    /// Control at rest, in motion, and against a PID baseline
    Control(ControlArgs),
    /// Results of `thermyo tune` on a wrongly configured muscle, and the control that follows
    Tune {
        #[command(flatten)]
        nominal: NominalArgs,
        #[command(flatten)]
        format: FormatArgs,
    },
    /// Fault injection: detection time, reaction, false alarms
    Faults(FaultsArgs),
    /// A joint of two muscles: angle, stiffness, loads, wrong configurations, vents
    Joint {
        #[command(flatten)]
        format: FormatArgs,
    },
    /// Random plants of every size: none diverges, and none oscillates without a warning
    Plants(PlantsArgs),
    /// Published measurements, from the data in a folder
    Truth {
        /// Folder of measured data
        data: PathBuf,
        #[command(flatten)]
        format: FormatArgs,
    },
}

#[derive(Debug, Args)]
struct NominalArgs {
    /// Nominal scenario [default: scenarios/nominal.toml as built in]
    #[arg(long, value_name = "FILE.toml")]
    scenario: Option<PathBuf>,
}

#[derive(Debug, Args)]
struct EstimatorArgs {
    #[command(flatten)]
    nominal: NominalArgs,
    /// Evaluate N random muscles (full model) instead of the table
    #[arg(long, value_name = "N", allow_negative_numbers = true, conflicts_with = "scenario", value_parser = |text: &str| whole(text, 1..=10_000_u64))]
    random: Option<u64>,
    /// Seed of the random muscles; with --random
    #[arg(long, value_name = "S", allow_negative_numbers = true, default_value_t = 1, requires = "random", value_parser = |text: &str| whole(text, 0..=u64::MAX))]
    seed: u64,
    /// Evaluate a board's recording in this folder, with a reference sensor's column; exit code 1
    /// where the error is above 0.5 K, above that of the bare sensor, or less than 85 % of the rows
    /// lie within two stated deviations
    #[arg(long, value_name = "DIR", conflicts_with_all = ["random", "scenario"])]
    recording: Option<PathBuf>,
    /// Lag of that reference sensor, such as 0.044 (s) or 44ms
    #[arg(long, value_name = "TIME", allow_hyphen_values = true, default_value_t = 0.0, requires = "recording", conflicts_with_all = ["random", "scenario"], value_parser = lag_s)]
    reference_lag: f64,
    #[command(flatten)]
    format: FormatArgs,
}

#[derive(Debug, Args)]
struct ControlArgs {
    #[command(flatten)]
    nominal: NominalArgs,
    /// Folder for report.html, and the plots of docs/background/control-trials.md
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    format: FormatArgs,
}

#[derive(Debug, Args)]
struct FaultsArgs {
    #[command(flatten)]
    nominal: NominalArgs,
    /// Simulated hours of healthy muscles
    #[arg(long, value_name = "HOURS", allow_hyphen_values = true, default_value_t = faults::HOURS, value_parser = hours)]
    hours: f64,
    /// Folder for report.html
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    format: FormatArgs,
}

#[derive(Debug, Args)]
struct PlantsArgs {
    /// Number of random plants
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = plants::COUNT, value_parser = |text: &str| whole(text, 1..=10_000_u64))]
    random: u64,
    /// Seed of the random plants
    #[arg(long, value_name = "S", allow_negative_numbers = true, default_value_t = 1, value_parser = |text: &str| whole(text, 0..=u64::MAX))]
    seed: u64,
    #[command(flatten)]
    format: FormatArgs,
}

fn lag_s(text: &str) -> Result<f64, String> {
    let value = quantity("s")(text).ok().filter(|value| (0.0..=10.0).contains(value));
    value.ok_or_else(|| {
        "must be seconds from 0 to 10, or a time with its unit such as 44ms".to_owned()
    })
}

fn hours(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value: &f64| (0.0..=10_000.0).contains(value));
    value.ok_or_else(|| "must be hours from 0 to 10000".to_owned())
}

impl Subject {
    fn format(&self) -> FormatArgs {
        match self {
            Self::Tune { format, .. } | Self::Truth { format, .. } | Self::Joint { format } => {
                *format
            }
            Self::Estimator(args) => args.format,
            Self::Control(args) => args.format,
            Self::Faults(args) => args.format,
            Self::Plants(args) => args.format,
        }
    }

    /// Folder for a report.
    fn out(&self) -> Option<&Path> {
        match self {
            Self::Control(ControlArgs { out, .. }) | Self::Faults(FaultsArgs { out, .. }) => {
                out.as_deref()
            }
            _ => None,
        }
    }

    /// The scenario that the cases start from.
    fn nominal(&self, to: &mut Console<'_>) -> Result<Loaded, Failure> {
        let path = match self {
            Self::Estimator(EstimatorArgs { nominal, .. })
            | Self::Control(ControlArgs { nominal, .. })
            | Self::Tune { nominal, .. }
            | Self::Faults(FaultsArgs { nominal, .. }) => nominal.scenario.as_deref(),
            Self::Plants(_) | Self::Truth { .. } | Self::Joint { .. } => None,
        };
        path.map_or_else(|| Ok(thermyo_evaluate::nominal()?), |path| load(path, to))
    }
}

pub(super) fn run(args: &EvaluateArgs, to: &mut Console<'_>) -> Result<(), Failure> {
    interrupt::watch();
    let subject = &args.subject;
    let to = to.as_asked(subject.format());
    let drawn = subject.out().map(OutputDir::create).transpose()?;
    let nominal = subject.nominal(to)?;
    let lines = evaluated(subject, &nominal, to)?;
    let stopped = interrupt::is_requested();
    to.print(&if to.format.json { pretty(&lines) } else { thermyo_evaluate::table(&lines) })?;
    if stopped {
        to.say(finished(lines.len()));
        return Err(Failure::Interrupted);
    }
    if let Some(files) = drawn {
        report(subject, &nominal, &lines, files, to)?;
    }
    match thermyo_evaluate::missed(&lines) {
        (0, _) => Ok(()),
        (1, all) => Err(Failure::Check(format!("1 of {all} targets is missed"))),
        (missed, all) => Err(Failure::Check(format!("{missed} of {all} targets are missed"))),
    }
}

fn evaluated(
    subject: &Subject,
    nominal: &Loaded,
    to: &mut Console<'_>,
) -> Result<Vec<CaseFigures>, Failure> {
    let bar = Bar::new(0, to.format.quiet);
    match subject {
        Subject::Estimator(EstimatorArgs { recording: Some(folder), reference_lag, .. }) => {
            let recorded = read_record(&trace_in(folder), to)?;
            Ok(vec![recording::evaluate(&recorded, *reference_lag)?])
        }
        Subject::Estimator(EstimatorArgs { random: Some(count), seed, .. }) => {
            estimator::random(*seed, *count, &bar).map_err(Failure::Run)
        }
        Subject::Estimator(_) => estimator::evaluate(nominal, &bar).map_err(Failure::Run),
        Subject::Control(_) => control_observed::evaluate(nominal, &bar).map_err(Failure::Run),
        Subject::Joint { .. } => joint::evaluate(&bar).map_err(Failure::Joint),
        Subject::Truth { data, .. } => {
            let maps = truth::maps(data)?;
            bar.clear();
            to.warn(&truth::doubts(&maps)?);
            let bar = Bar::new(0, to.format.quiet);
            Ok(truth::evaluate(data, maps, &bar)?)
        }
        Subject::Plants(PlantsArgs { random, seed, .. }) => {
            plants::evaluate(*seed, *random, &bar).map_err(Failure::Run)
        }
        Subject::Tune { .. } => Ok(tune::evaluate(nominal, &bar)?),
        Subject::Faults(FaultsArgs { hours, .. }) => {
            faults::Evaluation::new(nominal, *hours).evaluate(&bar).map_err(Failure::Run)
        }
    }
}

/// Writes the page, and for `control` its plots.
fn report(
    subject: &Subject,
    nominal: &Loaded,
    lines: &[CaseFigures],
    mut files: OutputDir,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    let page = if let Subject::Faults(_) = subject {
        faults::page::page(nominal, lines)
    } else {
        let plots = control_page::plots(nominal)?;
        for plot in &plots {
            files.text(plot.file, &plot.svg())?;
        }
        control_page::page(nominal, lines, &plots)
    };
    files.text("report.html", &page)?;
    to.publish(files)
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

    #[test]
    fn a_lag_may_have_its_unit() {
        assert_eq!(super::lag_s("44ms"), Ok(0.044));
        assert_eq!(super::lag_s("0.044"), Ok(0.044));
        assert!(super::lag_s("11s").is_err() && super::lag_s("1K").is_err());
    }
}
