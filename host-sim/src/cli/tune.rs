use super::progress::Bar;
use super::{BoardArgs, Failure, OutputArgs, interrupt, load, print, publish, quantity, title_of};
use clap::Args;
use model_core::{Config, Telemetry};
use std::io::Write;
use std::path::PathBuf;
use thermyo_boards::live::LiveBoard;
use thermyo_files::output::OutputDir;
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;
use thermyo_simulation::board::BoardError;
use thermyo_simulation::run::RunError;
use thermyo_studies::drive::LiveBench;
use thermyo_studies::tune;
use thermyo_studies::tune::{Bench, Simulated};

#[derive(Debug, Args)]
pub(super) struct TuneArgs {
    /// Scenario file (TOML): muscle and load or joint, and the core's present configuration
    pub(super) scenario: PathBuf,
    /// Highest absolute pressure of the experiment, such as 3.5bar or 350000 (Pa) [default: 4bar]
    #[arg(long, value_name = "PRESSURE", allow_negative_numbers = true, value_parser = pressure)]
    pub(super) max_pressure: Option<f64>,
    #[command(flatten)]
    pub(super) output: OutputArgs,
    #[command(flatten)]
    pub(super) board: BoardArgs,
}

/// Lower values are in another unit, such as bar \[Pa\].
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
}

impl Bench for Watched<'_> {
    fn drive(&mut self, driven: &Loaded, each: &mut dyn FnMut(&Telemetry)) -> Result<(), RunError> {
        let Self { bench, bar, before_ms } = self;
        let run = &driven.plant.run;
        let whole_ms = (run.duration_s * 1e3) as u64;
        if *before_ms == 0 {
            // The first drive is the experiment.
            bar.set_length(whole_ms + (tune::checks_s() * 1e3) as u64);
        }
        bench.drive(driven, &mut |telemetry| {
            let time_ms = f64::from(telemetry.step) * run.step_s * 1e3;
            bar.set_position(*before_ms + time_ms as u64);
            each(telemetry);
        })?;
        *before_ms += whole_ms;
        Ok(())
    }

    fn leave(&mut self, config: &Config) -> Result<(), BoardError> {
        self.bench.leave(config)
    }
}

pub(super) fn left_on_board(adopted: bool) -> &'static str {
    if adopted {
        "the board vents and has the tuned values, not saved; `thermyo board PORT config write` \
         with the scenario of before goes back\n"
    } else {
        "the board vents and has its former values; tuned.toml has the tuned ones\n"
    }
}

pub(super) fn run(
    args: &TuneArgs,
    stdout: &mut dyn Write,
    stderr: &mut dyn Write,
) -> Result<(), Failure> {
    let loaded = load(&args.scenario, args.output.format, stderr)?;
    let folder = args.output.out.clone().unwrap_or_else(|| PathBuf::from("out/tune"));
    let highest_pa = tune::highest_pa(&core_config(&loaded.believed), args.max_pressure)
        .map_err(|error| Failure::Usage(format!("--max-pressure: {error}")))?;
    let tuned = |args: &TuneArgs| -> Result<tune::Tuned, Failure> {
        let bar = Bar::new(0, args.output.format.quiet);
        let tune_on = |bench: &mut dyn Bench| {
            let mut watched = Watched { bench, bar: &bar, before_ms: 0 };
            let tuned = tune::tune_on(&loaded, &args.scenario, highest_pa, &mut watched);
            bar.clear();
            Ok(tuned?)
        };
        let Some(port) = args.board.port() else {
            let mut board = args.board.open()?;
            let board = board.as_mut();
            return tune_on(&mut Simulated { board, stopped: &interrupt::is_requested });
        };
        let mut board = LiveBoard::open(port)?;
        tune_on(&mut LiveBench::new(&mut board, "tune", highest_pa, &interrupt::is_requested))
    };
    interrupt::watch();
    let mut out = OutputDir::create(&folder)?;
    let tuned = match tuned(args) {
        // The emulated board gets the signal too, and may exit first.
        Err(_) if interrupt::is_requested() && args.board.port().is_none() => {
            let _ = writeln!(stderr, "thermyo: the experiment was not finished, nothing is kept");
            return Err(Failure::Interrupted);
        }
        tuned => tuned?,
    };
    let json = serde_json::to_string_pretty(&tuned.findings).expect("plain data") + "\n";
    let title = title_of(&args.scenario);
    out.text("summary.json", &json)?;
    out.text("tuned.toml", &thermyo_setup::render(&tuned.scenario))?;
    out.text("report.html", &tune::page(&tuned, &title))?;
    publish(out, args.output.format, stderr)?;
    if args.output.format.json {
        print(stdout, &json)
    } else {
        print(stdout, &tuned.findings.text())?;
        if args.board.port().is_some() {
            print(stdout, left_on_board(tuned.findings.adopted))?;
        }
        print(stdout, &format!("report: {}\n", folder.join("report.html").display()))
    }
}
