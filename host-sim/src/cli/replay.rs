use super::progress::Bar;
use super::{BoardArgs, Console, Failure, OutputArgs, interrupt, read_record, trace_in};
use clap::Args;
use std::path::PathBuf;
use thermyo_compute::parallel::Watch;
use thermyo_files::number::COUNT;
use thermyo_report::Colour;
use thermyo_report::Recorder;
use thermyo_report::chart::{Axis, Chart, Panel};
use thermyo_report::page::{Page, Section, Tile};
use thermyo_runs::replay::{Drawn, Record, Replay};

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

pub(super) fn run(args: &ReplayArgs, to: &mut Console<'_>) -> Result<(), Failure> {
    let to = to.as_asked(args.output.format);
    let trace = trace_in(&args.trace);
    let record = Record::read(&trace, &read_record(&trace, to)?)?;
    if matches!(record, Record::Joint(_)) && !args.board.is_core() {
        let message = "a joint is replayed with the core in this process: leave out --board";
        return Err(Failure::Usage(message.to_owned()));
    }
    let (part, drawn) = (record.part(), record.drawn());
    let rows = part.rows as u64;
    let mut out = args.output.create_beside("replay", &[&trace.with_file_name("scenario.toml")])?;
    let mut board = args.board.open()?;
    let bar = Bar::new(rows, args.output.format.quiet);
    let mut recorder = Recorder::new(drawn.columns);
    interrupt::watch();
    let outcome = record.replay(board.as_mut(), &mut |cells| {
        bar.done();
        recorder.push(cells);
        !interrupt::is_requested()
    });
    bar.clear();
    if interrupt::is_requested() {
        to.say("the replay was not finished, nothing is kept");
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
    out.text("report.html", &page(&outcome, rows, note.as_deref(), (drawn, &recorder)))?;
    let lines = [Some(sentence(&outcome, rows)), note].into_iter().flatten();
    let text: String = lines
        .map(|line| {
            line + "
"
        })
        .collect();
    to.results(out, (&json, &text))?;
    // Without the core's state at the first row, equal bits are not claimed.
    if part.first_step > 0 { Ok(()) } else { verdict(&outcome, rows) }
}

fn sentence(outcome: &Replay, rows: u64) -> String {
    let Replay { steps, mismatches, .. } = outcome;
    format!("{steps} of {rows} recorded steps replayed, {mismatches} differ")
}

fn verdict(outcome: &Replay, rows: u64) -> Result<(), Failure> {
    match &outcome.first {
        None if outcome.steps == rows => Ok(()),
        None => Err(Failure::Check(format!("{} of {rows} steps were replayed", outcome.steps))),
        Some(first) => Err(Failure::Check(format!(
            "{} of {} steps differ, the first is step {}: {} recorded, {} replayed",
            outcome.mismatches, outcome.steps, first.step, first.recorded, first.replayed
        ))),
    }
}

fn page(
    outcome: &Replay,
    rows: u64,
    note: Option<&str>,
    (drawn, recorder): (Drawn, &Recorder),
) -> String {
    const ESTIMATES: [Colour; 2] = [Colour::Estimate, Colour::Green];
    const DUTIES: [Colour; 4] = [Colour::Inlet, Colour::Outlet, Colour::Blue, Colour::Vermillion];
    let column = |name: &str| recorder.column(name).unwrap_or_default();
    let time = column("time_s");
    let mut estimates = Panel::new(Axis::new("Estimate of the gas temperature", "K"));
    let mut differences =
        Panel::new(Axis::new("Replayed less recorded", "K")).height(120.0).reference(0.0, "");
    for ((of, estimate, difference), colour) in drawn.estimates.iter().zip(ESTIMATES) {
        let [recorded, differs] =
            ["recorded", "difference"].map(|word| format!("{word} {of}").trim().to_owned());
        estimates = estimates.line(&recorded, colour, time, column(estimate));
        differences = differences.line(&differs, colour, time, column(difference));
    }
    let mut duties = Panel::new(Axis::new("Valve duty", "").range(0.0, 1.0)).height(110.0);
    for ((name, duty), colour) in drawn.duties.iter().zip(DUTIES) {
        duties = duties.line(name, colour, time, column(duty));
    }
    let differs = Panel::new(Axis::new("Steps that differ in any bit", "").range(0.0, 1.0))
        .height(60.0)
        .line("differs", Colour::Vermillion, time, column("differs"));
    let chart = Chart::new(Axis::new("Time", "s"))
        .panel(estimates)
        .panel(differences)
        .panel(differs)
        .panel(duties);
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
