use super::progress::Bar;
use super::{BoardArgs, Failure, OutputArgs, interrupt, print, publish, read_record, trace_in};
use clap::Args;
use model_core::Telemetry;
use std::io::Write;
use std::path::PathBuf;
use thermyo_compute::parallel::Watch;
use thermyo_files::number::COUNT;
use thermyo_files::output::OutputDir;
use thermyo_report::Colour;
use thermyo_report::Recorder;
use thermyo_report::chart::{Axis, Chart, Panel};
use thermyo_report::page::{Page, Section, Tile};
use thermyo_runs::replay;
use thermyo_runs::replay::{Record, Replay};

#[derive(Debug, Args)]
pub(super) struct ReplayArgs {
    /// A run with log_every = 1, or a record of a board: its folder of results, or its trace.csv
    /// with scenario.toml beside it
    trace: PathBuf,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    board: BoardArgs,
}

/// Columns of the page, beside `time_s`: as recorded, and the difference on replay.
const COLUMNS: [&str; 6] =
    ["time_s", "estimate_k", "estimate_difference_k", "duty_in", "duty_out", "differs"];

pub(super) fn run(
    args: &ReplayArgs,
    stdout: &mut dyn Write,
    stderr: &mut dyn Write,
) -> Result<(), Failure> {
    let trace = trace_in(&args.trace);
    let Record { config, part, rows } = replay::read_record(&trace, &read_record(&trace, stderr)?)?;
    let folder = args.output.out.clone().unwrap_or_else(|| PathBuf::from("out/replay"));
    let mut board = args.board.open()?;
    let mut out = OutputDir::create(&folder)?;
    let bar = Bar::new(rows.len() as u64, args.output.format.quiet);
    let mut recorder = Recorder::new(&COLUMNS);
    interrupt::watch();
    let mut each = |recorded: &Telemetry, replayed: &Telemetry| {
        bar.done();
        recorder.push(&row(f64::from(config.step_s), recorded, replayed));
        !interrupt::is_requested()
    };
    let outcome = replay::replay(board.as_mut(), &config, &rows, &mut each);
    bar.clear();
    if interrupt::is_requested() {
        let _ = writeln!(stderr, "thermyo: the replay was not finished, nothing is kept");
        return Err(Failure::Interrupted);
    }
    let outcome = outcome.map_err(Failure::Board)?;
    let json = serde_json::json!({
        "steps": outcome.steps,
        "mismatches": outcome.mismatches,
        "first_step": part.first_step,
        "rows_before": part.before,
        "rows_after": part.after,
    });
    let json = format!("{json:#}\n");
    out.text("summary.json", &json)?;
    let note = part.note();
    out.text("report.html", &page(&outcome, rows.len() as u64, note.as_deref(), &recorder))?;
    publish(out, args.output.format, stderr)?;
    if args.output.format.json {
        print(stdout, &json)?;
    } else {
        print(stdout, &format!("{}\n", sentence(&outcome, rows.len() as u64)))?;
        if let Some(note) = &note {
            print(stdout, &format!("{note}\n"))?;
        }
        print(stdout, &format!("report: {}\n", folder.join("report.html").display()))?;
    }
    // Without the state of the core at the first row, no equal bits are claimed.
    if part.first_step > 0 { Ok(()) } else { verdict(&outcome, rows.len() as u64) }
}

fn row(step_s: f64, recorded: &Telemetry, replayed: &Telemetry) -> [f64; COLUMNS.len()] {
    let differs = !replay::identical(recorded, replayed);
    [
        f64::from(recorded.step) * step_s,
        f64::from(recorded.estimate.gas_k),
        f64::from(replayed.estimate.gas_k) - f64::from(recorded.estimate.gas_k),
        f64::from(recorded.command.inlet.share()),
        f64::from(recorded.command.outlet.share()),
        f64::from(u8::from(differs)),
    ]
}

fn sentence(outcome: &Replay, rows: u64) -> String {
    let Replay { steps, mismatches, .. } = outcome;
    format!("{steps} of {rows} recorded steps replayed, {mismatches} differ")
}

fn verdict(outcome: &Replay, rows: u64) -> Result<(), Failure> {
    match outcome.first {
        None if outcome.steps == rows => Ok(()),
        None => Err(Failure::Check(format!("{} of {rows} steps were replayed", outcome.steps))),
        Some(first) => Err(Failure::Check(format!(
            "{} of {} steps differ, the first is step {}: {:?} recorded, {:?} replayed",
            outcome.mismatches,
            outcome.steps,
            first.recorded.step,
            first.recorded.estimate,
            first.replayed.estimate
        ))),
    }
}

fn page(outcome: &Replay, rows: u64, note: Option<&str>, recorder: &Recorder) -> String {
    let column = |name: &str| recorder.column(name).unwrap_or_default();
    let time = column("time_s");
    let chart = Chart::new(Axis::new("Time", "s"))
        .panel(Panel::new(Axis::new("Estimate of the gas temperature", "K")).line(
            "recorded",
            Colour::Estimate,
            time,
            column("estimate_k"),
        ))
        .panel(
            Panel::new(Axis::new("Replayed less recorded", "K"))
                .height(120.0)
                .line("difference", Colour::Vermillion, time, column("estimate_difference_k"))
                .reference(0.0, ""),
        )
        .panel(
            Panel::new(Axis::new("Steps that differ in any bit", "").range(0.0, 1.0))
                .height(60.0)
                .line("differs", Colour::Vermillion, time, column("differs")),
        )
        .panel(
            Panel::new(Axis::new("Valve duty", "").range(0.0, 1.0))
                .height(110.0)
                .line("inlet", Colour::Inlet, time, column("duty_in"))
                .line("outlet", Colour::Outlet, time, column("duty_out")),
        );
    let caption = "Recorded outputs of the core, and the difference on replay: a straight line at zero where no \
                   bit differs.";
    let note = note.map_or_else(String::new, |note| format!("; {note}"));
    let lead = format!("{}{note}.", sentence(outcome, rows));
    let steps = Tile::new("Steps replayed", outcome.steps as f64, COUNT)
        .target(&format!("all {rows}"), outcome.steps == rows);
    let differing = Tile::new("Steps that differ", outcome.mismatches as f64, COUNT)
        .target("0", outcome.mismatches == 0);
    Page::new("Replay", &lead, "")
        .tile(differing)
        .tile(steps)
        .section(Section::new("Recorded and replayed").figure(chart.figure("The core", caption)))
        .render()
}
