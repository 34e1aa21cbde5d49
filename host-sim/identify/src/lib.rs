//! `thermyo identify`: parameters that cannot be measured directly, from a recorded trace.
//!
//! ```text
//! CSV --data--> columns, recorded inputs --simulate--> predictions
//! scenario's [identify] --parameter--> search variables --fit--> values --uncertainty--> errors
//! ```
//!
//! The plant is driven by the recorded mass flows or duties, by the recorded volume of a piston, or by the scenario's
//! drive. A muscle is the lumped plant (or the paper's); if only its gas sensor is compared, it is the core's own
//! model, driven by the recorded pressure and length. A scenario with the model `full` gets the core's effective
//! parameters.
//!
//! A record with stops, during which both valves are shut for seconds, contains the gas temperature: see
//! [`thermyo_fit::stops`]. A table without time that has gauge pressure, length and force at rest is a static map: see
//! [`static_map`].

mod balance;
mod consider;
pub mod core_model;
mod data;
mod findings;
mod fit;
pub mod motion;
mod otherwise;
mod page;
mod parameter;
mod record;
mod simulate;
pub mod static_map;
mod uncertainty;
mod valves;

pub use data::Data;
pub use findings::Findings;
pub use page::page;
pub use record::{Found, identify_table, known_columns};

use balance::Failed;
use data::Input;
use findings::Rmse;
use fit::{End, Problem};
use nalgebra::{DMatrix, DVector};
use parameter::Parameter;
use simulate::Experiment;
use std::path::Path;
use thermyo_compute::parallel::Watch;
use thermyo_files::input::{InputError, Problem as InputProblem};
use thermyo_plant::{BuildError, Diverged};
use thermyo_record::measured::Measured;
use thermyo_scenario::schema;
use thermyo_scenario::schema::fittable;
use thermyo_scenario::{HeatModel, PlantModel, Scenario, number, with_numbers};
use thermyo_setup::Loaded;
use thermyo_setup::core_config::Effective;
use uncertainty::{Misfit, covariance};

/// Share of a jet's stirring that acts on the mean of the gas in a model of one zone: fresh gas, at the wall's
/// temperature, fills the stirred part. Identified on the plant `full`.
const STIRRING: f64 = 0.5;
/// Relative difference of the sums of squares up to which two searches ended at the same point.
const SAME_COST: f64 = 1e-3;
/// RMS weighted residual of a search that matches a record without noise \[-\].
const EXACT: f64 = 1e-6;
/// Difference of a parameter, in standard errors, up to which two searches agree.
const SAME_PLACE: f64 = 0.5;
/// Step of the differences in ln x that propagate the uncertainty to the gas mass.
const MASS_DIFFERENCE: f64 = 1e-4;

#[derive(Debug, thiserror::Error)]
pub enum IdentifyError {
    #[error(transparent)]
    Input(#[from] InputError),
    #[error("{0}")]
    Build(BuildError),
    #[error("with the scenario's own values, {0}")]
    Diverged(Diverged),
    /// Stopped by its watch; contains the results of the finished searches.
    #[error("stopped after {finished} of {starts} searches")]
    Stopped {
        finished: usize,
        starts: u64,
        /// Table with a row per finished search: cost, convergence, values.
        csv: String,
    },
}

/// Fits the parameters in the scenario of `config` to `measured`, which was read from `data_file`. Each start of the
/// search is a part of the progress in `watch`.
///
/// # Errors
/// [`IdentifyError`]. A search that does not converge is no error: see [`Findings::failed`].
pub fn identify(
    loaded: &Loaded,
    config: &Path,
    measured: &Measured,
    data_file: &Path,
    watch: &dyn Watch,
) -> Result<Identified, IdentifyError> {
    let parameters = named(loaded, config)?;
    let data = Data::new(measured, data_file, &loaded.plant)?;
    constant_where_given(loaded, config, &data)?;
    let from_data = data.volume.is_some();
    let data = data.with_volume(loaded);
    let scenario = comparable(&loaded.plant, &data);
    let problem = Problem {
        scenario: &scenario,
        parameters: &parameters,
        data: &data,
        experiment: Experiment::new(&data, &scenario),
        watch,
    };
    let without = |failed: Failed, ends: &[End]| match failed {
        Failed::Build(error) => IdentifyError::Build(error),
        Failed::Diverged(error) => IdentifyError::Diverged(error),
        Failed::Stopped => stopped(&problem, ends),
    };
    let own = DVector::from_vec(parameters.iter().map(|own| own.place(own.given)).collect());
    // A mistake in the scenario is reported as such, not as a failed search.
    problem.residuals(&own).map_err(|failed| without(failed, &[]))?;

    let ends = problem.search();
    if watch.stopped() {
        return Err(stopped(&problem, &ends));
    }
    let best = best(&ends);
    let residuals = problem.residuals(&best.place).map_err(|failed| without(failed, &ends))?;
    let residuals = by_column(&data, &residuals);
    let misfits = misfits(&data, &residuals, parameters.len());
    let covariance = covariance_inside(&problem, &best.place, &misfits);
    if watch.stopped() {
        // The predictions behind the differences ended early.
        return Err(stopped(&problem, &ends));
    }
    let findings = Findings::new(findings::Parts {
        parameters: &parameters,
        data: &data,
        best,
        ends: &ends,
        agreeing: agreeing(&ends, best, &parameters, covariance.as_ref(), data.values()),
        misfits: &misfits,
        covariance: covariance.as_ref(),
        mass: gas_mass(&problem, &best.place, covariance.as_ref()),
        otherwise: otherwise::found(&problem, best),
    });
    let found = parameters.iter().zip(best.place.iter());
    let values: Vec<(&str, f64)> =
        found.map(|(parameter, u)| (parameter.path.as_str(), parameter.value(*u))).collect();
    let scenario = adopted(loaded, &data, &values, from_data.then_some(data_file));
    let fitted = Box::new(problem.scenario_at(&best.place));
    Ok(Identified { findings, scenario, fitted, data, residuals })
}

/// With pressure and length as inputs, the core's model replaces the flow, with one constant coefficient.
fn constant_where_given(loaded: &Loaded, config: &Path, data: &Data) -> Result<(), InputError> {
    let given = matches!(data.input, Input::Given(_));
    if !given || loaded.plant.heat.model != HeatModel::Correlation {
        return Ok(());
    }
    let why = "heat.model = \"correlation\": pressure and length stand for the flow with heat.model = \"constant\" only, \
               which fits one coefficient to all of the motion; for the laws of air take stops, with \
               thermyo measure stop";
    Err(InputError::file(config, InputProblem::Unusable(why.to_owned())))
}

fn named(loaded: &Loaded, config: &Path) -> Result<Vec<Parameter>, InputError> {
    let parameters = Parameter::all(&loaded.plant);
    if parameters.is_empty() {
        let problem = InputProblem::Missing {
            key: "identify.parameters".to_owned(),
            why: "it names what is fitted, such as [\"heat.scale\"], unless both valves are shut at least three times, for 5 s \
                  or more".to_owned(),
        };
        return Err(InputError::file(config, problem));
    }
    Ok(parameters)
}

/// Misfits of the columns for this number of fitted parameters.
fn misfits(data: &Data, residuals: &[Vec<f64>], parameters: usize) -> Vec<Misfit> {
    let freedom = 1.0 - parameters as f64 / data.values() as f64;
    let compared = residuals.iter().zip(&data.observed);
    compared.map(|(own, observed)| Misfit::new(own, observed.deviation, freedom)).collect()
}

fn by_column(data: &Data, residuals: &[f64]) -> Vec<Vec<f64>> {
    let mut left = residuals.iter().copied();
    let mut take = |count| left.by_ref().take(count).collect();
    data.observed.iter().map(|observed| take(observed.points.len())).collect()
}

#[derive(Debug)]
pub struct Identified {
    pub findings: Findings,
    pub scenario: Loaded,
    /// Scenario of the plant that was compared, with the values found.
    fitted: Box<Scenario>,
    data: Data,
    /// Prediction minus measurement, by measured column.
    residuals: Vec<Vec<f64>>,
}

impl Identified {
    /// Computes the residuals of a record that the fit has not used. A plant that cannot follow it
    /// is a remark: the values found are kept.
    fn compare(&mut self, other: &Data, watch: &dyn Watch) {
        let residuals = match Experiment::new(other, &self.fitted).predict(&self.fitted, watch) {
            Ok(predicted) => other.less_measured(predicted),
            Err(failed) => {
                let remark = format!("The record to compare with is not followed: {failed}.");
                self.findings.remarks.push(remark);
                return;
            }
        };
        let misfits = misfits(other, &by_column(other, &residuals), 0);
        self.findings.against = Some(Rmse::new(&other.observed, &misfits));
    }
}

/// Whether the compared plant is built from a scenario with zones.
fn in_zones(scenario: &Scenario, data: &Data) -> bool {
    scenario.moves_in_full() && !matches!(data.input, Input::Given(_))
}

/// Scenario of the plant to compare with measurements, see the module's text.
fn comparable(scenario: &Scenario, data: &Data) -> Scenario {
    let mut scenario = scenario.clone();
    if in_zones(&scenario, data) {
        // Effective parameters, as the core uses them.
        let effective = Effective::of(&scenario);
        scenario.plant.model = PlantModel::Lumped;
        let path = dead_volume(&scenario);
        let dead_m3 = number(&scenario, &path).unwrap_or_default() + effective.tube_m3;
        scenario = with_numbers(&scenario, [(path.as_str(), dead_m3)]);
        scenario.heat.inner_per_flow *= STIRRING;
        scenario.wall.heat_capacity_j_k *= effective.wall;
        let lag_s = &mut scenario.sensor.gas.time_constant_s;
        *lag_s += effective.housing_s;
    }
    scenario
}

/// Key of the dead volume.
fn dead_volume(scenario: &Scenario) -> String {
    format!("{}.dead_volume_m3", scenario.plant.kind.word())
}

/// The scenario with the fitted values, for the core too. For `full` they are effective values of
/// the core's own model: only the core's configuration changes.
fn adopted(
    loaded: &Loaded,
    data: &Data,
    values: &[(&str, f64)],
    volume_csv: Option<&Path>,
) -> Loaded {
    let mut adopted = loaded.clone();
    let full = loaded.plant.moves_in_full();
    let configured = |path: &str| {
        fittable(path).is_some()
            && schema::key(path).is_some_and(|(table, _)| !full || table.believed)
    };
    let effective = Effective::of(&loaded.plant);
    let backwards = in_zones(&loaded.plant, data);
    let dead_volume = dead_volume(&loaded.plant);
    let values = values.iter().filter(|(path, _)| configured(path)).map(|(path, value)| {
        if !backwards {
            return (*path, *value);
        }
        // Inverts the conversion from a muscle in zones to the core's configuration.
        let value = match *path {
            path if path == dead_volume => value - effective.tube_m3,
            "heat.inner_per_flow" => value / STIRRING,
            "wall.heat_capacity_j_k" => value / effective.wall,
            "sensor.gas.time_constant_s" => value - effective.housing_s,
            _ => *value,
        };
        (*path, value.max(0.0))
    });
    let values: Vec<_> = values.collect();
    adopted.believed = with_numbers(&loaded.believed, values.iter().copied());
    if !full {
        adopted.plant = with_numbers(&loaded.plant, values);
    }
    if let Some(path) = volume_csv {
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
        adopted.plant.vessel.volume_csv = Some(path.clone());
        adopted.believed.vessel.volume_csv = Some(path);
    }
    adopted
}

/// Results of the finished searches.
fn stopped(problem: &Problem, ends: &[End]) -> IdentifyError {
    let paths: Vec<&str> = problem.parameters.iter().map(|p| p.path.as_str()).collect();
    let mut csv = format!("cost,converged,{}\n", paths.join(","));
    for end in ends {
        let values = problem.parameters.iter().zip(end.place.iter());
        let values: Vec<String> = values.map(|(p, u)| format!("{:?}", p.value(*u))).collect();
        csv += &format!("{:?},{},{}\n", end.cost, u8::from(end.converged), values.join(","));
    }
    let starts = problem.scenario.identify.starts;
    IdentifyError::Stopped { finished: ends.len(), starts, csv }
}

/// The search with the lowest cost; a converged one if there is any.
fn best(ends: &[End]) -> &End {
    let order = |end: &&End| (!end.converged, end.cost);
    ends.iter()
        .min_by(|a, b| {
            let ((a_open, a_cost), (b_open, b_cost)) = (order(a), order(b));
            a_open.cmp(&b_open).then(a_cost.total_cmp(&b_cost))
        })
        .expect("there is at least one start")
}

/// Covariance of the logarithms; parameters at a limit are held, and their rows are zero.
fn covariance_inside(
    problem: &Problem,
    place: &DVector<f64>,
    misfits: &[Misfit],
) -> Option<DMatrix<f64>> {
    let count = place.len();
    let inside: Vec<usize> =
        (0..count).filter(|i| !problem.parameters[*i].at_limit(place[*i])).collect();
    let sensitivities = problem.sensitivities(place).select_columns(&inside);
    let reduced = covariance(&sensitivities, &problem.data.observed, misfits)?;
    let reduced = consider::widened(problem, place, &sensitivities, reduced);
    let mut full = DMatrix::zeros(count, count);
    for (row, i) in inside.iter().enumerate() {
        for (column, j) in inside.iter().enumerate() {
            full[(*i, *j)] = reduced[(row, column)];
        }
    }
    Some(full)
}

/// Number of searches that ended where the best one did.
fn agreeing(
    ends: &[End],
    best: &End,
    parameters: &[Parameter],
    covariance: Option<&DMatrix<f64>>,
    values: usize,
) -> usize {
    let exact = EXACT * EXACT * values as f64;
    let near = |end: &&End| {
        let same_cost = end.cost <= (best.cost * (1.0 + SAME_COST)).max(exact);
        let same_place = parameters.iter().enumerate().all(|(i, parameter)| {
            if parameter.at_limit(end.place[i]) && parameter.at_limit(best.place[i]) {
                return end.place[i].signum() == best.place[i].signum();
            }
            let difference = parameter.value(end.place[i]) / parameter.value(best.place[i]);
            let error = covariance.map_or(0.0, |covariance| covariance[(i, i)].sqrt());
            difference.ln().abs() <= (SAME_PLACE * error).max(SAME_COST)
        });
        end.converged && same_cost && same_place
    };
    ends.iter().filter(near).count()
}

/// Gas mass at the start \[kg\] and its standard error, if a fitted parameter determines it.
fn gas_mass(
    problem: &Problem,
    place: &DVector<f64>,
    covariance: Option<&DMatrix<f64>>,
) -> Option<(f64, Option<f64>)> {
    let mass = |place: &DVector<f64>| {
        let scenario = problem.scenario_at(place);
        let plant = thermyo_plant::build(&scenario, problem.data.volume.clone()).ok()?;
        Some(plant.truth().mass_kg)
    };
    let found = mass(place)?;
    let mut gradient = DVector::zeros(place.len());
    for (i, parameter) in problem.parameters.iter().enumerate() {
        let mut shifted = place.clone();
        shifted[i] += MASS_DIFFERENCE / parameter.slope(place[i]);
        gradient[i] = (mass(&shifted)? - found) / MASS_DIFFERENCE;
    }
    if gradient.norm() <= 1e-9 * found {
        return None;
    }
    let variance = |covariance: &DMatrix<f64>| (gradient.transpose() * covariance * &gradient)[0];
    Some((found, covariance.map(|covariance| variance(covariance).sqrt())))
}
