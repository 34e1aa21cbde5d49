//! `thermyo board`: queries and commands to a flashed board, or to the emulated one.

use super::board_status::{Overview, configuration, configuration_json, started_by};
use super::joint_board::JointTask;
use super::log::LogArgs;
use super::muscle::{line, vents};
use super::progress::Bar;
use super::{
    Failure, FormatArgs, UnitArgs, calibrate, interrupt, joint_board, load, print, publish,
    read_to_compare, set, tune,
};
use clap::{Args, Subcommand};
use model_core::Faults;
use model_core::safety::supervisor::VENTING;
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};
use thermyo_boards::image::Variant;
use thermyo_boards::live::LiveBoard;
use thermyo_boards::{port, service};
use thermyo_files::input::write_new;
use thermyo_files::output::OutputDir;
use thermyo_files::units::UnitSystem;
use thermyo_protocol::{Event, Refusal};
use thermyo_record::board_trace::Recorder;
use thermyo_scenario::DriveKind;
use thermyo_setup::core_config::core_config;
use thermyo_setup::from_config;
use thermyo_setup::{Loaded, SET_POINT_COLUMNS};
use thermyo_simulation::board::BoardError;
use thermyo_studies::drive;
use thermyo_studies::drive::{Drawn, DriveError, Driven, Ended, Gathered};

#[derive(Debug, Args)]
pub(super) struct BoardCommand {
    /// Serial port, such as /dev/ttyACM0, or "emulated": the firmware on an emulated Pico, with a simulated
    /// muscle or joint at its pins
    port: String,
    /// Print the result as JSON on standard output
    #[arg(long, global = true)]
    json: bool,
    /// Print only requested results, warnings and errors
    #[arg(long, global = true)]
    quiet: bool,
    /// Print figures in SI: Pa, m, K and ratios instead of kPa, mm, degC and %
    #[arg(long, global = true)]
    si: bool,
    #[command(subcommand)]
    task: BoardTask,
}

#[derive(Debug, Subcommand)]
enum BoardTask {
    /// Print identity, configuration, faults and state of the board
    Info,
    /// Arm the board: set points are accepted until something vents it
    Arm(ArmArgs),
    /// Send a set point, show the muscle, and vent in the end
    Set(set::SetArgs),
    /// Vent
    Stop,
    /// Clear latched faults whose cause is gone
    Clear,
    /// Read, write, save or delete the configuration
    #[command(subcommand)]
    Config(ConfigTask),
    /// Print restarts and venting faults, the latest first
    History,
    /// Calibrate a sensor at two points with a reference instrument
    Calibrate(calibrate::CalibrateArgs),
    /// Drive a profile and record it like a simulated run: trace.csv, summary.json, report.html
    Drive(DriveArgs),
    /// Plug in the emulated board again, with the muscle of a scenario, or with the joint of one and its image
    Plug {
        /// Scenario file (TOML) [default: the nominal muscle]
        scenario: Option<PathBuf>,
    },
    /// Unplug the emulated board
    Unplug,
}

#[derive(Debug, Args)]
struct ArmArgs {
    /// Highest absolute pressure of a set point, such as 2bar or 200000 (Pa) [default: the limit in
    /// the configuration]
    #[arg(long, value_name = "PRESSURE", allow_negative_numbers = true, value_parser = tune::pressure)]
    max_pressure: Option<f64>,
}

#[derive(Debug, Args)]
struct DriveArgs {
    /// Scenario (TOML), whose drive and duration are used, or CSV: time_s and one of pressure_pa,
    /// contraction, flow_kg_s, duty, or value
    profile: PathBuf,
    /// Quantity of a CSV's column value
    #[arg(long, value_parser = ["pressure", "contraction", "mass-flow", "duty"])]
    kind: Option<String>,
    /// Arm the board first
    #[arg(long)]
    arm: bool,
    /// Measurements to compare with: time_s and any columns of trace.csv
    #[arg(long, value_name = "FILE.csv")]
    measured: Option<PathBuf>,
    /// Folder for the results, including report.html [default: out/drive]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    log: LogArgs,
}

#[derive(Debug, Subcommand)]
enum ConfigTask {
    /// Write the configuration to a scenario file
    Read {
        /// Scenario file that does not exist yet
        file: PathBuf,
    },
    /// Send the core's part of a scenario; the board vents and is not armed
    Write {
        /// Scenario file (TOML)
        file: PathBuf,
    },
    /// Save the configuration in flash
    Save,
    /// Delete the saved configuration
    Forget,
}

impl BoardTask {
    /// The same for a joint's board, if it has it.
    fn of_joint(self) -> Option<JointTask> {
        Some(match self {
            Self::Info => JointTask::Info,
            Self::Arm(ArmArgs { max_pressure }) => JointTask::Arm { max_pressure },
            Self::Set(args) => JointTask::Set(args),
            Self::Stop => JointTask::Stop,
            Self::Clear => JointTask::Clear,
            Self::Config(ConfigTask::Write { file }) => JointTask::Write { file },
            Self::Config(ConfigTask::Save) => JointTask::Save,
            Self::Config(ConfigTask::Forget) => JointTask::Forget,
            _ => return None,
        })
    }
}

pub(super) fn run(
    command: BoardCommand,
    out: &mut dyn Write,
    err: &mut dyn Write,
) -> Result<(), Failure> {
    let BoardCommand { port, json, quiet, si, task } = command;
    let (format, units) = (FormatArgs { json, quiet }, UnitArgs { si }.system());
    if let BoardTask::Plug { .. } | BoardTask::Unplug = task {
        return plug(&port, task, format, out);
    }
    let mut board = match LiveBoard::open(&port) {
        Err(BoardError::Refused(Refusal::OtherImage { joint: true })) => {
            return joint_board::run(&port, task.of_joint(), (format, units), out);
        }
        opened => opened?,
    };
    match task {
        BoardTask::Info => info(&mut board, (format, units), out),
        BoardTask::Arm(ArmArgs { max_pressure }) => {
            arm(&mut board, max_pressure, (format, units), out)
        }
        BoardTask::Set(args) => set::run(&mut board, &args, (format, units), out, err),
        BoardTask::Stop => {
            board.stop()?;
            format.done(out, &vents(), "it vents\n")
        }
        BoardTask::Clear => {
            let left = board.clear()?;
            let words = match left {
                Faults::NONE => "no fault is left; it vents until it is armed\n".to_owned(),
                Faults::NOT_CONFIGURED => {
                    "no fault is left; it waits for its configuration\n".to_owned()
                }
                left if !left.intersects(VENTING) => format!("shown: {left}\n"),
                left => return Err(Failure::Check(format!("still there: {left}"))),
            };
            format.done(out, &json!({ "faults": left.to_string() }), &words)
        }
        BoardTask::Config(task) => configure(&mut board, task, format, out, err),
        BoardTask::History => history(&mut board, (format, units), out),
        BoardTask::Calibrate(args) => calibrate::run(&mut board, &args, format, out, err),
        BoardTask::Drive(args) => drive_profile(&mut board, &args, (format, units), out, err),
        BoardTask::Plug { .. } | BoardTask::Unplug => Ok(()),
    }
}

fn plug(
    port: &str,
    task: BoardTask,
    format: FormatArgs,
    out: &mut dyn Write,
) -> Result<(), Failure> {
    if port != port::EMULATED {
        let usage =
            "only the emulated board is plugged in by a command: thermyo board emulated plug";
        return Err(Failure::Usage(usage.to_owned()));
    }
    match task {
        BoardTask::Plug { scenario } => {
            let mut plugged = (Variant::Standard, "plugged in\n");
            if let Some(scenario) = &scenario {
                match thermyo_joint::load(scenario)? {
                    Some(_) => plugged = (Variant::Joint, "plugged in: a joint\n"),
                    None => drop(thermyo_setup::load(scenario)?),
                }
            }
            let (image, words) = plugged;
            service::plug(image, scenario.as_deref())?;
            format.done(out, &json!({ "plugged": true }), words)
        }
        _ => {
            let words = if service::unplug() { "unplugged\n" } else { "it was not plugged in\n" };
            format.done(out, &json!({ "plugged": false }), words)
        }
    }
}

/// Arguments of the hidden command behind the port "emulated".
#[derive(Debug, Args)]
pub(super) struct ServeArgs {
    scripts: PathBuf,
    image: PathBuf,
    file: PathBuf,
    scenario: Option<PathBuf>,
}

pub(super) fn serve(args: &ServeArgs) -> Result<(), Failure> {
    let ServeArgs { scripts, image, file, scenario } = args;
    let joint = scenario.as_deref().map(thermyo_joint::load).transpose()?.flatten();
    if let Some(joint) = joint {
        return Ok(service::serve(scripts, image, file, joint_board::at_pins(&joint)?)?);
    }
    let loaded = match scenario {
        Some(path) => thermyo_setup::load(path)?,
        None => thermyo_setup::parse("", Path::new("the nominal muscle"))?,
    };
    Ok(service::serve(scripts, image, file, service::muscle(&loaded)?)?)
}

fn info(
    board: &mut LiveBoard,
    (format, units): (FormatArgs, UnitSystem),
    out: &mut dyn Write,
) -> Result<(), Failure> {
    let overview = Overview {
        version: board.version(),
        status: board.status()?,
        timing: board.timing()?,
        last_reset: board.last_reset()?,
    };
    let telemetry = board.fresh_telemetry()?;
    let mut json = overview.json(board.port());
    json["faults"] = telemetry.faults.to_string().into();
    json["pressure_pa"] = telemetry.pressure_pa.into();
    json["length_m"] = telemetry.length_m.into();
    json["estimate_k"] = telemetry.estimate.gas_k.into();
    let faults = match telemetry.faults {
        Faults::NONE => "none".to_owned(),
        faults => faults.to_string(),
    };
    let text =
        overview.text(&faults, &format!("muscle:        {}", line(&telemetry, units)), units);
    format.answer(out, &json, &text)
}

fn arm(
    board: &mut LiveBoard,
    most_pa: Option<f64>,
    (format, units): (FormatArgs, UnitSystem),
    out: &mut dyn Write,
) -> Result<(), Failure> {
    board.arm(most_pa.map(|pa| pa as f32))?;
    let armed_pa = board.status()?.armed_pa.unwrap_or_default();
    let words = format!("armed up to {}, absolute\n", units.text(armed_pa.into(), "Pa", 1));
    format.done(out, &json!({ "armed_pa": armed_pa }), &words)
}

/// A joint's scenario is nothing for a board that drives one muscle.
fn refuse_joint(file: &Path) -> Result<(), Failure> {
    if thermyo_joint::load(file)?.is_none() {
        return Ok(());
    }
    let file = file.display();
    let usage = format!(
        "{file}: has a [joint], and the board drives one muscle: `thermyo flash --joint`, or without hardware \
         `thermyo board emulated plug {file}`"
    );
    Err(Failure::Usage(usage))
}

fn configure(
    board: &mut LiveBoard,
    task: ConfigTask,
    format: FormatArgs,
    out: &mut dyn Write,
    err: &mut dyn Write,
) -> Result<(), Failure> {
    match task {
        ConfigTask::Write { file } => {
            refuse_joint(&file)?;
            let config = core_config(&load(&file, format, err)?.believed);
            let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let status = board.configure(&config, &name)?;
            format.done(out, &configuration_json(&status), &format!("{}\n", configuration(&status)))
        }
        ConfigTask::Read { file } => {
            let config = board.config()?;
            let status = board.status()?;
            let scenario = from_config::to_scenario(&config)?;
            let head = format!("# {}\n\n", configuration(&status));
            write_new(&file, &(head + &thermyo_setup::render(&scenario.scenario)))?;
            if !scenario.exact {
                let _ = writeln!(
                    err,
                    "thermyo: a scenario cannot hold all of this configuration: written back it has another \
                     checksum"
                );
            }
            let words = format!("{} in {}\n", configuration(&status), file.display());
            let mut json = configuration_json(&status);
            json["file"] = json!(file.display().to_string());
            format.done(out, &json, &words)
        }
        ConfigTask::Save => {
            board.save()?;
            let status = board.status()?;
            let words = format!("saved: {}\n", configuration(&status));
            format.done(out, &configuration_json(&status), &words)
        }
        ConfigTask::Forget => {
            board.forget()?;
            format.done(out, &json!({ "saved": false }), "the saved configuration is deleted\n")
        }
    }
}

fn history(
    board: &mut LiveBoard,
    (format, units): (FormatArgs, UnitSystem),
    out: &mut dyn Write,
) -> Result<(), Failure> {
    let events = board.history()?;
    let json = serde_json::to_value(&events).expect("plain data");
    if events.is_empty() {
        let words = "no events: it has neither vented by itself nor restarted\n";
        return format.answer(out, &json, words);
    }
    let mut words = String::new();
    for event in events {
        words += &match event {
            Event::Started(last_reset) => format!("started by {}\n", started_by(last_reset)),
            Event::Vented(first) => format!(
                "vented by {} at {}, step {}\n",
                first.faults,
                units.text(first.pressure_pa.into(), "Pa", 2),
                first.step
            ),
        };
    }
    format.answer(out, &json, &words)
}

fn drive_profile(
    board: &mut LiveBoard,
    args: &DriveArgs,
    shown: (FormatArgs, UnitSystem),
    out: &mut dyn Write,
    err: &mut dyn Write,
) -> Result<(), Failure> {
    let mut record = None;
    let driven = drive_and_record(board, args, shown, &mut record, out, err);
    if let (Err(_), Some(record)) = (&driven, record.filter(|record| record.exists())) {
        let _ = writeln!(err, "thermyo: the record so far is in {}", record.display());
    }
    driven
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
    shown: (FormatArgs, UnitSystem),
    record: &mut Option<PathBuf>,
    out: &mut dyn Write,
    err: &mut dyn Write,
) -> Result<(), Failure> {
    let config = board.config()?;
    let configured = from_config::to_scenario(&config)?;
    let armed_pa = if args.arm { None } else { board.status()?.armed_pa };
    let driven = drive::plan(&args.profile, args.kind(), &configured, armed_pa)?;
    let duration_s = driven.plant.run.duration_s;
    let measured =
        args.measured.as_deref().map(|path| read_to_compare(path, duration_s, err)).transpose()?;
    let folder = args.out.clone().unwrap_or_else(|| PathBuf::from("out/drive"));
    let mut files = drive_files(&folder, &driven)?;
    let mut recorder = Recorder::new(files.file("trace.csv")?)
        .map_err(|error| files.unwritable("trace.csv", &error))?
        .beside(args.log.wanted().open(&mut files)?);
    let (mut gathered, mut drawn) = (Gathered::new(&driven, measured.as_ref()), Drawn::new());
    interrupt::watch();
    if args.arm {
        board.arm(None)?;
    }
    let bar = Bar::new((driven.plant.run.duration_s * 1e3) as u64, shown.0.quiet);
    let outcome =
        drive::drive(board, &driven, &interrupt::is_requested, &mut |telemetry, status| {
            let row = recorder.write(&config, status, telemetry)?;
            gathered.add(&row);
            drawn.add(&row);
            bar.set_position((row.truth.time_s * 1e3) as u64);
            Ok(())
        });
    bar.clear();
    if gathered.rows() > 0 {
        files.keep();
        *record = Some(files.place().to_path_buf());
    }
    let unwritable = |error| Failure::from(files.unwritable("trace.csv", &error));
    let written = recorder.finish().map_err(unwritable);
    let ended = match outcome {
        Err(DriveError::Output(error)) => return Err(unwritable(error)),
        Err(DriveError::Board(error)) => return Err(error.into()),
        Ok(Ended::Stopped) if gathered.rows() == 0 => {
            let _ = writeln!(err, "thermyo: stopped before its first step, nothing is kept");
            return Err(Failure::Interrupted);
        }
        Ok(ended) => ended,
    };
    written?;
    let (status, timing) = (board.status()?, board.timing()?);
    let summary = Driven {
        stopped_of_s: (ended == Ended::Stopped).then_some(duration_s),
        ..gathered.finish(board.port(), &status, &timing)
    };
    let title = args.profile.file_stem().unwrap_or_default().to_string_lossy();
    files.text("report.html", &drive::page(&title, &driven, &drawn, &summary))?;
    drove(files, &folder, &summary, shown, out, err)
}

/// Publishes a drive, and prints its summary.
fn drove(
    mut files: OutputDir,
    folder: &Path,
    summary: &Driven,
    (format, units): (FormatArgs, UnitSystem),
    out: &mut dyn Write,
    err: &mut dyn Write,
) -> Result<(), Failure> {
    let json = serde_json::to_string_pretty(summary).expect("plain data") + "\n";
    files.text("summary.json", &json)?;
    publish(files, format, err)?;
    if format.json {
        print(out, &json)?
    } else {
        print(out, &brief(summary, units, folder))?
    }
    if summary.stopped_of_s.is_some() {
        let (driven, folder) = (summary.driven(), folder.display());
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

fn brief(summary: &Driven, units: UnitSystem, folder: &Path) -> String {
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
    text += &summary.core.fault_line();
    text + &format!("report: {}\n", folder.join("report.html").display())
}
