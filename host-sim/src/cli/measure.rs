//! `thermyo measure`: properties of the gas that the muscle itself shows.

use super::progress::Bar;
use super::{
    Console, Failure, FormatArgs, UnitArgs, counts_in_experiment, interrupt, load_with, quantity,
    title_of, tune, unbuilt, whole,
};
use clap::{Args, Subcommand};
use model_core::{Config, SetPointError};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use thermyo_boards::live::LiveBoard;
use thermyo_boards::subject::Subject;
use thermyo_files::output::OutputDir;
use thermyo_protocol::Refusal;
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;
use thermyo_setup::from_config;
use thermyo_simulation::board::{BoardError, CoreBoard};
use thermyo_simulation::run::RunError;
use thermyo_studies::stops::{
    Asked, LiveRows, Plan, Record, RowBench, SimulatedRows, measured, write,
};
use thermyo_studies::tune as experiment;

#[derive(Debug, Args)]
pub(super) struct MeasureCommand {
    #[command(subcommand)]
    task: MeasureTask,
}

#[derive(Debug, Subcommand)]
enum MeasureTask {
    /// Gas temperature and heat transfer without a wire: both valves are shut at random phases of a
    /// cycle of the pressure, and the gas relaxes to its wall
    ///
    /// The muscle moves, and vents in the end. Exit code 1: fewer than three stops can be used.
    Stop(StopArgs),
}

#[derive(Debug, Args)]
struct StopArgs {
    /// Serial port, such as /dev/ttyACM0, or "emulated"; or a scenario (TOML), which is simulated
    target: OsString,
    /// Number of stops, 3 to 100: with fewer than 8, too few may follow an inflow for `identify` to find the heat
    /// transfer [default: 8]
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value = "8", hide_default_value = true, value_parser = stops)]
    stops: usize,
    /// Time for which the valves stay shut, such as 30 (s) or 2min [default: four time constants of
    /// gas and sensor]
    #[arg(long, value_name = "TIME", allow_hyphen_values = true, value_parser = wait)]
    wait: Option<f64>,
    /// Period of the cycle, such as 5 (s) [default: 5]
    #[arg(long, value_name = "TIME", default_value = "5", hide_default_value = true, allow_hyphen_values = true, value_parser = period)]
    period: f64,
    /// Highest absolute pressure, such as 3.5bar or 350000 (Pa) [default: 4bar, or what is armed]
    #[arg(long, value_name = "PRESSURE", allow_hyphen_values = true, value_parser = tune::pressure)]
    max_pressure: Option<f64>,
    /// Seed of the random phases [default: 1]
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value = "1", hide_default_value = true, value_parser = |text: &str| whole(text, 0..=u64::MAX))]
    seed: u64,
    /// Arm the board first, up to the highest pressure
    #[arg(long)]
    arm: bool,
    /// Folder for the results, including report.html [default: out/measure]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    format: FormatArgs,
    #[command(flatten)]
    units: UnitArgs,
}

fn stops(text: &str) -> Result<usize, String> {
    whole(text, 3..=100)
}

fn seconds(text: &str, [least, most]: [f64; 2]) -> Result<f64, String> {
    let value = quantity("s")(text)?;
    let allowed = (least..=most).contains(&value);
    allowed.then_some(value).ok_or_else(|| format!("must be a time from {least} to {most} s"))
}

fn wait(text: &str) -> Result<f64, String> {
    seconds(text, [6.0, 3600.0])
}

fn period(text: &str) -> Result<f64, String> {
    seconds(text, [0.5, 120.0])
}

pub(super) fn run(command: &MeasureCommand, to: &mut Console<'_>) -> Result<(), Failure> {
    let MeasureTask::Stop(args) = &command.task;
    let to = to.as_asked(args.format).in_units(args.units);
    let asked = Asked {
        stops: args.stops,
        wait_s: args.wait,
        period_s: args.period,
        highest_pa: args.max_pressure,
        seed: args.seed,
    };
    let allowed = |config: &Config| -> Result<(), Failure> {
        let refused = |error| Failure::Usage(format!("--max-pressure: {error}"));
        experiment::highest_pa(config, args.max_pressure).map(drop).map_err(refused)
    };
    let path = Path::new(&args.target);
    let refused = |error| Failure::Usage(format!("{}: {error}", path.display()));
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml")) {
        let loaded = load_with(path, to, counts_in_experiment)?;
        unbuilt::refuse(&loaded, path, to)?;
        let config = core_config(&loaded.believed);
        allowed(&config)?;
        let plan = Plan::new(&loaded, &config, &asked, None).map_err(refused)?;
        let title = title_of(path);
        let mut board = CoreBoard::default();
        let mut bench = SimulatedRows(&mut board);
        return measure(args, &loaded, &plan, (&title, "simulated"), &mut bench, to);
    }
    let port = args.target.to_string_lossy();
    let mut board = LiveBoard::open(&port)?;
    let config = board.config()?;
    allowed(&config)?;
    let loaded = from_config::to_scenario(&config)?.scenario;
    let armed_pa = if args.arm { None } else { board.status()?.armed_pa };
    if !args.arm && armed_pa.is_none() {
        return Err(BoardError::Refused(Refusal::SetPoint(SetPointError::NotArmed)).into());
    }
    let plan = Plan::new(&loaded, &config, &asked, armed_pa).map_err(refused)?;
    interrupt::watch();
    let mut bench = LiveRows::arm(&mut board, config, &plan, args.arm)?;
    measure(args, &loaded, &plan, ("stops", &port), &mut bench, to)
}

fn measure(
    args: &StopArgs,
    loaded: &Loaded,
    plan: &Plan,
    (title, board): (&str, &str),
    bench: &mut dyn RowBench,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    let folder = args.out.clone().unwrap_or_else(|| PathBuf::from("out/measure"));
    let mut files = OutputDir::create(&folder)?;
    interrupt::watch();
    let step_s = plan.driven.plant.run.step_s;
    let bar = Bar::new((plan.driven.plant.run.duration_s * 1e3) as u64, args.format.quiet);
    let mut record = Record::default();
    let outcome = bench.measure(plan, &mut record, &mut |telemetry| {
        bar.set_position((f64::from(telemetry.step) * step_s * 1e3) as u64);
        interrupt::is_requested()
    });
    bar.clear();
    let interrupted = match outcome {
        Ok(()) => false,
        Err(RunError::Stopped | RunError::Board(BoardError::Interrupted)) => true,
        // The link broke or a fault vented: measurements until then are kept.
        Err(error) if !record.rows.rows.is_empty() => {
            let findings = measured(&record, plan, loaded, board);
            write(&mut files, &findings, &record, loaded, title)?;
            to.say(format_args!("the record so far is in {}", files.leave().display()));
            return Err(Failure::Run(error));
        }
        Err(error) => return Err(Failure::Run(error)),
    };
    if record.rows.rows.is_empty() {
        to.say("stopped before its first step, nothing is kept");
        return Err(Failure::Interrupted);
    }
    let bar = Bar::new(0, args.format.quiet);
    let findings = measured(&record, plan, loaded, board);
    bar.clear();
    write(&mut files, &findings, &record, loaded, title)?;
    to.results(files, (&findings.json(), &findings.text(to.units)))?;
    if interrupted {
        let measured_s = record.rows.rows.last().map_or(0.0, |row| row.time_s);
        let duration_s = plan.driven.plant.run.duration_s;
        return Err(Failure::StoppedAt(format!(
            "{measured_s:.2} s of {duration_s:.0} s; the record is in {}",
            folder.display()
        )));
    }
    findings.failed().map_or(Ok(()), |why| Err(Failure::Check(why)))
}
