//! Command line: arguments, progress, messages and exit codes.
//!
//! Exit codes: 0: done; 1: a stated check failed; 2: bad input or usage; 130: stopped by Ctrl-C.

mod board;
mod board_status;
mod board_task;
mod calibrate;
mod compare;
mod console;
mod drive;
mod evaluate;
mod failure;
mod flash;
mod flashed;
mod fmu;
mod folded;
mod init;
mod interrupt;
mod joint;
mod joint_board;
mod joint_identify;
mod joint_tune;
mod log;
mod measure;
mod muscle;
mod playground;
mod progress;
mod replay;
mod serve;
mod set;
mod shell;
mod sweep;
mod trace_size;
mod tune;
mod unbuilt;

use self::board::BoardArgs;
use self::console::{Console, FormatArgs, UnitArgs, print};
use self::failure::Failure;
use self::folded::Folded;
use self::log::LogArgs;
use self::progress::Bar;
use crate::commands::monitor::{self, Session, Shown};
use clap::{Args, CommandFactory, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;
use crossterm::terminal;
use serde::Serialize;
use std::ffi::OsString;
use std::fmt::Display;
use std::io::{self, IsTerminal, Write};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;
use thermyo_boards::checkout;
use thermyo_boards::live::LiveBoard;
use thermyo_boards::live_joint::LiveJoint;
use thermyo_files::input::{InputError, Problem, nearest};
use thermyo_files::number::{difference_text, speed};
use thermyo_files::output::{OutputDir, would_move};
use thermyo_files::shipped;
use thermyo_files::table;
use thermyo_files::table::Table;
use thermyo_files::units::{UnitSystem, Wanted};
use thermyo_identify::motion;
use thermyo_identify::static_map;
use thermyo_identify::static_map::Readings;
use thermyo_identify::{IdentifyError, identify_table, known_columns};
use thermyo_joint::JointLoaded;
use thermyo_logs::Logs;
use thermyo_logs::topics::MUSCLE;
use thermyo_record::board_trace::every_column;
use thermyo_record::measured::{self, Measured, check_pressures, of_unknown_column};
use thermyo_record::summary::Summary;
use thermyo_record::trace::{COLUMNS, COMPARABLE, Row};
use thermyo_runs::reproduce;
use thermyo_runs::run_page::RunRecorder;
use thermyo_scenario::{PlantKind, Scenario};
use thermyo_setup::Loaded;
use thermyo_simulation::board::{Board, CoreBoard};
use thermyo_simulation::run;
use thermyo_simulation::run::RunError;
use thermyo_studies::drive::Record;

/// Arguments that print text for a program or a file, which is not folded.
const AS_IT_IS: [Option<&str>; 4] =
    [Some("--json"), Some("--plan"), Some("check"), Some("completions")];

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
    /// Simulate the paper's isotonic working cycle: sensors compared, Fig. 2 and 5 (the default)
    Reproduce(ReproduceArgs),
    /// Write the scenario of your own rig: asks for muscle, valves, sensor and load, or takes flags
    Init(init::InitArgs),
    /// Run a scenario
    Run(RunArgs),
    /// Fit the plant's parameters to recorded data
    Identify(IdentifyArgs),
    /// Run a scenario over a grid of values: which sensor is fast enough
    Sweep(sweep::SweepArgs),
    /// Identify friction, valves and gains by a short experiment on a board
    Tune(tune::TuneArgs),
    /// Measure the gas temperature of a muscle, and its heat transfer, without a wire in the gas
    Measure(measure::MeasureCommand),
    /// Run recorded samples through the core again and compare every bit
    Replay(replay::ReplayArgs),
    /// Export a scenario for other simulators: FMI 3.0 co-simulation
    Fmu(fmu::FmuArgs),
    /// Compare recorded runs: plots and differences
    Compare(compare::CompareArgs),
    /// Record a board and show its figures; keys arm and drive it
    ///
    /// If standard output is no terminal, there are no keys: figures are printed once a second,
    /// until Ctrl-C or until the port is closed. With --quiet or --json it only records.
    Monitor {
        /// Serial port, such as /dev/ttyUSB0 or COM3, or "emulated"
        port: String,
        /// Folder for trace.csv and config.json [default: out/monitor]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        #[command(flatten)]
        format: FormatArgs,
        #[command(flatten)]
        units: UnitArgs,
        /// Record every N-th step; `thermyo replay` needs every step
        #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = monitor::EVERY, value_parser = |text: &str| whole(text, 1..=1000_u16))]
        every: u16,
        #[command(flatten)]
        log: LogArgs,
    },
    /// Serve a local page for a board: live plots, set points, recording, calibration, tuning
    Serve(serve::ServeArgs),
    /// Write the browser playground (core and plant in a page): a folder for any web host
    Playground(playground::PlaygroundArgs),
    /// Query, arm, drive and configure a flashed board
    Board(flashed::BoardCommand),
    /// The process behind the port "emulated"
    #[command(name = thermyo_boards::service::TASK, hide = true)]
    EmulatedBoard(flashed::ServeArgs),
    /// List the boards that are plugged in
    Ports(flash::PortsArgs),
    /// Build the UF2 of the firmware and flash a board
    Flash(flash::FlashArgs),
    /// Measure the project's own targets and print a table of target and figure
    Evaluate(evaluate::EvaluateArgs),
    /// Validate a scenario and print it with every default filled in
    Check {
        /// Scenario file (TOML)
        scenario: PathBuf,
        #[command(flatten)]
        format: FormatArgs,
    },
    /// Print a shell's completion script
    Completions {
        /// Shell
        shell: Shell,
        #[command(flatten)]
        format: FormatArgs,
    },
    /// Write the man pages
    Man {
        /// Folder for the man pages
        #[arg(long, value_name = "DIR", default_value = "out/man")]
        out: PathBuf,
        #[command(flatten)]
        format: FormatArgs,
    },
}

#[derive(Debug, Args)]
struct OutputArgs {
    /// Folder for the results, including report.html [default: out/<command>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    format: FormatArgs,
}

impl OutputArgs {
    /// Creates the folder for the results, `out/<command>` by default.
    fn create(&self, command: &str) -> Result<OutputDir, Failure> {
        self.create_beside(command, &[])
    }

    /// As [`Self::create`], for results of these records.
    ///
    /// # Errors
    /// For the folder of a record, which a new result would move.
    fn create_beside(&self, command: &str, records: &[&Path]) -> Result<OutputDir, Failure> {
        let usual = || Path::new("out").join(command);
        let folder = self.out.clone().unwrap_or_else(usual);
        if records.iter().any(|record| would_move(&folder, record)) {
            let folder = folder.display();
            let usage = format!("--out {folder}: is the record itself: give another folder");
            return Err(Failure::Usage(usage));
        }
        Ok(OutputDir::create(&folder)?)
    }
}

#[derive(Debug, Args)]
struct ReproduceArgs {
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    units: UnitArgs,
}

#[derive(Debug, Args)]
struct RunArgs {
    /// Scenario file (TOML)
    scenario: PathBuf,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    units: UnitArgs,
    #[command(flatten)]
    board: BoardArgs,
    #[command(flatten)]
    log: LogArgs,
    /// Measurements to compare with: time_s and any columns of trace.csv
    #[arg(long, value_name = "FILE.csv")]
    measured: Option<PathBuf>,
}

/// Kind of plan.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Plan {
    /// Readings of a static map
    Static,
    /// Pressures of a motion
    Motion,
}

#[derive(Debug, Args)]
struct IdentifyArgs {
    /// Recorded data: time_s and columns of trace.csv; a motion: time_s, length_m, pressure_pa, with force_n where it was
    /// measured; or a static map: rest_length_m, gauge_pressure_pa, length_m, force_n; of a joint: its joint_trace.csv, or
    /// time_s, angle_rad, a_pressure_pa, b_pressure_pa
    #[arg(required_unless_present = "plan")]
    data: Option<PathBuf>,
    /// Scenario file (TOML) whose [identify] names the parameters; of a joint all are sought
    #[arg(long, value_name = "FILE.toml")]
    config: PathBuf,
    /// Validation data: a second table of the same kind, that is not used for the fit; not for a record with stops, or of
    /// a joint
    #[arg(long, value_name = "OTHER.csv")]
    against: Option<PathBuf>,
    /// Print what to measure of the scenario's muscle, as CSV: the readings of a static map, or the pressures of a motion
    /// that shows slip and creep apart
    #[arg(
        long,
        value_enum,
        value_name = "KIND",
        num_args = 0..=1,
        default_missing_value = "static",
        conflicts_with_all = ["data", "out", "against"]
    )]
    plan: Option<Plan>,
    #[command(flatten)]
    output: OutputArgs,
}

/// Parser of an argument in SI, or in another unit of that quantity: `130000`, `1.3bar`.
fn quantity(si: &'static str) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| Wanted::new(si).read(text).map_err(|unread| format!("must be {unread}"))
}

/// As [`quantity`], in the core's f32.
fn core_quantity(si: &'static str) -> impl Fn(&str) -> Result<f32, String> + Clone {
    move |text| {
        let value = quantity(si)(text)? as f32;
        let too_large = || format!("must be less than {:e} {si}", f32::MAX).trim_end().to_owned();
        value.is_finite().then_some(value).ok_or_else(too_large)
    }
}

fn whole<T: FromStr + PartialOrd + Display>(
    text: &str,
    allowed: RangeInclusive<T>,
) -> Result<T, String> {
    let number = text.parse().ok().filter(|number| allowed.contains(number));
    number.ok_or_else(|| {
        format!("must be a whole number from {} to {}", allowed.start(), allowed.end())
    })
}

/// Runs the command of this process.
pub fn main() -> ExitCode {
    let arguments: Vec<OsString> = std::env::args_os().collect();
    if arguments.iter().any(|argument| argument == "--quiet") {
        checkout::say_nothing();
    }
    let size = terminal::size().ok().filter(|_| io::stdout().is_terminal());
    let columns = size.and_then(|(columns, _)| folded::columns(columns));
    let code = match columns {
        Some(columns)
            if !arguments.iter().any(|argument| AS_IT_IS.contains(&argument.to_str())) =>
        {
            let mut out = Folded::new(io::stdout(), columns);
            run(arguments, &mut out, &mut io::stderr())
        }
        _ => run(arguments, &mut io::stdout(), &mut io::stderr()),
    };
    ExitCode::from(code)
}

/// Runs one command, program name first; returns its exit code.
pub fn run<A: Into<OsString> + Clone>(
    arguments: impl IntoIterator<Item = A>,
    out: &mut dyn Write,
    err: &mut dyn Write,
) -> u8 {
    let arguments: Vec<OsString> = arguments.into_iter().map(Into::into).collect();
    let cli = match Cli::try_parse_from(&arguments) {
        Ok(cli) => cli,
        Err(mut usage) => {
            suggest(&mut usage, &arguments);
            suggest_sibling(&mut usage, &arguments);
            suggest_joined(&mut usage, &arguments);
            let text = usage.render();
            // `--help` and `--version` arrive here too. A failed write has no reader left to report
            // to.
            let _ = if usage.use_stderr() { write!(err, "{text}") } else { write!(out, "{text}") };
            return usage.exit_code() as u8;
        }
    };
    let to = &mut Console::new(out, err);
    let result = match cli.command.unwrap_or(Task::Reproduce(cli.reproduce)) {
        Task::Reproduce(args) => reproduce_command(&args, to),
        Task::Init(args) => init::run(&args, to),
        Task::Run(args) => run_command(&args, to),
        Task::Identify(args) => identify_command(&args, to),
        Task::Sweep(args) => sweep::run(args, to),
        Task::Tune(args) => tune_command(&args, to),
        Task::Measure(command) => measure::run(&command, to),
        Task::Replay(args) => replay::run(&args, to),
        Task::Fmu(args) => fmu::run(&args, to),
        Task::Compare(args) => compare::run(&args, to),
        Task::Monitor { port, out: folder, format, units, every, log } => {
            let folder = folder.unwrap_or_else(|| PathBuf::from("out/monitor"));
            let to = to.as_asked(format).in_units(units);
            monitor_command((&port, every), &folder, &log.wanted(), to)
        }
        Task::Serve(args) => serve::run(&args, to),
        Task::Playground(args) => playground::run(&args, to),
        Task::Board(command) => flashed::run(command, to),
        Task::EmulatedBoard(args) => flashed::serve(&args),
        Task::Ports(args) => flash::list(&args, to),
        Task::Flash(args) => flash::run(args, to),
        Task::Evaluate(args) => evaluate::run(&args, to),
        Task::Check { scenario, format } => check_command(&scenario, to.as_asked(format)),
        Task::Completions { shell, format } => shell::completions(shell, to.as_asked(format)),
        Task::Man { out: folder, format } => shell::man(&folder, to.as_asked(format)),
    };
    match result {
        Ok(()) => 0,
        Err(failure) => {
            to.say(&failure);
            failure.exit_code()
        }
    }
}

/// Adds the command that was probably meant where clap has no suggestion, such as for swapped letters.
fn suggest(usage: &mut clap::Error, arguments: &[OsString]) {
    use clap::error::{ContextKind, ContextValue};
    let Some(ContextValue::String(word)) = usage.get(ContextKind::InvalidSubcommand) else {
        return;
    };
    let of_thermyo = arguments.get(1).is_some_and(|argument| *argument == **word);
    let command = Cli::command();
    let names =
        command.get_subcommands().filter(|one| !one.is_hide_set()).map(|one| one.get_name());
    if let Some(near) = nearest(word, names.filter(|_| of_thermyo)).map(str::to_owned)
        && usage.get(ContextKind::SuggestedSubcommand).is_none()
    {
        usage.insert(ContextKind::SuggestedSubcommand, ContextValue::Strings(vec![near]));
    }
}

/// Adds the command that has an unknown option: for `--random` of `evaluate tune`, `evaluate estimator`.
fn suggest_sibling(usage: &mut clap::Error, arguments: &[OsString]) {
    use clap::error::{ContextKind, ContextValue};
    let Some(ContextValue::String(option)) = usage.get(ContextKind::InvalidArg) else { return };
    let (Some(task), Some(long)) = (arguments.get(1), option.strip_prefix("--")) else { return };
    let whole = Cli::command();
    let Some(task) = whole.get_subcommands().find(|one| *task == *one.get_name()) else { return };
    let having = task
        .get_subcommands()
        .filter(|one| one.get_arguments().any(|argument| argument.get_long() == Some(long)));
    let names: Vec<String> =
        having.map(|one| format!("`{} {}`", task.get_name(), one.get_name())).collect();
    if usage.kind() == clap::error::ErrorKind::UnknownArgument && !names.is_empty() {
        let tip = format!("--{long} goes with {}", names.join(", "));
        usage.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
    }
}

/// Joins the unit that was written apart from its number, as in `set pressure 1.3 bar`.
fn suggest_joined(usage: &mut clap::Error, arguments: &[OsString]) {
    use clap::error::{ContextKind, ContextValue};
    let Some(ContextValue::String(unit)) = usage.get(ContextKind::InvalidArg) else { return };
    let apart = arguments.windows(2).find_map(|pair| {
        let number = pair[0].to_str().filter(|number| number.parse::<f64>().is_ok())?;
        (pair[1] == **unit).then_some(number)
    });
    let is_unit = unit.starts_with(|first: char| first.is_alphabetic() || first == '%');
    if let Some(number) = apart.filter(|_| is_unit) {
        let tip = format!("a unit follows its number without a space: {number}{unit}");
        usage.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
    }
}

fn check_command(path: &Path, to: &mut Console<'_>) -> Result<(), Failure> {
    if let Some(joint) = joint_in(path, to)? {
        return joint::check(&joint, path, to);
    }
    let loaded = load(path, to)?;
    unbuilt::refuse(&loaded, path, to)?;
    let both = serde_json::json!({ "plant": loaded.plant, "believed": loaded.believed });
    to.done(&both, &thermyo_setup::render(&loaded))
}

/// The scenario of a joint, if the file is one; prints its warnings.
fn joint_in(path: &Path, to: &mut Console<'_>) -> Result<Option<JointLoaded>, Failure> {
    joint_with(path, to, |_| true)
}

fn joint_with(
    path: &Path,
    to: &mut Console<'_>,
    counts: fn(&InputError) -> bool,
) -> Result<Option<JointLoaded>, Failure> {
    let Some((loaded, mut warnings)) = thermyo_joint::load_with_warnings(path)? else {
        return Ok(None);
    };
    note_shipped(path, to);
    warnings.retain(counts);
    to.warn(&warnings);
    Ok(Some(loaded))
}

/// Whether a warning applies to an experiment. An experiment has its own duration: `run.duration_s` is not used.
fn counts_in_experiment(warning: &InputError) -> bool {
    let Problem::NoSense { key, .. } = &*warning.problem else { return true };
    !(key.starts_with("faults.") && key.ends_with("from_s"))
}

/// Prints a note if the built-in file is used.
fn note_shipped(path: &Path, to: &mut Console<'_>) {
    if shipped::instead_of(path).is_some() {
        let path = path.display();
        to.note(&format!("thermyo: {path} is not here: the one inside this program is used"));
    }
}

/// Loads a scenario; prints its warnings, and a note if the built-in file is used.
fn load(path: &Path, to: &mut Console<'_>) -> Result<Loaded, Failure> {
    load_with(path, to, |_| true)
}

fn load_with(
    path: &Path,
    to: &mut Console<'_>,
    counts: fn(&InputError) -> bool,
) -> Result<Loaded, Failure> {
    let (loaded, mut warnings) = thermyo_setup::load_with_warnings(path)?;
    note_shipped(path, to);
    warnings.retain(counts);
    to.warn(&warnings);
    Ok(loaded)
}

fn run_command(args: &RunArgs, to: &mut Console<'_>) -> Result<(), Failure> {
    let to = to.as_asked(args.output.format).in_units(args.units);
    if let Some(joint) = joint_in(&args.scenario, to)? {
        return joint::run(&joint, args, to);
    }
    let loaded = load(&args.scenario, to)?;
    unbuilt::refuse(&loaded, &args.scenario, to)?;
    let duration_s = loaded.plant.run.duration_s;
    let measured = match &args.measured {
        Some(path) => Some(read_to_compare(path, &loaded.plant, duration_s, to)?),
        None => None,
    };
    let logs = args.log.wanted();
    logs.check()?;
    trace_size::warn(&loaded.plant.run, COLUMNS.len(), &args.scenario, to);
    let mut board = args.board.open()?;
    let mut recorder = RunRecorder::new(&loaded);
    let mut out = args.output.create("run")?;
    let mut rows: u64 = 0;
    let quiet = args.output.format.quiet;
    let each = |row: &Row| {
        rows += 1;
        recorder.add(row);
    };
    let summary =
        record(&loaded, board.as_mut(), measured.as_ref(), (quiet, &logs), &mut out, each);
    let summary = match summary {
        Err(Failure::Interrupted) => return Err(stopped(out, to)),
        // The link broke or the board restarted: the rows so far stay where they are.
        Err(failure @ Failure::Run(RunError::Board(_))) if rows > 0 => {
            to.say(format_args!("the record so far is in {}", out.leave().display()));
            return Err(failure);
        }
        other => other?,
    };
    let title = title_of(&args.scenario);
    let page = recorder.page(&title, &loaded, measured.as_ref(), &summary);
    finish(out, &summary, &page, to)
}

fn tune_command(args: &tune::TuneArgs, to: &mut Console<'_>) -> Result<(), Failure> {
    let to = to.as_asked(args.output.format);
    match joint_with(&args.scenario, to, counts_in_experiment)? {
        Some(joint) => joint_tune::run(&joint, args, to),
        None => tune::run(args, to),
    }
}

fn identify_command(args: &IdentifyArgs, to: &mut Console<'_>) -> Result<(), Failure> {
    let to = to.as_asked(args.output.format);
    if let Some(joint) = joint_in(&args.config, to)? {
        return joint_identify::run(&joint, args, to);
    }
    let loaded = load(&args.config, to)?;
    let Some(data) = &args.data else {
        return plan_command(&loaded, args, to);
    };
    let table = identified_table(data, to)?;
    let against = args.against.as_deref().map(|other| identified_table(other, to)).transpose()?;
    interrupt::watch();
    // Created before the search, which takes minutes: an unwritable folder fails at once.
    let mut out = args.output.create_beside("identify", &[data])?;
    let bar = Bar::new(0, args.output.format.quiet);
    let found = identify_table(&loaded, &args.config, &table, data, against.as_ref(), &bar);
    drop(bar);
    let found = match found {
        Err(IdentifyError::Stopped { finished, starts, csv }) => {
            return Err(searched(out, (finished, starts), &csv, to)?);
        }
        found => found.map_err(Failure::Identify)?,
    };
    let title = title_of(data);
    let json = pretty(&found.findings());
    out.text("summary.json", &json)?;
    out.text("identified.toml", &thermyo_setup::render(found.scenario()))?;
    out.text("report.html", &found.page(&title))?;
    let (name, plot) = found.plot(&title);
    out.text(name, &plot)?;
    to.results(out, (&json, &found.text()))?;
    found.failed().map_or(Ok(()), |message| Err(Failure::Check(message)))
}

/// Reads a record or a static map, and prints what may be wrong with it.
fn identified_table(file: &Path, to: &mut Console<'_>) -> Result<Table, Failure> {
    let table = table::read_either(file, Readings::are_in)
        .map_err(|error| of_unknown_column(error, &known_columns()))?;
    // A table without times is refused for that, damaged or not.
    if table.column(measured::TIME).is_ok() || Readings::are_in(&table) {
        say_damage(&table, to);
        to.warn(measured::doubt(&table).as_slice());
    }
    Ok(table)
}

/// Prints the table on stdout, and the reasons on stderr.
fn plan_command(loaded: &Loaded, args: &IdentifyArgs, to: &mut Console<'_>) -> Result<(), Failure> {
    let shown = |csv: &str| match args.output.format.json {
        true => plan_json(csv),
        false => csv.to_owned(),
    };
    if let Some(Plan::Motion) = args.plan {
        let (text, reasons) = motion::plan(loaded, &args.config)?;
        to.print(&shown(&text))?;
        for reason in reasons {
            to.note(&reason);
        }
        return Ok(());
    }
    to.print(&shown(&static_map::plan(loaded, &args.config)?))
}

/// The rows of a plan as JSON: an object each, an empty cell as null.
fn plan_json(csv: &str) -> String {
    let mut lines = csv.lines().map(|line| line.split(','));
    let names: Vec<&str> = lines.next().into_iter().flatten().collect();
    let row = |cells: std::str::Split<'_, char>| -> serde_json::Map<String, serde_json::Value> {
        let values = cells.map(|cell| cell.parse::<f64>().ok().into());
        names.iter().map(|name| (*name).to_owned()).zip(values).collect()
    };
    format!("{:#}\n", serde_json::Value::from_iter(lines.map(row)))
}

/// Keeps the results of the finished searches of an identification, and prints where.
fn searched(
    mut out: OutputDir,
    (finished, starts): (usize, u64),
    csv: &str,
    to: &mut Console<'_>,
) -> Result<Failure, Failure> {
    let message = if finished == 0 {
        format!("none of {starts} searches was finished, nothing is kept")
    } else {
        out.text("searches.csv", csv)?;
        let left = out.leave().join("searches.csv");
        format!("the results of {finished} of {starts} searches are in {}", left.display())
    };
    to.say(message);
    Ok(Failure::Interrupted)
}

fn title_of(file: &Path) -> String {
    file.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into())
}

fn monitor_command(
    (port, every): (&str, u16),
    folder: &Path,
    logs: &Logs,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    // At a terminal Ctrl-C comes as a key, otherwise as a signal.
    interrupt::watch();
    if monitor::joint_at(port)? {
        monitor_as::<LiveJoint>((port, every), folder, logs, to)
    } else {
        monitor_as::<LiveBoard>((port, every), folder, logs, to)
    }
}

fn monitor_as<S: monitor::Monitored>(
    (port, every): (&str, u16),
    folder: &Path,
    logs: &Logs,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    let mut out = OutputDir::create(folder)?;
    let layout = S::Record::LAYOUT;
    let recorder = logs.record(&mut out, layout, &(layout.columns)())?;
    let mut session = Session::<S>::open(port, every, recorder).map_err(Failure::Board)?;
    let shown = match (to.is_read(), io::stdout().is_terminal()) {
        (false, _) => Shown::Not,
        (true, true) => Shown::Terminal,
        (true, false) => Shown::Lines,
    };
    // `to` folds lines: the figures need the raw stream.
    let shown = (shown, to.units);
    let outcome = monitor::run(&mut session, &mut out, shown, &interrupt::is_requested);
    let rows = session.rows();
    // Closes the file before it moves.
    drop(session);
    if rows > 0 {
        to.publish(out)?;
        let trace = folder.join(layout.file).display().to_string();
        let json = serde_json::json!({ "rows": rows, "trace": trace });
        to.done(&json, &format!("{} recorded: {trace}\n", monitor::rows(rows)))?;
    }
    match outcome? {
        monitor::Ended::Left => Ok(()),
        monitor::Ended::Stopped => Err(Failure::Interrupted),
    }
}

fn reproduce_command(args: &ReproduceArgs, to: &mut Console<'_>) -> Result<(), Failure> {
    let to = to.as_asked(args.output.format).in_units(args.units);
    let loaded = reproduce::scenario()?;
    let mut out = args.output.create("reproduce")?;
    let mut study = reproduce::Study::new(&loaded);
    let mut board = CoreBoard::default();
    let only_csv = Logs::default();
    let wanted = (args.output.format.quiet, &only_csv);
    let summary = record(&loaded, &mut board, None, wanted, &mut out, |row| study.add(row));
    let summary = match summary {
        Err(Failure::Interrupted) => return Err(stopped(out, to)),
        other => other?,
    };
    let findings = match study.finish(&summary) {
        Err(RunError::Stopped) => return Err(stopped(out, to)),
        findings => findings.map_err(Failure::Run)?,
    };
    let page = reproduce::page(&loaded, &findings, &summary);
    finish(out, &summary, &page, to)?;
    if !args.output.format.json {
        to.print(&findings.text())?;
    }
    findings.failed().map_or(Ok(()), |message| Err(Failure::Check(message)))
}

/// Runs a scenario and streams its trace into `out`; calls `each` with every logged row.
fn record(
    loaded: &Loaded,
    board: &mut dyn Board,
    measured: Option<&Measured>,
    (quiet, logs): (bool, &Logs),
    out: &mut OutputDir,
    mut each: impl FnMut(&Row),
) -> Result<Summary, Failure> {
    // Written first, so that the trace of a killed program can be replayed.
    out.scenario(&thermyo_setup::recorded(loaded))?;
    let mut writer = logs.record(out, MUSCLE, &COLUMNS)?;
    let unwritable = |error: io::Error| out.unwritable(MUSCLE.file, &error);
    let bar = Bar::new((loaded.plant.run.duration_s * 1000.0) as u64, quiet);
    let mut observer = |row: &Row| {
        writer.push(&row.cells())?;
        each(row);
        bar.set_position((row.truth.time_s * 1000.0) as u64);
        interrupt::check()
    };
    interrupt::watch();
    let result = run::run(loaded, board, measured, &mut observer);
    bar.clear();
    let written = writer.finish().map(drop).map_err(unwritable);
    let summary = result.map_err(|error| match error {
        // The emulated board gets the signal too, and may exit first.
        _ if interrupt::is_requested() => Failure::Interrupted,
        RunError::Output(error) => Failure::Input(unwritable(error)),
        other => Failure::Run(other),
    })?;
    written?;
    Ok(summary)
}

/// Keeps the rows so far after Ctrl-C, and prints where.
fn stopped(out: OutputDir, to: &mut Console<'_>) -> Failure {
    to.say(format_args!("the rows so far are in {}", out.leave().display()));
    Failure::Interrupted
}

/// Writes summary and report, and publishes all files.
fn finish(
    mut out: OutputDir,
    summary: &Summary,
    page: &str,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    let json = pretty(summary);
    out.text("summary.json", &json)?;
    out.text("report.html", page)?;
    to.results(out, (&json, &brief(summary, to.units)))
}

/// A result as JSON.
fn pretty(result: &impl Serialize) -> String {
    serde_json::to_string_pretty(result).expect("plain data") + "\n"
}

/// Trace of a run, given as a file or as its folder of results.
fn trace_in(run: &Path) -> PathBuf {
    let joint = run.join(thermyo_joint::trace::FILE);
    match run.is_dir() {
        true if joint.exists() => joint,
        true => run.join("trace.csv"),
        false => run.to_path_buf(),
    }
}

/// Reads a recorded table up to where it is damaged, and prints the damage.
fn read_record(path: &Path, to: &mut Console<'_>) -> Result<Table, Failure> {
    let table = table::read_record(path)?;
    say_damage(&table, to);
    Ok(table)
}

fn say_damage(table: &Table, to: &mut Console<'_>) {
    if let Some(damage) = table.damage() {
        to.say(damage);
    }
}

/// Reads measurements to compare with a run of this length; warns of rows after its end, and of columns that are not
/// compared.
fn read_to_compare(
    path: &Path,
    scenario: &Scenario,
    duration_s: f64,
    to: &mut Console<'_>,
) -> Result<Measured, Failure> {
    let known = every_column();
    let table = table::read_record(path).map_err(|error| of_unknown_column(error, &known))?;
    say_damage(&table, to);
    let measured = Measured::new(&table, &known)?;
    if scenario.plant.kind != PlantKind::Vessel {
        check_pressures(&table, "pressure_pa", scenario.ambient.pressure_pa)?;
    }
    let (measured, late) = measured.within_run(&table, &COMPARABLE, duration_s)?;
    if late > 0 {
        let (file, rows) = (path.display(), table.rows());
        to.say(format_args!(
            "warning: {file}: {late} of {rows} rows lie after the end of the run at \
             {duration_s} s and are not compared"
        ));
    }
    let compared: Vec<&str> = measured.columns.iter().map(|own| own.name.as_str()).collect();
    let all = table.columns().iter().map(|own| own.name.as_str());
    let others: Vec<&str> =
        all.filter(|name| *name != measured::TIME && !compared.contains(name)).collect();
    if !others.is_empty() {
        to.say(format_args!(
            "{}: compared: {}; not compared: {}",
            path.display(),
            compared.join(", "),
            others.join(", ")
        ));
    }
    Ok(measured)
}

fn brief(summary: &Summary, units: UnitSystem) -> String {
    let mut text = format!(
        "{} s simulated, {} times real time, core on board \"{}\"\n\
         pressure {}, gas {}\n\
         gas temperature, RMS error: bare sensor {:.3} K, model {:.3} K, estimate {:.3} K\n\
         balance errors: mass {:.1e}, energy {:.1e}\n",
        summary.duration_s,
        speed(summary.real_time_factor),
        summary.board,
        units.range([summary.pressure_pa.min, summary.pressure_pa.max], "Pa", 1),
        units.range([summary.gas_temperature_k.min, summary.gas_temperature_k.max], "K", 1),
        summary.rmse_k.sensor_gas,
        summary.rmse_k.model,
        summary.rmse_k.estimate,
        summary.mass_balance_error,
        summary.energy_balance_error,
    );
    if let Some(measured) = &summary.measured {
        for (name, difference) in measured {
            let [rmse, max] =
                [difference.rmse, difference.max].map(|v| difference_text(v, name, units));
            text += &format!("measured {name}: RMS difference {rmse}, largest {max}\n");
        }
    }
    if let Some(control) = &summary.control {
        text += &control.text(units);
    }
    text += &summary.core.fault_line();
    for warning in [summary.overconfidence(), summary.unrest()].into_iter().flatten() {
        text += &format!("warning: {warning}\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::Cli;
    use clap::{Command, CommandFactory};

    fn assert_takes_both(command: &Command, path: &str) {
        // Users do not start the process behind the port "emulated".
        if command.is_hide_set() || command.get_name() == "help" {
            return;
        }
        let path = format!("{path}{} ", command.get_name());
        // A name that only groups other commands prints nothing itself.
        let prints = !command.is_subcommand_required_set();
        for name in ["json", "quiet"].into_iter().filter(|_| prints) {
            let flag = command.get_arguments().find(|argument| argument.get_id() == name);
            assert!(flag.is_some(), "{path}has no --{name}");
            let conflicts = command.get_arg_conflicts_with(flag.unwrap());
            let other =
                conflicts.iter().any(|with| ["json", "quiet"].contains(&with.get_id().as_str()));
            assert!(!other, "{path}takes --json or --quiet, not both");
        }
        command.get_subcommands().for_each(|command| assert_takes_both(command, &path));
    }

    /// Exit code and message for arguments.
    fn refused(arguments: &[&str]) -> String {
        let (mut out, mut err) = (Vec::new(), Vec::new());
        let all = ["thermyo"].iter().chain(arguments);
        assert_eq!(super::run(all, &mut out, &mut err), 2, "{arguments:?}");
        String::from_utf8(err).unwrap()
    }

    #[test]
    fn a_negative_number_is_a_wrong_value_and_no_option() {
        for (arguments, allowed) in [
            (&["evaluate", "estimator", "--random", "-1"][..], "a whole number from 1 to 10000"),
            (&["evaluate", "plants", "--seed", "-1"], "a whole number from 0 to "),
            (&["evaluate", "faults", "--hours", "-1"], "hours from 0 to 10000"),
            (
                &["evaluate", "estimator", "--recording", "x", "--reference-lag", "-1"],
                "seconds from 0 to 10",
            ),
            (&["monitor", "emulated", "--every", "-3"], "a whole number from 1 to 1000"),
            (&["serve", "--port", "-1"], "a whole number from 1 to 65535"),
            (&["measure", "stop", "x", "--stops", "-1"], "a whole number from 3 to 100"),
            (&["measure", "stop", "x", "--seed", "-1"], "a whole number from 0 to "),
            (&["sweep", "x", "--vary", "a.b=1:2", "--lhs", "-1"], "a whole number from 1 to "),
            (&["sweep", "x", "--vary", "a.b=1:2:3", "--within", "-1"], "a number above 0"),
            (&["sweep", "x", "--vary", "a.b=1:2:3", "--within", "1s"], "a number above 0, in K"),
        ] {
            let message = refused(arguments);
            assert!(message.contains(&format!("must be {allowed}")), "{arguments:?}: {message}");
        }
    }

    /// The folder and the second record used to be ignored.
    #[test]
    fn a_plan_is_printed_and_needs_no_folder() {
        for ignored in ["--out", "--against"] {
            let message = refused(&["identify", "--config", "x", "--plan", "motion", ignored, "y"]);
            assert!(message.contains("'--plan [<KIND>]' cannot be used with"), "{message}");
        }
    }

    #[test]
    fn a_set_point_that_no_board_has_is_refused_before_it_is_sent() {
        let message = refused(&["board", "emulated", "set", "pressure", "1e300"]);
        assert!(message.contains("must be less than 3.4028235e38 Pa"), "{message}");
        for name in ["", " "] {
            let message = refused(&["board", name, "info"]);
            assert!(message.contains(&format!("{name:?}: is no name of a port: ")), "{message}");
        }
    }

    #[test]
    fn a_file_of_another_kind_is_named_as_one() {
        let message = refused(&["check", "-"]);
        assert_eq!(message, "thermyo: -: standard input is not read: name a file\n");
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, text: &str| {
            std::fs::write(folder.path().join(name), text).unwrap();
            folder.path().join(name).display().to_string()
        };
        let scenario = file("s.toml", "[run]\nduration_s = 1\n");
        let message = refused(&["run", &scenario, "--measured", &scenario]);
        let toml = "s.toml: is TOML: must be a CSV file, whose first line names the columns\n";
        assert!(message.ends_with(toml), "{message}");
        let vessel = file("v.toml", "[run]\n[plant]\nkind = \"vessel\"\n");
        let message = refused(&["serve", &vessel]);
        let allowed = "v.toml:3: plant.kind = \"vessel\": must be \"muscle\", \"cylinder\" or \"table\" at a \
                       board's page\n";
        assert!(message.ends_with(allowed), "{message}");
    }

    #[test]
    fn a_plant_that_is_too_fast_is_refused_at_its_key() {
        let folder = tempfile::tempdir().unwrap();
        let check = |text: &str| {
            let path = folder.path().join("s.toml");
            std::fs::write(&path, text).unwrap();
            refused(&["check", &path.display().to_string()])
        };
        for (text, start) in [
            (
                "[joint]\n\ninertia_kg_m2 = 1e-6\n",
                "s.toml:3: joint.inertia_kg_m2 = 1e-6: must be at least ",
            ),
            (
                "[tube]\nlength_m = 1e-4\ndiameter_m = 0.004\n",
                "s.toml:2: tube.length_m = 1e-4: tube.length_m is too short",
            ),
            (
                "[ambient]\npressure_pa = 1\n[plant]\ninitial_pressure_pa = 1e4\n",
                "s.toml:4: plant.initial_pressure_pa = 1e4: the chamber's smallest volume is too small",
            ),
        ] {
            let message = check(text);
            assert!(message.contains(start), "{message}");
        }
    }

    #[test]
    fn help_fits_a_narrow_terminal() {
        let mut command = Cli::command();
        command.build();
        for task in command.get_subcommands() {
            let help = task.clone().term_width(50).render_help().to_string();
            // A usage is one line, and words are not broken.
            let lines = help.lines().filter(|line| !line.starts_with("Usage:"));
            for line in lines.filter(|line| line.trim().contains(' ')) {
                assert!(line.chars().count() <= 50, "{}: {line}", task.get_name());
            }
        }
    }

    #[test]
    fn every_command_takes_json_and_quiet() {
        let mut command = Cli::command();
        command.build();
        assert!(command.get_subcommands().count() > 15);
        command.get_subcommands().for_each(|task| assert_takes_both(task, "thermyo "));
    }

    #[test]
    fn a_plan_is_json_too() {
        let json = super::plan_json("time_s,force_n\n0.5,\n1,20\n");
        let rows: serde_json::Value = serde_json::from_str(&json).unwrap();
        let wanted = serde_json::json!([
            { "time_s": 0.5, "force_n": null },
            { "time_s": 1.0, "force_n": 20.0 },
        ]);
        assert_eq!(rows, wanted);
    }
}
