//! `thermyo identify` of a record of motion: slip and creep of a muscle from length and pressure over time, and from
//! its force if that was measured.
//!
//! The scenario's `identify.parameters` selects the values to search: slip and creep alone, with the static law frozen,
//! or parts of that law too.

mod baseline;
mod fit;
mod law;
mod page;
mod plan;
mod record;
#[cfg(test)]
mod tests;

pub use baseline::{LawLeft, laws};
pub use fit::KEYS;
pub use page::{page, plot};
pub use plan::{check_plan, plan, profile};
pub use record::{Record, check_lengths, check_pace};

use fit::{Delay, FACTOR, MOTION, Parameter, Problem, Value, adopt, residuals};
use law::{Law, Start};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;
use thermyo_compute::parallel::Watch;
use thermyo_files::input::InputError;
use thermyo_files::number::significant;
use thermyo_files::table::Table;
use thermyo_fit::Fitted;
use thermyo_scenario::{LoadKind, PlantKind, Scenario};
use thermyo_setup::Loaded;

const SLIP_FORCE: &str = "muscle.slip_force_n";
const MOST_ROWS: usize = 4000;
/// Residual above which the law does not hold: of the length over the stroke, of the force over the
/// largest \[-\].
const MOST_LEFT: f64 = 0.1;
/// Distance from the longest length, as a share of the stroke, within which a load may lie on a stop \[-\].
const ON_STOP: f64 = 0.01;
/// Share of the largest force up to which a muscle may be slack, so that its length is not that of its load cell's
/// frame \[-\].
const SLACK: f64 = 0.01;
/// Share of its rows from which a record to compare with finds its own start: these rows do not count \[-\].
const START_SHARE: f64 = 0.1;
/// Longest start, in time constants of the slow creep \[-\].
const START_TIMES: f64 = 2.0;

/// Residuals of the law on a record.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Left {
    /// Lengths from pressures (and forces, if they were measured) \[m\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub length_m: Option<f64>,
    /// Forces from lengths and pressures \[N\].
    pub force_n: f64,
    /// Length over the stroke, or force over the largest \[-\].
    pub share: f64,
    pub rows: usize,
}

/// `summary.json` of a record of motion.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Findings {
    /// Whether the law holds, and the record determines every value.
    pub holds: bool,
    /// Keys that the record leaves open: they stay at the scenario's values.
    pub open: Vec<&'static str>,
    pub parameters: BTreeMap<&'static str, Fitted>,
    pub rmse: Left,
    /// Residuals of a record that the fit has not used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub against: Option<Left>,
    /// Remark on a delay between the channels by which values are wrong.
    #[serde(skip)]
    delay: Option<String>,
    pub remarks: Vec<String>,
}

#[derive(Debug)]
pub struct Identified {
    pub findings: Findings,
    pub scenario: Loaded,
    record: Record,
    /// Predicted minus measured, by row.
    residuals: Vec<f64>,
}

/// Whether a scenario asks for slip or creep.
pub fn is_asked_for(loaded: &Loaded) -> bool {
    let Scenario { identify, plant, .. } = &loaded.plant;
    let of_motion = |key: &String| MOTION.contains(&key.as_str());
    plant.kind == PlantKind::Muscle && identify.parameters.iter().any(of_motion)
}

/// Keys of slip and creep. A pressure factor that the scenario does not give needs a record with little load.
pub fn usual_keys(scenario: &Scenario) -> Vec<String> {
    let has_factor = scenario.muscle.slip_pressure_factor > 0.0;
    MOTION.into_iter().filter(|key| has_factor || *key != FACTOR).map(str::to_owned).collect()
}

fn parameters(scenario: &Scenario, config: &Path) -> Result<Vec<Parameter>, InputError> {
    let refused = |key: &str, value, allowed: &str| plan::refused(config, key, value, allowed);
    let one = |key: &String| {
        let Some(parameter) = Parameter::of(key, scenario) else {
            let known = KEYS.map(|(key, _)| key).join(", ");
            let allowed = format!("keys that a record of motion determines: {known}");
            return Err(refused("identify.parameters", format!("{key:?}"), &allowed));
        };
        if key == "load.force_n" && scenario.load.kind == LoadKind::Mass {
            let allowed = "\"isotonic\" to search load.force_n; a weight is known";
            return Err(refused("load.kind", "\"mass\"".to_owned(), allowed));
        }
        if parameter.is_missing() {
            return Err(refused(key, "0.0".to_owned(), "above 0, to start the search from"));
        }
        Ok(parameter)
    };
    scenario.identify.parameters.iter().map(one).collect()
}

/// Identifies from a table; `against` is a second record. `config` names the scenario in messages. If `watch` has
/// stopped it, the result is meaningless.
///
/// # Errors
/// As [`Record::of`], and for parameters that a record of motion cannot determine.
pub fn identify(
    loaded: &Loaded,
    config: &Path,
    table: &Table,
    against: Option<&Table>,
    watch: &dyn Watch,
) -> Result<Identified, InputError> {
    let scenario = &loaded.plant;
    let all = parameters(scenario, config)?;
    let record = Record::of(table, scenario)?;
    let against = against.map(|other| Record::of(other, scenario)).transpose()?;
    Ok(of_record(loaded, all, record, against.as_ref(), watch))
}

struct Searched {
    open: Vec<Parameter>,
    values: Vec<Value>,
    start: Start,
    delay: Option<Delay>,
}

/// Searches, leaves out values that the record leaves open, and searches the others again. Open values stay at the
/// scenario's.
fn search(
    scenario: &Scenario,
    searched: &mut Vec<Parameter>,
    record: &Record,
    watch: &dyn Watch,
) -> Searched {
    let mut open = Vec::new();
    loop {
        let problem = Problem::new(scenario, searched, record, watch);
        let place = problem.search().place;
        let start = problem.found_start(&place);
        let end = problem.end(place);
        let values = problem.values(&end);
        let Some(worst) = values.iter().position(|value| value.open) else {
            let delay = problem.delay(&end, &values).filter(Delay::counts);
            return Searched { open, values, start, delay };
        };
        open.push(searched.remove(worst));
    }
}

fn of_record(
    loaded: &Loaded,
    mut searched: Vec<Parameter>,
    record: Record,
    against: Option<&Record>,
    watch: &dyn Watch,
) -> Identified {
    let thin = record.thinned(MOST_ROWS);
    let Searched { open, values, start, delay } =
        search(&loaded.plant, &mut searched, &thin, watch);
    let found: Vec<(&'static str, f64)> =
        searched.iter().zip(&values).map(|(p, value)| (p.key, value.value)).collect();
    let mut scenario = loaded.clone();
    let mut remarks = Vec::new();
    for configured in [&mut scenario.plant, &mut scenario.believed] {
        *configured = adopt(configured, found.iter().copied());
        if found.iter().any(|(key, _)| *key == SLIP_FORCE) {
            remarks = friction_into_slip(configured);
        }
    }
    remarks.extend(record.doubts(&loaded.plant));
    let residuals = residuals(&scenario.plant, &record, &start);
    let fitted = |(parameter, value): (&Parameter, &Value)| {
        let Value { value, deviation, .. } = *value;
        let fitted = Fitted { value, standard_error: Some(deviation), unit: parameter.unit };
        (parameter.key, fitted)
    };
    let mut parameters: BTreeMap<_, _> = searched.iter().zip(&values).map(fitted).collect();
    for parameter in &open {
        let value = thermyo_scenario::number(&loaded.plant, parameter.key).unwrap_or_default();
        let fitted = Fitted { value, standard_error: None, unit: parameter.unit };
        parameters.insert(parameter.key, fitted);
    }
    let mut findings = Findings {
        holds: false,
        open: open.iter().map(|parameter| parameter.key).collect(),
        parameters,
        rmse: Left::of(&scenario.plant, &record, &start, 0),
        against: against.map(|other| compared(&scenario.plant, other)),
        delay: delay.map(|delay| delay_remark(&delay, loaded.plant.load.mass_kg)),
        remarks,
    };
    findings.holds = findings.failed().is_none();
    findings.remarks.extend(findings.failed());
    Identified { findings, scenario, record, residuals }
}

fn delay_remark(delay: &Delay, mass_kg: f64) -> String {
    let Delay { delay_s, deviation_s, times, key } = *delay;
    let [late, early] =
        if delay_s > 0.0 { ["length_m", "pressure_pa"] } else { ["pressure_pa", "length_m"] };
    format!(
        "{late} seems {:.0} +- {:.0} ms later than {early}, and with both read at one time {key} would differ by {} of \
         its stated errors: shift the column, or read both channels at one time and near the muscle; the inertia of \
         load.mass_kg = {mass_kg:?} delays the length too",
        1e3 * delay_s.abs(),
        1e3 * deviation_s,
        significant(times, 2)
    )
}

/// The slip found includes all that opposes motion in the record: friction beside it would count twice.
fn friction_into_slip(scenario: &mut Scenario) -> Vec<String> {
    let friction = &mut scenario.friction;
    let counted_n = friction.force_n + friction.stribeck_force_n;
    (friction.force_n, friction.stribeck_force_n) = (0.0, 0.0);
    let remark = || {
        format!(
            "friction.force_n and friction.stribeck_force_n, {} N, are now 0: {SLIP_FORCE} has them",
            significant(counted_n, 3)
        )
    };
    (counted_n > 0.0).then(remark).into_iter().collect()
}

/// Compares with a record that was not fitted: its first rows determine the start of slip and creep.
fn compared(scenario: &Scenario, record: &Record) -> Left {
    let rows = &record.rows;
    let first_s = rows.first().map_or(0.0, |row| row.time_s);
    let longest_s = START_TIMES * scenario.muscle.creep_slow_s;
    let of_time = rows.partition_point(|row| row.time_s - first_s < longest_s);
    let begins = of_time.min((START_SHARE * rows.len() as f64) as usize).max(1);
    let head = Record { rows: rows[..begins].to_vec(), has_force: record.has_force };
    let head = head.thinned(MOST_ROWS);
    let problem = Problem::new(scenario, &[], &head, &());
    let start = problem.found_start(&problem.search().place);
    Left::of(scenario, record, &start, begins)
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (count, squares) =
        values.fold((0_usize, 0.0), |(count, sum), value| (count + 1, sum + value * value));
    (squares / count.max(1) as f64).sqrt()
}

impl Left {
    /// Residuals from a row on.
    fn of(scenario: &Scenario, record: &Record, start: &Start, from: usize) -> Self {
        let law = Law::of(scenario, record.has_force);
        let rows = record.loaded(scenario);
        let forces = law.forces(&rows, start);
        // A load that lies on a stop shows nothing.
        let off_stop_m = if record.has_force {
            f64::INFINITY
        } else {
            record.longest_m() - ON_STOP * record.stroke_m()
        };
        let compared = forces.iter().zip(&rows).skip(from);
        let off_stop = compared.filter(|(_, row)| row.length_m < off_stop_m);
        let force_n = rms(off_stop.map(|(force, row)| force - row.force_n));
        let moves = record.moves(scenario.muscle.rest_length_m);
        let slack_n = if record.has_force { SLACK * record.largest_n() } else { f64::NEG_INFINITY };
        let length_m = moves.then(|| {
            let lengths = law.lengths(&rows, start);
            let taut =
                lengths.iter().zip(&rows).skip(from).filter(|(_, row)| row.force_n > slack_n);
            rms(taut.map(|(length, row)| length - row.length_m))
        });
        let share = match length_m.filter(|_| !record.has_force) {
            Some(length_m) => length_m / record.stroke_m(),
            None => force_n / record.largest_n().max(f64::MIN_POSITIVE),
        };
        Self { length_m, force_n, share, rows: rows.len() - from }
    }

    fn text(&self) -> String {
        let Self { length_m, force_n, share, rows } = self;
        let length = length_m.map_or_else(String::new, |m| format!("{:.3} mm, ", 1000.0 * m));
        format!("{length}{force_n:.2} N RMS, {:.2} %, {rows} rows", 100.0 * share)
    }
}

impl Findings {
    /// Reason why the values are not reliable, if there is one.
    pub fn failed(&self) -> Option<String> {
        if self.rmse.share > MOST_LEFT {
            return Some(format!(
                "the law leaves {} %: another rest length, load or unit, or another kind of muscle",
                significant(100.0 * self.rmse.share, 2)
            ));
        }
        if let Some(delay) = &self.delay {
            return Some(delay.clone());
        }
        (!self.open.is_empty()).then(|| {
            format!(
                "the record leaves {} open: {} as the scenario has {}; thermyo identify --plan motion prints \
                 an experiment that shows each",
                self.open.join(", "),
                if self.open.len() == 1 { "it stays" } else { "they stay" },
                if self.open.len() == 1 { "it" } else { "them" },
            )
        })
    }

    /// Figures as lines for a terminal.
    pub fn text(&self) -> String {
        let mut text: String =
            self.parameters.iter().map(|(path, fitted)| fitted.line(path)).collect();
        text += &format!("fitted: {}\n", self.rmse.text());
        if let Some(against) = &self.against {
            text += &format!("against: {}\n", against.text());
        }
        let failed = self.failed();
        for remark in self.remarks.iter().filter(|remark| Some(*remark) != failed.as_ref()) {
            text += &format!("{remark}\n");
        }
        text
    }
}
