//! `thermyo tune`: its arguments, and what it prints and writes.

use super::{BoardArgs, Failure, OutputArgs, interrupt, load, print, publish};
use crate::board::live::LiveBoard;
use crate::commands::drive::LiveBench;
use crate::commands::tune;
use crate::files::output::OutputDir;
use crate::scenario;
use clap::Args;
use std::io::Write;
use std::path::PathBuf;

/// Arguments of `thermyo tune`.
#[derive(Debug, Args)]
pub(super) struct TuneArgs {
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

/// Nobody means less than that: it is no pressure of a muscle, but one in another unit \[Pa\].
const LEAST_PA: f64 = 1.0e5;

fn pressure(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value >= LEAST_PA => Ok(value),
        Ok(value) if (1.0..100.0).contains(&value) => {
            Err(format!("must be an absolute pressure in Pa: {value} bar are {:.0}", value * 1e5))
        }
        _ => Err("must be an absolute pressure in Pa, at least 100000 (1 bar)".to_owned()),
    }
}

pub(super) fn run(
    args: &TuneArgs,
    stdout: &mut dyn Write,
    stderr: &mut dyn Write,
) -> Result<(), Failure> {
    let loaded = load(&args.scenario, stderr)?;
    let folder = args.output.out.clone().unwrap_or_else(|| PathBuf::from("out/tune"));
    let tuned = |args: &TuneArgs| -> Result<tune::Tuned, Failure> {
        let Some(port) = args.board.port() else {
            let mut board = args.board.open()?;
            return Ok(tune::tune(&loaded, &args.scenario, args.max_pressure, board.as_mut())?);
        };
        let mut board = LiveBoard::open(port)?;
        interrupt::watch();
        let highest_pa = args.max_pressure;
        let mut bench = LiveBench::new(&mut board, "tune", highest_pa, &interrupt::wanted);
        Ok(tune::tune_on(&loaded, &args.scenario, highest_pa, &mut bench)?)
    };
    let mut out = OutputDir::create(&folder)?;
    let tuned = tuned(args)?;
    let json = serde_json::to_string_pretty(&tuned.findings).expect("plain data") + "\n";
    let title = args.scenario.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into());
    out.text("summary.json", &json)?;
    out.text("tuned.toml", &scenario::render(&tuned.scenario))?;
    out.text("report.html", &tune::page(&tuned, &title))?;
    publish(out, stderr)?;
    if args.output.json {
        print(stdout, &json)
    } else {
        print(stdout, &tuned.findings.text())?;
        print(stdout, &format!("report: {}\n", folder.join("report.html").display()))
    }
}
