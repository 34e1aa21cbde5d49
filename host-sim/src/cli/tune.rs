use super::muscle::{warn_of_another_calibration, warn_of_another_muscle};
use super::progress::Bar;
use super::{
    BoardArgs, Console, Failure, OutputArgs, counts_in_experiment, interrupt, load_with, pretty,
    quantity, title_of, unbuilt,
};
use clap::{Args, ValueEnum};
use model_core::{Config, Telemetry};
use serde::Serialize;
use std::path::PathBuf;
use thermyo_boards::live::LiveBoard;
use thermyo_boards::subject::Subject;
use thermyo_files::output::OutputDir;
use thermyo_identify::motion;
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;
use thermyo_simulation::board::BoardError;
use thermyo_simulation::run::RunError;
use thermyo_studies::drive::LiveBench;
use thermyo_studies::tune;
use thermyo_studies::tune::{Bench, Left, Simulated};

#[derive(Debug, Args)]
pub(super) struct TuneArgs {
    /// Scenario file (TOML): muscle and load or joint, and the core's present configuration
    pub(super) scenario: PathBuf,
    /// Another experiment, of 5 min: slip and creep of a muscle, as `identify --plan motion` prints it
    #[arg(long, value_enum)]
    pub(super) plan: Option<TunePlan>,
    /// Highest absolute pressure of the experiment, such as 3.5bar or 350000 (Pa) [default: 4bar]
    #[arg(long, value_name = "PRESSURE", allow_hyphen_values = true, value_parser = pressure)]
    pub(super) max_pressure: Option<f64>,
    #[command(flatten)]
    pub(super) output: OutputArgs,
    #[command(flatten)]
    pub(super) board: BoardArgs,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(super) enum TunePlan {
    /// Slip and creep
    Motion,
}

const RECORD: &str = "motion.csv";
/// Lowest plausible pressure: a lower value is in another unit, such as bar \[Pa\].
const LEAST_PA: f64 = 1.0e5;

pub(super) fn pressure(text: &str) -> Result<f64, String> {
    let value = quantity("Pa")(text)?;
    if value >= LEAST_PA {
        return Ok(value);
    }
    let bare = text.parse::<f64>().is_ok_and(|bar| (1.0..100.0).contains(&bar));
    let meant = if bare { format!(": use {text}bar") } else { String::new() };
    Err(format!("must be an absolute pressure of at least 100000 Pa (1 bar){meant}"))
}

/// A bench that shows the driven time on a progress bar.
struct Watched<'a> {
    bench: &'a mut dyn Bench,
    bar: &'a Bar,
    /// Time driven before this experiment.
    before_ms: u64,
    /// Time of the checks after the experiment.
    checks_ms: u64,
}

impl Bench for Watched<'_> {
    fn drive(&mut self, driven: &Loaded, each: &mut dyn FnMut(&Telemetry)) -> Result<(), RunError> {
        let Self { bench, bar, before_ms, checks_ms } = self;
        let run = &driven.plant.run;
        let whole_ms = (run.duration_s * 1e3) as u64;
        if *before_ms == 0 {
            // The first drive is the experiment.
            bar.set_length(whole_ms + *checks_ms);
        }
        bench.drive(driven, &mut |telemetry| {
            let time_ms = f64::from(telemetry.step) * run.step_s * 1e3;
            bar.set_position(*before_ms + time_ms as u64);
            each(telemetry);
        })?;
        *before_ms += whole_ms;
        Ok(())
    }

    fn leave(&mut self, left: Left<'_, Config>) -> Result<(), BoardError> {
        self.bench.leave(left)
    }
}

fn left_on_board(adopted: bool) -> &'static str {
    if adopted {
        "the board vents and has the tuned values, not saved; `thermyo board PORT config write` \
         with the scenario of before goes back\n"
    } else {
        "the board vents and has its former configuration; tuned.toml has the tuned ones\n"
    }
}

/// Runs an experiment on the board of the arguments.
fn on_bench<T>(
    args: &TuneArgs,
    (loaded, highest_pa): (&Loaded, f64),
    to: &mut Console<'_>,
    experiment: impl FnOnce(&mut dyn Bench, &Bar) -> Result<T, Failure>,
) -> Result<T, Failure> {
    let bar = Bar::new(0, args.output.format.quiet);
    let watched = |bench: &mut dyn Bench| {
        let checks_ms = if args.plan.is_none() { (tune::checks_s() * 1e3) as u64 } else { 0 };
        experiment(&mut Watched { bench, bar: &bar, before_ms: 0, checks_ms }, &bar)
    };
    let Some(port) = args.board.port() else {
        let mut board = args.board.open()?;
        let board = board.as_mut();
        return watched(&mut Simulated { board, stopped: &interrupt::is_requested });
    };
    let mut board = LiveBoard::open(port)?;
    warn_of_another_calibration(&mut board, &args.scenario, loaded, to)?;
    watched(&mut LiveBench::new(&mut board, "tune", highest_pa, &interrupt::is_requested)?)
}

pub(super) fn run(args: &TuneArgs, to: &mut Console<'_>) -> Result<(), Failure> {
    let loaded = load_with(&args.scenario, to, counts_in_experiment)?;
    let highest_pa = tune::highest_pa(&core_config(&loaded.believed), args.max_pressure)
        .map_err(|error| Failure::Usage(format!("--max-pressure: {error}")))?;
    unbuilt::refuse(&loaded, &args.scenario, to)?;
    if let Some(port) = args.board.port() {
        warn_of_another_muscle(port, &args.scenario, &loaded, to);
    }
    interrupt::watch();
    let mut out = args.output.create("tune")?;
    let done = match args.plan {
        None => loops(args, (&loaded, highest_pa), &mut out, to),
        Some(TunePlan::Motion) => motion(args, (&loaded, highest_pa), &mut out, to),
    };
    match done {
        // The emulated board gets the signal too, and may exit first.
        Err(_) if interrupt::is_requested() && args.board.port().is_none() => {
            Err(interrupted(&out, to))
        }
        done => done?.publish(out, to),
    }
}

/// Prints what an interrupted experiment leaves.
pub(super) fn interrupted(out: &OutputDir, to: &mut Console<'_>) -> Failure {
    let record = out.place().join(RECORD);
    let left = if record.exists() {
        format!("the search was not finished, its record is {}", record.display())
    } else {
        "the experiment was not finished, nothing is kept".to_owned()
    };
    to.say(left);
    Failure::Interrupted
}

/// Results of an experiment for a terminal.
pub(super) struct Done {
    json: String,
    text: String,
    failed: Option<String>,
}

impl Done {
    /// Writes the files common to every experiment. `adopted` is whether a board keeps the values.
    pub(super) fn new(
        args: &TuneArgs,
        out: &mut OutputDir,
        findings: &impl Serialize,
        (scenario, report): (&str, &str),
        (mut text, adopted): (String, bool),
    ) -> Result<Self, Failure> {
        let json = pretty(findings);
        out.text("summary.json", &json)?;
        out.text("tuned.toml", scenario)?;
        out.text("report.html", report)?;
        text += match args.board.port() {
            Some(_) => left_on_board(adopted),
            None if adopted => "",
            None => "tuned.toml has the tuned values\n",
        };
        Ok(Self { json, text, failed: None })
    }

    /// The same result, for values that are not reliable.
    pub(super) fn failing(self, failed: Option<String>) -> Self {
        Self { failed, ..self }
    }

    pub(super) fn publish(self, out: OutputDir, to: &mut Console<'_>) -> Result<(), Failure> {
        to.results(out, (&self.json, &self.text))?;
        self.failed.map_or(Ok(()), |message| Err(Failure::Check(message)))
    }
}

fn loops(
    args: &TuneArgs,
    (loaded, highest_pa): (&Loaded, f64),
    out: &mut OutputDir,
    to: &mut Console<'_>,
) -> Result<Done, Failure> {
    let tuned = on_bench(args, (loaded, highest_pa), to, |bench, _| {
        Ok(tune::tune_on(loaded, &args.scenario, highest_pa, bench)?)
    })?;
    let page = tune::page(&tuned, &title_of(&args.scenario));
    let scenario = thermyo_setup::render(&tuned.scenario);
    let shown = (tuned.findings.text(), tuned.findings.adopted);
    Done::new(args, out, &tuned.findings, (&scenario, &page), shown)
}

fn motion(
    args: &TuneArgs,
    (loaded, highest_pa): (&Loaded, f64),
    out: &mut OutputDir,
    to: &mut Console<'_>,
) -> Result<Done, Failure> {
    let found = on_bench(args, (loaded, highest_pa), to, |bench, bar| {
        let record = tune::motion_record(loaded, &args.scenario, highest_pa, bench)?;
        out.text(RECORD, &record)?;
        // The experiment cannot be repeated quickly: its record stays if the search does not finish.
        out.keep();
        let record_file = out.place().join(RECORD);
        bar.clear();
        let watch = Bar::new(0, args.output.format.quiet);
        let record = (record.as_str(), record_file.as_path());
        let found = tune::motion_values(loaded, &args.scenario, record, &watch)?;
        if interrupt::is_requested() {
            return Err(Failure::Interrupted);
        }
        if found.findings.holds {
            bench.leave(Left::Found(&core_config(&found.scenario.believed)))?;
        }
        Ok(found)
    })?;
    let page = motion::page(&found, &title_of(&args.scenario));
    let scenario = thermyo_setup::render(&found.scenario);
    let shown = (found.findings.text(), found.findings.holds);
    let done = Done::new(args, out, &found.findings, (&scenario, &page), shown)?;
    Ok(done.failing(found.findings.failed()))
}
