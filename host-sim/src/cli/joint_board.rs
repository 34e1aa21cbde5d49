//! `thermyo board PORT` where the board drives a joint.

use super::board_status::{Overview, armed, cleared, config_file, history, save, shown_as};
use super::board_task::{ArmArgs, BoardTask, ConfigTask};
use super::drive::{DriveArgs, Planned, drive_planned, warn_of_times};
use super::joint::remarks;
use super::set::{SetArgs, SetPointArgs, stopped_at};
use super::{Console, Failure, calibrate, interrupt, joint_in, title_of};
use crate::commands::joint::line;
use model_core::Faults;
use model_core::joint::{JointError, JointField, JointMode, JointSetPoint, JointTelemetry, Motion};
use serde_json::{Value, json};
use std::path::Path;
use thermyo_boards::emulated::{EmulatedBoard, Exchange, STEP_NS};
use thermyo_boards::live_joint::LiveJoint;
use thermyo_boards::subject::Subject;
use thermyo_files::units::UnitSystem;
use thermyo_joint::{Inputs, JointLoaded, Rig, RunError, angle_text, named, venting};
use thermyo_protocol::Refusal;
use thermyo_record::following::Followed;
use thermyo_simulation::board::BoardError;
use thermyo_studies::drive::{driven, joint};

/// Interval of the printed lines \[s\].
const LINE_S: f64 = 0.5;

/// The joint of a scenario at an emulated board's pins: each call runs a millisecond of both. It starts where the drive
/// starts.
pub(super) fn at_pins(
    loaded: &JointLoaded,
) -> Result<impl FnMut(&mut EmulatedBoard) -> Result<Exchange, BoardError> + use<>, Failure> {
    let mut rig = Rig::new(loaded, Inputs::of(loaded.motion(0.0))).map_err(Failure::Joint)?;
    Ok(move |board: &mut EmulatedBoard| {
        let exchange = board.run(&rig.sample(), STEP_NS)?;
        let diverged = |error: RunError| BoardError::Emulator { message: error.to_string() };
        rig.advance(exchange.set_duties()).map_err(diverged)?;
        Ok(exchange)
    })
}

pub(super) fn run(port: &str, task: BoardTask, to: &mut Console<'_>) -> Result<(), Failure> {
    let mut board = LiveJoint::open(port)?;
    match task {
        BoardTask::Info => info(&mut board, to),
        BoardTask::Arm(ArmArgs { max_pressure }) => {
            board
                .arm(max_pressure.map(|pa| pa as f32))
                .map_err(|error| refused(error, None, to.units))?;
            let armed_pa = board.status()?.armed_pa.unwrap_or_default();
            let [config, _] = board.config()?.muscles;
            let of = "absolute, in either muscle";
            armed((armed_pa, &config, of), to)
        }
        BoardTask::Set(args) => set(&mut board, &args, to),
        BoardTask::Stop => {
            board.stop()?;
            to.done(&json!({ "mode": "vent" }), "both muscles vent\n")
        }
        BoardTask::Clear => clear(&mut board, to),
        BoardTask::Drive(args) => drive(&mut board, &args, to),
        BoardTask::Calibrate(args) => calibrate::run_joint(&mut board, &args, to),
        BoardTask::History => {
            let locks = board.config()?.mechanism.lock_s > 0.0;
            let ended = if locks { "locked or vented" } else { "vented" };
            history((&board.history()?, ended), to)
        }
        BoardTask::Config(ConfigTask::Read { file }) => read(&mut board, &file, to),
        BoardTask::Config(ConfigTask::Write { file }) => write(&mut board, &file, to),
        BoardTask::Config(ConfigTask::Save) => save(&mut board, to),
        BoardTask::Config(ConfigTask::Forget) => {
            board.forget()?;
            shown_as("", &board.status()?, to)
        }
        BoardTask::Plug { .. } | BoardTask::Unplug => Ok(()),
    }
}

fn clear(board: &mut LiveJoint, to: &mut Console<'_>) -> Result<(), Failure> {
    let left = board.clear()?;
    if let Some(left) = venting(&left) {
        return Err(Failure::Check(format!("still there: {left}")));
    }
    let words = cleared(board.status()?.armed_pa);
    to.done(&json!({ "faults": shown(&left) }), &words)
}

fn write(board: &mut LiveJoint, file: &Path, to: &mut Console<'_>) -> Result<(), Failure> {
    let Some(loaded) = joint_in(file, to)? else {
        let file = file.display();
        let usage = format!(
            "{file}: has no [joint], and the board drives one: `thermyo flash` for one muscle, or without \
             hardware `thermyo board emulated plug {file}`"
        );
        return Err(Failure::Usage(usage));
    };
    shown_as("", &board.configure(&loaded.config(), &title_of(file))?, to)
}

fn read(board: &mut LiveJoint, file: &Path, to: &mut Console<'_>) -> Result<(), Failure> {
    let (config, status) = (board.config()?, board.status()?);
    let scenario = thermyo_joint::to_scenario(&config)?;
    let exact = scenario.config() == config;
    config_file((file, &thermyo_joint::render(&scenario), exact), &status, to)
}

/// Faults of both muscles and of the joint.
fn shown(telemetry: &JointTelemetry) -> Value {
    let [a, b] = telemetry.muscles.map(|muscle| muscle.faults.to_string());
    json!({ "a": a, "b": b, "joint": telemetry.faults.to_string() })
}

/// A refusal of a typed set point or of arming: it names only the applicable reasons, and the command that helps.
fn refused(error: BoardError, typed: Option<&SetPointArgs>, units: UnitSystem) -> Failure {
    if let BoardError::Refused(Refusal::JointSetPoint(JointError::Range {
        field: JointField::Angle,
        value,
        minimum,
        maximum,
    })) = error
    {
        let has_no_unit =
            matches!(typed, Some(SetPointArgs::Angle { angle, .. }) if !angle.has_unit);
        let degrees = has_no_unit && (minimum..=maximum).contains(&value.to_radians());
        let meant = if degrees { format!("; use {value}deg") } else { String::new() };
        let [value, minimum, maximum] =
            [value, minimum, maximum].map(|rad| angle_text(rad.into(), units));
        return Failure::Usage(format!(
            "an angle of {value}: must be from {minimum} to {maximum}, the stops{meant}"
        ));
    }
    let BoardError::Refused(Refusal::JointSetPoint(JointError::Faults(muscles, joint))) = error
    else {
        return error.into();
    };
    if muscles.contains(&Faults::NOT_CONFIGURED) {
        return BoardError::Refused(Refusal::NotConfigured).into();
    }
    let faults = named(muscles, joint).unwrap_or_default();
    let words =
        format!("the board vents until this is cleared: {faults}: `thermyo board PORT clear`");
    Failure::Usage(words)
}

fn info(board: &mut LiveJoint, to: &mut Console<'_>) -> Result<(), Failure> {
    let overview = Overview::of(board)?;
    let telemetry = board.fresh_telemetry()?;
    let mut json = overview.json(board.port());
    json["faults"] = shown(&telemetry);
    json["angle_rad"] = telemetry.angle_rad.into();
    json["stiffness_n_m_rad"] = telemetry.stiffness_n_m_rad.into();
    json["pressure_pa"] = json!(telemetry.muscles.map(|muscle| muscle.pressure_pa));
    json["estimate_k"] = json!(telemetry.muscles.map(|muscle| muscle.estimate.gas_k));
    let faults = venting(&telemetry).unwrap_or_else(|| "none".to_owned());
    let text =
        overview.text(&faults, &format!("joint:         {}", line(&telemetry, to.units)), to.units);
    to.answer(&json, &text)
}

fn set_point(args: &SetArgs) -> Result<JointSetPoint, Failure> {
    Ok(match args.set_point {
        SetPointArgs::Angle { angle, stiffness } => {
            JointSetPoint::Angle(Motion::still(angle.angle_rad, stiffness))
        }
        SetPointArgs::Torque { torque_n_m, stiffness: stiffness_n_m_rad } => {
            JointSetPoint::Torque { torque_n_m, stiffness_n_m_rad }
        }
        SetPointArgs::Pressures { pressure_a_pa, pressure_b_pa } => {
            JointSetPoint::Pressures { pressure_pa: [pressure_a_pa, pressure_b_pa] }
        }
        SetPointArgs::Duties { inlet_a, outlet_a, inlet_b, outlet_b } => {
            JointSetPoint::Duty { inlet: [inlet_a, inlet_b], outlet: [outlet_a, outlet_b] }
        }
        SetPointArgs::Lock => JointSetPoint::Lock,
        SetPointArgs::Vent => JointSetPoint::Vent,
        _ => {
            let usage = "a joint's board takes angle, torque, pressures, duties, lock and vent";
            return Err(Failure::Usage(usage.to_owned()));
        }
    })
}

/// Sends a set point, shows the joint until the time is over or Ctrl-C is pressed, and vents.
fn set(board: &mut LiveJoint, args: &SetArgs, to: &mut Console<'_>) -> Result<(), Failure> {
    let set_point = set_point(args)?;
    let refused = |error| refused(error, Some(&args.set_point), to.units);
    interrupt::watch();
    if args.arm {
        // A refused set point leaves a board that is not armed as it was.
        board.check_set_point(set_point).and_then(|()| board.arm(None)).map_err(refused)?;
    }
    let first = board.set(set_point).map_err(refused)?;
    if set_point == JointSetPoint::Vent {
        return to.done(&json!({ "mode": "vent" }), "both muscles vent\n");
    }
    let (stopped, last) = hold(board, (args, set_point, first), to)?;
    board.stop()?;
    let Some((time_s, last)) = last else { return Err(Failure::Interrupted) };
    let json = json!({
        "angle_rad": last.angle_rad,
        "stiffness_n_m_rad": last.stiffness_n_m_rad,
        "pressure_pa": last.muscles.map(|muscle| muscle.pressure_pa),
        "limited": last.limited,
        "mode": "vent",
    });
    to.answer(&json, &format!("{}; it vents\n", line(&last, to.units)))?;
    if stopped { Err(stopped_at(time_s, args.hold)) } else { Ok(()) }
}

/// The time since the set point \[s\], and the joint then.
type Held = (f64, JointTelemetry);

/// Prints the joint from the step `first` on, until the time, or the time of a lock, is over or the user stops it.
/// Returns whether the user stopped it, and the last telemetry.
fn hold(
    board: &mut LiveJoint,
    (args, set_point, first): (&SetArgs, JointSetPoint, u32),
    to: &mut Console<'_>,
) -> Result<(bool, Option<Held>), Failure> {
    let hold_s = args.hold.unwrap_or(f64::INFINITY);
    let (mut next_line_s, mut last) = (0.0, None);
    while !interrupt::is_requested() {
        let Some(telemetry) = board.poll()? else { continue };
        let [a, _] = &telemetry.muscles;
        // Skips telemetry from before the set point, which may show a lost link that arming has cleared.
        let Some(steps) = a.step.checked_sub(first) else { continue };
        // Leaving would vent a joint that its lock still holds.
        let locked = telemetry.mode == JointMode::Locked;
        if let Some(faults) = venting(&telemetry).filter(|_| !locked) {
            return Err(Failure::Check(format!("it vents: {faults}")));
        }
        let time_s = f64::from(steps) * 1e-3;
        last = Some((time_s, telemetry));
        if time_s >= next_line_s && to.is_read() {
            next_line_s += LINE_S;
            to.print(&format!("{time_s:7.2} s  {}\n", line(&telemetry, to.units)))?;
        }
        let unlocked = set_point == JointSetPoint::Lock && telemetry.mode == JointMode::Vent;
        if time_s >= hold_s || unlocked {
            return Ok((false, last));
        }
    }
    Ok((true, last))
}

/// Drives a joint.
fn drive(board: &mut LiveJoint, args: &DriveArgs, to: &mut Console<'_>) -> Result<(), Failure> {
    if args.kind.is_some() || args.measured.is_some() {
        let usage = "--kind and --measured are for one muscle; a joint's CSV has time_s, angle_rad and \
                     stiffness_n_m_rad";
        return Err(Failure::Usage(usage.to_owned()));
    }
    let driven = joint::plan(&args.profile, &board.config()?)?;
    warn_of_times(args, driven.profile.as_ref().map(|[angle, _]| angle), to);
    let planned = Planned {
        record: joint::Gathered::new(driven.clone()),
        course: &driven,
        duration_s: driven.muscles[0].plant.run.duration_s,
        profile: driven.profile.as_ref().map(|[angle, stiffness]| {
            let rows = angle.points().iter().map(|(time_s, angle_rad)| {
                format!("{time_s},{angle_rad},{}\n", stiffness.value(*time_s))
            });
            let head = String::from("time_s,angle_rad,stiffness_n_m_rad\n");
            head + &rows.collect::<String>()
        }),
        brief,
        refused: |error, units| refused(error, None, units),
    };
    drive_planned(board, args, planned, to)
}

fn brief(summary: &joint::Driven, units: UnitSystem) -> String {
    let figures = &summary.figures;
    let [least, most] = figures.angle_rad.map(|angle_rad| angle_text(angle_rad, units));
    let [a, b] = figures.highest_pressure_pa.map(|pa| units.text(pa, "Pa", 1));
    let text = format!(
        "{} driven, configuration {} ({:08x}); it vents\n\
         angle {least} to {most}, RMS error {}, at the end {}{}\n\
         stiffness, RMS error {}; pulses of all valves {:.0} 1/s; highest pressures {a} and {b}\n\
         {}, telemetry of {} lost\n",
        driven(summary.duration_s, summary.stopped_of_s),
        summary.config_name,
        summary.config_checksum,
        angle_text(figures.rms_error_rad, units),
        angle_text(figures.end_error_rad, units),
        figures.control.as_ref().map_or_else(String::new, Followed::shape_text),
        units.text(figures.rms_stiffness_error, "", 2),
        figures.pulses_per_s,
        summary.timing.text(),
        summary.lost_steps,
    );
    text + &remarks(figures, units)
}
