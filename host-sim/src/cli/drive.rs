//! `thermyo board PORT drive`: a profile on a board, recorded like a simulated run.

use super::log::LogArgs;
use super::progress::Bar;
use super::{Console, Failure, interrupt, pretty, read_to_compare, title_of};
use clap::Args;
use std::path::PathBuf;
use thermyo_boards::live::LiveBoard;
use thermyo_boards::subject::Subject;
use thermyo_files::output::OutputDir;
use thermyo_files::units::UnitSystem;
use thermyo_record::board_trace::Recorder;
use thermyo_scenario::DriveKind;
use thermyo_scenario::profile::Profile;
use thermyo_setup::SET_POINT_COLUMNS;
use thermyo_setup::from_config;
use thermyo_simulation::board::BoardError;
use thermyo_studies::drive::{
    self, Course, DriveError, Driven, Ended, Gathered, MuscleCourse, Record, SetPointOf,
};

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

impl DriveArgs {
    /// The kind of the profile's column `value`.
    fn kind(&self) -> Option<DriveKind> {
        let kinds = SET_POINT_COLUMNS.iter().map(|(_, kind)| *kind);
        self.kind.as_deref().and_then(|word| kinds.into_iter().find(|kind| kind.word() == word))
    }
}

/// A drive on a board: set points over its time, and the resulting record.
pub(super) struct Planned<'a, R: Record> {
    pub(super) record: R,
    pub(super) course: &'a dyn Course<SetPointOf<R>>,
    pub(super) duration_s: f64,
    /// Content of `profile.csv`.
    pub(super) profile: Option<String>,
    /// Summary as text.
    pub(super) brief: fn(&R::Driven, UnitSystem) -> String,
    /// Failure for a board that refuses to be armed.
    pub(super) refused: fn(BoardError, UnitSystem) -> Failure,
}

/// Drives a muscle.
pub(super) fn drive_profile(
    board: &mut LiveBoard,
    args: &DriveArgs,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    let configured = from_config::to_scenario(&board.config()?)?;
    let armed_pa = if args.arm { None } else { board.status()?.armed_pa };
    let driven = drive::plan(&args.profile, args.kind(), &configured, armed_pa)?;
    let duration_s = driven.plant.run.duration_s;
    let measured = match &args.measured {
        Some(path) => Some(read_to_compare(path, &driven.plant, duration_s, to)?),
        None => None,
    };
    let profile = driven.drive_profile.as_ref();
    warn_of_times(args, profile, to);
    let planned = Planned {
        record: Gathered::new(driven.clone(), measured.as_ref()),
        course: &MuscleCourse::new(&driven),
        duration_s,
        profile: profile.map(|profile| {
            let rows = profile.points().iter().map(|(time_s, value)| format!("{time_s},{value}\n"));
            String::from("time_s,value\n") + &rows.collect::<String>()
        }),
        brief,
        refused: |error, _| error.into(),
    };
    drive_planned(board, args, planned, to)
}

/// Warns of a profile whose times seem to be in another unit.
pub(super) fn warn_of_times(args: &DriveArgs, profile: Option<&Profile>, to: &mut Console<'_>) {
    if let Some(why) = profile.and_then(Profile::doubt) {
        to.say(format_args!("warning: {}: {why}", args.profile.display()));
    }
}

/// Drives a board, and prints where the record of a drive that failed is: a drive cannot be repeated.
pub(super) fn drive_planned<R: Record>(
    board: &mut R::Board,
    args: &DriveArgs,
    planned: Planned<'_, R>,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    let mut place = None;
    let driven = drive_and_record(board, args, planned, &mut place, to);
    if let (Err(_), Some(place)) = (&driven, place.filter(|place| place.exists())) {
        to.say(format_args!("the record so far is in {}", place.display()));
    }
    driven
}

/// Drives a board and records it. `place` names the folder of the recording until it is published.
fn drive_and_record<R: Record>(
    board: &mut R::Board,
    args: &DriveArgs,
    planned: Planned<'_, R>,
    place: &mut Option<PathBuf>,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    let Planned { mut record, course, duration_s, profile, brief, refused } = planned;
    let config = board.config()?;
    let folder = args.out.clone().unwrap_or_else(|| PathBuf::from("out/drive"));
    let mut files = OutputDir::create(&folder)?;
    files.text("scenario.toml", &record.scenario())?;
    if let Some(profile) = profile {
        files.text("profile.csv", &profile)?;
    }
    let logs = args.log.wanted();
    let mut recorder = logs.record(&mut files, R::LAYOUT, &(R::LAYOUT.columns)())?;
    interrupt::watch();
    if args.arm {
        board.arm(None).map_err(|error| refused(error, to.units))?;
    }
    let bar = Bar::new((duration_s * 1e3) as u64, to.format.quiet);
    let outcome =
        drive::follow(board, course, &interrupt::is_requested, &mut |telemetry, status| {
            record.add(&R::write(&mut recorder, &config, status, telemetry)?);
            bar.set_position((record.steps().last_s * 1e3) as u64);
            Ok(())
        });
    bar.clear();
    let ended = ended(outcome, recorder, (R::LAYOUT.file, &mut files), place, to)?;
    let (status, timing) = (board.status()?, board.timing()?);
    let stopped_of_s = (ended == Ended::Stopped).then_some(duration_s);
    let driven = drive::driven(record.steps().last_s, stopped_of_s);
    let of = (board.port(), &status, &timing);
    let (summary, page) = record.finish(&title_of(&args.profile), of, stopped_of_s);
    let json = pretty(&summary);
    files.text("report.html", &page)?;
    files.text("summary.json", &json)?;
    to.results(files, (&json, &brief(&summary, to.units)))?;
    if ended == Ended::Stopped {
        let folder = folder.display();
        return Err(Failure::StoppedAt(format!("{driven}; the record is in {folder}")));
    }
    Ok(())
}

/// Closes the record of a drive. From its first row on it is kept, and `record` names its folder.
fn ended(
    outcome: Result<Ended, DriveError>,
    recorder: Recorder,
    (name, files): (&'static str, &mut OutputDir),
    place: &mut Option<PathBuf>,
    to: &mut Console<'_>,
) -> Result<Ended, Failure> {
    let rows = recorder.rows();
    if rows > 0 {
        files.keep();
        *place = Some(files.place().to_path_buf());
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

fn brief(summary: &Driven, units: UnitSystem) -> String {
    let mut text = format!(
        "{} driven, configuration {} ({:08x}); it vents\n\
         pressure {}, estimated gas {}\n\
         {}, telemetry of {} lost\n",
        drive::driven(summary.duration_s, summary.stopped_of_s),
        summary.config_name,
        summary.config_checksum,
        units.range([summary.pressure_pa.min, summary.pressure_pa.max], "Pa", 1),
        units.range([summary.estimate_k.min, summary.estimate_k.max], "K", 1),
        summary.timing.text(),
        summary.lost_steps,
    );
    if let Some(control) = &summary.control {
        text += &control.text(units);
    }
    text + &summary.core.fault_line()
}
