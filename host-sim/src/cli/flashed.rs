//! `thermyo board`: queries and commands to a flashed board, or to the emulated one.

use super::board_status::{Overview, armed, cleared, config_file, history, save, shown_as};
use super::board_task::{ArmArgs, BoardTask, ConfigTask};
use super::drive::drive_profile;
use super::muscle::{line, vents, warn_of_another_calibration, warn_of_another_muscle};
use super::{
    Console, Failure, FormatArgs, UnitArgs, calibrate, joint_board, joint_in, load, set, title_of,
};
use clap::Args;
use model_core::Faults;
use model_core::safety::supervisor::VENTING;
use serde_json::json;
use std::path::{Path, PathBuf};
use thermyo_boards::emulated::Port;
use thermyo_boards::image::Variant;
use thermyo_boards::live::LiveBoard;
use thermyo_boards::subject::Subject;
use thermyo_boards::{port, service};
use thermyo_protocol::Refusal;
use thermyo_setup::core_config::core_config;
use thermyo_setup::from_config;
use thermyo_simulation::board::BoardError;

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

pub(super) fn run(command: BoardCommand, to: &mut Console<'_>) -> Result<(), Failure> {
    let BoardCommand { port, json, quiet, si, task } = command;
    let to = to.as_asked(FormatArgs { json, quiet }).in_units(UnitArgs { si });
    if let BoardTask::Plug { .. } | BoardTask::Unplug = task {
        return plug(&port, task, to);
    }
    // A refused file leaves the board alone.
    if let BoardTask::Config(ConfigTask::Write { file }) = &task
        && thermyo_joint::load(file)?.is_none()
    {
        thermyo_setup::load(file)?;
    }
    let mut board = match LiveBoard::open(&port) {
        Err(BoardError::Refused(Refusal::OtherImage { joint: true })) => {
            return joint_board::run(&port, task, to);
        }
        Err(BoardError::Taken { port }) if matches!(task, BoardTask::Stop) => {
            let usage = format!(
                "{port}: not stopped: another program has it open, and goes on. Ctrl-C in that one vents; so does \
                 the emergency stop"
            );
            return Err(Failure::Usage(usage));
        }
        opened => opened?,
    };
    match task {
        BoardTask::Info => info(&mut board, to),
        BoardTask::Arm(ArmArgs { max_pressure }) => arm(&mut board, max_pressure, to),
        BoardTask::Set(args) => set::run(&mut board, &args, to),
        BoardTask::Stop => {
            board.stop()?;
            to.done(&vents(), "it vents\n")
        }
        BoardTask::Clear => {
            let left = board.clear()?;
            let words = match left {
                Faults::NONE => cleared(board.status()?.armed_pa),
                Faults::NOT_CONFIGURED => {
                    "no fault is left; it waits for its configuration\n".to_owned()
                }
                left if !left.intersects(VENTING) => format!("shown: {left}\n"),
                left => return Err(Failure::Check(format!("still there: {left}"))),
            };
            to.done(&json!({ "faults": left.to_string() }), &words)
        }
        BoardTask::Config(task) => configure(&mut board, task, to),
        BoardTask::History => history((&board.history()?, "vented"), to),
        BoardTask::Calibrate(args) => calibrate::run(&mut board, &args, to),
        BoardTask::Drive(args) => {
            if args.profile.extension().is_some_and(|extension| extension == "toml") {
                refuse_joint(&args.profile)?;
            }
            drive_profile(&mut board, &args, to)
        }
        BoardTask::Plug { .. } | BoardTask::Unplug => Ok(()),
    }
}

fn plug(port: &str, task: BoardTask, to: &mut Console<'_>) -> Result<(), Failure> {
    if port != port::EMULATED {
        let usage =
            "only the emulated board is plugged in by a command: thermyo board emulated plug";
        return Err(Failure::Usage(usage.to_owned()));
    }
    match task {
        BoardTask::Plug { scenario } => {
            let mut plugged = (Variant::Standard, "plugged in\n");
            if let Some(scenario) = &scenario {
                match joint_in(scenario, to)? {
                    Some(_) => plugged = (Variant::Joint, "plugged in: a joint\n"),
                    None => drop(load(scenario, to)?),
                }
            }
            let (image, words) = plugged;
            thermyo_boards::plug::plug(image, scenario.as_deref())?;
            to.done(&json!({ "plugged": true }), words)
        }
        _ => {
            let words = if service::unplug() { "unplugged\n" } else { "it was not plugged in\n" };
            to.done(&json!({ "plugged": false }), words)
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
    let files: [&Path; 3] = [scripts, image, file];
    let joint = scenario.as_deref().map(thermyo_joint::load).transpose()?.flatten();
    if let Some(joint) = joint {
        // The serial link carries the telemetry of a joint in every third step only.
        return Ok(service::serve(files, (Port::Usb, ""), joint_board::at_pins(&joint)?)?);
    }
    let loaded = match scenario {
        Some(path) => thermyo_setup::load(path)?,
        None => thermyo_setup::parse("", Path::new("the default muscle"))?,
    };
    Ok(service::serve_muscle(files, &loaded)?)
}

fn info(board: &mut LiveBoard, to: &mut Console<'_>) -> Result<(), Failure> {
    let overview = Overview::of(board)?;
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
        overview.text(&faults, &format!("muscle:        {}", line(&telemetry, to.units)), to.units);
    to.answer(&json, &text)
}

fn arm(board: &mut LiveBoard, most_pa: Option<f64>, to: &mut Console<'_>) -> Result<(), Failure> {
    board.arm(most_pa.map(|pa| pa as f32))?;
    let armed_pa = board.status()?.armed_pa.unwrap_or_default();
    armed((armed_pa, &board.config()?, "absolute"), to)
}

/// Refuses a joint's scenario for a board that drives one muscle.
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

fn configure(board: &mut LiveBoard, task: ConfigTask, to: &mut Console<'_>) -> Result<(), Failure> {
    match task {
        ConfigTask::Write { file } => {
            refuse_joint(&file)?;
            let loaded = load(&file, to)?;
            warn_of_another_muscle(board.port(), &file, &loaded, to);
            warn_of_another_calibration(board, &file, &loaded, to)?;
            let config = core_config(&loaded.believed);
            shown_as("", &board.configure(&config, &title_of(&file))?, to)
        }
        ConfigTask::Read { file } => {
            let config = board.config()?;
            let status = board.status()?;
            let scenario = from_config::to_scenario(&config)?;
            let text = thermyo_setup::render(&scenario.scenario);
            config_file((&file, &text, scenario.exact), &status, to)
        }
        ConfigTask::Save => save(board, to),
        ConfigTask::Forget => {
            board.forget()?;
            to.done(&json!({ "saved": false }), "the saved configuration is deleted\n")
        }
    }
}
