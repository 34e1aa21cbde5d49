//! Detection and reaction for every fault, and absence of false alarms on healthy muscles.

pub mod alarms;
pub mod cases;
pub mod muscle;
pub mod page;
pub mod trial;
pub mod vent;

use self::alarms::Healthy;
use self::cases::{Fault, Reaction};
use self::trial::{COMES_S, Outcome, Trial};
use super::{CaseFigures, Figure};
use model_core::Faults;
use thermyo_compute::parallel::{self, Watch};
use thermyo_setup::Loaded;
use thermyo_simulation::run::RunError;

/// Time within which a venting muscle is below 1.2 bar \[s\].
pub const VENTED_S: f64 = 1.0;
pub const RUNS: u64 = 100;
/// Number of healthy muscles on `full`.
const MUSCLES: u64 = 38;
/// Hours of healthy muscles on `lumped`, by default.
pub const HOURS: f64 = 1.0;
/// Largest pressure where there is no requirement: the supply's plus the sensor's noise \[kPa\].
const SUPPLY_KPA: f64 = 705.0;

/// Line of the table for all runs of a fault.
fn line(fault: &Fault, outcomes: &[Outcome]) -> CaseFigures {
    // Without a time limit, every run counts.
    let seen_s = if fault.within_s.is_finite() { fault.within_s } else { 0.0 };
    let (judged, hidden): (Vec<_>, Vec<_>) =
        outcomes.iter().partition(|o| o.found_s.is_some() || o.counted_s > seen_s);
    let count = |which: &dyn Fn(&Outcome) -> bool| judged.iter().filter(|o| which(o)).count();
    let percent = |count: usize| 100.0 * count as f64 / judged.len() as f64;
    let most = |value: &dyn Fn(&Outcome) -> f64| outcomes.iter().map(value).fold(0.0, f64::max);
    let mut times_s: Vec<f64> = outcomes.iter().filter_map(|outcome| outcome.found_s).collect();
    times_s.sort_by(f64::total_cmp);
    let at = |index: usize| times_s.get(index).copied().unwrap_or(f64::NAN);
    let in_time = times_s.iter().filter(|time_s| **time_s <= fault.within_s + 1e-9).count();
    let early = count(&|outcome| outcome.before != Faults::NONE);
    let highest_kpa = most(&|outcome| outcome.highest_pa / 1e3);
    let stated = fault.reaction != Reaction::NotStated;
    let least = if stated { 100.0 } else { 0.0 };
    let mut figures = vec![
        Figure::at_least("in_time_percent", percent(in_time), least),
        Figure::shown("median_s", at(times_s.len() / 2)),
        Figure::at_most("worst_s", at(times_s.len().wrapping_sub(1)), fault.within_s),
        Figure::shown("worst_since_s", most(&|outcome| outcome.since_s)),
    ];
    if stated {
        let reacted = count(&|outcome| outcome.reacted);
        figures.push(Figure::at_least("reacts_percent", percent(reacted), 100.0));
        figures.push(Figure::shown("highest_kpa", highest_kpa));
    } else {
        figures.push(Figure::at_most("highest_kpa", highest_kpa, SUPPLY_KPA));
    }
    if fault.reaction == Reaction::Shown {
        let error_k = most(&|outcome| outcome.error_k);
        figures.push(Figure::at_most("worst_error_k", error_k, fault.error_k()));
    }
    figures.push(Figure::at_most("early", early as f64, 0.0));
    if !hidden.is_empty() {
        figures.push(Figure::shown("hidden", hidden.len() as f64));
    }
    CaseFigures { case: fault.name.to_owned(), figures }
}

/// Runs every fault, `runs` times each. When stopped, returns the lines of the finished faults.
pub fn table(faults: &[Fault], runs: u64, watch: &dyn Watch) -> Result<Vec<CaseFigures>, RunError> {
    let trials: Vec<Trial> = faults
        .iter()
        .flat_map(|fault| (0..runs).map(|number| Trial::random(fault, number, COMES_S)))
        .collect();
    let mut results = parallel::map_watched(&trials, watch, Trial::run).into_iter();
    let mut lines = Vec::new();
    for fault in faults {
        let own: Vec<_> = results.by_ref().take(runs as usize).collect();
        let outcomes = whole(own, runs as usize)?;
        lines.extend(outcomes.map(|outcomes| line(fault, &outcomes)));
    }
    Ok(lines)
}

/// Results of the `count` jobs of a line; none if they were stopped before the last.
fn whole<R>(results: Vec<Result<R, RunError>>, count: usize) -> Result<Option<Vec<R>>, RunError> {
    let results: Vec<R> = results.into_iter().collect::<Result<_, _>>()?;
    Ok(Some(results).filter(|results| results.len() == count))
}

#[derive(Debug)]
pub struct Evaluation {
    faults: Vec<Fault>,
    vented: Vec<(&'static str, Vec<Loaded>)>,
    healthy: Vec<(&'static str, Vec<Healthy>)>,
}

impl Evaluation {
    /// All faults, venting, and this number of hours of healthy muscles.
    pub fn new(nominal: &Loaded, hours: f64) -> Self {
        Self {
            faults: cases::all(),
            vented: vent::muscles(nominal),
            healthy: vec![
                ("healthy: shipped scenarios", alarms::shipped()),
                ("healthy: random muscles, full", alarms::muscles()),
                ("healthy: configured wrong by up to two, lumped", alarms::configured_wrong(hours)),
            ],
        }
    }

    /// Runs everything. When stopped, returns the finished lines.
    pub fn evaluate(&self, watch: &dyn Watch) -> Result<Vec<CaseFigures>, RunError> {
        let mut lines = table(&self.faults, RUNS, watch)?;
        for (case, muscles) in &self.vented {
            let vented = parallel::map_watched(muscles, watch, vent::vent);
            let vented = whole(vented, muscles.len())?;
            lines.extend(vented.map(|vented| vent::line(case, &vented)));
        }
        for (case, runs) in &self.healthy {
            let shown = whole(parallel::map_watched(runs, watch, alarms::shown), runs.len())?;
            lines.extend(shown.map(|shown| alarms::line(case, runs, &shown)));
        }
        Ok(lines)
    }
}
