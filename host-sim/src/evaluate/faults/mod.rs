//! What breaks, how soon the core finds it, and what follows; and that what is healthy is left alone.

pub mod cases;
pub mod muscle;
pub mod trial;

use self::cases::{Fault, Reaction};
use self::trial::Outcome;
use super::{Figure, Line};
use crate::parallel;
use crate::run::RunError;

/// A muscle that vents is below 1.2 bar within that time \[s\].
pub const VENTED_S: f64 = 1.0;
/// Runs with each fault.
pub const RUNS: u64 = 100;

/// One line of the table.
fn line(fault: &Fault, outcomes: &[Outcome]) -> Line {
    let mut times: Vec<(f64, f64)> = outcomes.iter().filter_map(|outcome| outcome.found).collect();
    times.sort_by(|a, b| a.0.total_cmp(&b.0));
    let percent = |count: usize| 100.0 * count as f64 / outcomes.len() as f64;
    let in_time = times.iter().filter(|time| time.0 <= fault.within_s + 1e-9).count();
    let nan = (f64::NAN, f64::NAN);
    let median = times.get(times.len() / 2).copied().unwrap_or(nan);
    let worst = times.last().copied().unwrap_or(nan);
    let since_s = times.iter().map(|time| time.1).fold(f64::NAN, f64::max);
    let reacted = outcomes.iter().filter(|outcome| outcome.reacted).count();
    let highest_pa = outcomes.iter().map(|outcome| outcome.highest_pa).fold(0.0, f64::max);
    let worst_k = outcomes.iter().map(|outcome| outcome.error_k).fold(0.0, f64::max);
    let early = outcomes.iter().filter(|o| o.before != model_core::Faults::NONE).count();
    let mut figures = vec![
        Figure::shown("early", early as f64),
        Figure::at_least("in_time_percent", percent(in_time), 100.0),
        Figure::shown("median_s", median.0),
        Figure::at_most("worst_s", worst.0, fault.within_s),
        Figure::shown("worst_since_s", since_s),
        Figure::at_least("reacts_percent", percent(reacted), 100.0),
        Figure::shown("highest_bar", highest_pa / 1e5),
    ];
    if fault.reaction == Reaction::Shown {
        figures.push(Figure::shown("worst_error_k", worst_k));
    }
    Line { case: fault.name.to_owned(), figures }
}

/// Runs every fault, `runs` times each.
///
/// # Errors
/// The first run that could not be finished.
pub fn table(faults: &[Fault], runs: u64) -> Result<Vec<Line>, RunError> {
    let jobs: Vec<(usize, u64)> =
        (0..faults.len()).flat_map(|fault| (0..runs).map(move |run| (fault, run))).collect();
    let outcomes = parallel::map(&jobs, |(fault, run)| trial::run(&faults[*fault], *run));
    let outcomes = outcomes.into_iter().collect::<Result<Vec<Outcome>, RunError>>()?;
    Ok(faults.iter().zip(outcomes.chunks(runs as usize)).map(|(f, o)| line(f, o)).collect())
}

/// Runs everything.
///
/// # Errors
/// The first run that could not be finished.
pub fn evaluate() -> Result<Vec<Line>, RunError> {
    let runs = std::env::var("RUNS").map_or(RUNS, |r| r.parse().unwrap());
    table(&cases::all(), runs)
}
