//! Command line: arguments, progress, messages and exit codes.
//!
//! 0: done; 1: it ran and a stated check did not hold; 2: bad input or usage.

mod board;
mod evaluate;
mod failure;
mod sweep;
mod tune;

use self::board::BoardArgs;
use self::failure::Failure;
use crate::board::{Board, CoreBoard};
use crate::identify;
use crate::input::InputError;
use crate::measured::Measured;
use crate::monitor;
use crate::output::OutputDir;
use crate::replay;
use crate::report::run_page::RunRecorder;
use crate::reproduce;
use crate::run::{self, RunError};
use crate::scenario::{self, Loaded};
use crate::summary::Summary;
use crate::trace::{COLUMNS, Row, TraceWriter};
use clap::{Args, Parser, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use std::ffi::OsString;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Thermodynamics of a pneumatic muscle: simulate it, estimate its gas temperature, drive it.
#[derive(Debug, Parser)]
#[command(name = "thermyo", version, args_conflicts_with_subcommands = true)]
struct Cli {
    #[command(subcommand)]
    command: Option<Task>,
    #[command(flatten)]
    reproduce: ReproduceArgs,
}

#[derive(Debug, Subcommand)]
enum Task {
    /// The paper's isotonic working cycle: sensors compared, Fig. 2 and 5 (the default)
    Reproduce(ReproduceArgs),
    /// Runs a scenario
    Run(RunArgs),
    /// Finds the parameters that make the plant follow recorded data
    Identify(IdentifyArgs),
    /// The same run over a grid of values: which sensor is fast enough
    Sweep(sweep::SweepArgs),
    /// Finds friction, valves and gains by a short experiment on a board
    Tune(tune::TuneArgs),
    /// Recorded samples through the core again, compared to the bit
    Replay {
        /// trace.csv of a run with log_every = 1; its scenario.toml has to lie beside it
        trace: PathBuf,
        #[command(flatten)]
        board: BoardArgs,
    },
    /// Live view and recording of a flashed board; q ends it
    Monitor {
        /// Serial port, such as /dev/ttyACM0
        port: String,
        /// Folder for trace.csv [default: out/monitor]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
    /// Measures the project's own targets and prints a table of target and figure
    Evaluate(evaluate::EvaluateArgs),
    /// Validates a scenario and prints it with every default filled in
    Check {
        /// Scenario file (TOML)
        scenario: PathBuf,
    },
}

#[derive(Debug, Args)]
struct OutputArgs {
    /// Folder for the results, report.html among them [default: out/<command>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the summary as JSON on standard output
    #[arg(long)]
    json: bool,
    /// No progress bar
    #[arg(long)]
    quiet: bool,
}

#[derive(Debug, Args)]
struct ReproduceArgs {
    #[command(flatten)]
    output: OutputArgs,
}

#[derive(Debug, Args)]
struct RunArgs {
    /// Scenario file (TOML)
    scenario: PathBuf,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    board: BoardArgs,
    /// Measurements to compare with: time_s and any columns of trace.csv
    #[arg(long, value_name = "FILE.csv")]
    measured: Option<PathBuf>,
}

#[derive(Debug, Args)]
struct IdentifyArgs {
    /// Recorded data: time_s and columns of trace.csv
    data: PathBuf,
    /// Scenario file (TOML) whose [identify] names the parameters
    #[arg(long, value_name = "FILE.toml")]
    config: PathBuf,
    #[command(flatten)]
    output: OutputArgs,
}

/// Runs the command of this process.
pub fn main() -> ExitCode {
    ExitCode::from(run(std::env::args_os(), &mut io::stdout(), &mut io::stderr()))
}

/// Runs one command, program name first; gives its exit code.
pub fn run<A: Into<OsString> + Clone>(
    arguments: impl IntoIterator<Item = A>,
    out: &mut dyn Write,
    err: &mut dyn Write,
) -> u8 {
    let cli = match Cli::try_parse_from(arguments) {
        Ok(cli) => cli,
        Err(usage) => {
            let text = usage.render();
            // `--help` and `--version` arrive here too. Where the reader is gone there is nobody
            // left to tell.
            let _ = if usage.use_stderr() { write!(err, "{text}") } else { write!(out, "{text}") };
            return usage.exit_code() as u8;
        }
    };
    let result = match cli.command.unwrap_or(Task::Reproduce(cli.reproduce)) {
        Task::Reproduce(args) => reproduce_command(&args, out),
        Task::Run(args) => run_command(&args, out),
        Task::Identify(args) => identify_command(&args, out),
        Task::Sweep(args) => sweep::run(args, out),
        Task::Tune(args) => tune::run(&args, out),
        Task::Replay { trace, board } => replay_command(&trace, &board, out),
        Task::Monitor { port, out: folder } => {
            let folder = folder.unwrap_or_else(|| PathBuf::from("out/monitor"));
            monitor::run(&port, &folder.join("trace.csv")).map_err(Failure::Board)
        }
        Task::Evaluate(args) => evaluate::run(&args, out),
        Task::Check { scenario } => check_command(&scenario, out),
    };
    match result {
        Ok(()) => 0,
        Err(failure) => {
            let _ = writeln!(err, "thermyo: {failure}");
            failure.exit_code()
        }
    }
}

fn check_command(path: &Path, out: &mut dyn Write) -> Result<(), Failure> {
    let loaded = scenario::load(path)?;
    print(out, &scenario::render(&loaded))
}

fn replay_command(trace: &Path, board: &BoardArgs, out: &mut dyn Write) -> Result<(), Failure> {
    let (config, rows) = replay::read_record(trace)?;
    let outcome = replay::replay(board.open()?.as_mut(), &config, &rows).map_err(Failure::Board)?;
    let json = serde_json::json!({ "steps": outcome.steps, "mismatches": outcome.mismatches });
    print(out, &format!("{json:#}\n"))?;
    match outcome.first {
        None if outcome.steps == rows.len() as u64 => Ok(()),
        None => {
            Err(Failure::Check(format!("{} of {} steps were replayed", outcome.steps, rows.len())))
        }
        Some(first) => Err(Failure::Check(format!(
            "{} of {} steps differ, the first is step {}: {:?} recorded, {:?} replayed",
            outcome.mismatches,
            outcome.steps,
            first.recorded.step,
            first.recorded.estimate,
            first.replayed.estimate
        ))),
    }
}

fn run_command(args: &RunArgs, stdout: &mut dyn Write) -> Result<(), Failure> {
    let loaded = scenario::load(&args.scenario)?;
    let measured =
        args.measured.as_deref().map(|path| Measured::read(path, &COLUMNS)).transpose()?;
    let folder = args.output.out.clone().unwrap_or_else(|| PathBuf::from("out/run"));
    let mut board = args.board.open()?;
    let mut recorder = RunRecorder::new(&loaded);
    let mut out = OutputDir::create(&folder)?;
    let summary =
        record(&loaded, board.as_mut(), measured.as_ref(), &args.output, &mut out, |row| {
            recorder.add(row);
        })?;
    let title = args.scenario.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into());
    let page = recorder.page(&title, &loaded, measured.as_ref(), &summary);
    finish(out, stdout, &loaded, &summary, &page, &args.output)
}

fn identify_command(args: &IdentifyArgs, stdout: &mut dyn Write) -> Result<(), Failure> {
    let loaded = scenario::load(&args.config)?;
    let folder = args.output.out.clone().unwrap_or_else(|| PathBuf::from("out/identify"));
    let mut out = OutputDir::create(&folder)?;
    let identified =
        identify::identify(&loaded, &args.config, &args.data).map_err(Failure::Identify)?;
    let findings = &identified.findings;
    let title = args.data.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into());
    let json = serde_json::to_string_pretty(findings).expect("findings are plain data") + "\n";
    out.keep_text("summary.json", &json)?;
    out.keep_text("identified.toml", &scenario::render(&identified.scenario))?;
    out.keep_text("report.html", &identify::page(&identified, &title))?;
    out.publish()?;
    if args.output.json {
        print(stdout, &json)?;
    } else {
        print(stdout, &findings.text())?;
        print(stdout, &format!("report: {}\n", folder.join("report.html").display()))?;
    }
    findings.failed().map_or(Ok(()), |what| Err(Failure::Check(what)))
}

fn reproduce_command(args: &ReproduceArgs, stdout: &mut dyn Write) -> Result<(), Failure> {
    let loaded = reproduce::scenario()?;
    let folder = args.output.out.clone().unwrap_or_else(|| PathBuf::from("out/reproduce"));
    let mut out = OutputDir::create(&folder)?;
    let mut study = reproduce::Study::new(&loaded);
    let mut board = CoreBoard::default();
    let summary = record(&loaded, &mut board, None, &args.output, &mut out, |row| study.add(row))?;
    let findings = study.finish(&summary).map_err(Failure::Run)?;
    let page = reproduce::page(&loaded, &findings, &summary);
    finish(out, stdout, &loaded, &summary, &page, &args.output)?;
    if !args.output.json {
        print(stdout, &findings.text())?;
    }
    findings.failed().map_or(Ok(()), |what| Err(Failure::Check(what)))
}

/// Runs a scenario with its trace streamed into `out`; every logged row is shown to `each` too.
fn record(
    loaded: &Loaded,
    board: &mut dyn Board,
    measured: Option<&Measured>,
    args: &OutputArgs,
    out: &mut OutputDir,
    mut each: impl FnMut(&Row),
) -> Result<Summary, Failure> {
    let trace_path = out.path().join("trace.csv");
    let unwritable = |error: &io::Error| InputError::output(&trace_path, error);
    let mut writer = TraceWriter::new(out.file()?).map_err(|error| unwritable(&error))?;
    let bar = progress_bar((loaded.plant.run.duration_s * 1000.0) as u64, args.quiet);
    let mut observer = |row: &Row| {
        writer.write(&row.cells())?;
        each(row);
        bar.set_position((row.truth.time_s * 1000.0) as u64);
        Ok(())
    };
    let result = run::run(loaded, board, measured, &mut observer);
    bar.finish_and_clear();
    let summary = result.map_err(|error| match error {
        RunError::Output(error) => Failure::Input(unwritable(&error)),
        other => Failure::Run(other),
    })?;
    let file = writer.finish().map_err(|error| unwritable(&error))?;
    out.keep(file, "trace.csv")?;
    Ok(summary)
}

/// Writes summary, scenario and report, and gives all files their names.
fn finish(
    mut out: OutputDir,
    stdout: &mut dyn Write,
    loaded: &Loaded,
    summary: &Summary,
    page: &str,
    args: &OutputArgs,
) -> Result<(), Failure> {
    let json = serde_json::to_string_pretty(summary).expect("a summary is plain data") + "\n";
    let folder = out.path().to_path_buf();
    out.keep_text("summary.json", &json)?;
    out.keep_text("scenario.toml", &scenario::render(loaded))?;
    out.keep_text("report.html", page)?;
    out.publish()?;
    if args.json { print(stdout, &json) } else { print(stdout, &brief(summary, &folder)) }
}

/// The figures that a person looks for first.
fn brief(summary: &Summary, folder: &Path) -> String {
    let mut text = format!(
        "{} s simulated, {:.0} times real time, core on board \"{}\"\n\
         pressure {:.1} to {:.1} kPa, gas {:.1} to {:.1} K\n\
         gas temperature, RMS error: bare sensor {:.3} K, model {:.3} K, estimate {:.3} K\n\
         balance errors: mass {:.1e}, energy {:.1e}\n",
        summary.duration_s,
        summary.real_time_factor,
        summary.board,
        summary.pressure_pa.min / 1e3,
        summary.pressure_pa.max / 1e3,
        summary.gas_temperature_k.min,
        summary.gas_temperature_k.max,
        summary.rmse_k.sensor_gas,
        summary.rmse_k.model,
        summary.rmse_k.estimate,
        summary.mass_balance_error,
        summary.energy_balance_error,
    );
    if let Some(measured) = &summary.measured {
        for (name, difference) in measured {
            text += &format!(
                "measured {name}: RMS difference {:.4}, largest {:.4}\n",
                difference.rmse, difference.max
            );
        }
    }
    if let Some(control) = &summary.control {
        text += &format!(
            "set point: RMS error {:.4}, at the end {:.4}, overshoot {:.1} %\n",
            control.rms_error,
            control.steady_error,
            control.overshoot * 100.0
        );
    }
    text + &format!("report: {}\n", folder.join("report.html").display())
}

fn progress_bar(length: u64, quiet: bool) -> ProgressBar {
    if quiet {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{bar:40} {percent:>3} %  {msg}eta {eta}")
        .expect("the template is a constant");
    // Drawn on standard error, and only where that is a terminal.
    ProgressBar::new(length).with_style(style)
}

fn print(out: &mut dyn Write, text: &str) -> Result<(), Failure> {
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        // A reader that has seen enough, such as `head`, is no error.
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(InputError::output(Path::new("standard output"), &error).into())
        }
        _ => Ok(()),
    }
}
