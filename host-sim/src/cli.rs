//! Command line: arguments, progress, messages and exit codes.
//!
//! 0: done; 1: it ran and a stated check did not hold; 2: bad input or usage.

mod sweep;

use crate::board::emulated::EmulatedBoard;
use crate::board::serial::SerialBoard;
use crate::board::{Board, BoardError, CoreBoard};
use crate::evaluate::{self, control_page};
use crate::identify::{self, IdentifyError};
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
use crate::sweep::SweepError;
use crate::trace::{COLUMNS, Row, TraceWriter};
use crate::tune::{self, TuneError};
use clap::{Args, Parser, Subcommand, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use std::ffi::OsString;
use std::fmt;
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
    Tune(TuneArgs),
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
    Evaluate {
        /// What to evaluate
        #[arg(value_enum)]
        what: Subject,
        /// Nominal scenario [default: scenarios/nominal.toml as built in]
        #[arg(long, value_name = "FILE.toml")]
        scenario: Option<PathBuf>,
        /// Folder for report.html and the plots of docs/control.md; of `control`
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
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

#[derive(Debug, Args)]
struct TuneArgs {
    /// Scenario file (TOML): muscle, load, and what the core is told so far
    scenario: PathBuf,
    /// Highest absolute pressure of the experiment, in Pa
    #[arg(long, value_name = "PA", default_value_t = tune::HIGHEST_PA, value_parser = pressure)]
    max_pressure: f64,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    board: BoardArgs,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Subject {
    /// The estimate of the gas temperature
    Estimator,
    /// The muscle at rest, in motion, and against the usual practice
    Control,
    /// What `thermyo tune` finds of a muscle told wrong, and what that is worth
    Tune,
}

#[derive(Debug, Args)]
struct BoardArgs {
    /// Where the core runs: "core" (in this process), "emulated" (the firmware on an emulated
    /// RP2040) or "serial:PORT" (a flashed board, firmware built with its feature `hil`)
    #[arg(long, value_name = "BOARD", default_value = "core", value_parser = board_kind)]
    board: BoardKind,
    /// Image for the emulated board, ELF or UF2 [default: the firmware of this checkout]
    #[arg(long, value_name = "FILE")]
    image: Option<PathBuf>,
}

#[derive(Debug, Clone)]
enum BoardKind {
    Core,
    Emulated,
    Serial(String),
}

fn pressure(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value: &f64| value.is_finite() && *value > 0.0);
    value.ok_or_else(|| "must be an absolute pressure in Pa, above 0".to_owned())
}

fn board_kind(text: &str) -> Result<BoardKind, String> {
    match (text, text.strip_prefix("serial:")) {
        ("core", _) => Ok(BoardKind::Core),
        ("emulated", _) => Ok(BoardKind::Emulated),
        (_, Some(port)) if !port.is_empty() => Ok(BoardKind::Serial(port.to_owned())),
        _ => Err("must be core, emulated or serial:PORT".to_owned()),
    }
}

impl BoardArgs {
    fn open(&self) -> Result<Box<dyn Board>, Failure> {
        let board: Result<Box<dyn Board>, BoardError> = match (&self.board, &self.image) {
            (BoardKind::Core, None) => return Ok(Box::new(CoreBoard::default())),
            (BoardKind::Emulated, None) => EmulatedBoard::new().map(|board| Box::new(board) as _),
            (BoardKind::Emulated, Some(image)) => {
                EmulatedBoard::with_image(image).map(|board| Box::new(board) as _)
            }
            (BoardKind::Serial(port), None) => {
                SerialBoard::open(port).map(|board| Box::new(board) as _)
            }
            (BoardKind::Core | BoardKind::Serial(_), Some(_)) => {
                return Err(Failure::Usage("--image goes with --board emulated only".to_owned()));
            }
        };
        board.map_err(Failure::Board)
    }
}

/// Why the command does not end with 0.
#[derive(Debug)]
enum Failure {
    /// Exit 2.
    Input(InputError),
    /// Exit 2, or 1 where the plant diverges.
    Identify(IdentifyError),
    /// Exit 2.
    Sweep(SweepError),
    /// Exit 1: the data of a tuning was not good enough.
    Tune(tune::Refusal),
    /// Exit 2: arguments that do not go together.
    Usage(String),
    /// Exit 2: the board cannot be used.
    Board(BoardError),
    /// Exit 1.
    Run(RunError),
    /// Exit 1: it ran, and a stated check did not hold.
    Check(String),
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Input(error) => error.fmt(f),
            Self::Identify(error) => error.fmt(f),
            Self::Sweep(error) => error.fmt(f),
            Self::Tune(refusal) => write!(f, "nothing was tuned: {refusal}"),
            Self::Usage(what) => f.write_str(what),
            Self::Board(error) => error.fmt(f),
            Self::Run(error) => error.fmt(f),
            Self::Check(what) => f.write_str(what),
        }
    }
}

impl From<InputError> for Failure {
    fn from(error: InputError) -> Self {
        Self::Input(error)
    }
}

impl From<TuneError> for Failure {
    fn from(error: TuneError) -> Self {
        match error {
            TuneError::Input(error) => Self::Input(error),
            TuneError::Run(error) => Self::Run(error),
            TuneError::Refused(refusal) => Self::Tune(refusal),
        }
    }
}

impl Failure {
    fn exit_code(&self) -> u8 {
        match self {
            Self::Input(_)
            | Self::Sweep(_)
            | Self::Usage(_)
            | Self::Board(_)
            | Self::Identify(IdentifyError::Input(_) | IdentifyError::Build(_))
            | Self::Run(RunError::Build(_) | RunError::Config(_)) => 2,
            Self::Identify(IdentifyError::Diverged(_))
            | Self::Tune(_)
            | Self::Run(_)
            | Self::Check(_) => 1,
        }
    }
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
        Task::Tune(args) => tune_command(&args, out),
        Task::Replay { trace, board } => replay_command(&trace, &board, out),
        Task::Monitor { port, out: folder } => {
            let folder = folder.unwrap_or_else(|| PathBuf::from("out/monitor"));
            monitor::run(&port, &folder.join("trace.csv")).map_err(Failure::Board)
        }
        Task::Evaluate { what, scenario, out: folder } => {
            evaluate_command(what, scenario.as_deref(), folder.as_deref(), out)
        }
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

fn evaluate_command(
    what: Subject,
    path: Option<&Path>,
    folder: Option<&Path>,
    out: &mut dyn Write,
) -> Result<(), Failure> {
    if folder.is_some() && !matches!(what, Subject::Control) {
        return Err(Failure::Usage("--out goes with `evaluate control` only".to_owned()));
    }
    let drawn = folder.map(OutputDir::create).transpose()?;
    let nominal = match path {
        Some(path) => scenario::load(path)?,
        None => evaluate::nominal()?,
    };
    let lines = match what {
        Subject::Estimator => evaluate::estimator::evaluate(&nominal).map_err(Failure::Run)?,
        Subject::Control => evaluate::control::evaluate(&nominal).map_err(Failure::Run)?,
        Subject::Tune => evaluate::tune::evaluate(&nominal)?,
    };
    print(out, &evaluate::table(&lines))?;
    if let Some(mut files) = drawn {
        let plots = control_page::plots(&nominal)?;
        for plot in &plots {
            files.keep_text(plot.file, &plot.svg())?;
        }
        files.keep_text("report.html", &control_page::page(&nominal, &lines, &plots))?;
        files.publish()?;
    }
    match evaluate::missed(&lines) {
        (0, _) => Ok(()),
        (missed, all) => Err(Failure::Check(format!("{missed} of {all} targets are missed"))),
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

fn tune_command(args: &TuneArgs, stdout: &mut dyn Write) -> Result<(), Failure> {
    let loaded = scenario::load(&args.scenario)?;
    let folder = args.output.out.clone().unwrap_or_else(|| PathBuf::from("out/tune"));
    let mut board = args.board.open()?;
    let mut out = OutputDir::create(&folder)?;
    let tuned = tune::tune(&loaded, &args.scenario, args.max_pressure, board.as_mut())?;
    let json = serde_json::to_string_pretty(&tuned.findings).expect("plain data") + "\n";
    let title = args.scenario.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into());
    out.keep_text("summary.json", &json)?;
    out.keep_text("tuned.toml", &scenario::render(&tuned.scenario))?;
    out.keep_text("report.html", &tune::page(&tuned, &title))?;
    out.publish()?;
    if args.output.json {
        print(stdout, &json)
    } else {
        print(stdout, &tuned.findings.text())?;
        print(stdout, &format!("report: {}\n", folder.join("report.html").display()))
    }
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
