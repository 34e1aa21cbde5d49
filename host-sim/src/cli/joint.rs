//! `thermyo run` and `thermyo check` of a joint of two muscles.

use super::progress::Bar;
use super::{Console, Failure, RunArgs, interrupt, pretty, stopped, title_of, trace_size, unbuilt};
use std::io;
use std::path::Path;
use thermyo_files::number::speed;
use thermyo_files::output::OutputDir;
use thermyo_files::units::UnitSystem;
use thermyo_joint::page::PageRecorder;
use thermyo_joint::{COLUMNS, Figures, JointLoaded, Row, RunError, Summary, angle_text};
use thermyo_logs::Logs;
use thermyo_logs::topics::JOINT;
use thermyo_record::following::Followed;
use thermyo_simulation::board::JointBoard;

/// Validates the joint's scenario and prints it with every default.
pub(super) fn check(
    loaded: &JointLoaded,
    path: &Path,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    unbuilt::refuse_joint(loaded, path)?;
    let [a, b] = &loaded.muscles;
    let json = serde_json::json!({
        "joint": loaded.joint,
        "believed_joint": loaded.believed,
        "controller": loaded.controller,
        "drive": loaded.drive,
        "a": { "plant": a.plant, "believed": a.believed },
        "b": { "plant": b.plant, "believed": b.believed },
    });
    to.done(&json, &thermyo_joint::render(loaded))
}

pub(super) fn run(
    loaded: &JointLoaded,
    args: &RunArgs,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    let logs = args.log.wanted();
    logs.check()?;
    if let Some(measured) = &args.measured {
        let message = format!(
            "a joint runs without --measured: run it, then `thermyo compare out/run {}`",
            measured.display()
        );
        return Err(Failure::Usage(message));
    }
    unbuilt::refuse_joint(loaded, &args.scenario)?;
    trace_size::warn(&loaded.muscles[0].plant.run, COLUMNS.len(), &args.scenario, to);
    let board = args.board.open_joint(loaded)?;
    let mut out = args.output.create("run")?;
    let mut recorder = PageRecorder::default();
    let summary = match record((loaded, board), (args, &logs), &mut out, &mut recorder) {
        Err(Failure::Interrupted) => return Err(stopped(out, to)),
        // The board restarted: the rows so far stay where they are.
        Err(failure @ Failure::Board(_)) if !recorder.is_empty() => {
            to.say(format_args!("the record so far is in {}", out.leave().display()));
            return Err(failure);
        }
        other => other?,
    };
    let json = pretty(&summary);
    out.text("summary.json", &json)?;
    out.text("report.html", &recorder.page(&title_of(&args.scenario), loaded, &summary))?;
    to.results(out, (&json, &brief(&summary, to.units)))
}

/// Streams the trace of a run into `out`.
fn record(
    (loaded, board): (&JointLoaded, Option<Box<dyn JointBoard>>),
    (args, logs): (&RunArgs, &Logs),
    out: &mut OutputDir,
    recorder: &mut PageRecorder,
) -> Result<Summary, Failure> {
    out.scenario(&thermyo_joint::recorded(loaded))?;
    let mut rows = logs.record(out, JOINT, &COLUMNS)?;
    let unwritable = |error: io::Error| out.unwritable(JOINT.file, &error);
    let bar = Bar::new(
        (loaded.muscles[0].plant.run.duration_s * 1000.0) as u64,
        args.output.format.quiet,
    );
    interrupt::watch();
    let mut observer = |row: &Row| {
        rows.push(&row.cells())?;
        recorder.add(row);
        bar.set_position((row.time_s * 1000.0) as u64);
        interrupt::check()
    };
    let result = match board {
        Some(mut board) => thermyo_joint::run_on(board.as_mut(), loaded, &mut observer),
        None => thermyo_joint::run(loaded, &mut observer),
    };
    bar.clear();
    let written = rows.finish().map(drop).map_err(unwritable);
    let summary = result.map_err(|error| match error {
        _ if interrupt::is_requested() => Failure::Interrupted,
        RunError::Output(error) => Failure::Input(unwritable(error)),
        RunError::Board(error) => Failure::Board(error),
        other => Failure::Joint(other),
    })?;
    written?;
    Ok(summary)
}

/// Share of the time for which a joint may be limited before a line reports it: more than single steps of a set point.
const LIMITED: f64 = 0.05;

fn brief(summary: &Summary, units: UnitSystem) -> String {
    let figures = &summary.figures;
    let [estimate_a, estimate_b] = summary.estimate_rmse_k;
    let [least, most] = figures.angle_rad.map(|value_rad| angle_text(value_rad, units));
    let text = format!(
        "{} s simulated, {} times real time, core on board \"{}\"\n\
         angle {least} to {most}, RMS error {}, at the end {}{}\n\
         stiffness, RMS error {}; pulses of all valves {:.0} 1/s\n\
         gas temperature, RMS error of the estimate: a {estimate_a:.3} K, b {estimate_b:.3} K\n\
         balance error of the arm's energy {:.1e}\n",
        summary.duration_s,
        speed(summary.real_time_factor),
        summary.board,
        angle_text(figures.rms_error_rad, units),
        angle_text(figures.end_error_rad, units),
        figures.control.as_ref().map_or_else(String::new, Followed::shape_text),
        units.text(figures.rms_stiffness_error, "", 2),
        figures.pulses_per_s,
        summary.arm_balance_error,
    );
    let timing = summary.timing.map(|timing| timing.text() + "\n");
    text + &timing.unwrap_or_default() + &remarks(figures, units)
}

/// Lines about a limited quantity, faults and a limit cycle, if there are any.
pub(super) fn remarks(figures: &Figures, units: UnitSystem) -> String {
    let mut text = String::new();
    if figures.limited > LIMITED {
        text += &format!(
            "limited for {:.0} % of the time: the range of pressures gave less stiffness or torque \
             than was asked; a slower motion, less stiffness or larger valves help\n",
            100.0 * figures.limited
        );
    }
    for (name, faults) in ["muscle a", "muscle b", "joint"].iter().zip(&figures.faults) {
        if !faults.is_empty() {
            text += &format!("faults of {name}: {}\n", faults.join(", "));
        }
    }
    if let Some(vented_s) = figures.vented_s {
        text += &format!("both muscles vented at {vented_s:.3} s\n");
    }
    if let Some(warning) = figures.unrest(units) {
        text += &format!("warning: {warning}\n");
    }
    text
}
