//! `thermyo board PORT drive`: a profile on a board, recorded like a simulated run.

use super::log::LogArgs;
use super::progress::Bar;
use super::{Console, Failure, interrupt, pretty, read_to_compare, title_of};
use clap::Args;
use std::path::{Path, PathBuf};
use thermyo_boards::live::LiveBoard;
use thermyo_boards::subject::Subject;
use thermyo_files::output::OutputDir;
use thermyo_files::units::UnitSystem;
use thermyo_logs::topics::MUSCLE;
use thermyo_record::board_trace::Recorder;
use thermyo_scenario::DriveKind;
use thermyo_scenario::profile::Profile;
use thermyo_setup::from_config;
use thermyo_setup::{Loaded, SET_POINT_COLUMNS};
use thermyo_studies::drive;
use thermyo_studies::drive::{Drawn, DriveError, Driven, Ended, Gathered};

#[derive(Debug, Args)]
pub(super) struct DriveArgs {
    /// Scenario (TOML), whose drive and duration are used, or CSV: time_s and one of pressure_pa,
    /// contraction, flow_kg_s, duty, or value; of a joint time_s, angle_rad and stiffness_n_m_rad
    pub(super) profile: PathBuf,
    /// Quantity of a CSV's column value
    #[arg(long, value_parser = ["pressure", "contraction", "mass-flow", "duty"])]
    pub(super) kind: Option<String>,
    /// Arm the board first
    #[arg(long)]
    pub(super) arm: bool,
    /// Measurements to compare with: time_s and any columns of trace.csv
    #[arg(long, value_name = "FILE.csv")]
    pub(super) measured: Option<PathBuf>,
    /// Folder for the results, including report.html [default: out/drive]
    #[arg(long, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
    #[command(flatten)]
    pub(super) log: LogArgs,
}

/// Drives a muscle, and prints where the record of a drive that failed is.
pub(super) fn drive_profile(
    board: &mut LiveBoard,
    args: &DriveArgs,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    let mut record = None;
    let driven = drive_and_record(board, args, &mut record, to);
    say_record(&driven, record, to);
    driven
}

/// Prints where the record of a drive that failed is.
pub(super) fn say_record(
    driven: &Result<(), Failure>,
    record: Option<PathBuf>,
    to: &mut Console<'_>,
) {
    if let (Err(_), Some(record)) = (driven, record.filter(|record| record.exists())) {
        to.say(format_args!("the record so far is in {}", record.display()));
    }
}

impl DriveArgs {
    /// The kind of the profile's column `value`.
    fn kind(&self) -> Option<DriveKind> {
        let kinds = SET_POINT_COLUMNS.iter().map(|(_, kind)| *kind);
        self.kind.as_deref().and_then(|word| kinds.into_iter().find(|kind| kind.word() == word))
    }
}

/// `record` names the folder of the recording until it is published: a drive cannot be repeated.
fn drive_and_record(
    board: &mut LiveBoard,
    args: &DriveArgs,
    record: &mut Option<PathBuf>,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    let config = board.config()?;
    let configured = from_config::to_scenario(&config)?;
    let armed_pa = if args.arm { None } else { board.status()?.armed_pa };
    let driven = drive::plan(&args.profile, args.kind(), &configured, armed_pa)?;
    let duration_s = driven.plant.run.duration_s;
    let measured = match &args.measured {
        Some(path) => Some(read_to_compare(path, &driven.plant, duration_s, to)?),
        None => None,
    };
    warn_of_times(args, driven.drive_profile.as_ref(), to);
    let folder = args.out.clone().unwrap_or_else(|| PathBuf::from("out/drive"));
    let mut files = drive_files(&folder, &driven)?;
    let mut recorder = Recorder::new(files.file("trace.csv")?)
        .map_err(|error| files.unwritable("trace.csv", &error))?
        .beside(args.log.wanted().open(&mut files, MUSCLE)?);
    let (mut gathered, mut drawn) = (Gathered::new(&driven, measured.as_ref()), Drawn::default());
    interrupt::watch();
    if args.arm {
        board.arm(None)?;
    }
    let bar = Bar::new((duration_s * 1e3) as u64, to.format.quiet);
    let outcome =
        drive::drive(board, &driven, &interrupt::is_requested, &mut |telemetry, status| {
            let row = recorder.write(&config, status, telemetry)?;
            gathered.add(&row);
            drawn.add(&row);
            bar.set_position((row.truth.time_s * 1e3) as u64);
            Ok(())
        });
    bar.clear();
    let ended = ended(outcome, recorder, ("trace.csv", &mut files), record, to)?;
    let (status, timing) = (board.status()?, board.timing()?);
    let summary = Driven {
        stopped_of_s: (ended == Ended::Stopped).then_some(duration_s),
        ..gathered.finish(board.port(), &status, &timing)
    };
    let title = title_of(&args.profile);
    files.text("report.html", &drive::page(&title, &driven, &drawn, &summary))?;
    let summed = Summed {
        json: pretty(&summary),
        brief: brief(&summary, to.units),
        stopped: summary.stopped_of_s.map(|_| summary.driven()),
    };
    drove(files, &folder, &summed, to)
}

/// Warns of a profile whose times seem to be in another unit.
pub(super) fn warn_of_times(args: &DriveArgs, profile: Option<&Profile>, to: &mut Console<'_>) {
    if let Some(why) = profile.and_then(Profile::doubt) {
        to.say(format_args!("warning: {}: {why}", args.profile.display()));
    }
}

/// Closes the record of a drive. From its first row on it is kept, and `record` names its folder.
pub(super) fn ended(
    outcome: Result<Ended, DriveError>,
    recorder: Recorder,
    (name, files): (&'static str, &mut OutputDir),
    record: &mut Option<PathBuf>,
    to: &mut Console<'_>,
) -> Result<Ended, Failure> {
    let rows = recorder.rows();
    if rows > 0 {
        files.keep();
        *record = Some(files.place().to_path_buf());
    }
    let unwritable = |error| Failure::from(files.unwritable(name, &error));
    let written = recorder.finish().map_err(unwritable);
    let ended = match outcome {
        Err(DriveError::Output(error)) => return Err(unwritable(error)),
        Err(DriveError::Board(error)) => return Err(error.into()),
        Ok(Ended::Stopped) if rows == 0 => {
            to.say("stopped before its first step, nothing is kept");
            return Err(Failure::Interrupted);
        }
        Ok(ended) => ended,
    };
    written.map(|_| ended)
}

/// Summary of a drive: as JSON, as text, and the driven time where it was stopped early.
pub(super) struct Summed {
    pub(super) json: String,
    pub(super) brief: String,
    pub(super) stopped: Option<String>,
}

/// Publishes a drive, and prints its summary.
pub(super) fn drove(
    mut files: OutputDir,
    folder: &Path,
    summed: &Summed,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    let Summed { json, brief, stopped } = summed;
    files.text("summary.json", json)?;
    to.results(files, (json, brief))?;
    if let Some(driven) = stopped {
        let folder = folder.display();
        return Err(Failure::StoppedAt(format!("{driven}; the record is in {folder}")));
    }
    Ok(())
}

/// Creates the folder of a drive, with its scenario and its profile.
fn drive_files(folder: &Path, driven: &Loaded) -> Result<OutputDir, Failure> {
    let mut files = OutputDir::create(folder)?;
    files.text("scenario.toml", &thermyo_setup::render(driven))?;
    if let Some(profile) = &driven.drive_profile {
        let rows = profile.points().iter().map(|(time_s, value)| format!("{time_s},{value}\n"));
        files.text("profile.csv", &(String::from("time_s,value\n") + &rows.collect::<String>()))?;
    }
    Ok(files)
}

fn brief(summary: &Driven, units: UnitSystem) -> String {
    let mut text = format!(
        "{} driven, configuration {} ({:08x}); it vents\n\
         pressure {}, estimated gas {}\n\
         core step {:.0} us mean, {:.0} us worst; {} missed, telemetry of {} lost\n",
        summary.driven(),
        summary.config_name,
        summary.config_checksum,
        units.range([summary.pressure_pa.min, summary.pressure_pa.max], "Pa", 1),
        units.range([summary.estimate_k.min, summary.estimate_k.max], "K", 1),
        summary.timing.step_mean_us,
        summary.timing.step_worst_us,
        summary.timing.missed_steps,
        summary.lost_steps,
    );
    if let Some(control) = &summary.control {
        text += &control.text(units);
    }
    text + &summary.core.fault_line()
}
