//! Command line: arguments, progress, messages and exit codes.
//!
//! 0: done; 1: it ran and a stated check did not hold; 2: bad input or usage.

mod board;
mod calibrate;
mod evaluate;
mod failure;
mod flashed;
mod interrupt;
mod sweep;
mod tune;

use self::board::BoardArgs;
use self::failure::Failure;
use crate::board::{Board, CoreBoard};
use crate::commands::identify;
use crate::commands::monitor::{self, Recorder, Session};
use crate::commands::replay;
use crate::commands::reproduce;
use crate::files::input::InputError;
use crate::files::measured::Measured;
use crate::files::output::OutputDir;
use crate::files::summary::Summary;
use crate::files::table::{self, Table};
use crate::files::trace::{COLUMNS, Row, TraceWriter};
use crate::report::run_page::RunRecorder;
use crate::scenario::{self, Loaded};
use crate::simulation::run::{self, RunError};
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
    /// Live view and recording of a board, which it arms and drives too
    Monitor {
        /// Serial port, such as /dev/ttyACM0, or "emulated"
        port: String,
        /// Folder for trace.csv and config.json [default: out/monitor]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
    /// A flashed board: asked, armed, driven, configured
    Board(flashed::BoardCommand),
    /// The process behind the port "emulated"
    #[command(name = crate::board::service::TASK, hide = true)]
    EmulatedBoard(flashed::ServeArgs),
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
        Task::Reproduce(args) => reproduce_command(&args, out, err),
        Task::Run(args) => run_command(&args, out, err),
        Task::Identify(args) => identify_command(&args, out, err),
        Task::Sweep(args) => sweep::run(args, out, err),
        Task::Tune(args) => tune::run(&args, out, err),
        Task::Replay { trace, board } => replay_command(&trace, &board, out, err),
        Task::Monitor { port, out: folder } => {
            let folder = folder.unwrap_or_else(|| PathBuf::from("out/monitor"));
            monitor_command(&port, &folder, out, err)
        }
        Task::Board(command) => flashed::run(command, out, err),
        Task::EmulatedBoard(args) => flashed::serve(&args),
        Task::Evaluate(args) => evaluate::run(&args, out, err),
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

fn replay_command(
    trace: &Path,
    board: &BoardArgs,
    out: &mut dyn Write,
    err: &mut dyn Write,
) -> Result<(), Failure> {
    let (config, rows) = replay::read_record(trace, &read_record(trace, err)?)?;
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

fn run_command(
    args: &RunArgs,
    stdout: &mut dyn Write,
    stderr: &mut dyn Write,
) -> Result<(), Failure> {
    let loaded = scenario::load(&args.scenario)?;
    let measured = args.measured.as_deref().map(|path| read_measured(path, stderr)).transpose()?;
    let folder = args.output.out.clone().unwrap_or_else(|| PathBuf::from("out/run"));
    let mut board = args.board.open()?;
    let mut recorder = RunRecorder::new(&loaded);
    let mut out = OutputDir::create(&folder)?;
    let mut rows: u64 = 0;
    let summary =
        record(&loaded, board.as_mut(), measured.as_ref(), &args.output, &mut out, |row| {
            rows += 1;
            recorder.add(row);
        });
    let summary = match summary {
        // A line that broke, a board that restarted: what it said so far is not said again.
        Err(failure @ Failure::Run(RunError::Board(_))) if rows > 0 => {
            let left = out.leave();
            let _ = writeln!(stderr, "thermyo: the record so far is in {}", left.display());
            return Err(failure);
        }
        other => other?,
    };
    let title = args.scenario.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into());
    let page = recorder.page(&title, &loaded, measured.as_ref(), &summary);
    finish(out, stdout, stderr, &summary, &page, &args.output)
}

fn identify_command(
    args: &IdentifyArgs,
    stdout: &mut dyn Write,
    stderr: &mut dyn Write,
) -> Result<(), Failure> {
    let loaded = scenario::load(&args.config)?;
    let measured = read_measured(&args.data, stderr)?;
    let folder = args.output.out.clone().unwrap_or_else(|| PathBuf::from("out/identify"));
    let mut out = OutputDir::create(&folder)?;
    let identified = identify::identify(&loaded, &args.config, &measured, &args.data)
        .map_err(Failure::Identify)?;
    let findings = &identified.findings;
    let title = args.data.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into());
    let json = serde_json::to_string_pretty(findings).expect("findings are plain data") + "\n";
    out.text("summary.json", &json)?;
    out.text("identified.toml", &scenario::render(&identified.scenario))?;
    out.text("report.html", &identify::page(&identified, &title))?;
    publish(out, stderr)?;
    if args.output.json {
        print(stdout, &json)?;
    } else {
        print(stdout, &findings.text())?;
        print(stdout, &format!("report: {}\n", folder.join("report.html").display()))?;
    }
    findings.failed().map_or(Ok(()), |what| Err(Failure::Check(what)))
}

fn monitor_command(
    port: &str,
    folder: &Path,
    stdout: &mut dyn Write,
    stderr: &mut dyn Write,
) -> Result<(), Failure> {
    let mut out = OutputDir::create(folder)?;
    let recorder = Recorder::new(out.file("trace.csv")?)
        .map_err(|error| out.unwritable("trace.csv", &error))?;
    let mut session = Session::open(port, recorder).map_err(Failure::Board)?;
    let outcome = monitor::run(&mut session, &mut out);
    let rows = session.rows();
    // The file is closed before it moves.
    drop(session);
    if rows > 0 {
        publish(out, stderr)?;
        let trace = folder.join("trace.csv");
        print(stdout, &format!("{rows} rows recorded: {}\n", trace.display()))?;
    }
    Ok(outcome?)
}

fn reproduce_command(
    args: &ReproduceArgs,
    stdout: &mut dyn Write,
    stderr: &mut dyn Write,
) -> Result<(), Failure> {
    let loaded = reproduce::scenario()?;
    let folder = args.output.out.clone().unwrap_or_else(|| PathBuf::from("out/reproduce"));
    let mut out = OutputDir::create(&folder)?;
    let mut study = reproduce::Study::new(&loaded);
    let mut board = CoreBoard::default();
    let summary = record(&loaded, &mut board, None, &args.output, &mut out, |row| study.add(row))?;
    let findings = study.finish(&summary).map_err(Failure::Run)?;
    let page = reproduce::page(&loaded, &findings, &summary);
    finish(out, stdout, stderr, &summary, &page, &args.output)?;
    if !args.output.json {
        print(stdout, &findings.text())?;
    }
    findings.failed().map_or(Ok(()), |what| Err(Failure::Check(what)))
}

/// Runs a scenario, written into `out` with its trace, which is streamed; every logged row is shown to `each` too.
fn record(
    loaded: &Loaded,
    board: &mut dyn Board,
    measured: Option<&Measured>,
    args: &OutputArgs,
    out: &mut OutputDir,
    mut each: impl FnMut(&Row),
) -> Result<Summary, Failure> {
    // First of all: a trace whose program was killed is replayed with it.
    out.text("scenario.toml", &scenario::render(loaded))?;
    let file = out.file("trace.csv")?;
    let unwritable = |error: io::Error| out.unwritable("trace.csv", &error);
    let mut writer = TraceWriter::new(file).map_err(unwritable)?;
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
        RunError::Output(error) => Failure::Input(unwritable(error)),
        other => Failure::Run(other),
    })?;
    writer.finish().map_err(unwritable)?;
    Ok(summary)
}

/// Writes summary and report, and puts all files where they belong.
fn finish(
    mut out: OutputDir,
    stdout: &mut dyn Write,
    stderr: &mut dyn Write,
    summary: &Summary,
    page: &str,
    args: &OutputArgs,
) -> Result<(), Failure> {
    let json = serde_json::to_string_pretty(summary).expect("a summary is plain data") + "\n";
    let folder = out.path().to_path_buf();
    out.text("summary.json", &json)?;
    out.text("report.html", page)?;
    publish(out, stderr)?;
    if args.json { print(stdout, &json) } else { print(stdout, &brief(summary, &folder)) }
}

/// Puts the results where they belong, and says where an earlier one went.
fn publish(out: OutputDir, stderr: &mut dyn Write) -> Result<(), Failure> {
    let folder = out.path().to_path_buf();
    if let Some(earlier) = out.publish()? {
        let (folder, earlier) = (folder.display(), earlier.display());
        // Where nobody reads it any more, nobody misses it.
        let _ = writeln!(stderr, "thermyo: the earlier result in {folder} is now in {earlier}");
    }
    Ok(())
}

/// A recorded table, read up to where it is damaged; says so.
fn read_record(path: &Path, stderr: &mut dyn Write) -> Result<Table, Failure> {
    let table = table::read_record(path)?;
    if let Some(damage) = table.damage() {
        let _ = writeln!(stderr, "thermyo: {damage}");
    }
    Ok(table)
}

fn read_measured(path: &Path, stderr: &mut dyn Write) -> Result<Measured, Failure> {
    Ok(Measured::new(&read_record(path, stderr)?, &COLUMNS)?)
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
