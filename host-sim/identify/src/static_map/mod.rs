//! `thermyo identify` of a static map: the muscle's force law from gauge pressure, length and force.

mod fit;
mod page;
mod plan;
mod readings;

pub use page::{page, plot};
pub use readings::{COLUMNS, DIRECTION, FEWEST, Reading, Readings};

use fit::{DIFFERENCE, Problem};
use nalgebra::DVector;
use plan::{LEAST_STROKE, instead, places, surely_pulls};
use readings::LOADED;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;
use thermyo_files::input::{InputError, Problem as InputProblem};
use thermyo_files::number::short;
use thermyo_fit::Fitted;
use thermyo_fit::search::central_slopes;
use thermyo_scenario::preset::MusclePreset;
use thermyo_scenario::{Muscle, PlantKind, Scenario};
use thermyo_setup::{Loaded, highest_pa};

/// Residual, as a fraction of the largest force, above which the law does not hold \[-\].
const MOST_LEFT: f64 = 0.05;
/// Fraction of the prior's deviation above which the readings contribute little.
const LITTLE_TOLD: f64 = 0.7;
/// Standard errors below zero above which a negative friction is set to none.
const BACKWARDS: f64 = 3.0;
/// Correlation above which two parameters cannot be distinguished.
const INSEPARABLE: f64 = 0.95;
/// Share of the supply's gauge pressure up to which there is no remark: 6 bar of a supply of 7 bar \[-\].
const GAUGE_MARGIN: f64 = 1.02;
/// Ratio of the residuals as given to those with the ambient pressure subtracted from which on the pressures count as
/// absolute; with fewer than `FREE` readings more than parameters chance may do that \[-\].
const BETTER: f64 = 3.0;
const FREE: usize = 3;
/// Ratio of rest length or diameter to the scenario's from which on a unit is asked about: the diameter's prior spread,
/// and less than the ratio of any two units \[-\].
const UNLIKE: f64 = 2.7;
/// Grid of gauge pressures and lengths on which the law's deviation is computed.
const GRID: usize = 12;

/// Keys of the fitted values, in the order of the search.
const KEYS: [(&str, &str); 6] = [
    ("muscle.diameter_m", "m"),
    ("muscle.braid_angle_deg", "deg"),
    ("muscle.bladder_saturation_n", "N"),
    ("muscle.bladder_strain", ""),
    ("muscle.slack_m", "m"),
    ("friction.force_n", "N"),
];

/// Keys of the geometry: if these are open, the other values are meaningless.
const GEOMETRY: [&str; 2] = [KEYS[0].0, KEYS[1].0];

#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Left {
    /// Root mean square \[N\].
    pub force_n: f64,
    /// As a fraction of the largest force \[-\].
    pub share: f64,
    pub readings: usize,
}

/// `summary.json` of a static map.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Findings {
    pub holds: bool,
    /// Keys whose values went to a limit of the search.
    pub at_limit: Vec<&'static str>,
    /// Keys that the readings hardly determine: they stay near the scenario's values.
    pub open: Vec<&'static str>,
    pub parameters: BTreeMap<&'static str, Fitted>,
    pub rmse: Left,
    /// Residuals with the ambient pressure subtracted, where they show that the pressures are absolute.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub absolute: Option<Left>,
    /// Residuals of readings that the fit has not used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub against: Option<Left>,
    /// Stated deviation of the law's force within the measured range, mean and largest \[N\].
    pub law_sd_n: [f64; 2],
    /// Parameters that the readings do not determine, in words.
    pub remarks: Vec<String>,
}

#[derive(Debug)]
pub struct Identified {
    pub findings: Findings,
    pub scenario: Loaded,
    readings: Readings,
    /// Law minus reading \[N\].
    residuals_n: Vec<f64>,
}

/// Table of the readings to take, without forces; `config` names the scenario in messages.
///
/// # Errors
/// If the scenario is no muscle with a bladder that saturates, or its supply is too low for it to pull.
pub fn plan(loaded: &Loaded, config: &Path) -> Result<String, InputError> {
    let muscle = filling_muscle(loaded, config)?;
    let scenario = &loaded.plant;
    let Scenario { supply, sensor, ambient, .. } = scenario;
    let highest_pa = highest_pa(scenario) - ambient.pressure_pa;
    let stroke = surely_pulls(muscle, highest_pa);
    if stroke < LEAST_STROKE {
        let (key, value_pa) = if supply.pressure_pa < sensor.pressure.range_pa {
            ("supply.pressure_pa", supply.pressure_pa)
        } else {
            ("sensor.pressure.range_pa", sensor.pressure.range_pa)
        };
        let allowed = format!(
            "higher: the muscle surely pulls over {:.1} % of its length only, too little to tell its law",
            100.0 * stroke
        );
        return Err(refused(config, key, format!("{value_pa:?}"), &allowed));
    }
    let rest_m = muscle.rest_length_m;
    let places = places(muscle, highest_pa);
    Ok(places.iter().fold(COLUMNS.join(",") + "\n", |text, place| {
        let gauge_pa = (place.gauge_pressure_pa / 1000.0).round() * 1000.0;
        let length_m = (rest_m * (1.0 - place.contraction) * 1e4).round() / 1e4;
        text + &format!("{rest_m:?},{gauge_pa:?},{length_m:?},\n")
    }))
}

/// The scenario's muscle, if it has a bladder that saturates, which a static map can determine.
fn filling_muscle<'a>(loaded: &'a Loaded, config: &Path) -> Result<&'a Muscle, InputError> {
    let Scenario { plant, muscle, .. } = &loaded.plant;
    if plant.kind != PlantKind::Muscle {
        let kind = format!("{:?}", plant.kind.word());
        return Err(refused(config, "plant.kind", kind, "\"muscle\" for a static map"));
    }
    if muscle.bladder_saturation_n <= 0.0 {
        let allowed = "above 0 to start from, as in scenarios/static_map.toml";
        let value = format!("{:?}", muscle.bladder_saturation_n);
        return Err(refused(config, KEYS[2].0, value, allowed));
    }
    Ok(muscle)
}

fn refused(config: &Path, key: &str, value: String, allowed: &str) -> InputError {
    let (key, allowed) = (key.to_owned(), allowed.to_owned());
    InputError::file(config, InputProblem::NotAllowed { key, value, allowed })
}

/// Splits readings into the loaded ones nearest to the plan for this muscle, and the others.
pub fn planned(muscle: &Muscle, readings: &Readings) -> [Readings; 2] {
    let highest_pa = readings.loaded.iter().map(|r| r.gauge_pressure_pa).fold(0.0, f64::max);
    let mut others = readings.loaded.clone();
    let mut taken = Vec::new();
    for place in places(&Problem::new(readings, muscle).usual(), highest_pa) {
        let off = |reading: &Reading| {
            // A tenth of the length has the weight of the whole pressure range.
            (10.0 * (readings.contraction(reading) - place.contraction))
                .hypot((reading.gauge_pressure_pa - place.gauge_pressure_pa) / highest_pa)
        };
        let nearest =
            (0..others.len()).min_by(|a, b| off(&others[*a]).total_cmp(&off(&others[*b])));
        taken.extend(nearest.map(|i| others.remove(i)));
    }
    [taken, others].map(|loaded| Readings { loaded, ..readings.clone() })
}

/// Refuses too few loaded readings, and states where to repeat the slack ones.
fn enough(problem: &Problem, readings: &Readings, data: &Path) -> Result<(), InputError> {
    let found = readings.places();
    let missing = FEWEST.saturating_sub(found);
    if missing == 0 {
        return Ok(());
    }
    let mut what: Vec<String> = Vec::new();
    if found > 0 && !readings.slack.is_empty() {
        let place = problem.search().place;
        let muscle = problem.muscle(&place);
        // Readings that are almost loaded come first.
        let forces = problem.force_n(&place, &readings.slack);
        let mut slack: Vec<(f64, &Reading)> = forces.into_iter().zip(&readings.slack).collect();
        slack.sort_by(|(a, _), (b, _)| b.total_cmp(a));
        what.extend(slack.iter().take(missing).map(|(_, reading)| instead(&muscle, reading)));
    }
    if readings.loaded.len() > found {
        what.push("those at one pressure and length count as one".to_owned());
    }
    what.extend(copied(readings));
    if what.len() < missing {
        what.push("thermyo identify --plan lists useful ones".to_owned());
    }
    let why = what.join("; ");
    Err(InputError::file(data, InputProblem::TooFewLoaded { found, fewest: FEWEST, why }))
}

fn copied(readings: &Readings) -> Option<String> {
    let [[line, of], ..] = readings.copies[..] else { return None };
    let others = match readings.copies.len() - 1 {
        0 => String::new(),
        others => format!(", and so do {others} more"),
    };
    Some(format!("line {line} repeats line {of} to the last digit{others}: a copy counts once"))
}

/// Identifies the muscle from `readings`, and computes its residuals on `against`; `config` and `data` name the files
/// in messages.
///
/// # Errors
/// If the scenario is no muscle with a bladder that saturates, or there are too few readings.
pub fn identify(
    loaded: &Loaded,
    readings: Readings,
    against: Option<&Readings>,
    config: &Path,
    data: &Path,
) -> Result<Identified, InputError> {
    let problem = Problem::new(&readings, filling_muscle(loaded, config)?);
    enough(&problem, &readings, data)?;
    let end = problem.search();
    let place = &end.place;
    let covariance = problem.covariance(place);
    let deviation = |i: usize| covariance[(i, i)].sqrt();

    let found = problem.muscle(place);
    let largest_n = readings.largest_n();
    let friction_n = problem.friction_n(place);
    if let Some(friction_n) = friction_n.filter(|n| *n < -BACKWARDS * largest_n * deviation(5)) {
        return Err(InputError::file(data, InputProblem::Backwards { friction_n }));
    }
    let friction_n = friction_n.map(|n| if n > 0.0 { n } else { 0.0 });
    let values = [
        (found.diameter_m, found.diameter_m),
        (found.braid_angle_deg, 1.0_f64.to_degrees()),
        (found.bladder_saturation_n, found.bladder_saturation_n),
        (found.bladder_strain, found.bladder_strain),
        (found.slack_m, readings.rest_length_m),
        (friction_n.unwrap_or_default(), largest_n),
    ];
    let parameters = KEYS
        .iter()
        .zip(values)
        .take(place.len())
        .enumerate()
        .map(|(i, ((key, unit), (value, per)))| {
            let standard_error = (!Problem::at_limit(place, i)).then(|| per * deviation(i));
            (*key, Fitted { value, standard_error, unit })
        })
        .collect();
    let residuals_n = residuals_n(&problem, place, &readings);
    let rmse = Left::of(&residuals_n, largest_n);
    let limited = (0..place.len()).filter(|i| Problem::at_limit(place, *i));
    let mut findings = Findings {
        holds: false,
        at_limit: limited.map(|i| KEYS[i].0).collect(),
        open: hardly_determined(place, &covariance),
        parameters,
        against: against
            .map(|other| Left::of(&self::residuals_n(&problem, place, other), other.largest_n())),
        rmse,
        absolute: absolute(&readings, &loaded.plant, rmse, place.len()),
        law_sd_n: law_sd_n(&problem, place, &covariance, &readings),
        remarks: Vec::new(),
    };
    findings.holds = findings.failed().is_none();
    findings.remarks = remarks(&findings, &readings, place.len(), &covariance);
    findings.remarks.extend(on_scenario(&readings, &found, &loaded.plant));

    let mut scenario = loaded.clone();
    for configured in [&mut scenario.plant, &mut scenario.believed] {
        configured.muscle = Muscle { preset: MusclePreset::None, ..found.clone() };
        if let Some(friction_n) = friction_n {
            configured.friction.force_n = friction_n;
        }
    }
    Ok(Identified { findings, scenario, readings, residuals_n })
}

fn hardly_determined(
    place: &DVector<f64>,
    covariance: &nalgebra::DMatrix<f64>,
) -> Vec<&'static str> {
    let inside = (0..place.len()).filter(|i| !Problem::at_limit(place, *i));
    let little = inside.filter(|i| covariance[(*i, *i)].sqrt() > LITTLE_TOLD * Problem::spread(*i));
    little.map(|i| KEYS[i].0).collect()
}

fn residuals_n(problem: &Problem, place: &DVector<f64>, readings: &Readings) -> Vec<f64> {
    let forces = problem.force_n(place, &readings.loaded);
    forces
        .iter()
        .zip(&readings.loaded)
        .map(|(force_n, reading)| force_n - reading.force_n)
        .collect()
}

/// Mean and largest deviation over the measured lengths and pressures where the muscle pulls.
fn law_sd_n(
    problem: &Problem,
    place: &DVector<f64>,
    covariance: &nalgebra::DMatrix<f64>,
    readings: &Readings,
) -> [f64; 2] {
    let ends = |of: fn(&Reading) -> f64| {
        let values = || readings.loaded.iter().map(of);
        (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max))
    };
    let (pressures_pa, lengths_m) = (ends(|r| r.gauge_pressure_pa), ends(|r| r.length_m));
    let along = |(from, to): (f64, f64), i: usize| from + (to - from) * i as f64 / GRID as f64;
    let grid: Vec<Reading> = (0..(GRID + 1) * (GRID + 1))
        .map(|i| Reading {
            line: 0,
            gauge_pressure_pa: along(pressures_pa, i % (GRID + 1)),
            length_m: along(lengths_m, i / (GRID + 1)),
            force_n: 0.0,
            direction: 0.0,
        })
        .collect();
    let forces = |place: &DVector<f64>| DVector::from_vec(problem.force_n(place, &grid));
    let slopes = central_slopes(place, DIFFERENCE, |_| DIFFERENCE, forces);
    let pulls = forces(place);
    let deviations: Vec<f64> = (0..grid.len())
        .filter(|i| pulls[*i] > LOADED * readings.largest_n())
        .map(|i| (slopes.row(i) * covariance * slopes.row(i).transpose())[0].sqrt())
        .collect();
    let mean = deviations.iter().sum::<f64>() / deviations.len().max(1) as f64;
    [mean, deviations.iter().copied().fold(0.0, f64::max)]
}

/// Names the first gauge pressure that the scenario's supply cannot give: it may be absolute.
pub fn beyond_supply(readings: &Readings, scenario: &Scenario) -> Option<String> {
    let Scenario { supply, ambient, .. } = scenario;
    let most_pa = supply.pressure_pa - ambient.pressure_pa;
    let beyond = |reading: &&Reading| reading.gauge_pressure_pa > GAUGE_MARGIN * most_pa;
    let Reading { line, gauge_pressure_pa, .. } = readings.loaded.iter().find(beyond)?;
    Some(format!(
        "line {line}: a gauge pressure of {gauge_pressure_pa} Pa is above the {most_pa} Pa that supply.pressure_pa \
         gives: if the pressures are absolute, subtract the ambient one."
    ))
}

/// Residuals with the ambient pressure subtracted, if the law then leaves far less than `rmse`.
fn absolute(readings: &Readings, scenario: &Scenario, rmse: Left, unknowns: usize) -> Option<Left> {
    let ambient_pa = scenario.ambient.pressure_pa;
    let less = |readings: &[Reading]| -> Option<Vec<Reading>> {
        let gauge = |reading: &Reading| {
            let gauge_pressure_pa = reading.gauge_pressure_pa - ambient_pa;
            (gauge_pressure_pa >= 0.0).then_some(Reading { gauge_pressure_pa, ..*reading })
        };
        readings.iter().map(gauge).collect()
    };
    let loaded = less(&readings.loaded).filter(|loaded| loaded.len() >= unknowns + FREE)?;
    let readings = Readings { loaded, ..readings.clone() };
    let problem = Problem::new(&readings, &scenario.muscle);
    let left = residuals_n(&problem, &problem.search().place, &readings);
    let left = Left::of(&left, readings.largest_n());
    (rmse.force_n > BETTER * left.force_n).then_some(left)
}

/// Asks about the units of a muscle that is far longer, shorter, wider or narrower than the scenario's.
fn unlike(found: &Muscle, given: &Muscle) -> Option<String> {
    let sizes = [
        ("rest_length_m", found.rest_length_m, given.rest_length_m, "the lengths in m"),
        ("diameter_m", found.diameter_m, given.diameter_m, "the forces in N"),
    ];
    let far = |(_, own, usual, _): &(&str, f64, f64, &str)| {
        !(1.0 / UNLIKE..UNLIKE).contains(&(own / usual))
    };
    let (key, own_m, usual_m, unit) = sizes.into_iter().find(far)?;
    Some(format!(
        "muscle.{key} = {} is far from the scenario's {}: are {unit}?",
        short(own_m),
        short(usual_m)
    ))
}

fn on_scenario(readings: &Readings, found: &Muscle, scenario: &Scenario) -> Vec<String> {
    let remarks = [beyond_supply(readings, scenario), unlike(found, &scenario.muscle)];
    remarks.into_iter().flatten().collect()
}

fn remarks(
    findings: &Findings,
    readings: &Readings,
    count: usize,
    covariance: &nalgebra::DMatrix<f64>,
) -> Vec<String> {
    let mut remarks: Vec<String> = findings.failed().into_iter().collect();
    for (i, (key, _)) in KEYS.iter().enumerate().take(count) {
        if findings.at_limit.contains(key) {
            // The geometry has its own remark above.
            if !GEOMETRY.contains(key) {
                remarks.push(format!("{key} went to a limit of the search."));
            }
        } else if findings.open.contains(key) && !GEOMETRY.contains(key) {
            remarks.push(format!(
                "The readings hardly determine {key}: it stays near the scenario's value."
            ));
        }
        for (j, (other, _)) in KEYS.iter().enumerate().take(count).skip(i + 1) {
            let correlation = covariance[(i, j)] / (covariance[(i, i)] * covariance[(j, j)]).sqrt();
            if correlation.abs() > INSEPARABLE {
                remarks.push(format!(
                    "{key} and {other} cannot be distinguished (correlation {correlation:.3}): the force is \
                     known better than either."
                ));
            }
        }
    }
    remarks.extend(copied(readings).map(|copied| format!("{copied}.")));
    if !readings.go_both_ways() {
        remarks.push(
            "Friction is not found: that takes readings come to by contracting (column direction, 1) and by \
             lengthening (-1)."
                .to_owned(),
        );
    }
    let extremes = readings.loaded.iter().map(|reading| readings.contraction(reading));
    let deepest = extremes.fold(0.0, f64::max);
    remarks.push(format!(
        "No reading beyond a contraction of {:.0} %: there the law is a guess.",
        100.0 * deepest
    ));
    remarks
}

impl Left {
    fn of(residuals_n: &[f64], largest_n: f64) -> Self {
        let readings = residuals_n.len();
        let squares: f64 = residuals_n.iter().map(|residual_n| residual_n * residual_n).sum();
        let force_n = (squares / readings.max(1) as f64).sqrt();
        Self { force_n, share: force_n / largest_n, readings }
    }

    fn text(&self) -> String {
        let Self { force_n, share, readings } = self;
        let noun = if *readings == 1 { "reading" } else { "readings" };
        format!("{force_n:.2} N RMS, {:.1} % of the largest, {readings} {noun}", 100.0 * share)
    }
}

impl Findings {
    /// Reason why the values are not reliable, if there is one.
    pub fn failed(&self) -> Option<String> {
        let wrong = "another rest length, another unit, or a reading that is wrong";
        let limited: Vec<&str> =
            GEOMETRY.into_iter().filter(|key| self.at_limit.contains(key)).collect();
        if !limited.is_empty() {
            let keys = limited.join(" and ");
            return Some(format!("{keys} went to a limit of the search: {wrong}."));
        }
        let open: Vec<&str> = GEOMETRY.into_iter().filter(|key| self.open.contains(key)).collect();
        if !open.is_empty() {
            return Some(format!(
                "The readings hardly determine {}, near the scenario's value: thermyo identify --plan lists readings \
                 that do.",
                open.join(" and ")
            ));
        }
        if let Some(left) = &self.absolute {
            return Some(format!(
                "The law leaves {:.2} N, and {:.2} N with the ambient pressure subtracted: these are absolute \
                 pressures, not gauge.",
                self.rmse.force_n, left.force_n
            ));
        }
        let percent = 100.0 * self.rmse.share;
        (self.rmse.share > MOST_LEFT).then(|| {
            format!(
                "The law leaves {percent:.0} % of the largest force: another kind of muscle, {wrong}."
            )
        })
    }

    /// Figures as lines for a terminal.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for (path, fitted) in &self.parameters {
            text += &fitted.line(path);
        }
        text += &format!("fitted: {}\n", self.rmse.text());
        if let Some(against) = &self.against {
            text += &format!("against: {}\n", against.text());
        }
        let [mean_n, worst_n] = self.law_sd_n;
        text += &format!("stated deviation of the law: {mean_n:.1} N, at most {worst_n:.1} N\n");
        self.remarks.iter().fold(text, |text, remark| text + remark + "\n")
    }
}
