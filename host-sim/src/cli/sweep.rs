use super::progress::Bar;
use super::{Console, Failure, OutputArgs, interrupt, joint_in, load, pretty, whole};
use clap::Args;
use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use thermyo_compute::parallel::Watch;
use thermyo_files::input::InputError;
use thermyo_files::output::OutputDir;
use thermyo_files::units::Wanted;
use thermyo_sweep::page::page;
use thermyo_sweep::{Journal, Latin, MOST_POINTS, Outcome, Range, Shard, Sweep, merge};

#[derive(Debug, Args)]
pub(super) struct SweepArgs {
    /// Scenario file (TOML)
    #[arg(required_unless_present = "merge")]
    scenario: Option<PathBuf>,
    /// Key of the scenario and its values: COUNT values from FROM to TO with a fixed difference,
    /// with ":log" a fixed ratio, or a list, which may hold words. Several --vary are combined to a
    /// grid. With --lhs: FROM:TO without COUNT, or a list
    #[arg(long, value_name = "KEY=FROM:TO:COUNT[:log]", required_unless_present = "merge")]
    vary: Vec<Range>,
    /// Run N points of a Latin hypercube instead of a grid
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = |text: &str| whole(text, 1..=MOST_POINTS))]
    lhs: Option<usize>,
    /// Seed of the Latin hypercube
    #[arg(
        long,
        value_name = "S",
        allow_negative_numbers = true,
        default_value_t = 1,
        requires = "lhs",
        value_parser = |text: &str| whole(text, 0..=u64::MAX)
    )]
    seed: u64,
    /// Run only every N-th point, starting with the I-th (1 to N)
    #[arg(long, value_name = "I/N", default_value_t = Shard::WHOLE)]
    shard: Shard,
    /// Merge the results of a sweep's shards, from their folders
    #[arg(
        long,
        value_name = "DIR",
        num_args = 1..,
        conflicts_with_all = ["scenario", "vary", "lhs", "shard"]
    )]
    merge: Vec<PathBuf>,
    /// Tolerated root-mean-square error, such as 0.5 (K) or 0.5K
    #[arg(long, value_name = "K", allow_negative_numbers = true, default_value_t = 1.0, value_parser = tolerance)]
    within: f64,
    #[command(flatten)]
    output: OutputArgs,
}

fn tolerance(text: &str) -> Result<f64, String> {
    let kelvin = Wanted { si: "K", absolute: false };
    let value = kelvin.read(text).ok().filter(|value| *value > 0.0);
    value.ok_or_else(|| "must be a number above 0, in K".to_owned())
}

pub(super) fn run(args: SweepArgs, to: &mut Console<'_>) -> Result<(), Failure> {
    let to = to.as_asked(args.output.format);
    let folder = args.output.out.clone().unwrap_or_else(|| PathBuf::from("out/sweep"));
    let Some(scenario) = &args.scenario else {
        return merge_shards(&args, &folder, to);
    };
    if joint_in(scenario, to)?.is_none() {
        load(scenario, to)?;
    }
    let latin = args.lhs.map(|points| Latin { points, seed: args.seed });
    let sweep =
        Sweep::new(scenario, args.vary.clone(), latin, args.shard).map_err(Failure::Sweep)?;
    for warning in sweep.warnings() {
        to.say(format_args!("warning: {warning}"));
    }
    let study = &sweep.study;
    let (journal, kept) = Journal::open(&folder, study)?;
    if let Some(text) = kept.text(study) {
        to.say(format_args!("{}: {text}", folder.display()));
    }
    let done: BTreeSet<usize> = kept.rows.iter().map(|row| row.point).collect();
    let left: Vec<usize> = study.own().into_iter().filter(|p| !done.contains(p)).collect();
    let bar = Bar::new(left.len() as u64, args.output.format.quiet);
    interrupt::watch();
    let rows = sweep.run(
        &left,
        interrupt::check,
        |point| journal.begin(point),
        |row| {
            bar.done();
            journal.add(study, row)
        },
    );
    bar.clear();
    let rows = match rows {
        Ok(rows) => rows,
        Err(error) => {
            let place = journal.place().display();
            to.say(format_args!(
                "the points so far are in {place}; the same command goes on from there"
            ));
            return Err(match error.kind() {
                io::ErrorKind::Interrupted => Failure::Interrupted,
                _ => InputError::output(&journal.place().join("sweep.csv"), &error).into(),
            });
        }
    };
    let outcome = Outcome::new(study, kept.rows.into_iter().chain(rows).collect());
    finish(&outcome, journal.close(), &args, to)
}

fn merge_shards(args: &SweepArgs, folder: &Path, to: &mut Console<'_>) -> Result<(), Failure> {
    let (study, rows) = merge(&args.merge).map_err(Failure::Merge)?;
    let mut out = OutputDir::create(folder)?;
    out.text("scenario.toml", &study.scenario)?;
    out.text("study.json", &study.label_text())?;
    finish(&Outcome::new(&study, rows), out, args, to)
}

fn finish(
    outcome: &Outcome<'_>,
    mut out: OutputDir,
    args: &SweepArgs,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    let summary = outcome.summary(args.within);
    let json = pretty(&summary);
    out.text("sweep.csv", &outcome.csv())?;
    out.text("summary.json", &json)?;
    out.text("report.html", &page(outcome, args.within))?;
    let mut text = format!("{} of {} points run\n", summary.run, summary.points);
    text += &format!("{}\n", summary.conclusion);
    for key in &summary.without_effect {
        text += &format!("{key} changes nothing in this scenario\n");
    }
    to.results(out, (&json, &text))?;
    outcome.failed().map_or(Ok(()), |what| Err(Failure::Check(what)))
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_tolerance_may_have_its_unit() {
        assert_eq!(super::tolerance("0.5K"), Ok(0.5));
        assert!(super::tolerance("25degC").is_err() && super::tolerance("0K").is_err());
    }
}
